#include "tribode/analysis/weighted_modal_fit.hpp"
#include "tribode/base/random.hpp"

#include <array>
#include <cmath>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode {
namespace {

using Complex = std::complex<double>;
const ModalModel truth{0.094, {{0.013, 33.3, 0.025}, {0.0053, 82.2, 0.0032}}};
constexpr double delay = 1.38e-3;

// Noise of a sensor: relative to a response that falls with the square of the frequency it grows with that.
std::vector<MeasuredPoint> noisy_response(double noise, std::uint64_t seed, double misfit = 0) {
    std::vector<MeasuredPoint> points;
    for (int i = 0; i < 80; ++i) {
        MeasuredPoint point;
        point.frequency_hz = 15 + 2.2 * i;
        const auto response =
            truth.response(point.frequency_hz) * std::polar(1.0, -2 * std::numbers::pi * point.frequency_hz * delay);
        const double deviation = noise / std::abs(response);
        const auto k = static_cast<std::uint64_t>(i);
        const auto component = [&](std::uint64_t stream) {
            return std::sqrt(0.5 * deviation * deviation + misfit * misfit) * standard_normal(seed, stream, k);
        };
        point.value = response * std::exp(std::complex(component(0), component(1)));
        point.variance = deviation * deviation;
        points.push_back(point);
    }
    return points;
}

std::array<double, 8> values_of(const WeightedFit& fit) {
    const auto& m = fit.model.modes;
    return {fit.model.rigid_gain, m[0].gain, m[0].freq_hz, m[0].zeta, m[1].gain, m[1].freq_hz, m[1].zeta, fit.delay};
}

const WeightedFitOptions options{0, 1e9, 2, 1.3e-3};

TEST(WeightedModalFit, FindsTheModelExactly) {
    const auto fit = fit_weighted(noisy_response(0, 1), options);
    const auto found = values_of(fit);
    const auto wanted = values_of({truth, delay, {}, 0, {}, {}, 0, 0, ""});
    for (std::size_t j = 0; j < found.size(); ++j) EXPECT_NEAR(found[j] / wanted[j], 1, 1e-7) << j;
    EXPECT_LT(fit.misfit, 1e-6);
    EXPECT_EQ(fit.parameters.size(), 8u);
    EXPECT_EQ(fit.covariance.size(), 8u);
}

// 95 % bounds of all parameters over 100 records, with errors that the variances describe, and with more.
TEST(WeightedModalFit, BoundsCoverTheTruth) {
    const auto wanted = values_of({truth, delay, {}, 0, {}, {}, 0, 0, ""});
    for (const double misfit : {0.0, 0.01}) {
        int covered = 0;
        constexpr int records = 100;
        for (std::uint64_t seed = 0; seed < records; ++seed) {
            const auto fit = fit_weighted(noisy_response(2e-9, seed, misfit), options);
            const auto found = values_of(fit);
            for (std::size_t j = 0; j < found.size(); ++j) {
                covered += std::abs(found[j] - wanted[j]) < 1.96 * std::sqrt(fit.covariance[j][j]);
            }
            if (misfit > 0) {
                EXPECT_NEAR(fit.misfit / misfit, 1, 0.4);
            }
        }
        EXPECT_GT(covered, 0.90 * 8 * records) << misfit;
        EXPECT_LT(covered, 0.98 * 8 * records) << misfit;
    }
}

// A variance is relative to its value: where noise made that larger, the variance is smaller.
TEST(WeightedModalFit, ValuesThatNoiseMadeLargerWeighNoMore) {
    double error = 0, square = 0;
    constexpr int records = 40;
    for (std::uint64_t seed = 0; seed < records; ++seed) {
        auto points = noisy_response(0, seed);
        for (std::size_t i = 0; i < points.size(); ++i) {
            const double variance = 0.05;
            const Complex noise(standard_normal(seed, 0, i), standard_normal(seed, 1, i));
            const Complex factor = 1.0 + std::sqrt(variance / 2) * noise;
            points[i].value *= factor;
            points[i].variance = variance / std::norm(factor);
        }
        const double own = std::log(fit_weighted(points, options).model.rigid_gain / truth.rigid_gain);
        error += own / records;
        square += own * own / records;
    }
    EXPECT_LT(std::abs(error), 3 * std::sqrt(square / records));
    EXPECT_LT(std::abs(error), 0.02);
}

// Above its mode a machine is a mass; what the lag of the drive takes off is no mode above the data.
TEST(WeightedModalFit, AModeOutsideOfTheDataIsNotDetermined) {
    std::vector<MeasuredPoint> points;
    for (const double f : {300.0, 400.0, 500.0, 600.0, 700.0, 800.0, 850.0, 890.0}) {
        MeasuredPoint point;
        point.frequency_hz = f;
        point.value = ModalModel{0.1, {{0.02, 40, 0.02}}}.response(f) *
                      std::polar(1.0, -2 * std::numbers::pi * f * delay) / Complex(1, f / 750);
        point.variance = 1e-12;
        points.push_back(point);
    }
    const auto fit = fit_weighted(points, {0, 1e9, 1, delay});
    EXPECT_TRUE(fit.covariance.empty());
    EXPECT_FALSE(std::isfinite(fit.standard_errors.rigid_gain));
    EXPECT_FALSE(fit.message.empty());
}

TEST(WeightedModalFit, WeightsCutTheScatter) {
    // The noise of a sensor is hundreds of times larger at the highest frequencies than at the lowest.
    double weighted = 0, alike = 0;
    for (std::uint64_t seed = 0; seed < 30; ++seed) {
        auto points = noisy_response(1e-8, seed);
        weighted += std::pow(fit_weighted(points, options).model.rigid_gain / truth.rigid_gain - 1, 2);
        for (auto& point : points) point.variance = 1e-6;
        alike += std::pow(fit_weighted(points, options).model.rigid_gain / truth.rigid_gain - 1, 2);
    }
    EXPECT_LT(std::sqrt(weighted), 0.5 * std::sqrt(alike));
}

} // namespace
} // namespace tribode
