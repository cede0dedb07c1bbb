#include "commands/progress_display.hpp"
#include "tribode/base/text.hpp"

#include <cstdio>
#include <fmt/format.h>
#include <unistd.h>

namespace tribode {

ProgressDisplay::ProgressDisplay() : terminal_(isatty(STDERR_FILENO) != 0) {}

void ProgressDisplay::show(const std::string& what, std::size_t done, std::size_t of) {
    const auto now = std::chrono::steady_clock::now();
    if (what != what_ || done < done_) {
        what_ = what;
        start_ = now;
        first_ = done;
        tenth_ = 0;
        shown_ = {};
    }
    done_ = done;
    const bool last = done == of;
    const double elapsed = std::chrono::duration<double>(now - start_).count();
    if (terminal_ ? !last && now - shown_ < std::chrono::milliseconds(100)
                  : elapsed < 2 || done * 10 < of * (tenth_ + 1)) {
        return;
    }
    shown_ = now;
    tenth_ = of ? done * 10 / of : 0;
    const auto made = static_cast<double>(done - first_);
    const double left = made > 0 ? elapsed * static_cast<double>(of - done) / made : 0;
    const double rate = elapsed > 0 ? made / elapsed : 0;
    constexpr std::size_t width = 30;
    const std::size_t filled = of ? width * done / of : width;
    std::fprintf(stderr, "%s%s", terminal_ ? "\r" : "",
                 fmt::format("{} [{:#<{}}{:.<{}}] {}/{}  {:.3g}/s  {}{}", printable(what), "", filled, "",
                             width - filled, done, of, rate,
                             last ? fmt::format("{:.1f} s    ", elapsed) : fmt::format("{:.0f} s left ", left),
                             terminal_ && !last ? "" : "\n")
                     .c_str());
    std::fflush(stderr);
    open_ = terminal_ && !last;
}

void ProgressDisplay::close_line() {
    if (open_) std::fputc('\n', stderr);
    open_ = false;
}

} // namespace tribode
