#include "tribode/record/guarded.hpp"
#include "tribode/base/error.hpp"

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <fstream>
#include <string_view>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace tribode {

namespace {

// First byte of what the child sends.
enum Answer : char { result = 'r', wrong_input = 'i' };

// Of the address space [bytes].
std::size_t memory_in_use() {
    std::size_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    return pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

// Quiet in every kind of end: no core file, no last words of the C library or of a sanitizer.
void prepare_to_crash(const GuardLimits& limits) {
    for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGXCPU, SIGALRM}) std::signal(signal, SIG_DFL);
    const rlimit no_core{0, 0}, time{limits.cpu_seconds, limits.cpu_seconds};
    const rlim_t most = memory_in_use() + limits.memory_bytes;
    const rlimit memory{most, most};
    ::setrlimit(RLIMIT_CORE, &no_core);
    ::setrlimit(RLIMIT_CPU, &time);
    ::setrlimit(RLIMIT_AS, &memory);
    ::alarm(20 * limits.cpu_seconds); // should it wait for something that never comes
    if (const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC); nowhere >= 0) ::dup2(nowhere, STDERR_FILENO);
}

bool send(int pipe, std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t sent = ::write(pipe, bytes.data(), bytes.size());
        if (sent < 0 && errno != EINTR) return false;
        if (sent > 0) bytes.remove_prefix(static_cast<std::size_t>(sent));
    }
    return true;
}

[[noreturn]] void run_child(int pipe, const GuardLimits& limits, const std::function<std::string()>& work) {
    prepare_to_crash(limits);
    bool sent = false;
    try {
        const std::string bytes = work();
        sent = send(pipe, std::string(1, result)) && send(pipe, bytes);
    } catch (const InputError& problem) {
        sent = send(pipe, std::string(1, wrong_input)) && send(pipe, problem.what());
    } catch (...) {
        // As a crash: nothing of use was found.
    }
    // Without the parent's destructors and buffers.
    ::_exit(sent ? 0 : 1);
}

std::string receive(int pipe) {
    std::string bytes;
    std::array<char, 65536> piece;
    for (;;) {
        const ssize_t got = ::read(pipe, piece.data(), piece.size());
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return bytes;
        bytes.append(piece.data(), static_cast<std::size_t>(got));
    }
}

} // namespace

std::optional<std::string> run_guarded(const GuardLimits& limits, const std::function<std::string()>& work) {
    std::array<int, 2> ends;
    if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw Error(fmt::format("no pipe ({})", std::strerror(errno)));
    const pid_t child = ::fork();
    if (child == 0) run_child(ends[1], limits, work);
    ::close(ends[1]);
    if (child < 0) {
        ::close(ends[0]);
        throw Error(fmt::format("no further process ({})", std::strerror(errno)));
    }
    std::string bytes = receive(ends[0]);
    ::close(ends[0]);
    int status = 0;
    while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0 || bytes.empty()) return std::nullopt;
    const char report = bytes.front();
    bytes.erase(0, 1);
    if (report == wrong_input) throw InputError(bytes);
    return bytes;
}

} // namespace tribode
