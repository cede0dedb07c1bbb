#include "tribode/control/quantizer.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

// A resolution of one half and its quarters are exact in binary.
TEST(Quantizer, RoundsToTheNearestMultiple) {
    EXPECT_EQ(quantize(0.24, 0.5), 0.0);
    EXPECT_EQ(quantize(0.26, 0.5), 0.5);
    EXPECT_EQ(quantize(-0.24, 0.5), 0.0);
    EXPECT_EQ(quantize(-0.26, 0.5), -0.5);
    EXPECT_EQ(quantize(7.5, 0.5), 7.5);
}

TEST(Quantizer, RoundsHalvesUpwardsAlsoBelowZero) {
    EXPECT_EQ(quantize(0.25, 0.5), 0.5);
    EXPECT_EQ(quantize(0.75, 0.5), 1.0);
    EXPECT_EQ(quantize(-0.25, 0.5), 0.0);
    EXPECT_EQ(quantize(-0.75, 0.5), -0.5);
}

TEST(Quantizer, AResolutionOfZeroLeavesTheValue) {
    EXPECT_EQ(quantize(1.0 / 3.0, 0), 1.0 / 3.0);
    EXPECT_EQ(quantize(-1e-300, 0), -1e-300);
}

} // namespace
} // namespace tribode
