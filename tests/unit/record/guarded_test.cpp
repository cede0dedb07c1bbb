#include "tribode/base/error.hpp"
#include "tribode/record/guarded.hpp"
#include "unit/script/messages.hpp"

#include <csignal>
#include <cstdlib>
#include <gtest/gtest.h>
#include <unistd.h>

namespace tribode {
namespace {

constexpr GuardLimits limits{1, std::size_t{64} << 20};

TEST(Guarded, ReturnsTheBytesHoweverMany) {
    // More than a pipe holds at a time.
    const std::string many(5'000'000, 'x');
    EXPECT_EQ(run_guarded(limits, [&] { return many; }), many);
    EXPECT_EQ(run_guarded(limits, [] { return std::string(); }), "");
}

TEST(Guarded, ACrashAnEndlessLoopOrAHugeMemoryIsNoResult) {
    EXPECT_FALSE(run_guarded(limits, []() -> std::string {
        ::raise(SIGSEGV);
        return "";
    }));
    EXPECT_FALSE(run_guarded(limits, []() -> std::string { std::abort(); }));
    EXPECT_FALSE(run_guarded(limits, []() -> std::string { ::_exit(0); }));
    EXPECT_FALSE(run_guarded(limits, []() -> std::string {
        for (volatile bool on = true; on;) {
        }
        return "";
    }));
    EXPECT_FALSE(run_guarded(limits, [] { return std::string(std::size_t{512} << 20, 'x'); }));
    EXPECT_FALSE(run_guarded(limits, []() -> std::string { throw Error("no sentence for a user"); }));
}

TEST(Guarded, TheSentenceOfAnInputErrorComesThrough) {
    EXPECT_EQ(problem_of([] { run_guarded(limits, []() -> std::string { throw InputError("x: is wrong"); }); }),
              "input: x: is wrong");
}

} // namespace
} // namespace tribode
