#pragma once
#include "tribode/base/json.hpp"
#include "tribode/base/options.hpp"
#include "tribode/control/cascade_controller.hpp"
#include "tribode/control/pid_controller.hpp"
#include "tribode/effect/effect.hpp"
#include "tribode/friction/dry_friction.hpp"
#include "tribode/friction/rolling_friction.hpp"
#include "tribode/plant/servo_plant.hpp"

#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <variant>
#include <vector>

namespace tribode {

using Controller = std::variant<std::monostate, PidController, CascadeController>;

enum class InputKind { hold, band_limited }; // how u runs between its samples
enum class InitialKind { rest, fitted };     // the state at the first sample

// A servo machine as its user describes it: validated, SI units. describe() is the one list of its fields: reading, writing, the
// hash, paths, tolerances, warnings and the table in docs/machine-description.md visit it.
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
    Controller controller;
    std::optional<bool> closed_loop; // none: where there is a controller
    InputKind input = InputKind::hold;
    InitialKind initial = InitialKind::rest;
    std::map<std::string, double> tolerance; // relative standard deviations of uncertain fields, by key
    std::vector<Effect> effects;             // applied in this order

    // Paths of optional fields that its description left to their defaults. They are neither written nor hashed as long as
    // they have them.
    std::set<std::string> left_out;

    static void describe(auto& m, auto& fields) {
        describe_known(m, fields);
        fields.group(
            "tolerance",
            [&](auto& tolerance) {
                for (const auto& key : tolerance_keys()) {
                    tolerance.entry(key, m.tolerance, "", Allowed::non_negative,
                                    About().usually(1e-6, 1, "it is relative: 0.05 means 5 %"));
                }
            },
            "relative standard deviations of uncertain fields, used by `tribode diagnose`; a field that is absent is "
            "exact");
        fields.entries(
            "effects", m.effects, [](FieldReader& effect) { return Effect::begin(effect); }, describe_struct,
            "`name` and `parameters` of each further [effect](effects.md)");
    }

    // Throws InputError with the field, what was found and what is allowed. `where`: the file it came from.
    static MachineModel from_description(const Json& description, const std::string& where);
    // The fields, as from_description() takes them. Notes of the original are not kept.
    Json description() const;
    // SHA-256 of the fields: the same for the same fields, in whatever order and with whatever notes they were written.
    std::string hash() const;

    // A copy with fields replaced, {"friction.viscous": 2.5, "modes[1].freq_hz": 33}, and after that numbers multiplied,
    // {"friction.elements[*].F": 1.1}; see field_path.hpp. Throws InputError with the path.
    MachineModel with_fields(const Json& replaced, const Json& scaled, const std::string& where) const;
    // The value of one field as it is written; null where it is none.
    Json field(const std::string& path) const;

    // All its numbers, in the order of its fields. Copies with as many modes, elements and effects have the same at the same
    // place.
    std::vector<double*> numbers();

    // Numbers that a fit moves together by one factor, where their tolerance allows it; see About::uncertain().
    struct UncertainField {
        std::string name;                // "modes[1].freq_hz", "friction.elements"
        double deviation;                // relative standard deviation, > 0
        std::vector<std::size_t> places; // in numbers()
    };
    std::vector<UncertainField> uncertain_fields() const;

    // One sentence for each field with an implausible value, such as an encoder step of one metre.
    std::vector<std::string> warnings(const std::string& where) const;

    // The keys a tolerance may have.
    static const std::vector<std::string>& tolerance_keys();
    // The fields as a table in Markdown, for docs/machine-description.md.
    static std::string field_table();

    // The same machine with these effects instead of its own; its description and hash say so. Throws InputError where
    // an effect does not fit the machine.
    MachineModel with_effects(std::vector<Effect> others) const;

    // The axis of the fields with the effects applied: what ServoSystem is made of.
    ServoAxis axis() const;
    bool has_controller() const { return !std::holds_alternative<std::monostate>(controller); }
    // Whether a record with both r and u is run in closed loop.
    bool in_closed_loop() const { return has_controller() && closed_loop.value_or(true); }

  private:
    // All but the tolerances and the effects.
    static void describe_known(auto& m, auto& fields) {
        fields.number("Ts", m.sample_time, "s", Allowed::positive,
                      About("sample time of controller and encoder").usually(1e-6, 0.1));
        fields.number("rigid_gain_per_kg", m.rigid_gain, "m/(N s^2)", Allowed::non_negative,
                      About("k0, the inverse of the moving mass; may be zero if there is a mode")
                          .usually(1e-6, 10, "it is the inverse of the moving mass, not the mass")
                          .uncertain("rigid_gain_per_kg"));
        fields.list("modes", m.modes, "vibration modes");
        fields.group("friction", [&](auto& friction) {
            DryFriction::describe(m.dry, friction);
            friction.number("viscous", m.viscous, "N s/m", Allowed::non_negative,
                            About("D_v").usually(1e-6, 1e6).uncertain("friction.viscous"));
            friction.list("elements", m.elements, "Maxwell-slip elements");
        });
        fields.number("input_delay_s", m.input_delay, "s", Allowed::non_negative,
                      About("dead time from the sample instant to the actuator, in addition to the hold")
                          .usually(1e-9, 0.1)
                          .uncertain("input_delay_s"));
        fields.number("output_delay_s", m.output_delay, "s", Allowed::non_negative,
                      About("y[k] is the position at t_k − output_delay_s").usually(1e-9, 0.1));
        fields.optional("current_loop_hz", m.current_loop_hz, 0.0, "Hz", Allowed::positive,
                        About("first-order lag of the thrust").usually(1, 1e5).uncertain("current_loop_hz"));
        fields.number(
            "encoder_resolution_m", m.encoder_resolution, "m", Allowed::non_negative,
            About("rounding to the nearest multiple, halves upward; 0: exact").usually(1e-14, 1e-3, "it is in meters"));
        fields.number(
            "noise_rms_m", m.noise_rms, "m", Allowed::non_negative,
            About("white noise of the sensor, added before rounding").usually(1e-15, 1e-3, "it is in meters"));
        fields.number("process_noise_rms_N", m.process_noise_rms, "N", Allowed::non_negative,
                      About("unmodeled force: white, constant over a sample time").usually(1e-6, 1e4));
        fields.variant("controller", m.controller, "type", {"pid", "cascade"});
        fields.flag(
            "closed_loop", m.closed_loop,
            "whether a record with both r and u is run in closed loop; without it: true if there is a controller");
        fields.choice("input", m.input, {"hold", "band_limited"},
                      "how u runs between its samples; `\"band_limited\"` in open loop only");
        fields.choice("initial", m.initial, {"rest", "fitted"},
                      "state at the first sample; `\"fitted\"`: position and velocity from the measured y");
    }

    class Replacer;
    static MachineModel read(const Json& description, const std::string& where); // not checked as a whole
    void replace(const std::string& path, const Json& value, const std::string& where);
    void check(const std::string& where) const;
};

} // namespace tribode
