#pragma once
#include "tribode/base/json.hpp"
#include "tribode/effect/effect.hpp"
#include "tribode/friction/dry_friction.hpp"
#include "tribode/friction/rolling_friction.hpp"
#include "tribode/plant/servo_plant.hpp"

#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace tribode {

// PID settings of a machine; the equations are those of PidController.
struct PidSettings {
    double kp = 0, ki = 0, kd = 0;              // [N/m], [N/(m s)], [N s/m]
    std::optional<double> derivative_filter_hz; // none: no filter
};

// Cascade settings; the equations are those of CascadeController.
struct CascadeSettings {
    double kp = 0;               // [1/s]
    double kv = 0;               // [N s/m]
    std::optional<double> limit; // [N]
    long delay_samples = 0;
};

using ControllerSettings = std::variant<std::monostate, PidSettings, CascadeSettings>;

enum class InputKind { hold, band_limited }; // how u runs between its samples
enum class InitialKind { rest, fitted };     // the state at the first sample

// A servo machine as its user describes it: validated, SI units. The fields are those of the machine description
// (docs/machine-description.md); what is absent there is zero or none here.
struct MachineModel {
    double sample_time = 5e-4; // Ts [s]
    double rigid_gain = 0;     // k0 [m/(N s^2)]
    std::vector<VibrationMode> modes;
    std::vector<MaxwellSlipElement> elements;
    DryFriction dry;
    double viscous = 0;            // D_v [N s/m]
    double input_delay = 0;        // [s], sample instant to actuator, besides the hold
    double output_delay = 0;       // [s], y[k] is the position at t_k - output_delay
    double current_loop_hz = 0;    // 0: none
    double encoder_resolution = 0; // [m], 0: exact
    double noise_rms = 0;          // [m], white, added before rounding
    double process_noise_rms = 0;  // [N], force noise of which only the size is known
    ControllerSettings controller;
    bool closed_loop = false;
    InputKind input = InputKind::hold;
    InitialKind initial = InitialKind::rest;
    std::map<std::string, double> tolerance; // relative standard deviations of what is not sure
    std::vector<Effect> effects;             // applied in this order
    Json description;                        // the fields as read, notes included

    // Throws InputError with the field, what was found and what is allowed. `where`: the file it came from.
    static MachineModel from_description(const Json& description, const std::string& where);

    // The same machine with these effects instead of its own; its description and hash say so. Throws InputError where
    // an effect does not fit the machine.
    MachineModel with_effects(std::vector<Effect> others) const;

    // The axis of the fields with the effects applied: what ServoSystem is made of.
    ServoAxis axis() const;
    bool has_controller() const { return !std::holds_alternative<std::monostate>(controller); }

    // SHA-256 of the fields: the same for the same machine, however it was written.
    std::string hash() const;
};

} // namespace tribode
