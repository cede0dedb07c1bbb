#include "plant/held_input.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

TEST(HeldInput, WithoutARateItIsConstant) {
    const HeldInput input{.coefficient = {3, 5, 7, 9}, .start = 1, .rate = 0};
    EXPECT_EQ(input(1), 3);
    EXPECT_EQ(input(100), 3);
}

TEST(HeldInput, IsACubicInTheShareOfThePeriod) {
    const HeldInput input{.coefficient = {1, 2, 4, 8}, .start = 10, .rate = 4}; // period 0.25 s
    EXPECT_EQ(input(10), 1);
    EXPECT_EQ(input(10.125), 1 + 1 + 1 + 1); // half of the period; all exact in binary
    EXPECT_EQ(input(10.25), 1 + 2 + 4 + 8);
}

TEST(HeldInput, IsZeroAtFirst) { EXPECT_EQ(HeldInput{}(5), 0); }

} // namespace
} // namespace tribode
