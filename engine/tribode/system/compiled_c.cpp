#include "tribode/system/compiled_c.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <dlfcn.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <fstream>
#include <spawn.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/utsname.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

namespace tribode {

namespace fs = std::filesystem;

namespace {

// Every operation is rounded by itself, and the functions are those of the library that the engine calls.
constexpr std::array flags = {"-O2", "-std=c99", "-shared", "-fPIC", "-ffp-contract=off", "-fno-builtin"};

// Makes the folder where it is missing.
void require_own(const fs::path& folder) {
    std::error_code problem;
    fs::create_directories(folder.parent_path(), problem);
    ::mkdir(folder.c_str(), S_IRWXU); // what is wrong shows below
    struct stat status {};
    if (::stat(folder.c_str(), &status) != 0 || !S_ISDIR(status.st_mode)) {
        throw Error(fmt::format("{}: this folder for compiled equations cannot be made", folder.string()));
    }
    if (status.st_uid != ::geteuid() || (status.st_mode & (S_IWGRP | S_IWOTH)) != 0) {
        throw Error(fmt::format("{}: this folder for compiled equations must belong to this user, and none else may "
                                "write there",
                                folder.string()));
    }
}

std::string key_of(const std::string& command, const std::string& text) {
    struct utsname machine {};
    ::uname(&machine);
    std::string all = fmt::format("{}\n{} {}\n", command, machine.sysname, machine.machine);
    for (const char* flag : flags) all += fmt::format("{} ", flag);
    return sha256(all + "\n" + text);
}

// The first line of what a program has said.
std::string first_line(const fs::path& file) {
    std::ifstream in(file);
    std::string line;
    std::getline(in, line);
    return line;
}

// Standard error goes to `messages`. Returns the exit status.
int run(const std::vector<std::string>& command, const fs::path& messages) {
    std::vector<char*> arguments;
    for (const auto& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, messages.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    pid_t child = 0;
    const int failure = posix_spawnp(&child, arguments[0], &actions, nullptr, arguments.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    if (failure != 0) {
        throw Error(fmt::format("there is no C compiler {}: {}", command[0], std::strerror(failure)));
    }
    int status = 0;
    while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    return status;
}

// Held on the cache by one process, or thread, at a time.
class Lock {
  public:
    explicit Lock(const fs::path& folder) : file_(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
        while (file_ >= 0 && ::flock(file_, LOCK_EX) != 0 && errno == EINTR) {
        }
    }
    ~Lock() {
        if (file_ >= 0) ::close(file_);
    }
    Lock(const Lock&) = delete;
    Lock& operator=(const Lock&) = delete;

  private:
    int file_;
};

// Files beside the one to be made, of this attempt alone; removed at the end.
struct Attempt {
    fs::path text, object, messages;

    explicit Attempt(const fs::path& file) {
        static std::atomic<unsigned> count{0};
        const std::string name = fmt::format("{}.{}.{}", file.string(), ::getpid(), count++);
        text = name + ".c";
        object = name + ".so";
        messages = name + ".txt";
    }
    ~Attempt() {
        std::error_code ignored;
        for (const auto& file : {text, object, messages}) fs::remove(file, ignored);
    }
    Attempt(const Attempt&) = delete;
    Attempt& operator=(const Attempt&) = delete;
};

void compile(const std::string& command, const std::string& text, const fs::path& file) {
    const Attempt attempt(file);
    std::ofstream(attempt.text) << text;
    std::vector<std::string> line = {command};
    line.insert(line.end(), flags.begin(), flags.end());
    for (const auto& word : {std::string("-o"), attempt.object.string(), attempt.text.string(), std::string("-lm")}) {
        line.push_back(word);
    }
    if (run(line, attempt.messages) != 0) {
        throw Error(fmt::format("the C compiler {} fails: {}", command, first_line(attempt.messages)));
    }
    // Whoever looks for the file finds none, or all of it.
    std::error_code problem;
    fs::rename(attempt.object, file, problem);
    if (problem) throw Error(fmt::format("{}: cannot be written: {}", file.string(), problem.message()));
}

} // namespace

fs::path CCompiler::usual_cache() {
    const auto set = [](const char* name) {
        const char* value = std::getenv(name);
        return value && *value == '/' ? fs::path(value) : fs::path();
    };
    if (const fs::path cache = set("XDG_CACHE_HOME"); !cache.empty()) return cache / "tribode";
    if (const fs::path home = set("HOME"); !home.empty()) return home / ".cache" / "tribode";
    throw Error("compiled equations need a folder: neither XDG_CACHE_HOME nor HOME is set");
}

CCompiler::Library::Library(const fs::path& file)
    : file_(file),
      handle_(::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL)) {
    if (!handle_) throw Error(fmt::format("{}: cannot be loaded: {}", file.string(), ::dlerror()));
}

CCompiler::Library::~Library() { ::dlclose(handle_); }

void* CCompiler::Library::function(const std::string& name) const {
    void* place = ::dlsym(handle_, name.c_str());
    if (!place) throw Error(fmt::format("{}: has no function {}", file_.string(), name));
    return place;
}

std::shared_ptr<const CCompiler::Library> CCompiler::load(const std::string& text) const {
    const fs::path folder = cache.empty() ? usual_cache() : cache;
    require_own(folder);
    const fs::path file = folder / (key_of(command, text) + ".so");
    bool is_damaged = false;
    if (fs::exists(file)) {
        try {
            return std::make_shared<const Library>(file);
        } catch (const Error&) {
            is_damaged = true; // as a full disk leaves files: made anew
        }
    }
    // One compiles, and whoever wants the same meanwhile waits for it. A lock ends with its process.
    const Lock lock(folder);
    if (!fs::exists(file) || is_damaged) compile(command, text, file);
    return std::make_shared<const Library>(file);
}

} // namespace tribode
