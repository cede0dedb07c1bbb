#include "tribode/base/normal.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

// The distribution function of the C library is the other road.
TEST(NormalQuantile, InvertsTheErrorFunction) {
    for (double p = 1e-300; p < 0.5; p *= 3) {
        EXPECT_NEAR(normal_cumulative(normal_quantile(p)) / p, 1, 1e-12) << p; // x^2 = 1400 times its rounding
    }
    for (int k = 1; k < 100; ++k) {
        const double p = k / 100.0;
        EXPECT_NEAR(normal_cumulative(normal_quantile(p)), p, 1e-15);
        EXPECT_NEAR(normal_quantile(1 - p), -normal_quantile(p), 1e-13); // rounding of 1 - p
    }
}

} // namespace
} // namespace tribode
