#include "tribode/analysis/sine_fit.hpp"

#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

namespace tribode {
namespace {

constexpr double sample_time = 500e-6; // [s]
constexpr double turn = 2 * std::numbers::pi;

std::vector<double> sampled(std::size_t count, double first_instant, const std::function<double(double)>& signal) {
    std::vector<double> samples(count);
    for (std::size_t i = 0; i < count; ++i) samples[i] = signal(first_instant + static_cast<double>(i) * sample_time);
    return samples;
}

double wave(double t, double frequency_hz, std::complex<double> phasor) {
    return (phasor * std::polar(1.0, turn * frequency_hz * t)).real();
}

// Well-conditioned problem of size one: a few hundred eps.
constexpr double rounding = 1e-12;

TEST(SineFit, FindsOffsetDriftAndHarmonicsOfAnIncommensurateSignal) {
    const double f = 33.3217;
    const std::complex<double> x1(0.3, -0.8), x2(-0.05, 0.02), x3(0.01, 0.1);
    const double first = 1.2345;
    const Window window = whole_periods(0, 10, sample_time, f);
    const double middle = first + 0.5 * static_cast<double>(window.count - 1) * sample_time;
    const auto samples = sampled(window.count, first, [&](double t) {
        return 2.5 + 0.7 * (t - middle) + wave(t, f, x1) + wave(t, 2 * f, x2) + wave(t, 3 * f, x3);
    });
    const SineFit fit = fit_sine(samples, sample_time, f, first, 3, Drift::linear);
    EXPECT_NEAR(fit.offset, 2.5, rounding);
    EXPECT_NEAR(fit.drift, 0.7, 100 * rounding); // divided by half the window, 0.15 s
    EXPECT_LT(std::abs(fit.fundamental() - x1), rounding);
    EXPECT_LT(std::abs(fit.harmonics[1] - x2), rounding);
    EXPECT_LT(std::abs(fit.harmonics[2] - x3), rounding);
    EXPECT_LT(fit.residual_rms, rounding);
    EXPECT_NEAR(fit.total_harmonic_distortion(), std::sqrt(std::norm(x2) + std::norm(x3)) / std::abs(x1), rounding);
}

TEST(SineFit, FundamentalAloneIsThatOfTheFit) {
    const double f = 33.3217;
    const auto samples = sampled(500, 0.1, [&](double t) {
        return 0.2 + wave(t, f, {0.3, -0.8}) + wave(t, 2 * f, 0.1);
    });
    for (const Drift drift : {Drift::none, Drift::linear}) {
        const SineBasis basis(samples.size(), sample_time, f, 0.1, 3, drift);
        EXPECT_EQ(basis.fundamental(samples), basis.fit(samples).fundamental());
    }
}

TEST(SineFit, PhaseIsThatOfTheRunWhateverTheWindow) {
    const double f = 171.3;
    const std::complex<double> phasor(-0.4, 0.9);
    // 700 s into a run f t is 1.2e5 turns, known to 1.5e-11 turns.
    for (const double first : {0.0, 0.0123, 3.7, 700.0}) {
        const auto samples = sampled(500, first, [&](double t) { return wave(t, f, phasor); });
        EXPECT_LT(std::abs(fit_sine(samples, sample_time, f, first).fundamental() - phasor), 1e-9) << first;
    }
}

TEST(SineFit, HarmonicsThatCannotBeToldAreZeroAndLeaveTheOthersRight) {
    const std::complex<double> x1(1, 2), x4(0.1, -0.2);
    // 4 * 200 Hz lies below 1000 Hz, 5 * 200 Hz on it.
    const auto samples = sampled(100, 0, [&](double t) { return wave(t, 200, x1) + wave(t, 800, x4); });
    const SineFit fit = fit_sine(samples, sample_time, 200, 0, 7);
    ASSERT_EQ(fit.harmonics.size(), 7u);
    EXPECT_LT(std::abs(fit.fundamental() - x1), rounding);
    EXPECT_LT(std::abs(fit.harmonics[3] - x4), rounding);
    for (const std::size_t n : {4u, 5u, 6u}) EXPECT_EQ(fit.harmonics[n], 0.0);
}

TEST(SineFit, HarmonicsOnlyJustBelowNyquistAreLeftOut) {
    // 5 * 199.9 Hz is 0.5 Hz below the Nyquist frequency; a window of 50 ms resolves 20 Hz.
    const auto samples = sampled(100, 0, [](double t) { return wave(t, 199.9, 1.0) + 1e-3 * std::cos(1e4 * t * t); });
    EXPECT_EQ(fit_sine(samples, sample_time, 199.9, 0, 5).harmonics[4], 0.0);
    // A window of 2.5 s resolves 0.4 Hz.
    const auto longer = sampled(5000, 0, [](double t) { return wave(t, 199.9, 1.0) + wave(t, 999.5, 0.1); });
    EXPECT_LT(std::abs(fit_sine(longer, sample_time, 199.9, 0, 5).harmonics[4] - 0.1), 1e-10);
}

TEST(SineFit, NoiseIsLeftAsResidualAndAveragedInThePhasor) {
    const double sigma = 0.1;
    const std::size_t count = 2000;
    auto samples = sampled(count, 0, [](double t) { return wave(t, 47.3, 1.0); });
    for (std::size_t i = 0; i < count; ++i) samples[i] += sigma * standard_normal(7, 0, i);
    const SineFit fit = fit_sine(samples, sample_time, 47.3, 0);
    // The rms of 2000 normal numbers scatters by 1.6 %; four times that.
    EXPECT_NEAR(fit.residual_rms, sigma, 0.064 * sigma);
    // Each part of the phasor has the deviation sigma sqrt(2/N) = 3.2e-3; four times that, and not zero.
    EXPECT_LT(std::abs(fit.fundamental() - 1.0), 4 * std::sqrt(2.0) * sigma * std::sqrt(2.0 / count));
    EXPECT_GT(std::abs(fit.fundamental() - 1.0), 1e-6);
}

TEST(SineFit, RefusesWhatItCannotSolve) {
    const std::vector<double> few(4, 1.0), some(100, 1.0);
    EXPECT_THROW(fit_sine(few, sample_time, 50, 0, 2), InputError); // five unknowns
    EXPECT_THROW(fit_sine(some, sample_time, 1e-4, 0), InputError); // 5e-6 of a period
    EXPECT_THROW(fit_sine(some, sample_time, 1000, 0), InputError); // at the Nyquist frequency
    EXPECT_THROW(fit_sine(some, sample_time, -1, 0), InputError);
    EXPECT_THROW(fit_sine(some, 0, 50, 0), InputError);
    EXPECT_THROW(fit_sine(some, sample_time, 50, 0, 0), InputError);
}

TEST(SineFit, ANonFiniteSampleMakesTheFitNaN) {
    auto samples = sampled(200, 0, [](double t) { return wave(t, 50, 1.0); });
    samples[17] = std::numeric_limits<double>::quiet_NaN();
    EXPECT_TRUE(std::isnan(fit_sine(samples, sample_time, 50, 0).fundamental().real()));
}

TEST(WholePeriods, EndsWithinHalfASampleAndFitsWhatIsThere) {
    for (const double f : {10.0, 33.32, 199.9}) {
        const Window window = whole_periods(17, 10, sample_time, f);
        EXPECT_EQ(window.first, 17u);
        EXPECT_LE(std::abs(static_cast<double>(window.count) - 10 / (f * sample_time)), 0.5);
        EXPECT_EQ(periods_within(window.count, sample_time, f), 10);
        EXPECT_EQ(periods_within(window.count - 1, sample_time, f), 9);
    }
}

TEST(Coherence, IsOneForARepeatedResponseAndFallsWithNoise) {
    const double f = 43.7;
    const std::size_t count = whole_periods(0, 40, sample_time, f).count;
    const auto input = sampled(count, 0, [&](double t) { return wave(t, f, 1.0); });
    auto output = sampled(count, 0, [&](double t) { return 3 + wave(t, f, {0.2, -0.5}); });
    EXPECT_NEAR(coherence(input, output, sample_time, f), 1, rounding);

    // Phasors of single periods (about 46 samples) then carry the noise power 4 sigma^2 / 46, so gamma^2 is
    // about 1 / (1 + 4 sigma^2 / (46 abs(Y)^2)); its scatter over 40 periods is below 0.05.
    const double sigma = 1;
    for (std::size_t i = 0; i < count; ++i) output[i] += sigma * standard_normal(3, 0, i);
    EXPECT_NEAR(coherence(input, output, sample_time, f), 1 / (1 + 4 * sigma * sigma / (46 * 0.29)), 0.15);
}

TEST(Coherence, WorksUpToTheNyquistFrequencyAndRefusesShortRecords) {
    for (const double f : {199.9, 470.0, 900.0, 980.0}) {
        const auto input = sampled(2000, 0, [&](double t) { return wave(t, f, 1.0); });
        const auto output = sampled(2000, 0, [&](double t) { return wave(t, f, {0.1, 0.3}); });
        EXPECT_NEAR(coherence(input, output, sample_time, f), 1, 1e-9) << f;
    }
    const std::vector<double> one_period(40, 1.0), other_length(41, 1.0);
    EXPECT_THROW(coherence(one_period, one_period, sample_time, 50), InputError);
    EXPECT_THROW(coherence(one_period, other_length, sample_time, 100), InputError);
}

// To the last bit, so that a result does not depend on which signals are fitted together.
TEST(SineBasis, FitsEachSignalAsTheFitOfItAlone) {
    const double f = 33.3217, first = 1.2345;
    const SineBasis basis(600, sample_time, f, first, 3, Drift::linear);
    for (const double phase : {0.0, 1.0, 2.0}) {
        const auto samples = sampled(
            600, first, [&](double t) { return 2.5 + 0.7 * t + std::sin(turn * f * t + phase) + std::cos(70 * t); });
        const SineFit one = basis.fit(samples), alone = fit_sine(samples, sample_time, f, first, 3, Drift::linear);
        EXPECT_EQ(one.offset, alone.offset);
        EXPECT_EQ(one.drift, alone.drift);
        EXPECT_EQ(one.harmonics, alone.harmonics);
        EXPECT_EQ(one.residual_rms, alone.residual_rms);
    }
}

TEST(Coherence, OfSeveralInputsIsThatOfEach) {
    const double f = 33.3217;
    const auto output = sampled(2000, 0, [&](double t) { return wave(t, f, {0.1, 0.3}) + std::cos(300 * t); });
    const auto first = sampled(2000, 0, [&](double t) { return wave(t, f, 1.0) + std::sin(170 * t); });
    const auto second = sampled(2000, 0, [&](double t) { return wave(t, f, 2.0) + std::sin(t * t); });
    const std::span<const double> inputs[] = {first, second};
    const std::vector<double> both = coherence(inputs, output, sample_time, f);
    ASSERT_EQ(both.size(), 2u);
    EXPECT_EQ(both[0], coherence(first, output, sample_time, f));
    EXPECT_EQ(both[1], coherence(second, output, sample_time, f));
}

TEST(Coherence, IsZeroWithoutASignal) {
    const std::vector<double> silent(400, 0.0);
    EXPECT_EQ(coherence(silent, silent, sample_time, 50), 0.0);
}

TEST(Settled, ComparesWithTheLatestPhasor) {
    EXPECT_TRUE(settled({1.0, 0.001}, {1.0, 0.0}, 1e-3));
    EXPECT_FALSE(settled({1.0, 0.0011}, {1.0, 0.0}, 1e-3));
    EXPECT_TRUE(settled(0.0, 0.0, 1e-3));
    EXPECT_FALSE(settled(std::numeric_limits<double>::quiet_NaN(), 1.0, 1e-3));
}

} // namespace
} // namespace tribode
