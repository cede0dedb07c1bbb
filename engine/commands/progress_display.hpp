#pragma once
#include <chrono>
#include <cstddef>
#include <string>

namespace tribode {

// A line on standard error: bar, count, time left. Where that is no terminal, a line every tenth of the way, and none
// for work of a second or two.
class ProgressDisplay {
  public:
    ProgressDisplay();

    void show(const std::string& what, std::size_t done, std::size_t of);

    // So that what is printed next begins in a line of its own.
    void close_line();

  private:
    const bool terminal_;
    std::string what_;
    std::chrono::steady_clock::time_point start_, shown_;
    std::size_t first_ = 0, done_ = 0, tenth_ = 0;
    bool open_ = false; // the bar is in an unfinished line
};

} // namespace tribode
