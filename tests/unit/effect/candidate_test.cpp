#include "tribode/base/error.hpp"
#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <set>
#include <stdexcept>

namespace tribode {
namespace {

TEST(Candidate, fitted_values_go_to_the_parameters_of_their_names) {
    const Candidate ripple(effect_kind("force_ripple"), {.parameters = {{"harmonics[2].period_m", 1e-3, 1},
                                                                        {"harmonics[1].period_m", 1e-3, 1},
                                                                        {"harmonics[1].F", 0, 9}}});
    const std::vector<double> values{0.5, 0.25, 3};
    EXPECT_EQ(ripple.at(values).records("harmonics"), (std::vector<std::vector<double>>{{3, 0.25, 0}, {0, 0.5, 0}}));
}

TEST(Candidate, a_form_fixes_numbers_choices_and_flags) {
    const Candidate ramp(effect_kind("time_varying_friction"),
                         {.fixed = {{"kind", "ramp"}, {"T", 10.0}}, .parameters = {{"a", -1, 1}}});
    const Effect effect = ramp.at(std::vector<double>{0.5});
    EXPECT_EQ(effect.choice("kind"), "ramp");
    EXPECT_EQ(effect.numbers(), (std::vector<double>{0.5, 10}));
    const Candidate slip(
        effect_kind("presliding_hysteresis"),
        {.fixed = {{"replace_coulomb", 1.0}}, .parameters = {{"elements[1].K", 1, 1e6}, {"elements[1].F", 0.1, 9}}});
    EXPECT_TRUE(slip.at(std::vector<double>{1e4, 2}).flag("replace_coulomb"));
}

TEST(Candidate, names_that_the_kind_does_not_have_are_refused_at_once) {
    const EffectKind& kind = effect_kind("time_varying_friction");
    EXPECT_THROW(Candidate(kind, {.parameters = {{"b", 0, 1}}}), std::logic_error);
    EXPECT_THROW(Candidate(kind, {.fixed = {{"b", 0.0}}, .parameters = {}}), std::logic_error);
    EXPECT_THROW(Candidate(kind, {.fixed = {{"kind", "step"}}, .parameters = {}}), std::logic_error);
}

TEST(Candidate, values_that_the_kind_does_not_allow_are_refused) {
    const Candidate gain(effect_kind("thrust_gain"), {.parameters = {{"gain", -1, 1}}});
    EXPECT_THROW(gain.at(std::vector<double>{-0.5}), InputError);
    EXPECT_THROW(gain.at(std::vector<double>{NAN}), InputError);
    EXPECT_EQ(gain.numbers_at(std::vector<double>{-0.5}), std::vector<double>{-0.5}); // for differences
}

// A record of a rigid axis with dry friction, moved to and fro, where a spring of 100 N/m about 0.01 m is missing.
struct Record {
    ServoAxis axis;
    ResidualForce residual;
    Signal measured, whitened;
    double longest_stroke = 0; // [m]

