#include "tribode/base/random.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"
#include "tribode/diagnosis/system_step.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <utility>

namespace tribode {
namespace {

// White noise, the same but for its size: of so many errors.
std::vector<double> errors_of(std::size_t count, double size, std::uint64_t seed = 1) {
    std::vector<double> errors;
    for (std::size_t k = 0; k < count; ++k) errors.push_back(size * standard_normal(seed, 0, k));
    return errors;
}

// With what a random force does to a motion, which follows it twice with a lag.
std::vector<double> moved(std::vector<double> errors, double size, std::uint64_t seed = 2) {
    double force = 0, motion = 0;
    for (std::size_t k = 0; k < errors.size(); ++k) {
        force = 0.95 * force + standard_normal(seed, 0, k);
        motion = 0.95 * motion + 0.012 * force;
        errors[k] += size * motion;
    }
    return errors;
}

const Stretches stretches = {{{0, 300}}, {{0, 100}}};
const SystemErrors all_errors = {stretches, 0.5};

// A hole ends a stretch, and so do outputs and records. Rows of a map follow nothing.
TEST(Stretches, AreOfWhatIsMeasuredInARow) {
    const double none = std::numeric_limits<double>::quiet_NaN();
    const SystemRecord first{.t = {0, 1, 2, 3, 4}, .outputs = {{1, 2, none, none, 5}, {1, 2, 3, 4, 5}}},
        second{.t = {0, 1}, .outputs = {{1, 2}, {none, 2}}};
    const auto told = [&](const SystemModel& model) {
        std::vector<std::pair<std::size_t, std::size_t>> all;
        for (const Stretch& one : stretches_of(model, {first, second})) all.emplace_back(one.output, one.samples);
        return all;
    };
    SystemModel model{.equations = {}};
    EXPECT_EQ(told(model),
              (std::vector<std::pair<std::size_t, std::size_t>>{
                  {0, 1}, {0, 1}, {0, 1}, {1, 1}, {1, 1}, {1, 1}, {1, 1}, {1, 1}, {0, 1}, {0, 1}, {1, 1}}));
    model.equations.states.emplace_back();
    EXPECT_EQ(told(model), (std::vector<std::pair<std::size_t, std::size_t>>{{0, 2}, {0, 1}, {1, 5}, {0, 2}, {1, 1}}));
}

SystemCandidate candidate_with(const std::vector<std::string>& names, double error) {
    SystemCandidate one{.model = {}};
    one.fitted = errors_of(300, error);
    if (!names.empty()) one.fitted[names[0].size()] *= -1; // models that differ leave errors that differ
    one.predicted = errors_of(100, error);
    for (const auto& name : names) {
        one.terms.push_back({.name = name, .equation = "der(x)", .of = "x", .parameters = {{.name = "a"}}});
        one.model.parameters.emplace_back();
    }
    return one;
}

// Twice the logarithm of the likelihood ratio over p ln N + 2 ln M.
TEST(Evidence, IsThatOfTheBayesianInformationCriterion) {
    SystemStep before{.candidate = candidate_with({}, 1)}, after{.candidate = candidate_with({"linear"}, 0.5)};
    before.on_validation = errors_of(100, 1);
    after.on_validation = errors_of(100, 0.5);
    const double each = 2 * std::log(2.0), price = 2 * std::log(50.0);
    EXPECT_NEAR(evidence(before, after, stretches, 50), 100 * each / (std::log(100.0) + price), 1e-9);
    // Fitted values may follow what random forces did: each error of the fitted records gains no more than one of the others does.
    before.on_fitted = errors_of(300, 1);
    after.on_fitted = errors_of(300, 0.01);
    EXPECT_NEAR(evidence(before, after, stretches, 50), 400 * each / (std::log(400.0) + price), 1e-9);
    after.on_fitted = errors_of(300, 1);
    EXPECT_NEAR(evidence(before, after, stretches, 50), 100 * each / (std::log(400.0) + price), 1e-9);
    EXPECT_EQ(evidence(after, before, stretches, 50), 0);
}

// To explain what a random force did is little evidence, though it makes the errors much smaller.
TEST(Evidence, IsSmallWhereARandomForceIsExplained) {
    const Stretches these = {{{0, 400}}, {{0, 400}}};
    SystemStep before{.candidate = candidate_with({}, 1)}, after{.candidate = candidate_with({"linear"}, 0.5)};
    after.on_validation = errors_of(400, 1, 3);
    after.on_fitted = errors_of(400, 1, 4);
    before.on_validation = moved(after.on_validation, 2, 5);
    before.on_fitted = moved(after.on_fitted, 2, 6);
    const double larger = rms_of_errors(before.on_validation) / rms_of_errors(after.on_validation);
    EXPECT_GT(larger, 1.3);
    const double of_a_force = evidence(before, after, these, 200);
    // As large, but not following from what was before.
    before.on_validation = errors_of(400, larger, 5);
    before.on_fitted = errors_of(400, larger, 6);
    EXPECT_GT(evidence(before, after, these, 200), 2.5 * of_a_force);
}

TEST(SystemStep, TermsShareTheProbabilityOfWhatHasThem) {
    const auto current = candidate_with({}, 1);
    const std::vector<SystemCandidate> found = {candidate_with({"linear"}, 0.5), candidate_with({"cubic"}, 0.5),
                                                candidate_with({"linear", "square"}, 0.5),
                                                candidate_with({"gravity"}, 0.9)};
    SystemStep step{.candidate = found[0], .certainty = 1};
    step.weigh(current, found, {0, 1, 2, 3}, 0, {0.5, 0.5, 0.5, 0.9}, 400, all_errors);
    ASSERT_EQ(step.weighed.size(), 1u);
    const auto& [kind, term] = *step.weighed.begin();
    EXPECT_EQ(kind, found[0].terms[0].kind());
    EXPECT_NEAR(term.probability, 1.0 / 2, 1e-12); // two terms have no share that explain no more
    ASSERT_EQ(term.rivals.size(), 1u);             // of 0.9 nothing is left after 400 errors
    EXPECT_NEAR(term.rivals[0].second, 1.0 / 2, 1e-12);
    ASSERT_EQ(step.contenders.size(), 2u);
    EXPECT_EQ(step.contenders[1].terms[0].name, "cubic");
}

// Of what does about as well as the best, the one with the fewest parameters.
TEST(SystemStep, TheSimplestOfWhatDoesAsWellIsTaken) {
    std::vector<SystemCandidate> found = {candidate_with({"linear", "cubic"}, 0.5), candidate_with({"square"}, 0.505)};
    EXPECT_EQ(simplest(found, {0, 1}, all_errors), 1u);
    found[1] = candidate_with({"square"}, 0.7);
    EXPECT_EQ(simplest(found, {0, 1}, all_errors), 0u);
    EXPECT_EQ(simplest(found, {}, all_errors), std::nullopt);
    // Not a part of the best that another one beats which costs no more.
    found = {candidate_with({"linear", "cubic"}, 0.5), candidate_with({"dead_zone"}, 0.51),
             candidate_with({"linear"}, 0.515)};
    EXPECT_EQ(simplest(found, {0, 1, 2}, all_errors), 1u);
}

// Ten times as likely beforehand, also where noise is all that is left.
TEST(SystemStep, OfTwoThatDoAsWellTheOneWithANameIsTaken) {
    std::vector<SystemCandidate> found = {candidate_with({nameless_term}, 0.5), candidate_with({"overflow"}, 0.5005)};
    for (auto& one : found) one.is_noise = true;
    EXPECT_EQ(simplest(found, {0, 1}, all_errors), 1u);
    SystemStep step{.candidate = found[1], .certainty = 1};
    step.weigh(candidate_with({}, 5), found, {0, 1}, 1, {0.5, 0.5005}, 400, all_errors);
    EXPECT_GT(step.weighed.begin()->second.probability, 0.8);
    found[1] = candidate_with({"overflow"}, 0.52);
    found[1].is_noise = true;
    EXPECT_EQ(simplest(found, {0, 1}, all_errors), 0u);
}

// What has more terms, and follows what a random force did, does not win by that.
TEST(SystemStep, WhatFollowsARandomForceIsNoBetter) {
    std::vector<SystemCandidate> found = {candidate_with({"linear", "cubic", "product", "memory"}, 0.5),
                                          candidate_with({"square"}, 0.5)};
    found[1].fitted = moved(found[0].fitted, 0.4);
    found[1].predicted = moved(found[0].predicted, 0.4);
    EXPECT_GT(found[1].score(), 1.1 * found[0].score());
    EXPECT_EQ(simplest(found, {0, 1}, all_errors), 1u);
    SystemStep step{.candidate = found[1], .certainty = 1};
    step.weigh(candidate_with({}, 5), found, {0, 1}, 1, {found[0].score(), found[1].score()}, 100, all_errors);
    EXPECT_GT(step.weighed.begin()->second.probability, 0.5);
    // What it leaves is as large and does not follow from anything.
    found[1].fitted = errors_of(300, 0.58, 7);
    found[1].predicted = errors_of(100, 0.58, 8);
    EXPECT_EQ(simplest(found, {0, 1}, all_errors), 0u);
}

// Forms of one effect are the same answer, so what more parameters may follow by chance is no reason to take the worse one.
TEST(SystemStep, OfTheFormsOfAnEffectTheBetterOneIsTaken) {
    std::vector<SystemCandidate> found = {candidate_with({"dry_friction"}, 0.5), candidate_with({"dry_friction"}, 0.5)};
    for (const char* name : {"width", "rise", "velocity"}) {
        found[0].terms[0].parameters.push_back({.name = name});
        found[0].model.parameters.emplace_back();
    }
    found[1].fitted = moved(found[0].fitted, 0.4);
    found[1].predicted = moved(found[0].predicted, 0.4);
    EXPECT_EQ(simplest(found, {0, 1}, all_errors), 0u);
    found[1].terms[0].name = "square";
    EXPECT_EQ(simplest(found, {0, 1}, all_errors), 1u);
    // Where both do as well the simpler one is.
    found[1] = candidate_with({"dry_friction"}, 0.505);
    EXPECT_EQ(simplest(found, {0, 1}, all_errors), 1u);
}

// An input that never crosses its dead zone is shifted by it.
TEST(SystemStep, OfWhatIsTheSameThePlainestIsNamed) {
    std::vector<SystemCandidate> found = {candidate_with({"dead_zone"}, 0.5), candidate_with({"offset"}, 0.5),
                                          candidate_with({"constant"}, 0.5)};
    for (auto& one : found) one.fitted = found[0].fitted;
    EXPECT_EQ(simplest(found, {0, 1, 2}, all_errors), 2u);
    EXPECT_EQ(simplest(found, {0, 1}, all_errors), 1u);
    found[2].fitted[0] *= 2;
    EXPECT_EQ(simplest(found, {0, 1, 2}, all_errors), 1u);
}

} // namespace
} // namespace tribode
