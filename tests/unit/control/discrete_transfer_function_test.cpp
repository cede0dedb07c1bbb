#include "tribode/control/discrete_transfer_function.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

namespace tribode {
namespace {

using Complex = std::complex<double>;

constexpr double turn = 2 * std::numbers::pi;
constexpr double sample_time = 500e-6; // [s]
constexpr double delay = 1.38e-3;      // [s], that of the paper

// b0 x[k] + b1 x[k-1] + ... = a0 y[k] + a1 y[k-1] + ..., term by term.
std::vector<double> by_difference_equation(const std::vector<double>& b, const std::vector<double>& a,
                                           const std::vector<double>& x) {
    std::vector<double> y;
    for (std::size_t k = 0; k < x.size(); ++k) {
        double sum = 0;
        for (std::size_t i = 0; i < b.size() && i <= k; ++i) sum += b[i] * x[k - i];
        for (std::size_t i = 1; i < a.size() && i <= k; ++i) sum -= a[i] * y[k - i];
        y.push_back(sum / a[0]);
    }
    return y;
}

// The frequency at which the bilinear transform puts what stands at w [rad/s].
double warped(double omega) { return 2 / sample_time * std::tan(omega * sample_time / 2); }

TEST(DiscreteTransferFunction, StepGivesTheDifferenceEquation) {
    const std::vector<std::pair<std::vector<double>, std::vector<double>>> cases = {
        {{1}, {1, -0.5}},             // one pole
        {{0.5, 0.25, -2}, {1}},       // finite impulse response
        {{3}, {1}},                   // a gain
        {{0, 0.2}, {2, -1, 0.5}},     // a denominator to be divided, more poles than zeros
        {{1, 2, 3, 4}, {-4, 1, 0.1}}, // more zeros than poles
    };
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> sample(-1, 1);
    std::vector<double> x(60, 1.0); // a step, then anything
    for (std::size_t k = 30; k < x.size(); ++k) x[k] = sample(random);
    for (const auto& [b, a] : cases) {
        DiscreteTransferFunction filter(b, a);
        const auto expected = by_difference_equation(b, a, x);
        for (std::size_t k = 0; k < x.size(); ++k) {
            // Stable filters with outputs below 10: a few rounding errors.
            ASSERT_NEAR(filter.step(x[k]), expected[k], 1e-14) << "k = " << k << ", " << b.size() << " zeros";
        }
    }
}

TEST(DiscreteTransferFunction, ResetForgetsEverything) {
    DiscreteTransferFunction filter({1, 2}, {1, -0.9});
    const double first = filter.step(1);
    EXPECT_NE(filter.step(1), first);
    filter.reset();
    EXPECT_EQ(filter.step(1), first);
}

TEST(DiscreteTransferFunction, ResponseByHandAtAQuarterAndHalfOfTheSampleRate) {
    const double quarter = 0.25 / sample_time, half = 0.5 / sample_time; // z^-1 = -j and -1
    const DiscreteTransferFunction zeros({1, 2, 5}, {1}), pole({1}, {1, -0.5});
    // Rounding of numbers of order one, and of the angle.
    EXPECT_LT(std::abs(zeros.response(quarter, sample_time) - Complex(-4, -2)), 1e-14);
    EXPECT_LT(std::abs(zeros.response(half, sample_time) - Complex(4, 0)), 1e-14);
    EXPECT_LT(std::abs(zeros.response(0, sample_time) - Complex(8, 0)), 1e-14);
    EXPECT_LT(std::abs(pole.response(quarter, sample_time) - 1.0 / Complex(1, 0.5)), 1e-14);
    EXPECT_LT(std::abs(pole.response(half, sample_time) - 1.0 / 1.5), 1e-14);
}

class PadeDelay : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Orders, PadeDelay, ::testing::Range(1, 7));

TEST_P(PadeDelay, PassesEveryFrequencyWithGainOne) {
    for (const double l : {0.1e-3, delay, 5e-3}) {
        const auto filter = DiscreteTransferFunction::pade_delay(l, GetParam(), sample_time);
        for (double f = 0; f <= 1000; f += 12.5) {
            // Numerator and denominator are conjugate but for rounding; near half the sample rate the terms
            // of (1 + z^-1)^6 cancel to 1e-8 of their size.
            EXPECT_NEAR(std::abs(filter.response(f, sample_time)), 1, f < 900 ? 1e-11 : 1e-7)
                << l << " s at " << f << " Hz";
        }
    }
}

// An impulse comes out with all its energy, so the recursion is stable and is that of the response.
TEST_P(PadeDelay, KeepsTheEnergyOfAnImpulse) {
    auto filter = DiscreteTransferFunction::pade_delay(delay, GetParam(), sample_time);
    double energy = 0;
    for (int k = 0; k < 2000; ++k) energy += std::pow(filter.step(k == 0), 2);
    EXPECT_NEAR(energy, 1, 1e-9); // the slowest pole is below 0.9: nothing is left after 1 s
}

// The error of the approximant of order n in phase is n!^2 / ((2n)! (2n+1)!) (w L)^(2n+1) for small w L.
TEST_P(PadeDelay, ItsPhaseIsThatOfTheDelayToTheOrderOfTheApproximant) {
    const int n = GetParam();
    const auto filter = DiscreteTransferFunction::pade_delay(delay, n, sample_time);
    const double f = 120, angle = warped(turn * f) * delay; // 1.05 rad
    const double error = std::arg(filter.response(f, sample_time) * std::polar(1.0, angle));
    const double leading = std::pow(std::tgamma(n + 1.0), 2) / (std::tgamma(2 * n + 1.0) * std::tgamma(2 * n + 2.0)) *
                           std::pow(angle, 2 * n + 1);
    // The next term is smaller by about (w L)^2 / 10; below 1e-13 rounding is larger.
    EXPECT_NEAR(error, leading, 0.15 * leading + 1e-13);
}

// Eq. (19), evaluated where the bilinear transform puts the frequency.
TEST(PadeDelayOfOrderFour, IsTheEquationOfThePaper) {
    const auto filter = DiscreteTransferFunction::pade_delay(delay, 4, sample_time);
    for (double f = 5; f < 1000; f += 55) {
        const Complex x(0, warped(turn * f) * delay);
        const Complex above = ((x - 20.0) * x + 180.0) * x * x - 840.0 * x + 1680.0;
        const Complex below = ((x + 20.0) * x + 180.0) * x * x + 840.0 * x + 1680.0;
        // The transform cancels (1 + z^-1)^4, 1e-5 at the highest frequency here.
        EXPECT_LT(std::abs(filter.response(f, sample_time) - above / below), 1e-10) << f;
    }
}

TEST(PadeDelayOfOrderFour, TheTransformMakesTheDelayLongerByTheStatedShare) {
    const auto filter = DiscreteTransferFunction::pade_delay(delay, 4, sample_time);
    for (const double f : {10.0, 82.0, 120.0}) {
        const double omega = turn * f, x = omega * sample_time;
        const double measured = -std::arg(filter.response(f, sample_time)) / omega;
        // The next term is (w Ts)^4 / 120.
        EXPECT_NEAR(measured / delay, 1 + x * x / 12, 1.1 * std::pow(x, 4) / 120 + 1e-8) << f;
    }
}

TEST(PadeDelayOfOrderFour, ALongSlowSignalComesOutLaterByTheDelay) {
    auto filter = DiscreteTransferFunction::pade_delay(delay, 4, sample_time);
    double output = 0;
    for (int k = 0; k <= 4000; ++k) output = filter.step(k * sample_time); // a ramp of slope one, to 2 s
    EXPECT_NEAR(output, 2 - delay, 1e-12);                                 // 2 s times some rounding errors
}

TEST(PadeDelayOfLengthZero, IsTheInputItself) {
    for (int order = 1; order <= 6; ++order) {
        auto filter = DiscreteTransferFunction::pade_delay(0, order, sample_time);
        EXPECT_EQ(filter.step(0.3), 0.3);
        EXPECT_EQ(filter.step(-7), -7.0);
        EXPECT_EQ(filter.response(123, sample_time), Complex(1, 0));
    }
}

} // namespace
} // namespace tribode
