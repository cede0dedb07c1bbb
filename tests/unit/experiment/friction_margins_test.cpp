#include "physics/reference_machine.hpp"
#include "tribode/base/error.hpp"
#include "tribode/experiment/friction_margins.hpp"
#include "tribode/machine/machine_controller.hpp"

#include <complex>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode {
namespace {

TEST(FrictionMargins, TheGainMarginFallsWithEveryShareThatIsFedBack) {
    const MachineModel machine = machine_of(reference_description());
    for (const double amplitude : {0.0, 1e-6, 1e-5}) {
        double before = 1e9;
        for (const double share : {0.0, 0.5, 0.8, 0.9, 1.0}) {
            const FrictionMargins found = friction_margins(machine, share, amplitude);
            ASSERT_TRUE(found.stable && found.margins.gain_margin) << share;
            EXPECT_LT(*found.margins.gain_margin, before) << share << " at " << amplitude;
            before = *found.margins.gain_margin;
        }
        EXPECT_LT(before, 1.05) << "little is left at 100 %";
        EXPECT_FALSE(friction_margins(machine, 1.2, amplitude).stable);
    }
}

TEST(FrictionMargins, LargeMotionsBearMoreThanAllOfTheFriction) {
    const auto found = friction_margins(machine_of(reference_description()), 1.2, 1e-3);
    EXPECT_TRUE(found.stable);
    ASSERT_TRUE(found.critical);
    EXPECT_GT(found.critical->share, 3);
}

// The response of a controller is what its steps make of a sine.
TEST(FrictionMargins, ControllersHaveTheResponseOfTheirSteps) {
    const Json filters = {{{"type", "notch"}, {"freq_hz", 82}, {"zeta", 0.4}, {"depth", 0.1}},
                          {{"type", "low_pass"}, {"freq_hz", 300}}};
    Json d = reference_description();
    for (const Json& controller :
         {Json{{"type", "cascade"}, {"kp", 40}, {"kv", 300}, {"ki", 60}, {"delay_samples", 2}, {"filters", filters}},
          Json{{"type", "pid"}, {"kp", 1e4}, {"ki", 1e5}, {"kd", 300}, {"filters", filters}}}) {
        d["controller"] = controller;
        const MachineModel machine = machine_of(d);
        const MachineController steps(machine);
        MachineController::State state;
        constexpr double f = 50; // 40 samples a period
        std::complex<double> sum = 0;
        for (int k = 0; k < 4040; ++k) {
            const auto turn = std::polar(1.0, 2 * std::numbers::pi * f * machine.sample_time * k);
            const double u = steps.step(state, 0, 1e-3 * turn.real());
            if (k >= 4000) sum += u * std::conj(turn) / 20.0;
        }
        EXPECT_NEAR(std::abs(-sum / 1e-3 / controller_response(machine, f) - 1.0), 0, 1e-9) << controller;
    }
}

TEST(FrictionMargins, WhatDoesNotFitIsRefused) {
    Json d = reference_description();
    const MachineModel machine = machine_of(d);
    EXPECT_THROW(friction_loop_gain(machine, 1, {1e-6, 1e-6}, {10}), InputError);
    EXPECT_THROW(friction_loop_gain(machine, 1, {1e-6}, {1000}), InputError);
    EXPECT_EQ(friction_loop_gain(machine, 1, {1e-6}, {10, 20}).size(), 2u);
    d.erase("friction");
    EXPECT_THROW(friction_margins(machine_of(d), 1, 0), InputError);
    d = reference_description();
    d.erase("controller");
    EXPECT_THROW(friction_margins(machine_of(d), 1, 0), InputError);
}

} // namespace
} // namespace tribode
