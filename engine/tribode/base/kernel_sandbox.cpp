#include "tribode/base/kernel_sandbox.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <fcntl.h>
#include <fstream>
#include <link.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sstream>
#include <string>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace tribode {

namespace fs = std::filesystem;

namespace {

// ---- files: Landlock, as linux/landlock.h has it, which older systems lack ----------------------------------------

#ifndef SYS_landlock_create_ruleset
constexpr long SYS_landlock_create_ruleset = 444, SYS_landlock_add_rule = 445, SYS_landlock_restrict_self = 446;
#endif

enum Access : std::uint64_t {
    execute = 1u << 0,
    write_file = 1u << 1,
    read_file = 1u << 2,
    read_dir = 1u << 3,
    remove_dir = 1u << 4,
    remove_file = 1u << 5,
    make_char = 1u << 6,
    make_dir = 1u << 7,
    make_reg = 1u << 8,
    make_sock = 1u << 9,
    make_fifo = 1u << 10,
    make_block = 1u << 11,
    make_sym = 1u << 12,
    refer = 1u << 13,    // from version 2 on; without it no file could be moved to another folder
    truncate = 1u << 14, // from version 3 on
};
constexpr std::uint64_t reading = read_file | read_dir;
constexpr std::uint64_t writing =
    reading | write_file | remove_dir | remove_file | make_dir | make_reg | refer | truncate;
constexpr std::uint64_t of_a_file = execute | write_file | read_file | truncate;

struct RulesetAttributes {
    std::uint64_t files = 0;
};
struct [[gnu::packed]] PathRule {
    std::uint64_t allowed = 0;
    std::int32_t parent = -1;
};
constexpr std::uint32_t version_flag = 1, path_rule = 1;

class Ruleset {
  public:
    explicit Ruleset(long version) {
        handled_ = (std::uint64_t{refer} << 1) - 1;
        if (version >= 3) handled_ |= truncate;
        const RulesetAttributes attributes{handled_};
        number_ = static_cast<int>(::syscall(SYS_landlock_create_ruleset, &attributes, sizeof attributes, 0));
    }
    ~Ruleset() {
        if (number_ >= 0) ::close(number_);
    }
    Ruleset(const Ruleset&) = delete;
    Ruleset& operator=(const Ruleset&) = delete;

    void allow(const fs::path& path, std::uint64_t access) const {
        const int place = ::open(path.c_str(), O_PATH | O_CLOEXEC);
        if (place < 0) return;
        struct stat about {};
        const bool known = ::fstat(place, &about) == 0;
        if (known && !S_ISDIR(about.st_mode)) access &= of_a_file;
        const PathRule rule{access & handled_, place};
        if (known) ::syscall(SYS_landlock_add_rule, number_, path_rule, &rule, 0);
        ::close(place);
    }

    bool enforce() const { return number_ >= 0 && ::syscall(SYS_landlock_restrict_self, number_, 0) == 0; }
    bool exists() const { return number_ >= 0; }

