#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace tribode {

// What this process, and all that it starts, may still do, by files and folders. A folder stands for all that lies in it;
// what does not exist is passed over.
struct KernelSandbox {
    std::vector<std::filesystem::path> read;    // besides the system's libraries, fonts and devices such as /dev/null
    std::vector<std::filesystem::path> write;   // made, written, renamed and removed; read, too
    std::vector<std::filesystem::path> execute; // programs that may be started

    // The program that a shell would find by this name, with what it takes to start it.
    void allow_program(const std::string& name);
    // A file or folder that is to be written: the folder where it lies or, where that is missing, the next one above.
    void allow_output(const std::filesystem::path& path);

    // Lets the kernel refuse everything else, for good: by Landlock (Linux 5.19 or later) other files, by seccomp the
    // network and what looks into other processes. This is a second wall: what is refused here should have been refused
    // before. Where the kernel has neither, nothing happens. Call it while there is one thread. Returns whether files are
    // confined.
    bool enter() const;
};

// Limits this process and each one that it starts: its memory [bytes], its time of the processor [s]; 0: no limit. Above
// the first, memory is refused; at the second SIGXCPU comes, and five seconds later SIGKILL.
void limit_process(std::size_t memory_bytes, std::size_t cpu_seconds);

} // namespace tribode
