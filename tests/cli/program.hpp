#pragma once
#include <chrono>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <sys/types.h>
#include <vector>

namespace tribode::cli {

// Where and how the program is started.
struct Surroundings {
    std::filesystem::path folder;      // working folder
    std::size_t largest_file = 0;      // limit of a file's size [bytes]; 0: none
    std::string input;                 // standard input, a pipe
    std::filesystem::path output;      // standard output goes there; empty: to Ending::out
    bool as_nobody = false;            // a superuser gives up all rights first
    bool errors_to_terminal = false;   // standard error is a terminal
    bool terminal_is_stopped = false;  // it is one, and stopped as by Ctrl-S: what writes there waits until `finish`
    std::chrono::minutes patience{15}; // a program that hangs is killed then
};

// How it ended.
struct Ending {
    int exit_code = -1;   // -1: ended by a signal
    int signal = 0;       // that ended it; 0: none
    std::string out, err; // all of standard output and standard error
};

// The program while it runs. Started with fork and exec, without a shell in between.
class Program {
  public:
    // Exit code where there is no such program, or no right to run it.
    static constexpr int cannot_start = 127;

    Program(const std::vector<std::string>& arguments, const Surroundings& surroundings);
    ~Program(); // kills what still runs
    Program(const Program&) = delete;
    Program& operator=(const Program&) = delete;

    // Waits until the condition holds; false where the program ended first, or patience did.
    bool wait_until(const std::function<bool()>& condition);
    bool has_ended();
    void send(int signal) const;
    // Whether it has a function of its own for the signal: false before it has begun to listen, and where the first
    // signal of two was heard.
    bool listens_to(int signal) const;
    pid_t number() const { return process_; }

    std::string out() const; // so far
    std::string err() const;
    Ending finish();

  private:
    void read_terminal();

    std::chrono::steady_clock::time_point give_up_;
    int out_, err_; // files without a name
    int terminal_ = -1;
    bool terminal_is_stopped_;
    std::string terminal_text_;
    pid_t process_ = -1;
    int status_ = 0;
    bool ended_ = false;
};

Ending run(const std::vector<std::string>& arguments, const Surroundings& surroundings);

// All files below a folder by their relative names, sorted.
std::vector<std::string> files_in(const std::filesystem::path& folder);

std::string text_of(const std::filesystem::path& file);

// Expects this exit code and, as all there is on standard error, one sentence of the program with these
// parts.
void expect_sentence(const Ending& ending, int exit_code, const std::vector<std::string>& parts);

} // namespace tribode::cli
