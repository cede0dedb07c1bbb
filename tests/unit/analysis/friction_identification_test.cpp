#include "tribode/analysis/friction_identification.hpp"

#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

// Limits of 1, 10 and 100 um, so displacements from a reversal of 2, 20 and 200 um.
const std::vector<MaxwellSlipElement> truth = {{2e6, 2.0, 0}, {1e5, 1.0, 0}, {3e4, 3.0, 0}};
constexpr double true_level = 6;

FrictionFitOptions three_elements() { return {.elements = 3, .shortest = 2e-6, .longest = 2e-4}; }

// Sines of 0.5 mm: four reversals.
std::vector<double> plain_loop() {
    std::vector<double> y;
    for (int k = 0; k < 4000; ++k) y.push_back(5e-4 * std::sin(2 * M_PI * k / 2000.0));
    return y;
}

// Loops within loops, down to a few micrometers.
std::vector<double> nested_loops() {
    std::vector<double> y;
    for (int k = 0; k < 4000; ++k) {
        const double t = k / 2000.0;
        y.push_back(3e-4 * std::sin(2 * M_PI * t) + 8e-5 * std::sin(2 * M_PI * 7.3 * t) +
                    1e-5 * std::sin(2 * M_PI * 31.7 * t));
    }
    return y;
}

double rms_difference(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (std::size_t k = 0; k < a.size(); ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
    return std::sqrt(sum / static_cast<double>(a.size()));
}

TEST(RollingForce, FollowsAnElementByHand) {
    // X = 1 um: 0.5 um along, held at 1 um, then back: -2 um from the limit is slip the other way.
    const std::vector<MaxwellSlipElement> one = {{2e6, 2.0, 0}};
    const auto force = rolling_force(one, std::vector<double>{3e-6, 3.5e-6, 9e-6, 8.5e-6, 6e-6});
    const std::vector<double> wanted = {0, 1, 2, 1, -2};
    for (std::size_t k = 0; k < wanted.size(); ++k) EXPECT_NEAR(force[k], wanted[k], 1e-9) << k; // rounding
}

TEST(FitFriction, RecoversElementsWhoseBreakPointsItKnows) {
    for (const auto& position : {plain_loop(), nested_loops()}) {
        const FrictionFit fit = fit_friction(position, rolling_force(truth, position), three_elements());
        ASSERT_EQ(fit.elements.size(), truth.size());
        for (std::size_t i = 0; i < truth.size(); ++i) {
            // Squared regressors, condition number about 100: rounding by some 1e-11.
            EXPECT_NEAR(fit.elements[i].stiffness / truth[i].stiffness, 1, 1e-9);
            EXPECT_NEAR(fit.elements[i].level / truth[i].level, 1, 1e-9);
            EXPECT_EQ(fit.elements[i].damping, 0);
        }
        EXPECT_LT(fit.residual_max, 1e-8);
    }
}

TEST(FitFriction, OfAPlainLoopPredictsNestedOnes) {
    const auto loop = plain_loop(), nested = nested_loops();
    FrictionFitOptions options = three_elements();
    options.elements = 20;
    options.shortest = 5e-7;
    options.longest = 5e-4;
    options.break_points = FrictionFitOptions::BreakPoints::optimized;
    const FrictionFit fit = fit_friction(loop, rolling_force(truth, loop), options);
    // The grid's steps of 10 % leave 1 % of the level at most; three quarters of the range have been seen only once.
    EXPECT_LT(rms_difference(rolling_force(fit.elements, nested), rolling_force(truth, nested)), 0.01 * true_level);
}

TEST(FitFriction, LeavesTheNoiseAndFindsTheElementsWithinIt) {
    const auto position = nested_loops();
    auto force = rolling_force(truth, position);
    constexpr double noise = 0.05;
    for (std::size_t k = 0; k < force.size(); ++k) force[k] += noise * standard_normal(5, 0, k);
    const FrictionFit fit = fit_friction(position, force, three_elements());
    // The rms of 4000 samples is known to 1.1 %; four of these.
    EXPECT_NEAR(fit.residual_rms / noise, 1, 0.045);
    // The noise of a level is about 0.05 N/sqrt(4000) times the condition of some ten.
    ASSERT_EQ(fit.elements.size(), 3u);
    for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(fit.elements[i].level, truth[i].level, 0.04);
}

TEST(FitFriction, ErrorFallsWithTheNumberOfElements) {
    const auto position = nested_loops();
    const auto force = rolling_force(truth, position);
    double previous = true_level;
    for (const int n : {1, 2, 5, 20}) {
        FrictionFitOptions options{.elements = n,
                                   .shortest = 5e-7,
                                   .longest = 5e-4,
                                   .break_points = FrictionFitOptions::BreakPoints::optimized};
        const FrictionFit fit = fit_friction(position, force, options);
        EXPECT_LT(fit.residual_rms, 0.8 * previous) << n;
        EXPECT_LE(fit.elements.size(), static_cast<std::size_t>(n));
        previous = fit.residual_rms;
    }
    EXPECT_LT(previous, 0.005 * true_level); // twenty elements for three with break points between the grid's
}

TEST(FitFriction, OptimisedBreakPointsAreNoWorseThanGeometricOnes) {
    const auto position = plain_loop();
    const auto force = rolling_force(truth, position);
    for (const int n : {2, 3, 6}) {
        FrictionFitOptions options{.elements = n, .shortest = 5e-7, .longest = 5e-4};
        const double geometric = fit_friction(position, force, options).residual_rms;
        options.break_points = FrictionFitOptions::BreakPoints::optimized;
        EXPECT_LT(fit_friction(position, force, options).residual_rms, geometric) << n;
    }
}

TEST(FitFriction, ForgetsAnUnknownStartBeforeTheFirstFittedSample) {
    // Cut where the elements are loaded; the reversal at sample 500 and 200 um of motion make up for it.
    const auto whole = plain_loop();
    const auto force = rolling_force(truth, whole);
    const std::vector<double> position(whole.begin() + 300, whole.end()), cut(force.begin() + 300, force.end());
    FrictionFitOptions options = three_elements();
    EXPECT_GT(fit_friction(position, cut, options).residual_rms, 0.1);
    options.first_fitted = 600;
    EXPECT_LT(fit_friction(position, cut, options).residual_max, 1e-8);
}

TEST(FitFriction, FindsNoFrictionInAForceThatDrives) {
    const auto position = plain_loop();
    auto force = rolling_force(truth, position);
    for (double& f : force) f = -f;
    EXPECT_TRUE(fit_friction(position, force, three_elements()).elements.empty());
}

TEST(FitFriction, RefusesWhatDoesNotFit) {
    const std::vector<double> y = {0, 1e-3, 0}, f = {0, 1, 0};
    EXPECT_THROW(fit_friction(y, std::vector<double>{0, 1}, {}), InputError);
    EXPECT_THROW(fit_friction(y, f, {.first_fitted = 3}), InputError);
    EXPECT_THROW(fit_friction(y, f, {.shortest = 1e-3, .longest = 1e-4}), InputError);
    EXPECT_THROW(fit_friction(std::vector<double>(3, 0.0), f, {}), InputError); // no motion
    EXPECT_THROW(fit_friction(y, std::vector<double>{0, NAN, 0}, {}), InputError);
    EXPECT_THROW(fit_friction({}, {}, {}), InputError);
}

} // namespace
} // namespace tribode
