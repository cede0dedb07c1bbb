#include "tribode/analysis/frequency_response.hpp"

#include "tribode/analysis/modal_model.hpp"
#include "tribode/base/error.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace tribode {
namespace {

const ModalModel two_modes{0.09, {{0.013, 33.3, 0.025}, {0.005, 82.2, 0.003}}};

FrequencyResponse sampled(const ModalModel& model, double delay, double from_hz, double to_hz, std::size_t count) {
    FrequencyResponse response;
    for (std::size_t i = 0; i < count; ++i) {
        const double f = from_hz + (to_hz - from_hz) * static_cast<double>(i) / static_cast<double>(count - 1);
        response.frequency_hz.push_back(f);
        response.value.push_back(model.response(f));
    }
    return response.remove_delay(-delay);
}

TEST(ModalModel, IsTheSumOfAMassAndOscillators) {
    // By hand at w = 10 rad/s: -2/100 + 3/(400 - 100 + j 2 0.1 20 10).
    const ModalModel model{2, {{3, 20 / (2 * std::numbers::pi), 0.1}}};
    const std::complex<double> expected = -0.02 + 3.0 / std::complex<double>(300, 40);
    EXPECT_LT(std::abs(model.response(10 / (2 * std::numbers::pi)) - expected), 1e-15);
}

TEST(ModalModel, WithoutARigidGainIsFiniteAtRest) {
    const ModalModel model{0, {{3, 1 / (2 * std::numbers::pi), 0.1}}};
    EXPECT_LT(std::abs(model.response(0) - 3.0), 1e-14);
}

TEST(FrequencyResponse, PhaseIsContinuousThroughResonancesAndDelay) {
    // Without delay the phase returns to -180 deg above the modes; the delay adds -360 f L.
    const double delay = 1.38e-3;
    const std::vector<double> phase = sampled(two_modes, delay, 10, 200, 400).phase_deg();
    EXPECT_GT(phase.front(), -200);
    EXPECT_LE(phase.front(), 0);
    // The tails of the dampings turn the phase by about 0.01 deg at 200 Hz.
    EXPECT_NEAR(phase.back(), -180 - 360 * 200 * delay, 0.1);
    for (std::size_t i = 1; i < phase.size(); ++i) EXPECT_LT(std::abs(phase[i] - phase[i - 1]), 180);
}

TEST(FrequencyResponse, PhaseStartsOnTheBranchAskedFor) {
    const FrequencyResponse spring{{10, 20}, {std::polar(1.0, -0.1), std::polar(1.0, 0.1)}};
    EXPECT_NEAR(spring.phase_deg()[0], -0.1 * 180 / std::numbers::pi, 1e-12);
    EXPECT_NEAR(spring.phase_deg()[1], 0.1 * 180 / std::numbers::pi, 1e-12);
    EXPECT_NEAR(spring.phase_deg(-540)[0], -360 - 0.1 * 180 / std::numbers::pi, 1e-12);
}

TEST(FrequencyResponse, GainIsInDecibels) {
    const FrequencyResponse response{{1, 2}, {0.1, {0, 10}}};
    EXPECT_NEAR(response.gain_db()[0], -20, 1e-12);
    EXPECT_NEAR(response.gain_db()[1], 20, 1e-12);
}

TEST(FrequencyResponse, InterpolationIsExactForAMassWithDelayAndAtThePoints) {
    const ModalModel mass{0.1, {}};
    const double delay = 1e-3;
    const FrequencyResponse response = sampled(mass, delay, 10, 200, 20);
    const double f = 47.11;
    const std::complex<double> expected = mass.response(f) * std::polar(1.0, -2 * std::numbers::pi * f * delay);
    EXPECT_LT(std::abs(response.at(f) / expected - 1.0), 1e-12);
    EXPECT_EQ(response.at(10), response.value.front());
    EXPECT_EQ(response.at(200), response.value.back());
    EXPECT_THROW(response.at(9.99), InputError);
    EXPECT_THROW(response.at(200.01), InputError);
    EXPECT_THROW(FrequencyResponse{}.at(10), InputError);
}

TEST(PhaseDelay, IsTheDelayOfAMass) {
    for (const double delay : {-2e-3, 0.0, 1.38e-3, 4e-3}) {
        const FrequencyResponse response = sampled({0.1, {}}, delay, 10, 200, 400);
        EXPECT_NEAR(phase_delay(response, 120), delay, 1e-14) << delay;
    }
}

TEST(PhaseDelay, IsReadThroughLightlyDampedResonancesOnFineAndCoarseGrids) {
    // At 120 Hz the dampings turn the phase of this plant by less than 0.2 deg: 5 us.
    for (const std::size_t count : {2000u, 400u, 60u, 20u, 12u})
        EXPECT_NEAR(phase_delay(sampled(two_modes, 1.38e-3, 10, 200, count), 120), 1.38e-3, 5e-6) << count;
}

TEST(PhaseDelay, AveragesOverItsNeighbourhood) {
    // A phase error of +3 and -3 deg in turn: read from one point it would be 69 us.
    FrequencyResponse response = sampled({0.1, {}}, 1.38e-3, 10, 200, 400);
    for (std::size_t i = 0; i < response.size(); ++i)
        response.value[i] *= std::polar(1.0, (i % 2 ? 3 : -3) * std::numbers::pi / 180);
    EXPECT_NEAR(phase_delay(response, 120), 1.38e-3, 5e-6); // 3 deg over 21 points: at most 3.3 us of mean
}

TEST(PhaseDelay, LongDelaysNeedAnExpectation) {
    const FrequencyResponse response = sampled({0.1, {}}, 10e-3, 10, 200, 400);
    EXPECT_NEAR(phase_delay(response, 120), 10e-3 - 1.0 / 120, 1e-13);
    EXPECT_NEAR(phase_delay(response, 120, 5, 9e-3), 10e-3, 1e-13);
    EXPECT_THROW(phase_delay(response, 201), InputError);
}

} // namespace
} // namespace tribode
