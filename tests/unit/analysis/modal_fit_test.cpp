#include "tribode/analysis/modal_fit.hpp"
#include "unit/script/messages.hpp"

#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace tribode {
namespace {

// The plant of the paper, Table III, last column.
const ModalModel paper_plant{94.28e-3, {{13.08e-3, 33.32, 2.48e-2}, {5.27e-3, 82.22, 3.22e-3}}};

struct Errors {
    double relative = 0;      // standard deviation of gain [neper] and of phase [rad]
    double wild_fraction = 0; // of the points are off by a factor of e^2 and by 2 rad, standard deviations
};

FrequencyResponse measured(const ModalModel& model, std::size_t count, const Errors& errors = {},
                           std::uint64_t seed = 1) {
    FrequencyResponse response;
    for (std::size_t i = 0; i < count; ++i) {
        const double f = 10 + 190 * static_cast<double>(i) / static_cast<double>(count - 1);
        const bool wild = uniform(seed, 2, i) < errors.wild_fraction;
        const double size = wild ? 2 : errors.relative;
        response.frequency_hz.push_back(f);
        response.value.push_back(
            model.response(f) *
            std::exp(std::complex<double>(size * standard_normal(seed, 0, i), size * standard_normal(seed, 1, i))));
    }
    return response;
}

ModalFitOptions with_modes(std::size_t modes) {
    ModalFitOptions options;
    options.modes = static_cast<int>(modes);
    return options;
}

std::vector<double> parameters(const ModalModel& model) {
    std::vector<double> all = {model.rigid_gain};
    for (const VibrationMode& mode : model.modes) all.insert(all.end(), {mode.gain, mode.freq_hz, mode.zeta});
    return all;
}

// Largest relative difference of two parameter sets.
double difference(const ModalModel& found, const ModalModel& truth) {
    const std::vector<double> a = parameters(found), b = parameters(truth);
    EXPECT_EQ(a.size(), b.size());
    double largest = 0;
    for (std::size_t i = 0; i < b.size(); ++i) largest = std::max(largest, std::abs(a[i] / b[i] - 1));
    return largest;
}

// Errors in units of their standard errors.
std::vector<double> pulls(const ModalFitResult& result, const ModalModel& truth) {
    const std::vector<double> found = parameters(result.model), sigma = parameters(result.standard_errors);
    std::vector<double> all = parameters(truth);
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = (found[i] - all[i]) / sigma[i];
    return all;
}

TEST(ModalFit, FindsExactPlantsFromABlindStart) {
    const ModalModel plants[] = {
        paper_plant,
        {0.1, {}},
        {0.1, {{0.02, 60, 0.01}}},
        {0.05, {{0.1, 25, 0.002}}},                                       // mode above the mass
        {0.1, {{0.03, 50, 0.3}}},                                         // no peak to be seen
        {0.1, {{0.02, 60, 0.01}, {0.03, 63, 0.015}}},                     // 5 % apart
        {0.06, {{0.0042, 99.3, 0.035}, {0.0036, 102.7, 0.021}}},          // closer than their widths
        {0.09, {{0.02, 30, 0.02}, {0.01, 70, 0.01}, {0.03, 140, 0.005}}}, // three modes
        {0.09, {{0.05, 45, 0.5}, {0.005, 110, 0.004}}},                   // one broad, one narrow
    };
    for (const ModalModel& plant : plants) {
        const ModalFitResult result = fit_modal_model(measured(plant, 400), with_modes(plant.modes.size()));
        EXPECT_TRUE(result.converged);
        EXPECT_EQ(result.message, "");
        // Exact data leave the rounding of the response, amplified by the worst-known parameter.
        EXPECT_LT(difference(result.model, plant), 1e-8) << to_json(plant).dump();
        EXPECT_LT(result.residual_rms, 1e-8); // what such errors of the parameters leave
    }
}

TEST(ModalFit, DoesNotDependOnTheOrderOfThePoints) {
    const FrequencyResponse forward = measured(paper_plant, 200, {.relative = 0.01});
    FrequencyResponse backward = forward;
    std::reverse(backward.frequency_hz.begin(), backward.frequency_hz.end());
    std::reverse(backward.value.begin(), backward.value.end());
    EXPECT_EQ(parameters(fit_modal_model(forward).model), parameters(fit_modal_model(backward).model));
}

TEST(ModalFit, WithNoiseStaysWithinItsStandardErrors) {
    const ModalFitResult result = fit_modal_model(measured(paper_plant, 400, {.relative = 0.01}));
    // Four standard errors: 1 in 16000 per parameter.
    for (const double pull : pulls(result, paper_plant)) EXPECT_LT(std::abs(pull), 4);
    // abs(ln(H/P)) has two components; the rms of 380 of them scatters by 2.6 %.
    EXPECT_NEAR(result.residual_rms, 0.01 * std::sqrt(2.0), 4 * 0.026 * 0.0141);
}

// Share of the pulls of all parameters of many noisy repetitions that lie within `widths` standard errors.
double coverage(const std::vector<double>& all_pulls, double widths) {
    const auto inside =
        std::count_if(all_pulls.begin(), all_pulls.end(), [&](double pull) { return std::abs(pull) < widths; });
    return static_cast<double>(inside) / static_cast<double>(all_pulls.size());
}

TEST(ModalFit, StandardErrorsCoverTheTruthAsOftenAsTheyPromise) {
    const ModalModel plant{0.1, {{0.02, 60, 0.03}}};
    constexpr int repetitions = 60;
    for (const double scale : {0.0, std::numeric_limits<double>::infinity()}) {
        std::vector<double> all;
        ModalFitOptions options = with_modes(1);
        options.robust_scale = scale;
        for (int seed = 1; seed <= repetitions; ++seed) {
            const std::vector<double> own = pulls(
                fit_modal_model(measured(plant, 90, {.relative = 0.02}, static_cast<std::uint64_t>(seed)), options),
                plant);
            all.insert(all.end(), own.begin(), own.end());
        }
        // 60 independent repetitions; the four parameters of one are correlated, so the deviation of the
        // share is at most that of 60 draws: sqrt(0.683 0.317 / 60) = 0.060 and sqrt(0.954 0.046 / 60) =
        // 0.027. Three of each.
        EXPECT_NEAR(coverage(all, 1), 0.683, 0.180) << scale;
        EXPECT_NEAR(coverage(all, 2), 0.954, 0.081) << scale;
    }
}

TEST(ModalFit, WildPointsHardlyMoveIt) {
    const Errors errors{.relative = 0.01, .wild_fraction = 0.05};
    const FrequencyResponse response = measured(paper_plant, 400, errors);
    ModalFitOptions from_data;
    from_data.robust_scale = 0;
    const ModalFitResult robust = fit_modal_model(response, from_data);
    EXPECT_TRUE(robust.converged);
    for (const double pull : pulls(robust, paper_plant)) EXPECT_LT(std::abs(pull), 4);
    // Three standard deviations, read with 5 % of wild points among 380: they raise the median by about 5 %.
    EXPECT_NEAR(robust.robust_scale, 0.03, 0.005);

    // Plain least squares, which the same points pull away, shows that they are wild enough to matter.
    ModalFitOptions plain;
    plain.robust_scale = std::numeric_limits<double>::infinity();
    EXPECT_GT(difference(fit_modal_model(response, plain).model, paper_plant),
              5 * difference(robust.model, paper_plant));
}

TEST(ModalFit, ConvergesOnAResponseThatFrictionHasDistorted) {
    // As conventional analysis sees it at small amplitude: the first peak is flattened, and below 40 Hz
    // friction turns the phase forward and takes gain, the more the lower the frequency.
    ModalModel flattened = paper_plant;
    flattened.modes[0].zeta *= 2.5;
    FrequencyResponse response = measured(flattened, 400, {.relative = 0.01});
    for (std::size_t i = 0; i < response.size(); ++i) {
        const double f = response.frequency_hz[i];
        const std::complex<double> spring_and_loss = 1.0 + std::complex<double>(-0.6, 0.5) * std::pow(15 / f, 2);
        response.value[i] /= spring_and_loss;
    }
    const ModalFitResult result = fit_modal_model(response);
    EXPECT_TRUE(result.converged);
    EXPECT_EQ(result.message, "");
    // Chosen: what the distortion may do to gains is not small, to the frequencies it is.
    EXPECT_NEAR(result.model.rigid_gain, paper_plant.rigid_gain, 0.2 * paper_plant.rigid_gain);
    EXPECT_NEAR(result.model.modes[0].freq_hz, 33.32, 2);
    EXPECT_NEAR(result.model.modes[1].freq_hz, 82.22, 0.2);
    EXPECT_GT(result.model.modes[0].zeta, 1.5 * paper_plant.modes[0].zeta);
}

TEST(ModalFit, SaysWhenTheDataDoNotHoldSoManyModes) {
    const ModalFitResult result = fit_modal_model(measured({0.1, {}}, 100), with_modes(1));
    EXPECT_NE(result.message, "");
    EXPECT_TRUE(std::isinf(result.standard_errors.modes[0].zeta));
}

TEST(ModalFit, RefusesUnusableInput) {
    const FrequencyResponse good = measured(paper_plant, 400);
    EXPECT_THROW(fit_modal_model({}, {}), InputError);
    EXPECT_THROW(fit_modal_model(measured(paper_plant, 7)), InputError); // six in the band
    EXPECT_THROW(fit_modal_model(good, {.f_min_hz = 100, .f_max_hz = 50}), InputError);
    EXPECT_THROW(fit_modal_model(good, {.modes = -1}), InputError);
    EXPECT_THROW(fit_modal_model(good, {.robust_scale = -1}), InputError);
    FrequencyResponse shorter = good;
    shorter.value.pop_back();
    EXPECT_THROW(fit_modal_model(shorter), InputError);
    for (const std::complex<double> bad : {std::complex<double>(std::nan(""), 0), std::complex<double>(0, 0)}) {
        FrequencyResponse broken = good;
        broken.value[200] = bad;
        EXPECT_THROW(fit_modal_model(broken), InputError);
        broken.value[200] = good.value[200];
        broken.value[0] = bad; // 10 Hz, below the band
        EXPECT_NO_THROW(fit_modal_model(broken, with_modes(0)));
    }
    // Squares and ratios of these are no numbers any more.
    for (const double size : {1e300, 1e160, 1e61, 1e-61, 1e-300}) {
        FrequencyResponse broken = good;
        broken.value[200] = {0, size};
        EXPECT_NE(problem_of([&] { fit_modal_model(broken); }).find("must be from 1e-60 to 1e+60"), std::string::npos);
    }
    for (const double size : {1e60, 1e-60}) {
        FrequencyResponse odd = good;
        odd.value[200] = size;
        EXPECT_NO_THROW(fit_modal_model(odd, with_modes(1)));
    }
}

TEST(ModalFit, WritesItsParametersUnderTheirNames) {
    const Json json = to_json(fit_modal_model(measured(paper_plant, 200, {.relative = 0.01})));
    std::vector<std::string> keys;
    for (const auto& [key, value] : json.items()) keys.push_back(key);
    EXPECT_EQ(keys, (std::vector<std::string>{"k0", "k1", "f1_hz", "zeta1", "k2", "f2_hz", "zeta2", "standard_errors",
                                              "residual_rms", "converged", "message"}));
    EXPECT_EQ(json["standard_errors"].size(), 7u);
    EXPECT_GT(json["standard_errors"]["zeta2"].get<double>(), 0);
    EXPECT_LT(json["f1_hz"].get<double>(), json["f2_hz"].get<double>());
}

} // namespace
} // namespace tribode
