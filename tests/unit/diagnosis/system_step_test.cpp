#include "tribode/diagnosis/prediction_statistics.hpp"
#include "tribode/diagnosis/system_step.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

// Errors of this size, of which `run` at a time have the same sign.
std::vector<double> errors_of(std::size_t count, double size, std::size_t run = 1) {
    std::vector<double> errors;
    for (std::size_t k = 0; k < count; ++k) errors.push_back(k / run % 2 == 0 ? size : -size);
    return errors;
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

// N ln(squared errors before / after) over p ln N + 2 ln M.
TEST(Evidence, IsThatOfTheBayesianInformationCriterion) {
    SystemStep before{.candidate = candidate_with({}, 1)}, after{.candidate = candidate_with({"linear"}, 0.5)};
    before.on_validation = errors_of(100, 1);
    after.on_validation = errors_of(100, 0.5);
    const double each = 2 * std::log(2.0), price = 2 * std::log(50.0);
    EXPECT_NEAR(evidence(before, after, 50), 100 * each / (std::log(100.0) + price), 1e-12);
    // Fitted values may follow what random forces did: each error of the fitted records gains no more than one of the others does.
    before.on_fitted = errors_of(300, 1);
    after.on_fitted = errors_of(300, 0.01);
    EXPECT_NEAR(evidence(before, after, 50), 400 * each / (std::log(400.0) + price), 1e-12);
    after.on_fitted = errors_of(300, 1);
    EXPECT_NEAR(evidence(before, after, 50), 100 * each / (std::log(400.0) + price), 1e-12);
    EXPECT_EQ(evidence(after, before, 50), 0);
}

// Where the errors of the validation records stay correlated, white ones of the fitted records count no more than those in proportion.
TEST(Evidence, CountsErrorsOfFittedRecordsAsThoseOfTheValidationRecords) {
    SystemStep before{.candidate = candidate_with({}, 1)}, after{.candidate = candidate_with({"linear"}, 0.5)};
    before.on_validation = errors_of(400, 1, 20);
    after.on_validation = errors_of(400, 0.5, 20);
    before.on_fitted = errors_of(800, 1);
    after.on_fitted = errors_of(800, 0.5);
    const double independent = 3 * 400 / correlation_length(after.on_validation);
    ASSERT_LT(independent, 300);
    EXPECT_NEAR(evidence(before, after, 50),
                independent * 2 * std::log(2.0) / (std::log(independent) + 2 * std::log(50.0)), 1e-12);
}

TEST(SystemStep, TermsShareTheProbabilityOfWhatHasThem) {
    const auto current = candidate_with({}, 1);
    const std::vector<SystemCandidate> found = {candidate_with({"linear"}, 0.5), candidate_with({"cubic"}, 0.5),
                                                candidate_with({"linear", "square"}, 0.5),
                                                candidate_with({"gravity"}, 0.9)};
    SystemStep step{.candidate = found[0], .certainty = 1};
    step.weigh(current, found, {0, 1, 2, 3}, 0, {0.5, 0.5, 0.5, 0.9}, 400);
    ASSERT_EQ(step.weighed.size(), 1u);
    const auto& [kind, term] = *step.weighed.begin();
    EXPECT_EQ(kind, found[0].terms[0].kind());
    EXPECT_NEAR(term.probability, 2.0 / 3, 1e-12); // alone and with another one
    ASSERT_EQ(term.rivals.size(), 1u);             // of 0.9 nothing is left after 400 errors
    EXPECT_NEAR(term.rivals[0].second, 1.0 / 3, 1e-12);
    ASSERT_EQ(step.contenders.size(), 2u);
    EXPECT_EQ(step.contenders[1].terms[0].name, "cubic");
}

// Of what does about as well as the best, the one with the fewest parameters; of white noise, the score alone decides.
TEST(SystemStep, TheSimplestOfWhatDoesAsWellIsTaken) {
    std::vector<SystemCandidate> found = {candidate_with({"linear", "cubic"}, 0.5), candidate_with({"square"}, 0.505)};
    EXPECT_EQ(simplest(found, {0, 1}), 1u);
    found[0].is_noise = true;
    EXPECT_EQ(simplest(found, {0, 1}), 0u);
    EXPECT_EQ(simplest(found, {}), std::nullopt);
    // Not a part of the best that another one beats which costs no more.
    found = {candidate_with({"linear", "cubic"}, 0.5), candidate_with({"dead_zone"}, 0.51),
             candidate_with({"linear"}, 0.515)};
    EXPECT_EQ(simplest(found, {0, 1, 2}), 1u);
}

} // namespace
} // namespace tribode
