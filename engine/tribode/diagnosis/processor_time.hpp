#pragma once
#include <algorithm>
#include <ctime>
#include <pthread.h>

namespace tribode {

// Time that this process has computed since this was made, per worker [s], or that of the thread that made this one where that is more:
// it works alone where nothing is side by side. Unlike a clock it stands still while other programs have the processors: a search within
// so much of it tries the same on a busy computer and on an idle one. The thread has to outlive it.
class ProcessorTime {
  public:
    explicit ProcessorTime(unsigned workers) : workers_(workers > 0 ? workers : 1) {
        pthread_getcpuclockid(pthread_self(), &thread_);
        thread_begin_ = now(thread_);
    }

    double seconds() const {
        return std::max((now(CLOCK_PROCESS_CPUTIME_ID) - process_begin_) / workers_, now(thread_) - thread_begin_);
    }

  private:
    static double now(clockid_t clock) {
        timespec time{};
        clock_gettime(clock, &time);
        return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
    }

    clockid_t thread_{};
    double process_begin_ = now(CLOCK_PROCESS_CPUTIME_ID), thread_begin_ = 0;
    unsigned workers_;
};

} // namespace tribode
