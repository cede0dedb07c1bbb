#include "tribode/base/run_control.hpp"
#include "unit/script/messages.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <thread>
#include <vector>

namespace tribode {
namespace {

class ForEachIndex : public ::testing::TestWithParam<unsigned> {
  protected:
    RunControl control{.stop = &stop, .progress = {}, .workers = GetParam()};
    std::atomic<bool> stop{false};
};

INSTANTIATE_TEST_SUITE_P(Workers, ForEachIndex, ::testing::Values(0u, 1u, 3u, 64u)); // none counts as one

TEST_P(ForEachIndex, RunsEachIndexOnce) {
    std::vector<std::atomic<int>> runs(50);
    EXPECT_EQ(for_each_index(runs.size(), control, "runs", [&](std::size_t i) { ++runs[i]; }), runs.size());
    EXPECT_TRUE(std::all_of(runs.begin(), runs.end(), [](const auto& n) { return n == 1; }));
}

TEST_P(ForEachIndex, HasNothingToDoForNone) {
    EXPECT_EQ(for_each_index(0, control, "runs", [](std::size_t) { FAIL(); }), 0u);
}

TEST_P(ForEachIndex, ProgressGrowsByOneToTheEnd) {
    std::vector<std::size_t> seen; // without a lock: calls come one at a time
    control.progress = [&](const std::string& what, std::size_t done, std::size_t of) {
        EXPECT_EQ(what, "points");
        EXPECT_EQ(of, 40u);
        seen.push_back(done);
    };
    // With several workers the indices end in another order than they begin.
    for_each_index(40, control, "points", [](std::size_t i) {
        if (i % 7 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    });
    ASSERT_EQ(seen.size(), 40u);
    for (std::size_t i = 0; i < seen.size(); ++i) EXPECT_EQ(seen[i], i + 1);
}

TEST_P(ForEachIndex, ThrowsWhatAWorkerThrewAfterAllHaveEnded) {
    std::atomic<int> running{0};
    const std::string text = problem_of([&] {
        for_each_index(1000, control, "runs", [&](std::size_t i) {
            ++running;
            if (i != 7) std::this_thread::sleep_for(std::chrono::milliseconds(1));
            --running;
            if (i == 7) throw InputError("index 7 is wrong");
        });
    });
    EXPECT_EQ(text, "input: index 7 is wrong");
    EXPECT_EQ(running, 0);
}

TEST_P(ForEachIndex, ThrowsTheFirstOfSeveralExceptions) {
    std::atomic<bool> thrown{false}, another_runs{false};
    EXPECT_EQ(problem_of([&] {
                  for_each_index(3, control, "runs", [&](std::size_t i) {
                      if (i == 0) {
                          while (control.workers > 1 && !another_runs) std::this_thread::yield();
                          thrown = true;
                          throw InputError("first");
                      }
                      another_runs = true;
                      while (!thrown) std::this_thread::yield();
                      std::this_thread::sleep_for(std::chrono::milliseconds(20));
                      throw InputError("later");
                  });
              }),
              "input: first");
}

TEST_P(ForEachIndex, TakesUpNoNewIndexAfterAFailure) {
    std::atomic<std::size_t> runs{0};
    EXPECT_THROW(for_each_index(100000, control, "runs",
                                [&](std::size_t i) {
                                    ++runs;
                                    if (i == 0) throw InputError("no");
                                    std::this_thread::sleep_for(std::chrono::milliseconds(1));
                                }),
                 InputError);
    // Each of the other workers finishes what it has begun; index 0 fails within the first few milliseconds.
    EXPECT_LT(runs, 10000u);
}

TEST_P(ForEachIndex, AStopEndsItBetweenIndicesAndCountsWhatIsDone) {
    std::atomic<std::size_t> runs{0};
    const std::size_t done = for_each_index(100000, control, "runs", [&](std::size_t i) {
        if (i == 4) stop = true;
        std::this_thread::sleep_for(std::chrono::microseconds(200));
        ++runs;
    });
    EXPECT_EQ(done, runs);
    EXPECT_GE(done, 1u);
    EXPECT_LT(done, 10000u);
    if (control.workers <= 1) {
        EXPECT_EQ(done, 5u);
    }
}

TEST_P(ForEachIndex, AStopBeforehandRunsNothing) {
    stop = true;
    EXPECT_EQ(for_each_index(10, control, "runs", [](std::size_t) { FAIL(); }), 0u);
}

TEST_P(ForEachIndex, AnExceptionOfTheProgressDisplayArrivesToo) {
    control.progress = [](const std::string&, std::size_t done, std::size_t) {
        if (done == 3) throw OutputError("the display is gone");
    };
    EXPECT_EQ(problem_of([&] { for_each_index(100, control, "runs", [](std::size_t) { std::this_thread::yield(); }); }),
              "output: the display is gone");
}

TEST(RunControl, WithoutAFlagNobodyStops) { EXPECT_FALSE(RunControl{}.stop_requested()); }

} // namespace
} // namespace tribode