  private:
    std::uint64_t handled_ = 0;
    int number_ = -1;
};

// Where programs and what they need lie.
constexpr std::array program_folders = {"/usr", "/bin", "/opt", "/nix/store", "/gnu/store"};

// A folder of the user, as the XDG Base Directory Specification finds it; empty where there is none.
fs::path in_home(const char* variable, const char* beside_home) {
    const auto set = [](const char* name) {
        const char* value = std::getenv(name);
        return value && *value == '/' ? fs::path(value) : fs::path();
    };
    if (fs::path own = set(variable); !own.empty()) return own;
    const fs::path home = set("HOME");
    return home.empty() ? fs::path() : home / beside_home;
}

void allow_system(const Ruleset& rules) {
    for (const char* folder :
         {"/usr", "/lib", "/lib32", "/lib64", "/bin", "/opt", "/nix/store", "/gnu/store", "/proc", "/etc/ld.so.cache",
          "/etc/ld.so.preload", "/etc/alternatives", "/etc/fonts", "/etc/localtime", "/etc/ssl/openssl.cnf",
          "/etc/locale.alias", "/var/cache/fontconfig", "/sys/devices/system"}) {
        rules.allow(folder, reading);
    }
    for (const char* device : {"/dev/null", "/dev/zero", "/dev/full", "/dev/tty"})
        rules.allow(device, reading | write_file);
    for (const char* device : {"/dev/urandom", "/dev/random"}) rules.allow(device, reading);
    for (const auto& [variable, folder] : {std::pair{"XDG_CACHE_HOME", ".cache"}, {"XDG_CONFIG_HOME", ".config"}}) {
        rules.allow(in_home(variable, folder) / "fontconfig", reading);
    }
    rules.allow(in_home("XDG_DATA_HOME", ".local/share") / "fonts", reading);
    rules.allow(in_home("HOME", "") / ".fonts", reading);
}

// What the kernel starts a program of the system by: the same as this one.
fs::path loader_of_programs() {
    std::string loader;
    ::dl_iterate_phdr(
        [](dl_phdr_info* info, std::size_t, void* found) {
            for (int i = 0; i < info->dlpi_phnum; ++i) {
                const auto& part = info->dlpi_phdr[i];
                if (part.p_type != PT_INTERP) continue;
                *static_cast<std::string*>(found) = reinterpret_cast<const char*>(info->dlpi_addr + part.p_vaddr);
            }
            return 1; // the first is this program
        },
        &loader);
    return loader;
}

bool confine_files(const KernelSandbox& sandbox) {
    const long version = ::syscall(SYS_landlock_create_ruleset, nullptr, 0, version_flag);
    if (version < 2) return false; // moving a file to another folder would fail
    const Ruleset rules(version);
    if (!rules.exists()) return false;
    allow_system(rules);
    for (const auto& path : sandbox.read) rules.allow(path, reading);
    for (const auto& path : sandbox.write) rules.allow(path, writing);
    for (const auto& path : sandbox.execute) rules.allow(path, reading | execute);
    if (!sandbox.execute.empty()) rules.allow(loader_of_programs(), reading | execute);
    return rules.enforce();
}

// ---- system calls: seccomp -----------------------------------------------------------------------------------------

#if defined(__x86_64__)
constexpr std::uint32_t architecture = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
constexpr std::uint32_t architecture = AUDIT_ARCH_AARCH64;
#else
constexpr std::uint32_t architecture = 0; // none that is known here
#endif

// Sockets, the memory of other processes (ptrace is Landlock's), programs in the kernel, rings of calls that no filter sees, other name spaces.
constexpr std::array refused_calls = {SYS_socket,
                                      SYS_socketpair,
                                      SYS_connect,
                                      SYS_bind,

                                      SYS_process_vm_readv,
                                      SYS_process_vm_writev,
                                      SYS_bpf,
                                      SYS_perf_event_open,
                                      SYS_unshare,
                                      SYS_setns,
                                      SYS_mount,
                                      SYS_umount2,
                                      SYS_keyctl,
                                      SYS_add_key,
                                      SYS_request_key,
                                      SYS_userfaultfd,
                                      SYS_io_uring_setup,
                                      SYS_open_by_handle_at};

void confine_calls() {
    if (architecture == 0) return;
    const auto statement = [](unsigned code, std::uint32_t value) {
        return sock_filter{static_cast<std::uint16_t>(code), 0, 0, value};
    };
    // Jumps over `if_not` statements where the condition does not hold.
    const auto unless = [](unsigned code, std::uint32_t value, std::uint8_t if_not) {
        return sock_filter{static_cast<std::uint16_t>(BPF_JMP | code | BPF_K), 0, if_not, value};
    };
    const std::uint32_t refuse = SECCOMP_RET_ERRNO | EACCES;
    std::vector<sock_filter> program = {
        statement(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, arch)),
        sock_filter{static_cast<std::uint16_t>(BPF_JMP | BPF_JEQ | BPF_K), 1, 0, architecture},
        statement(BPF_RET | BPF_K, refuse), // calls of another kind of processor have other numbers
        statement(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
    };
#if defined(__x86_64__)
    constexpr std::uint32_t x32_calls = 0x40000000;
    program.push_back(unless(BPF_JGE, x32_calls, 1));
    program.push_back(statement(BPF_RET | BPF_K, refuse));
#endif
    for (const long call : refused_calls) {
        program.push_back(unless(BPF_JEQ, static_cast<std::uint32_t>(call), 1));
        program.push_back(statement(BPF_RET | BPF_K, refuse));
    }
    program.push_back(statement(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
    const sock_fprog filter{static_cast<unsigned short>(program.size()), program.data()};
    ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter);
}

} // namespace

void KernelSandbox::allow_program(const std::string& name) {
    const char* folders = std::getenv("PATH");
    std::istringstream rest(folders ? folders : "/usr/bin:/bin");
    for (std::string folder; std::getline(rest, folder, ':');) {
        const fs::path file = fs::path(folder) / name;
        if (::access(file.c_str(), X_OK) != 0 || fs::is_directory(file)) continue;
        execute.push_back(file);
        // A script that starts the program needs its shell and what else it may call.
        char begin[2] = {};
        std::ifstream(file, std::ios::binary).read(begin, sizeof begin);
        if (begin[0] == '#' && begin[1] == '!')
            execute.insert(execute.end(), program_folders.begin(), program_folders.end());
        return;
    }
}

void KernelSandbox::allow_output(const fs::path& path) {
    std::error_code problem;
    fs::path place = fs::weakly_canonical(fs::absolute(path), problem);
    if (problem) return;
    write.push_back(place); // a device, a pipe or a folder
    while (place.has_relative_path() && !fs::is_directory(place, problem)) place = place.parent_path();
    write.push_back(place);
}

bool KernelSandbox::enter() const {
    if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return false;
    const bool confined = confine_files(*this);
    confine_calls();
    return confined;
}

void limit_process(std::size_t memory_bytes, std::size_t cpu_seconds) {
    const auto limit = [](auto resource, rlim_t soft, rlim_t hard) {
        rlimit now{};
        if (::getrlimit(resource, &now) != 0) return;
        const rlimit wanted{std::min(soft, now.rlim_cur), std::min(hard, now.rlim_max)};
        ::setrlimit(resource, &wanted);
    };
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    memory_bytes = 0; // a sanitizer keeps terabytes of shadow memory
#endif
    if (memory_bytes > 0) limit(RLIMIT_DATA, memory_bytes, memory_bytes);
    constexpr rlim_t grace = 5; // to write what is known so far
    if (cpu_seconds > 0) limit(RLIMIT_CPU, cpu_seconds, cpu_seconds + grace);
}

} // namespace tribode
