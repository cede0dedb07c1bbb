#include "tribode/diagnosis/processor_time.hpp"

#include <ctime>
#include <gtest/gtest.h>
#include <thread>
#include <vector>

namespace tribode {
namespace {

double seconds_of(clockid_t clock) {
    timespec time{};
    clock_gettime(clock, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

void compute() {
    const double begin = seconds_of(CLOCK_THREAD_CPUTIME_ID);
    while (seconds_of(CLOCK_THREAD_CPUTIME_ID) < begin + 0.1) {
    }
}

TEST(ProcessorTime, OfAThreadThatWorksAloneIsNotDividedByTheWorkers) {
    const ProcessorTime time(8);
    compute();
    EXPECT_GE(time.seconds(), 0.1);
}

TEST(ProcessorTime, OfWorkSideBySideIsDivided) {
    const double begin = seconds_of(CLOCK_PROCESS_CPUTIME_ID);
    const ProcessorTime time(4);
    {
        std::vector<std::jthread> others;
        for (int i = 0; i < 4; ++i) others.emplace_back(compute);
    }
    EXPECT_GE(time.seconds(), 0.1);
    EXPECT_LT(time.seconds(), 0.5 * (seconds_of(CLOCK_PROCESS_CPUTIME_ID) - begin));
}

} // namespace
} // namespace tribode
