#include "tribode/control/loop_filter.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

constexpr double ts = 5e-4;

// The bilinear transform keeps the gain and phase at freq_hz, at zero and at half the rate.
TEST(LoopFilter, HasTheResponseOfItsEquationWhereTheTransformKeepsIt) {
    const LoopFilter low{.freq_hz = 150, .zeta = 0.4};
    EXPECT_NEAR(std::abs(low.response(1e-6, ts) - 1.0), 0, 1e-7);
    EXPECT_NEAR(std::abs(low.response(150, ts) - std::complex(0.0, -1 / 0.8)), 0, 1e-12);
    EXPECT_NEAR(std::abs(low.response(1000, ts)), 0, 1e-12);
    const LoopFilter notch{.kind = LoopFilter::Kind::notch, .freq_hz = 82, .zeta = 0.3, .depth = 0.05};
    EXPECT_NEAR(std::abs(notch.response(1e-6, ts) - 1.0), 0, 1e-7);
    EXPECT_NEAR(std::abs(notch.response(82, ts) - 0.05), 0, 1e-12);
    EXPECT_NEAR(std::abs(notch.response(1000, ts) - 1.0), 0, 1e-12);
    // Far below the sampling rate it is the continuous one.
    const std::complex<double> s(0.0, 10.0 / 82);
    const auto continuous = (s * s + 2 * 0.05 * 0.3 * s + 1.0) / (s * s + 2 * 0.3 * s + 1.0);
    EXPECT_NEAR(std::abs(notch.response(10, ts) - continuous), 0, 1e-3);
}

TEST(LoopFilter, StepsAreItsResponse) {
    const std::vector<LoopFilter> filters = {{.freq_hz = 200},
                                             {.kind = LoopFilter::Kind::notch, .freq_hz = 82, .zeta = 0.5}};
    for (const double f : {20.0, 82.0, 150.0}) {
        LoopFilterStates states;
        const auto response = filters[0].response(f, ts) * filters[1].response(f, ts);
        for (int k = 0; k < 4000; ++k) {
            const auto turn = std::polar(1.0, 2 * std::numbers::pi * f * ts * k);
            const double out = states.step(filters, turn.real(), ts);
            if (k > 3000) {
                EXPECT_NEAR(out, (response * turn).real(), 1e-9) << f;
            }
        }
    }
}

} // namespace
} // namespace tribode
