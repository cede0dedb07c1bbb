#include "physics/reference_machine.hpp"
#include "tribode/analysis/delay_estimation.hpp"
#include "tribode/analysis/modal_fit.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/experiment/friction_margins.hpp"
#include "tribode/experiment/simulation.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

SweepResult sweep(double friction_feedback, std::vector<double> frequency_hz) {
    SweepOptions options;
    options.frequency_hz = std::move(frequency_hz);
    options.friction_feedback = friction_feedback;
    RunControl control;
    control.workers = 2;
    return run_sweep(machine_of(reference_description()), options, control);
}

// Half the range of the true position over a part of a run that begins with a push of 20 ms.
struct AfterPush {
    ServoTrace trace;

    AfterPush(const Json& description, double friction_feedback, double push, double seconds) {
        const MachineModel machine = machine_of(description);
        DriveRecord record;
        for (int k = 0; k * machine.sample_time < seconds; ++k) {
            record.t.push_back(k * machine.sample_time);
            record.excitation.push_back(k * machine.sample_time < 0.02 ? push : 0);
        }
        trace = simulate(machine, record, {.friction_feedback = friction_feedback}).trace;
    }
    double range(double from, double to) const {
        const auto at = [&](double part) { return trace.x.begin() + std::lround(part * double(trace.x.size())); };
        const auto [least, most] = std::minmax_element(at(from), at(to));
        return (*most - *least) / 2;
    }
};

Json without_rounding() {
    Json d = reference_description();
    d["encoder_resolution_m"] = 0.0;
    return d;
}

TEST(FrictionFeedbackPhysics, AddedOnOrCalculatedFra2IdentifiesTheSamePlantAt15N) {
    std::vector<double> frequency_hz;
    for (int i = 0; i < 60; ++i) frequency_hz.push_back(10 + i * 190.0 / 59);
    const auto identified = [](const FrequencyResponse& response) {
        return fit_modal_model(response.remove_delay(phase_delay(response, 120)), {}).model;
    };
    const ModalModel calculated = identified(sweep(0, frequency_hz).response(1));
    const ModalModel added = identified(sweep(1, frequency_hz).add_on());
    // Both see (1 - Gi Go) f too much, eq. (5), at somewhat different amplitudes: with friction fed back the thrust is
    // another. Gains and frequencies bear that out to a percent, the dampings, which friction makes, to a tenth.
    EXPECT_NEAR(added.rigid_gain / calculated.rigid_gain, 1, 0.01);
    for (std::size_t i = 0; i < 2; ++i) {
        EXPECT_NEAR(added.modes[i].gain / calculated.modes[i].gain, 1, 0.02) << i;
        EXPECT_NEAR(added.modes[i].freq_hz / calculated.modes[i].freq_hz, 1, 0.001) << i;
        EXPECT_NEAR(added.modes[i].zeta / calculated.modes[i].zeta, 1, 0.1) << i;
    }
    EXPECT_LT(added.rigid_gain, 0.97 * 94.28e-3) << "the bias of the delay";
}

TEST(FrictionFeedbackPhysics, TheDescribingFunctionGivesTheLoopGainOfASweep) {
    const MachineModel machine = machine_of(reference_description());
    for (const double share : {0.0, 0.8, 1.0}) {
        const SweepResult result = sweep(share, {12, 20, 40, 60, 100});
        std::vector<double> amplitude;
        for (const auto& point : result.points) amplitude.push_back(std::abs(point.position));
        const FrequencyResponse seen = result.loop_gain();
        const FrequencyResponse made = friction_loop_gain(machine, share, amplitude, seen.frequency_hz);
        ASSERT_EQ(seen.size(), 5u);
        for (std::size_t i = 0; i < seen.size(); ++i) {
            // What harmonics, rounding and reversals between samples leave.
            EXPECT_LT(std::abs(seen.value[i] - made.value[i]) / std::abs(1.0 + made.value[i]), 0.05)
                << share << ", " << seen.frequency_hz[i];
        }
    }
}

// With an element that never slips all is linear: a small push dies away or grows.
TEST(FrictionFeedbackPhysics, AStuckAxisIsStableWhereNyquistsCriterionSaysSo) {
    Json d = without_rounding();
    d["friction"]["elements"] = {{{"K", 3.5e6}, {"F", 1e30}}};
    struct Case {
        double delay, share;
        bool stable;
    };
    for (const auto& [delay, share, stable] :
         {Case{0.5e-3, 0, true}, Case{0.5e-3, 0.8, true}, Case{0.5e-3, 1.05, false}, Case{1.5e-3, 0, false},
          Case{1.5e-3, 0.5, true}, Case{3e-3, 0.5, false}}) {
        d["input_delay_s"] = delay;
        EXPECT_EQ(friction_margins(machine_of(d), share, 0).stable, stable) << delay << ", " << share;
        const AfterPush run(d, share, 0.1, 4);
        const double early = run.range(0.25, 0.5), late = run.range(0.75, 1);
        EXPECT_EQ(late < early, stable) << delay << ", " << share << ": " << early << " m, then " << late << " m";
    }
}

TEST(FrictionFeedbackPhysics, TooMuchFrictionFedBackMakesTheLimitCycleOfTheDescribingFunction) {
    const Json d = without_rounding();
    EXPECT_LT(AfterPush(d, 0.9, 15, 3).range(0.8, 1), 1e-7); // comes to rest; the least element slips at 2.5e-7 m
    for (const double share : {1.1, 1.2, 1.5}) {
        const AfterPush run(d, share, 15, 3);
        const double amplitude = run.range(0.8, 1);
        EXPECT_NEAR(run.range(0.6, 0.8) / amplitude, 1, 0.02) << "it lasts";
        const auto critical = friction_margins(machine_of(d), share, amplitude).critical;
        ASSERT_TRUE(critical);
        // Harmonics of the motion are left out: a few parts in a thousand of the share.
        EXPECT_NEAR(critical->share, share, 0.01) << amplitude;
    }
}

} // namespace
} // namespace tribode