    Record() {
        axis.plant.rigid_gain = 0.1;
        axis.plant.dry.coulomb = 3;
        axis.input_delay = 5e-4;
        residual.sample_time = 1e-3;
        residual.bandwidth = 200;
        for (int k = 0; k < 2000; ++k) {
            const double t = 1e-3 * k, y = 0.02 * std::sin(6 * t), v = 0.12 * std::cos(6 * t), a = -36 * y;
            residual.time.push_back(t);
            residual.position.push_back(y);
            residual.velocity.push_back(v);
            residual.inertial.push_back(10 * a);
            residual.friction.push_back(3 * std::tanh(v / 1e-3));
            residual.thrust.push_back(10 * a + residual.friction.back());
            residual.thrust_rate.push_back(-360 * v);
            residual.reference_thrust.push_back(residual.thrust.back());
            residual.force.push_back(-100 * (y - 0.01));
            measured.push_back(y);
            whitened.push_back(20 * std::sin(40 * t));
        }
    }
    std::vector<Candidate> candidates() const {
        return tribode::candidates(Clues(axis, 1e-3, residual, measured, whitened, 1e-7, longest_stroke),
                                   [](const EffectKind&) { return true; });
    }
};

TEST(Candidate, every_kind_that_is_fitted_has_starts_within_bounds_which_it_allows) {
    std::set<std::string> names;
    for (const auto& candidate : Record().candidates()) {
        const std::string what = candidate.kind().name + " " + candidate.form;
        names.insert(candidate.kind().name);
        for (const auto* points : {&candidate.starts, &candidate.probes}) {
            for (const auto& point : *points) {
                ASSERT_EQ(point.size(), candidate.parameters.size()) << what;
                for (std::size_t i = 0; i < point.size(); ++i) {
                    EXPECT_GE(point[i], candidate.parameters[i].low) << what;
                    EXPECT_LE(point[i], candidate.parameters[i].high) << what;
                }
                EXPECT_NO_THROW(candidate.at(point)) << what;
                if (const auto richer = candidate.richer_near(point)) {
                    EXPECT_GT(richer->parameters.size(), candidate.parameters.size()) << what;
                    EXPECT_NO_THROW(richer->at(richer->starts.front())) << what;
                }
            }
        }
        for (const auto& p : candidate.parameters) {
            EXPECT_LT(p.low, p.high) << what;
            EXPECT_GT(p.step, 0) << what;
            if (p.logarithmic) {
                EXPECT_GT(p.low, 0) << what;
            }
        }
    }
    for (const auto* kind : effect_kinds()) EXPECT_EQ(names.contains(kind->name), kind->forms != nullptr) << kind->name;
}

TEST(Candidate, a_start_is_read_from_the_residual_force) {
    for (const auto& candidate : Record().candidates()) {
        if (candidate.kind().name != "spring_force" || !candidate.form.empty()) continue;
        EXPECT_NEAR(candidate.starts[0][0], 100, 1e-5);
        EXPECT_NEAR(candidate.starts[0][1], 0.01, 1e-9);
        return;
    }
    FAIL();
}

TEST(Candidate, what_a_longer_record_shows_whole_is_a_ripple_and_what_none_does_is_gravity) {
    Record record; // over 40 mm
    record.longest_stroke = 0.1;
    const double period = 0.06;
    for (std::size_t k = 0; k < record.residual.force.size(); ++k) {
        record.residual.force[k] = 2 * std::sin(2 * std::numbers::pi / period * record.residual.position[k] + 0.3);
    }
    bool ripple = false, arm = false;
    for (const auto& candidate : record.candidates()) {
        if (candidate.kind().name == "force_ripple" && candidate.form == "one harmonic") {
            EXPECT_NEAR(candidate.starts[0][0], 2, 0.1);
            EXPECT_NEAR(candidate.starts[0][1], period, 0.05 * period);
            EXPECT_DOUBLE_EQ(candidate.parameters[1].high, record.longest_stroke);
            ripple = true;
        }
        if (candidate.kind().name == "gravity" && candidate.form == "any turn") {
            EXPECT_DOUBLE_EQ(candidate.parameters[1].low, record.longest_stroke);
            arm = true;
        }
    }
    EXPECT_TRUE(ripple);
    EXPECT_TRUE(arm);
}

// What of an encoder's error shows in the errors of prediction may be its second harmonic.
TEST(Candidate, an_encoder_error_may_have_twice_the_period_that_shows) {
    Record record;
    const double period = 0.5e-3;
    for (std::size_t k = 0; k < record.whitened.size(); ++k) {
        record.whitened[k] = 20 * std::sin(2 * std::numbers::pi / period * record.measured[k]);
    }
    for (const auto& candidate : record.candidates()) {
        if (candidate.kind().name != "encoder_periodic_error" || candidate.form != "two harmonics") continue;
        for (const double expected : {period, 2 * period}) {
            EXPECT_TRUE(std::ranges::any_of(candidate.starts, [&](const auto& start) {
                return std::abs(start[1] - expected) < 1e-3 * expected;
            })) << expected;
        }
        return;
    }
    FAIL();
}

// Where friction is off besides, the power that explains most may be on the wrong side of a gain, and no fit crosses it.
TEST(Candidate, a_power_law_is_begun_on_both_sides_of_a_gain) {
    for (const auto& candidate : Record().candidates()) {
        if (candidate.kind().name != "thrust_power_law") continue;
        EXPECT_TRUE(std::ranges::any_of(candidate.starts, [](const auto& start) { return start[0] < 1; }));
        EXPECT_TRUE(std::ranges::any_of(candidate.starts, [](const auto& start) { return start[0] > 1; }));
        return;
    }
    FAIL();
}

TEST(Candidate, a_ripple_is_sought_down_to_the_period_that_the_motion_shows) {
    Record record;
    const double period = 0.4e-3; // a hundred times over the stroke
    for (std::size_t k = 0; k < record.residual.force.size(); ++k) {
        record.residual.force[k] = 2 * std::sin(2 * std::numbers::pi / period * record.residual.position[k] + 0.3);
    }
    for (const auto& candidate : record.candidates()) {
        if (candidate.kind().name != "force_ripple" || candidate.form != "one harmonic") continue;
        EXPECT_NEAR(candidate.starts[0][0], 2, 1e-2);
        EXPECT_NEAR(candidate.starts[0][1], period, 1e-3 * period);
        return;
    }
    FAIL();
}

} // namespace
} // namespace tribode
