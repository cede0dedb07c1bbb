#include "tribode/analysis/signal.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <utility>

namespace tribode {
namespace {

constexpr double Ts = 1e-3, turn = 2 * std::numbers::pi;

std::vector<double> sampled(std::size_t count, const auto& f) {
    std::vector<double> values;
    for (std::size_t k = 0; k < count; ++k) values.push_back(f(static_cast<double>(k) * Ts));
    return values;
}

// The gain of the analogue filter at the frequency that the bilinear transform maps to f, squared by the second pass.
double gain(double f, double corner, int order) {
    const double ratio = std::tan(turn / 2 * f * Ts) / std::tan(turn / 2 * corner * Ts);
    return 1 / (1 + std::pow(ratio, 2 * order));
}

TEST(ZeroPhaseLowPass, HasTheGainOfButterworthTwiceAndNoPhase) {
    for (const int order : {2, 4, 8}) {
        for (const double f : {5.0, 60.0, 100.0, 150.0}) {
            const auto out =
                zero_phase_low_pass(sampled(4000, [f](double t) { return std::sin(turn * f * t); }), Ts, 100, order);
            for (std::size_t k = 1500; k < 2500; ++k) {
                EXPECT_NEAR(out[k], gain(f, 100, order) * std::sin(turn * f * static_cast<double>(k) * Ts), 1e-9)
                    << order << " " << f;
            }
        }
    }
}

TEST(ZeroPhaseLowPass, LeavesALineAloneToItsEnds) {
    const auto line = sampled(200, [](double t) { return 3 - 7 * t; });
    const auto out = zero_phase_low_pass(line, Ts, 200);
    for (std::size_t k = 0; k < line.size(); ++k) EXPECT_NEAR(out[k], line[k], 1e-3);
}

TEST(ZeroPhaseLowPass, RefusesWhatNoFilterIs) {
    const std::vector<double> values(100, 1.0);
    EXPECT_THROW(zero_phase_low_pass(values, Ts, 500), InputError);
    EXPECT_THROW(zero_phase_low_pass(values, Ts, 100, 3), InputError);
    EXPECT_THROW(zero_phase_low_pass(std::vector<double>(12, 1.0), Ts, 100, 4), InputError);
}

// Chebyshev's polynomial of order 8 by its recursion.
double chebyshev(double x) {
    double before = 1, now = x;
    for (int n = 2; n <= 8; ++n) before = std::exchange(now, 2 * x * now - before);
    return now;
}

TEST(Decimation, HasTheGainOfChebyshevTwiceAndKeepsTheLastValue) {
    const double ripple = std::pow(10, 0.05 / 10) - 1;
    for (const double f : {0.0, 10.0, 35.0, 40.0, 60.0}) {
        const auto wave = [f](double t) { return std::cos(turn * f * t); };
        const auto out = decimated(sampled(8003, wave), 10);
        ASSERT_EQ(out.size(), 801u);
        const double ratio = std::tan(turn / 2 * f * Ts) / std::tan(turn / 2 * 40 * Ts);
        const double gain = 1 / (1 + ripple * std::pow(chebyshev(ratio), 2));
        for (std::size_t k = 300; k < 500; ++k) {
            EXPECT_NEAR(out[k], gain * wave((2 + 10 * static_cast<double>(k)) * Ts), 1e-9) << f;
        }
    }
    EXPECT_THROW(decimated(std::vector<double>(100, 1.0), 1), InputError);
    EXPECT_THROW(decimated(std::vector<double>(24, 1.0), 10), InputError);
}

TEST(CentralDifferences, AreExactForAParabolaInside) {
    const auto rates = central_differences(sampled(50, [](double t) { return 5 * t * t; }), Ts);
    for (std::size_t k = 1; k + 1 < rates.size(); ++k) EXPECT_NEAR(rates[k], 10 * static_cast<double>(k) * Ts, 1e-12);
    EXPECT_NEAR(rates.front(), 5 * Ts, 1e-12); // one-sided
    EXPECT_THROW(central_differences(std::vector<double>{1}, Ts), InputError);
}

TEST(LinearFit, FindsCoefficientsWithinTheErrorsItStates) {
    // Mean square of the deviation in standard errors over many draws: one.
    double square = 0;
    const int draws = 300;
    for (int seed = 0; seed < draws; ++seed) {
        std::vector<double> a, b, values;
        for (int k = 0; k < 60; ++k) {
            a.push_back(1e6 * std::sin(0.3 * k));
            b.push_back(1e-6 * k);
            values.push_back(2e-6 * a.back() + 3e6 * b.back() +
                             0.5 * standard_normal(static_cast<std::uint64_t>(seed), 0, static_cast<std::uint64_t>(k)));
        }
        const LinearFit fit = linear_fit({a, b}, values);
        square += std::pow((fit.coefficients[0] - 2e-6) / fit.standard_errors[0], 2) / draws / 2;
        square += std::pow((fit.coefficients[1] - 3e6) / fit.standard_errors[1], 2) / draws / 2;
        double left = 0, all = 0;
        for (std::size_t k = 0; k < values.size(); ++k) {
            left += fit.residual[k] * fit.residual[k];
            all += values[k] * values[k];
        }
        EXPECT_NEAR(fit.relative_error, std::sqrt(left / all), 1e-12);
    }
    EXPECT_NEAR(square, 1, 0.2);
}

TEST(LinearFit, RefusesWhatHasNoAnswer) {
    const std::vector<double> one = {1, 2, 3}, twice = {2, 4, 6};
    EXPECT_THROW(linear_fit({one, twice}, one), InputError);
    const auto wave = sampled(4000, [](double t) { return std::sin(9.3 * t); });
    EXPECT_THROW(linear_fit({wave, wave}, wave), InputError);
    EXPECT_THROW(linear_fit({{1, 2}}, one), InputError);
    EXPECT_THROW(linear_fit({}, one), InputError);
    EXPECT_THROW(linear_fit({one, twice, one}, one), InputError);
}

} // namespace
} // namespace tribode
