#include "cli/program.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <fstream>
#include <grp.h>
#include <gtest/gtest.h>
#include <iterator>
#include <stdexcept>
#include <sys/resource.h>
#include <sys/wait.h>
#include <termios.h>
#include <thread>
#include <unistd.h>

namespace tribode::cli {

namespace {

constexpr uid_t nobody = 65534;

int file_without_name() {
    std::FILE* file = std::tmpfile();
    if (!file) throw std::runtime_error("no temporary file can be made");
    const int number = dup(fileno(file));
    std::fclose(file);
    return number;
}

std::string all_of(int file) {
    std::string text;
    char bytes[4096];
    // At a place of our own: the program goes on writing at the file's.
    for (ssize_t got; (got = pread(file, bytes, sizeof bytes, static_cast<off_t>(text.size()))) > 0;) {
        text.append(bytes, static_cast<std::size_t>(got));
    }
    return text;
}

int new_terminal(int& errors) {
    const int terminal = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (terminal < 0 || grantpt(terminal) != 0 || unlockpt(terminal) != 0) {
        throw std::runtime_error("no terminal can be made");
    }
    errors = open(ptsname(terminal), O_RDWR | O_NOCTTY | O_CLOEXEC);
    return terminal;
}

bool take_rights_away() {
    if (geteuid() != 0) return true;
    return setgroups(0, nullptr) == 0 && setgid(nobody) == 0 && setuid(nobody) == 0;
}

// A pipe that holds the text and ends.
int pipe_with(const std::string& text) {
    int ends[2];
    if (text.size() > 60000 || pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("no pipe can be made");
    const bool written = write(ends[1], text.data(), text.size()) == static_cast<ssize_t>(text.size());
    close(ends[1]);
    if (!written) throw std::runtime_error("a pipe cannot be filled");
    return ends[0];
}

[[noreturn]] void become_program(char* const* arguments, const Surroundings& surroundings, int in, int out, int err) {
    const bool ready = chdir(surroundings.folder.c_str()) == 0 && dup2(in, STDIN_FILENO) >= 0 &&
                       dup2(out, STDOUT_FILENO) >= 0 && dup2(err, STDERR_FILENO) >= 0 &&
                       (!surroundings.as_nobody || take_rights_away());
    if (surroundings.largest_file > 0) {
        const rlimit limit{surroundings.largest_file, surroundings.largest_file};
        setrlimit(RLIMIT_FSIZE, &limit);
    }
    if (ready) execv(arguments[0], arguments);
    _exit(Program::cannot_start);
}

} // namespace

Program::Program(const std::vector<std::string>& arguments, const Surroundings& surroundings)
    : give_up_(std::chrono::steady_clock::now() + surroundings.patience),
      out_(file_without_name()),
      terminal_is_stopped_(surroundings.terminal_is_stopped) {
    if (surroundings.errors_to_terminal || terminal_is_stopped_) {
        terminal_ = new_terminal(err_);
        if (terminal_is_stopped_) tcflow(err_, TCOOFF);
    } else {
        err_ = file_without_name();
    }
    if (!surroundings.output.empty()) {
        close(out_);
        out_ = open(surroundings.output.c_str(), O_WRONLY | O_CLOEXEC); // not to be read back
    }
    std::vector<std::string> words = {TRIBODE_PROGRAM};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> pointers;
    for (auto& word : words) pointers.push_back(word.data());
    pointers.push_back(nullptr);
    const int in = pipe_with(surroundings.input);
    process_ = fork();
    if (process_ == 0) become_program(pointers.data(), surroundings, in, out_, err_);
    close(in);
    if (process_ < 0) throw std::runtime_error("no process can be made");
}

Program::~Program() {
    if (!has_ended()) {
        kill(process_, SIGKILL);
        waitpid(process_, &status_, 0);
    }
    close(out_);
    close(err_);
    if (terminal_ >= 0) close(terminal_);
}

bool Program::has_ended() {
    if (!ended_) ended_ = waitpid(process_, &status_, WNOHANG) == process_;
    return ended_;
}

bool Program::wait_until(const std::function<bool()>& condition) {
    while (!condition()) {
        if (has_ended() || std::chrono::steady_clock::now() > give_up_) return false;
        read_terminal();
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return true;
}

void Program::send(int signal) const { kill(process_, signal); }

bool Program::listens_to(int signal) const {
    std::ifstream status("/proc/" + std::to_string(process_) + "/status");
    unsigned long long caught = 0;
    for (std::string word; status >> word;) {
        if (word == "SigCgt:") status >> std::hex >> caught;
    }
    return caught >> (signal - 1) & 1;
}

std::string Program::out() const { return all_of(out_); }

std::string Program::err() const { return terminal_ >= 0 ? terminal_text_ : all_of(err_); }

void Program::read_terminal() {
    if (terminal_ < 0) return;
    char bytes[4096];
    for (ssize_t got; (got = read(terminal_, bytes, sizeof bytes)) > 0;) {
        terminal_text_.append(bytes, static_cast<std::size_t>(got));
    }
}

Ending Program::finish() {
    if (terminal_is_stopped_) tcflow(err_, TCOON);
    if (!wait_until([this] { return has_ended(); })) {
        kill(process_, SIGKILL);
        waitpid(process_, &status_, 0);
        ended_ = true;
    }
    read_terminal();
    Ending ending;
    if (WIFEXITED(status_)) ending.exit_code = WEXITSTATUS(status_);
    if (WIFSIGNALED(status_)) ending.signal = WTERMSIG(status_);
    ending.out = out();
    ending.err = err();
    return ending;
}

Ending run(const std::vector<std::string>& arguments, const Surroundings& surroundings) {
    return Program(arguments, surroundings).finish();
}

std::vector<std::string> files_in(const std::filesystem::path& folder) {
    std::vector<std::string> names;
    if (!std::filesystem::exists(folder)) return names;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
        if (!entry.is_directory()) names.push_back(entry.path().lexically_relative(folder).string());
    }
    std::sort(names.begin(), names.end());
    return names;
}

std::string text_of(const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    if (!stream) throw std::runtime_error(file.string() + " cannot be read");
    return {std::istreambuf_iterator<char>(stream), {}};
}

void expect_sentence(const Ending& ending, int exit_code, const std::vector<std::string>& parts) {
    EXPECT_EQ(ending.exit_code, exit_code) << ending.err;
    EXPECT_EQ(ending.signal, 0);
    EXPECT_TRUE(ending.err.starts_with("tribode: ")) << ending.err;
    EXPECT_EQ(ending.err.find('\n'), ending.err.size() - 1) << "more or less than one line: " << ending.err;
    for (const auto& part : parts) {
        EXPECT_NE(ending.err.find(part), std::string::npos) << "\"" << part << "\" is not in: " << ending.err;
    }
}

} // namespace tribode::cli
