#include "tribode/analysis/delay_estimation.hpp"

#include "tribode/analysis/modal_model.hpp"
#include "tribode/base/error.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode {
namespace {

using Complex = std::complex<double>;

// FRA-1 and FRA-2 of a loop without any other error: friction is `share` times the effective thrust.
struct TwoAnalyses {
    FrequencyResponse fra1, fra2;
};

TwoAnalyses measured(const ModalModel& plant, double delay, Complex share) {
    TwoAnalyses both;
    for (double f = 20; f <= 200; f += 2) {
        const Complex effective = 1, position = plant.response(f), friction = share * effective;
        const Complex thrust = (effective + friction) * std::polar(1.0, 2 * std::numbers::pi * f * delay);
        both.fra1.frequency_hz.push_back(f);
        both.fra1.value.push_back(position / thrust);
        both.fra2.frequency_hz.push_back(f);
        both.fra2.value.push_back(position / (thrust - friction));
    }
    return both;
}

const ModalModel mass{0.1, {}};
const ModalModel table{0.09428, {{0.01308, 33.32, 0.0248}, {0.00527, 82.22, 0.00322}}};

TEST(EstimateDelay, IsExactForAMassWithAnyFriction) {
    for (const double delay : {0.0, 1.38e-3, 3e-3}) {
        // A spring lowers the thrust (the position is against the effective thrust), a loop's area turns it.
        for (const Complex share : {Complex(0, 0), Complex(-0.14, 0), Complex(-0.1, -0.1), Complex(-0.4, -0.4)}) {
            const auto [fra1, fra2] = measured(mass, delay, share);
            const DelayEstimate estimate = estimate_delay(fra1, fra2, 100, 140, delay);
            EXPECT_NEAR(estimate.delay, delay, 1e-14); // rounding of an angle
            EXPECT_LT(estimate.spread, 1e-14);
            EXPECT_EQ(estimate.frequency_hz.size(), 21u);
            EXPECT_EQ(estimate.delays.size(), 21u);
        }
    }
}

TEST(EstimateDelay, WithoutFrictionIsTheReadingOfThePaper) {
    const auto [fra1, fra2] = measured(mass, 1.38e-3, 0);
    EXPECT_NEAR(estimate_delay(fra1, fra2, 115, 125).delay, phase_delay(fra1, 120), 1e-12); // rounding of a line
}

TEST(EstimateDelay, HasNotTheBiasOfThePaper) {
    // 10 % friction in phase with velocity, -j of the effective thrust: atan(0.1) = 5.7 deg, 132 us at 120 Hz.
    const auto [fra1, fra2] = measured(table, 1.38e-3, Complex(0, -0.1));
    EXPECT_NEAR(phase_delay(fra1, 120), 1.38e-3 - std::atan(0.1) / (2 * std::numbers::pi * 120), 6e-6);
    // The dampings of the two modes turn the plant's phase by 0.15 deg there, 3.5 us.
    EXPECT_NEAR(estimate_delay(fra1, fra2, 115, 125).delay, 1.38e-3, 5e-6);
}

TEST(EstimateDelay, GoesByTheMedianOfTheBand) {
    auto [fra1, fra2] = measured(mass, 1.38e-3, -0.1);
    const auto other = measured(mass, 0.5e-3, -0.1);
    fra1.value[52] = other.fra1.value[52]; // 124 Hz, one of eleven
    fra2.value[52] = other.fra2.value[52];
    const auto estimate = estimate_delay(fra1, fra2, 110, 130, 1.38e-3);
    EXPECT_NEAR(estimate.delay, 1.38e-3, 1e-12);
    EXPECT_NEAR(estimate.delays[7], 0.5e-3, 1e-12);
}

TEST(EstimateDelay, IsTheOneNearestTheExpected) {
    const double period = 1 / 120.0;
    const auto [fra1, fra2] = measured(mass, 1e-3, -0.1);
    EXPECT_NEAR(estimate_delay(fra1, fra2, 120, 120, period).delay, 1e-3 + period, 1e-12);
}

TEST(EstimateDelay, LeavesOutFrequenciesWhereFrictionTakesAllOfTheThrust) {
    auto [fra1, fra2] = measured(mass, 1e-3, -0.1);
    auto stuck = measured(mass, 1e-3, Complex(-1.2, 0));
    EXPECT_THROW(estimate_delay(stuck.fra1, stuck.fra2, 100, 140), InputError);
    fra1.value[45] = stuck.fra1.value[45];
    fra2.value[45] = stuck.fra2.value[45];
    const auto estimate = estimate_delay(fra1, fra2, 100, 118, 1e-3);
    EXPECT_TRUE(std::isnan(estimate.delays[5]));
    EXPECT_NEAR(estimate.delay, 1e-3, 1e-12);
}

TEST(EstimateDelay, RefusesOtherFrequenciesAndAnEmptyBand) {
    const auto [fra1, fra2] = measured(mass, 1e-3, -0.1);
    FrequencyResponse shifted = fra2;
    shifted.frequency_hz[3] += 0.1;
    EXPECT_THROW(estimate_delay(fra1, shifted, 100, 140), InputError);
    EXPECT_THROW(proposed_response(fra1, shifted, 1e-3), InputError);
    EXPECT_THROW(estimate_delay(fra1, fra2, 201, 300), InputError);
}

TEST(ProposedResponse, IsThePlantWithTheRightDelayAndFra2WithNone) {
    const auto [fra1, fra2] = measured(table, 1.38e-3, Complex(-0.2, -0.15));
    const auto right = proposed_response(fra1, fra2, 1.38e-3), none = proposed_response(fra1, fra2, 0);
    for (std::size_t i = 0; i < right.size(); ++i) {
        EXPECT_LT(std::abs(right.value[i] / table.response(right.frequency_hz[i]) - 1.0), 1e-12); // rounding
        EXPECT_LT(std::abs(none.value[i] / fra2.value[i] - 1.0), 1e-12);
    }
}

} // namespace
} // namespace tribode
