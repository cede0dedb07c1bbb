#pragma once
#include "tribode/machine/machine_model.hpp"

#include <numbers>

namespace tribode {

// The linear-motor-driven table in closed loop: two modes, twenty elements with half of the printed swings,
// delays, thrust lag, encoder, and a PID controller with a bandwidth of 7 Hz. Its friction and linear
// dynamics are those of problems::linear_motor_table().
inline Json reference_description() {
    constexpr double table[][2] = {// F_m [N], K [N/mm]
                                   {1.12, 2226.6}, {0.60, 602.1}, {0.33, 165.1}, {0.54, 154.9}, {0.49, 81.6},
                                   {0.46, 56.8},   {0.16, 15.8},  {0.36, 30.0},  {0.25, 17.9},  {0.73, 45.8},
                                   {0.73, 36.2},   {0.88, 29.3},  {1.34, 26.8},  {1.23, 16.4},  {0.77, 7.7},
                                   {0.72, 3.6},    {0.97, 2.0},   {1.08, 1.1},   {1.74, 0.9},   {0.89, 0.3}};
    const double mass = 1 / 94.28e-3, omega = 2 * std::numbers::pi * 7;
    Json d;
    d["Ts"] = 5e-4;
    d["rigid_gain_per_kg"] = 94.28e-3;
    d["modes"] = {{{"gain", 13.08e-3}, {"freq_hz", 33.32}, {"zeta", 2.48e-2}},
                  {{"gain", 5.27e-3}, {"freq_hz", 82.22}, {"zeta", 3.22e-3}}};
    d["friction"]["viscous"] = 2.35;
    for (const auto& [swing, stiffness] : table) {
        d["friction"]["elements"].push_back({{"K", 1000 * stiffness}, {"F", swing / 2}});
    }
    d["friction"]["elements"].back()["D"] = 10.0;
    d["input_delay_s"] = 5e-4;
    d["output_delay_s"] = 4.18e-4;
    d["current_loop_hz"] = 750.0;
    d["encoder_resolution_m"] = 1e-7;
    d["controller"] = {{"type", "pid"},
                       {"kp", mass * omega * omega},
                       {"kd", 1.4 * mass * omega},
                       {"ki", mass * omega * omega * omega / 5}};
    return d;
}

// The same machine without controller, delays, thrust lag and encoder.
inline Json bare_description() {
    Json d = reference_description();
    for (const char* key :
         {"input_delay_s", "output_delay_s", "current_loop_hz", "encoder_resolution_m", "controller"}) {
        d.erase(key);
    }
    return d;
}

inline MachineModel machine_of(const Json& description) { return MachineModel::from_description(description, "test"); }

} // namespace tribode
