#pragma once
#include <ctime>

namespace tribode {

// Time that this process has computed since this was made, per worker [s]. Unlike a clock it stands still while other programs
// have the processors: a search within so much of it tries the same on a busy computer and on an idle one.
class ProcessorTime {
  public:
    explicit ProcessorTime(unsigned workers) : workers_(workers > 0 ? workers : 1) {}

    double seconds() const {
        return static_cast<double>(std::clock() - begin_) / static_cast<double>(CLOCKS_PER_SEC) / workers_;
    }

  private:
    std::clock_t begin_ = std::clock();
    unsigned workers_;
};

} // namespace tribode
