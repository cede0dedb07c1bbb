// Exponential collocation beside the exact solution and beside erk, on machines with every smooth effect.
#include "tribode/base/error.hpp"
#include "tribode/experiment/simulation.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <string>

namespace tribode {
namespace {

MachineModel machine_with(const std::string& effect, const std::string& friction) {
    Json machine = Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.09428, "closed_loop": true,
        "modes": [{"gain": 0.01308, "freq_hz": 33.32, "zeta": 0.0248}], "current_loop_hz": 750,
        "input_delay_s": 0.0005, "output_delay_s": 0.000418,
        "controller": {"type": "pid", "kp": 20500, "ki": 180000, "kd": 650}})");
    machine["friction"] = Json::parse(friction);
    if (!effect.empty()) machine["effects"] = Json::array({Json::parse(effect)});
    return MachineModel::from_description(machine, "collocation_test");
}

const std::string elements = R"({"viscous": 2.35, "elements": [{"K": 1e6, "F": 0.5}, {"K": 3e4, "F": 2.5}]})";
const std::string coulomb = R"({"viscous": 2.35, "coulomb": 4})";

// Half a second of a slow reciprocation with a faster one on it.
DriveRecord record() {
    DriveRecord drive;
    for (int k = 0; k <= 1000; ++k) {
        const double t = k * 5e-4;
        drive.t.push_back(t);
        drive.reference.push_back(0.01 * (1 - std::cos(2 * std::numbers::pi * 2 * t)));
        drive.excitation.push_back(5 * std::sin(2 * std::numbers::pi * 23 * t));
    }
    return drive;
}

Simulation run(const MachineModel& machine, Method method, double tolerance) {
    static const DriveRecord drive = record();
    return simulate(
        machine, drive,
        {.solver = {.method = method, .relative_tolerance = tolerance, .absolute_tolerance = 1e-4 * tolerance}});
}

double largest_difference(const Simulation& a, const Simulation& b) {
    EXPECT_EQ(a.trace.x.size(), b.trace.x.size());
    double largest = 0;
    for (std::size_t i = 0; i < a.trace.x.size(); ++i) {
        largest = std::max(largest, std::abs(a.trace.x[i] - b.trace.x[i]));
    }
    return largest;
}

class Collocation : public testing::TestWithParam<std::string> {};

INSTANTIATE_TEST_SUITE_P(
    effects, Collocation,
    testing::Values(
        R"({"name": "force_ripple", "parameters": {"harmonics": [{"F": 3, "period_m": 0.02, "phase": 0.3}]}})",
        R"({"name": "cubic_stiffness", "parameters": {"k3": 1e6, "y0": 0.005}})",
        R"({"name": "quadratic_drag", "parameters": {"c": 50}})",
        R"({"name": "position_dependent_friction",
            "parameters": {"mode": "sine", "a": 0.3, "period_m": 0.01, "phase": 0.5}})",
        R"({"name": "time_varying_friction", "parameters": {"kind": "exp", "a": 0.4, "T": 1}})",
        R"({"name": "stribeck_friction", "parameters": {"dFs": 3, "velocity": 0.01}})",
        R"({"name": "load_dependent_friction", "parameters": {"share": 0.1, "reach": 1e-4}})",
        R"({"name": "lugre_friction", "parameters": {"F": 2, "Fs": 3, "velocity": 0.01, "K": 1e5, "D": 30}})"));

// The reference is erk at 1e-12, itself good to 1e-13 m or so; an encoder step is 1e-7 m. A relative error of 1e-6 of a
// deflection is one of a friction of 3 N, which moves a loop of 2e4 N/m by 1.5e-10 m.
TEST_P(Collocation, agrees_with_erk_and_converges_with_the_tolerance) {
    for (const auto& friction : {elements, coulomb}) {
        const auto machine = machine_with(GetParam(), friction);
        const auto reference = run(machine, Method::erk, 1e-12);
        ASSERT_TRUE(reference.outcome.ok());
        const bool has_deflection =
            GetParam().find("load_dependent") != GetParam().npos || GetParam().find("lugre") != GetParam().npos;
        for (const auto& [tolerance, bound] :
             {std::pair{1e-6, has_deflection ? 3e-10 : 1e-10}, {1e-8, 1e-11}, {1e-10, 1e-12}}) {
            const auto found = run(machine, Method::collocation, tolerance);
            ASSERT_TRUE(found.outcome.ok()) << found.outcome.message;
            EXPECT_LT(largest_difference(found, reference), bound) << tolerance;
            EXPECT_EQ(found.events.size(), reference.events.size()) << tolerance;
        }
    }
}

// An affine machine has no forcing, and the method is then that of exact, to rounding.
TEST(CollocationOfAffineMachines, is_the_exact_solution) {
    for (const auto& friction : {elements, coulomb}) {
        const auto machine = machine_with("", friction);
        const auto exact = run(machine, Method::exact, 1e-6), found = run(machine, Method::collocation, 1e-6);
        EXPECT_LT(largest_difference(found, exact), 1e-14);
        EXPECT_EQ(found.events.size(), exact.events.size());
    }
}

} // namespace
} // namespace tribode
