#pragma once
#include "tribode/machine/servo_system.hpp"
#include "tribode/plant/servo_plant_tangent.hpp"

#include <functional>
#include <string>
#include <vector>

namespace tribode {

// All numbers that a servo system is made of, its effects applied; or their derivatives by one parameter.
struct ServoNumbers {
    double sample_time = 0, encoder_resolution = 0; // by which a run has no derivative
    double output_delay = 0, input_delay = 0, noise_rms = 0, process_noise_rms = 0;
    Amplifier amplifier;
    std::vector<PeriodicEncoderError> encoder_errors;
    Controller controller;
    ServoPlantNumbers plant;
    ServoSystem::Start start{0.0, 0.0};

    // At rest where the model is at rest. Throws InputError where its effects do not fit.
    static ServoNumbers of(const MachineModel& model);

    static void each(auto& n, const auto& act) {
        for (auto* number : {&n.sample_time, &n.encoder_resolution, &n.output_delay, &n.input_delay, &n.noise_rms,
                             &n.process_noise_rms, &n.amplifier.limit, &n.amplifier.half_width, &n.amplifier.gain,
                             &n.amplifier.exponent, &n.amplifier.size, &n.start.position, &n.start.velocity}) {
            act(*number);
        }
        for (auto& error : n.encoder_errors) {
            for (auto* number :
                 {&error.amplitude, &error.period, &error.phase, &error.second_amplitude, &error.second_phase}) {
                act(*number);
            }
        }
        const auto each_filter = [&](auto& filters) {
            for (auto& filter : filters) {
                for (auto* number : {&filter.freq_hz, &filter.zeta, &filter.depth}) act(*number);
            }
        };
        if (auto* pid = std::get_if<PidController>(&n.controller)) {
            each_filter(pid->filters);
            for (auto* number : {&pid->kp, &pid->ki, &pid->kd, &pid->derivative_filter_hz}) act(*number);
        }
        if (auto* cascade = std::get_if<CascadeController>(&n.controller)) {
            each_filter(cascade->filters);
            for (auto* number : {&cascade->kp, &cascade->kv, &cascade->ki, &cascade->limit}) act(*number);
        }
        ServoPlantNumbers::each(n.plant, act);
    }
};

// What a run is differentiated by: a parameter of its machine, its start, or a factor on its input.
struct ServoDirection {
    std::string name;
    ServoNumbers numbers;                             // their derivatives
    double thrust = 0, reference = 0, excitation = 0; // 1: of a factor on these
};

// By a field of the machine, "friction.coulomb" or "modes[1].freq_hz"; by the start, "start.position_m" or
// "start.velocity_m_per_s"; by a factor on "u", "r" or "exc". Throws InputError where there is no such number, and where a run
// has no derivative by it.
ServoDirection servo_direction(const MachineModel& model, const std::string& name);

// Along a family of machines model(c) at c = 0, smooth there, that have the same parts. size: c that changes little.
ServoDirection servo_direction(const std::string& name, const std::function<MachineModel(double c)>& model,
                               double size);

} // namespace tribode
