#include "tribode/analysis/modal_descent.hpp"

#include "tribode/analysis/modal_model.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace tribode {
namespace {

constexpr double infinite = std::numeric_limits<double>::infinity();
const ModalModel plant{0.09, {{0.013, 33, 0.025}, {0.005, 82, 0.01}}};

std::vector<double> logarithms_of(const ModalModel& model) {
    std::vector<double> all = {std::log(model.rigid_gain)};
    for (const auto& [gain, freq_hz, zeta] : model.modes) {
        all.insert(all.end(), {std::log(gain), std::log(2 * std::numbers::pi * freq_hz), std::log(zeta)});
    }
    return all;
}

std::vector<ResponsePoint> points_of(const ModalModel& model, std::size_t count) {
    std::vector<ResponsePoint> points;
    for (std::size_t i = 0; i < count; ++i) {
        const double f = 20 + 180 * static_cast<double>(i) / static_cast<double>(count - 1);
        points.push_back({2 * std::numbers::pi * f, model.response(f)});
    }
    return points;
}

ModalDescent descent_of(const std::vector<ResponsePoint>& points) {
    return {points, {-20, 5}, {std::log(60.0), std::log(2500.0)}, {std::log(1e-6), std::log(5.0)}};
}

// Away from the plant, in all parameters.
std::vector<double> near_the_plant() {
    std::vector<double> at = logarithms_of(plant);
    for (std::size_t j = 0; j < at.size(); ++j) at[j] += j % 2 == 0 ? 0.02 : -0.015;
    return at;
}

TEST(ModalDescent, ResidualsAreLogarithmsOfTheRatioAndDerivativesTheirSlopes) {
    const auto points = points_of(plant, 45); // fills its vectors in part
    ModalDescent descent = descent_of(points);
    const std::vector<double> at = near_the_plant();
    const auto found = descent.residuals(at);
    ASSERT_EQ(found.gain.size(), points.size());
    ModalModel model{std::exp(at[0]), {}};
    for (std::size_t j = 1; j < at.size(); j += 3) {
        model.modes.push_back({std::exp(at[j]), std::exp(at[j + 1]) / (2 * std::numbers::pi), std::exp(at[j + 2])});
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
        const auto ratio = points[i].value / model.response(points[i].omega / (2 * std::numbers::pi));
        // Some operations on numbers of the order of one; near a resonance they lose a digit or two.
        EXPECT_NEAR(found.gain[i], std::log(std::abs(ratio)), 1e-13);
        EXPECT_NEAR(found.phase[i], std::arg(ratio), 1e-13);
    }
    for (std::size_t j = 0; j < at.size(); ++j) {
        constexpr double h = 1e-6;
        std::vector<double> above = at, below = at;
        above[j] += h;
        below[j] -= h;
        const auto up = descent.residuals(above), down = descent.residuals(below);
        const auto column = static_cast<Eigen::Index>(j), count = static_cast<Eigen::Index>(points.size());
        for (Eigen::Index i = 0; i < count; ++i) {
            const auto k = static_cast<std::size_t>(i);
            // The difference leaves h^2/6 of the third derivative, some 1e6 at the resonance of 1 %, and rounding/h.
            EXPECT_NEAR(found.derivatives(i, column), (up.gain[k] - down.gain[k]) / (2 * h), 1e-6);
            EXPECT_NEAR(found.derivatives(count + i, column), (up.phase[k] - down.phase[k]) / (2 * h), 1e-6);
        }
    }
}

TEST(ModalDescent, ComesToTheModelOfExactDataFromNearby) {
    for (const std::size_t count : {8u, 40u, 45u, 401u}) {
        for (const double scale : {0.3, infinite}) {
            ModalDescent descent = descent_of(points_of(plant, count));
            const auto found = descent.descend(near_the_plant(), scale, 50);
            EXPECT_TRUE(found.converged);
            const std::vector<double> truth = logarithms_of(plant);
            // The rounding of the response, amplified by the parameter known worst.
            for (std::size_t j = 0; j < truth.size(); ++j) EXPECT_NEAR(found.logarithms[j], truth[j], 1e-8) << count;
        }
    }
}

TEST(ModalDescent, OfPlainLeastSquaresAllPointsCountAlike) {
    // A mass alone: the best logarithm of its gain is the mean of those of the points.
    std::vector<ResponsePoint> points = points_of({1, {}}, 11);
    double mean = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const double off = 0.01 * static_cast<double>(i * i);
        points[i].value *= std::exp(off);
        mean += off / static_cast<double>(points.size());
    }
    const auto found = descent_of(points).descend({0}, infinite, 50);
    EXPECT_TRUE(found.converged);
    // It ends where a step gains less than 1e-12 of the cost: so far from the best is 1e-6 of the points' scatter of 0.33.
    EXPECT_NEAR(found.logarithms[0], mean, 4e-7);
    // With the loss the wildest points count less.
    EXPECT_LT(descent_of(points).descend({0}, 0.1, 50).logarithms[0], mean - 0.05);
}

TEST(ModalDescent, StaysWithinItsBounds) {
    const auto points = points_of(plant, 40);
    const ModalModel outside{0.09, {{0.013, 5, 0.025}, {0.005, 82, 0.01}}};
    ModalDescent descent = descent_of(points);
    const auto found = descent.descend(logarithms_of(outside), 0.5, 50);
    for (std::size_t j = 0; j < found.logarithms.size(); ++j) {
        EXPECT_GE(found.logarithms[j], descent.bounds(j).low);
        EXPECT_LE(found.logarithms[j], descent.bounds(j).high);
    }
}

} // namespace
} // namespace tribode
