#include "tribode/machine/machine_model.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/options.hpp"
#include "tribode/base/text.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

constexpr int max_delayed_samples = 100000;

DryFriction read_dry_friction(FieldReader& friction) {
    DryFriction dry;
    dry.coulomb = friction.number("coulomb", "N", Allowed::non_negative, 0);
    dry.static_level = dry.coulomb;
    if (friction.has("stribeck")) {
        FieldReader stribeck = friction.table("stribeck");
        dry.static_level = stribeck.number("static", "N", Allowed::non_negative);
        dry.velocity = stribeck.number("velocity", "m/s", Allowed::positive);
        dry.exponent = stribeck.number("exponent", "", Allowed::positive, 1);
        stribeck.finish();
    } else {
        friction.table("stribeck"); // null is allowed
    }
    return dry;
}

ControllerSettings read_controller(FieldReader& machine) {
    if (!machine.has("controller")) {
        machine.table("controller"); // null is allowed
        return std::monostate{};
    }
    FieldReader fields = machine.table("controller");
    const std::string type = fields.choice("type", {"pid", "cascade"}, "pid");
    ControllerSettings settings;
    if (type == "pid") {
        PidSettings pid;
        pid.kp = fields.number("kp", "N/m", Allowed::finite);
        pid.ki = fields.number("ki", "N/(m s)", Allowed::finite, 0);
        pid.kd = fields.number("kd", "N s/m", Allowed::finite, 0);
        pid.derivative_filter_hz = fields.optional_number("derivative_filter_hz", "Hz", Allowed::positive);
        settings = pid;
    } else {
        CascadeSettings cascade;
        cascade.kp = fields.number("kp", "1/s", Allowed::finite);
        cascade.kv = fields.number("kv", "N s/m", Allowed::finite);
        cascade.limit = fields.optional_number("limit", "N", Allowed::positive);
        cascade.delay_samples = fields.integer("delay_samples", 0, max_delayed_samples, 0);
        settings = cascade;
    }
    fields.finish();
    return settings;
}

std::map<std::string, double> read_tolerance(FieldReader& machine) {
    FieldReader fields = machine.table("tolerance");
    std::map<std::string, double> tolerance;
    for (const char* key : {"rigid_gain_per_kg", "modes.gain", "modes.freq_hz", "modes.zeta", "friction.coulomb",
                            "friction.viscous", "friction.elements", "input_delay_s", "current_loop_hz"}) {
        if (const auto value = fields.optional_number(key, "", Allowed::non_negative)) tolerance[key] = *value;
    }
    fields.finish();
    return tolerance;
}

} // namespace

MachineModel MachineModel::from_description(const Json& description, const std::string& where) {
    FieldReader fields(description, where);
    MachineModel m;
    m.description = description;
    m.sample_time = fields.number("Ts", "s", Allowed::positive, 5e-4);
    m.rigid_gain = fields.number("rigid_gain_per_kg", "m/(N s^2)", Allowed::non_negative, 0);
    fields.each("modes", [&](FieldReader& mode) {
        m.modes.push_back({mode.number("gain", "m/(N s^2)", Allowed::positive),
                           mode.number("freq_hz", "Hz", Allowed::positive),
                           mode.number("zeta", "", Allowed::non_negative)});
    });
    if (m.rigid_gain == 0 && m.modes.empty()) {
        fields.fail("rigid_gain_per_kg", "is zero or missing and there is no mode: nothing could move");
    }

    FieldReader friction = fields.table("friction");
    m.dry = read_dry_friction(friction);
    m.viscous = friction.number("viscous", "N s/m", Allowed::non_negative, 0);
    OptionReader(friction).list("elements", m.elements);
    friction.finish();

    m.input_delay = fields.number("input_delay_s", "s", Allowed::non_negative, 0);
    m.output_delay = fields.number("output_delay_s", "s", Allowed::non_negative, 0);
    for (const auto& [key, delay] : {std::pair{"input_delay_s", m.input_delay}, {"output_delay_s", m.output_delay}}) {
        if (delay > max_delayed_samples * m.sample_time) {
            fields.fail(key,
                        fmt::format("= {} s, must be {} sample times at most", to_text(delay), max_delayed_samples));
        }
    }
    m.current_loop_hz = fields.optional_number("current_loop_hz", "Hz", Allowed::positive).value_or(0);
    m.encoder_resolution = fields.number("encoder_resolution_m", "m", Allowed::non_negative, 0);
    m.noise_rms = fields.number("noise_rms_m", "m", Allowed::non_negative, 0);
    m.process_noise_rms = fields.number("process_noise_rms_N", "N", Allowed::non_negative, 0);
    m.controller = read_controller(fields);
    m.closed_loop = fields.boolean("closed_loop", m.has_controller());
    m.input =
        fields.choice("input", {"hold", "band_limited"}, "hold") == "hold" ? InputKind::hold : InputKind::band_limited;
    if (m.input == InputKind::band_limited && m.closed_loop && m.has_controller()) {
        fields.fail("input", "= \"band_limited\" needs u as a whole record, so closed_loop must be false");
    }
    m.initial =
        fields.choice("initial", {"rest", "fitted"}, "rest") == "rest" ? InitialKind::rest : InitialKind::fitted;
    m.tolerance = read_tolerance(fields);
    fields.each("effects", [&](FieldReader& effect) { m.effects.push_back(Effect::read(effect)); });
    fields.finish();
    try {
        m.axis();
    } catch (const InputError& error) {
        throw InputError(fmt::format("{}: {}{}", where, m.effects.empty() ? "" : "effects: ", error.what()));
    }
    return m;
}

MachineModel MachineModel::with_effects(std::vector<Effect> others) const {
    MachineModel m = *this;
    m.effects = std::move(others);
    m.description["effects"] = Json::array();
    for (const auto& effect : m.effects) m.description["effects"].push_back(effect.to_json());
    m.axis(); // may refuse
    return m;
}

ServoAxis MachineModel::axis() const {
    ServoAxis axis;
    axis.plant = {rigid_gain, modes, RollingFriction(elements), dry, viscous, current_loop_hz};
    axis.input_delay = input_delay;
    axis.encoder_resolution = encoder_resolution;
    for (const auto& effect : effects) effect.apply(axis);
    axis.require_possible();
    if (axis.input_delay > max_delayed_samples * sample_time) {
        throw InputError(fmt::format("they leave an input delay of {} s, must be {} sample times at most",
                                     to_text(axis.input_delay), max_delayed_samples));
    }
    return axis;
}

// The fields in order of their names, notes left out, numbers as doubles: however a machine was written, it is the same.
static void append_canonical(std::string& text, const Json& value) {
    if (value.is_object()) {
        std::map<std::string, const Json*> fields;
        for (const auto& [key, field] : value.items()) {
            if (!FieldReader::is_note(key) && !field.is_null()) fields[key] = &field;
        }
        for (const auto& [key, field] : fields) {
            text += key + "{";
            append_canonical(text, *field);
            text += "}";
        }
    } else if (value.is_array()) {
        for (const auto& entry : value) {
            text += "[";
            append_canonical(text, entry);
            text += "]";
        }
    } else if (value.is_number()) {
        append_text(text, value.get<double>());
    } else {
        text += value.dump();
    }
}

std::string MachineModel::hash() const {
    std::string text;
    append_canonical(text, description);
    return sha256(text);
}

} // namespace tribode
