#include "tribode/plant/held_input.hpp"

#include <gtest/gtest.h>

#include <cmath>

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

// Its coefficients from another instant on, over another length, give the same values.
TEST(HeldInput, ItsTaylorCoefficientsAreThoseOfTheSameCubic) {
    const HeldInput cubic{.coefficient = {1, 2, 4, 8}, .start = 10, .rate = 4};
    const HeldInput constant{.coefficient = {3, 5, 7, 9}, .start = 1, .rate = 0};
    const double t0 = 10.0625, h = 0.125;
    for (const auto& input : {cubic, constant}) {
        for (const double s : {0.0, 0.5, 1.0}) {
            double sum = 0;
            for (int n = 0; n <= 3; ++n) sum += input.taylor(n, t0, h) * std::pow(s, n);
            EXPECT_EQ(sum, input(t0 + s * h)); // all exact in binary
        }
        EXPECT_EQ(input.taylor(4, t0, h), 0);
    }
}

TEST(HeldInput, IsZeroAtFirst) { EXPECT_EQ(HeldInput{}(5), 0); }

} // namespace
} // namespace tribode
