#include "target.hpp"

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <stdexcept>
#include <sys/time.h>
#include <unistd.h>

namespace tribode::fuzz {

namespace {

std::atomic<bool> patience_is_over{false};

struct Scratch {
    std::filesystem::path path;
    pid_t owner = ::getpid(); // a child that was forked leaves the folder alone

    Scratch() {
        const char* memory = "/dev/shm";
        std::string name = std::filesystem::is_directory(memory) ? memory : "/tmp";
        name += "/tribode-fuzz-XXXXXX";
        if (!::mkdtemp(name.data())) throw std::runtime_error("no folder can be made in memory");
        path = name;
    }
    ~Scratch() {
        std::error_code ignored;
        if (::getpid() == owner) std::filesystem::remove_all(path, ignored);
    }
    Scratch(const Scratch&) = delete;
    Scratch& operator=(const Scratch&) = delete;
};

} // namespace

void require(bool condition, std::string_view text) {
    if (condition) return;
    std::fprintf(stderr, "broken promise: %.*s\n", static_cast<int>(text.size()), text.data());
    std::abort();
}

const std::filesystem::path& scratch_folder() {
    static const Scratch scratch;
    return scratch.path;
}

void write_plainly(const std::filesystem::path& path, std::string_view bytes) {
    const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    const bool written = file >= 0 && ::write(file, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size());
    if (file >= 0) ::close(file);
    if (!written) throw std::runtime_error(path.string() + " cannot be written");
}

void Patience::begin() {
    static const auto handler = std::signal(SIGVTALRM, [](int) { patience_is_over = true; });
    static_cast<void>(handler);
    patience_is_over = false;
    // Of processor time, so that a busy machine changes nothing.
    const itimerval tenth{{0, 0}, {0, 100'000}};
    ::setitimer(ITIMER_VIRTUAL, &tenth, nullptr);
}

const std::atomic<bool>& Patience::over() { return patience_is_over; }

} // namespace tribode::fuzz
