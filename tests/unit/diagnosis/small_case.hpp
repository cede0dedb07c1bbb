#pragma once
#include "tribode/diagnosis/measurement.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/machine/machine_model.hpp"

#include <cmath>
#include <numbers>
#include <string>

namespace tribode::diagnosis_cases {

// A bare axis under a PID loop with a noisy encoder, as a user would describe it.
inline Json small_axis() {
    return Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.1, "friction": {"coulomb": 5, "viscous": 4},
        "input_delay_s": 0.0005, "current_loop_hz": 900, "encoder_resolution_m": 1e-7, "noise_rms_m": 1e-7,
        "controller": {"type": "pid", "kp": 40000, "ki": 500000, "kd": 800, "derivative_filter_hz": 300}})");
}

// Moves to and fro: a sine that begins gently, of an amplitude [m] and a frequency [Hz].
inline DriveRecord sine_record(double amplitude, double frequency, double seconds) {
    DriveRecord record;
    for (int k = 0; k < static_cast<int>(seconds / 5e-4); ++k) {
        const double t = k * 5e-4;
        record.t.push_back(t);
        record.reference.push_back(amplitude * (1 - std::cos(2 * std::numbers::pi * frequency * t)) / 2);
        record.excitation.push_back(0);
    }
    return record;
}

// What the machine with hidden effects would have measured.
inline Table measured(Json machine, const Json& hidden, const DriveRecord& record, std::uint64_t seed) {
    machine["effects"] = hidden;
    const Simulation run = simulate(MachineModel::from_description(machine, "case"), record, {.seed = seed});
    Table table;
    table.add("t", "s", run.trace.t);
    table.add("r", "m", run.trace.r);
    table.add("u", "N", run.trace.u);
    table.add("y", "m", run.trace.y);
    return table;
}

} // namespace tribode::diagnosis_cases
