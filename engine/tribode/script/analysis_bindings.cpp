#include "tribode/analysis/delay_estimation.hpp"
#include "tribode/analysis/friction_identification.hpp"
#include "tribode/analysis/modal_fit.hpp"
#include "tribode/analysis/signal.hpp"
#include "tribode/base/error.hpp"
#include "tribode/control/discrete_transfer_function.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/machine/friction_model.hpp"
#include "tribode/script/conversions.hpp"
#include "tribode/script/lua_function.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

Json model_response(const Json& arguments) {
    FieldReader fields(arguments, "tb.model_response");
    const auto frequency_hz = fields.numbers("frequency_hz", "Hz", Allowed::positive, {});
    const ModalModel model = modal_model_from_json(fields.value("model"), "tb.model_response");
    fields.finish();
    FrequencyResponse response;
    for (const double f : frequency_hz) {
        response.frequency_hz.push_back(f);
        response.value.push_back(model.response(f));
    }
    return to_json(response);
}

Json fit_modal(const Json& arguments) {
    FieldReader fields(arguments, "tb.fit_modal");
    const FrequencyResponse response = response_of(fields);
    ModalFitOptions options;
    read_options(options, fields);
    fields.finish();
    return to_json(fit_modal_model(response, options));
}

Json read_phase_delay(const Json& arguments) {
    FieldReader fields(arguments, "tb.phase_delay");
    const FrequencyResponse response = response_of(fields);
    const double frequency = fields.number("at_hz", "Hz", Allowed::positive);
    fields.finish();
    return phase_delay(response, frequency);
}

Json remove_delay(const Json& arguments) {
    FieldReader fields(arguments, "tb.remove_delay");
    const FrequencyResponse response = response_of(fields);
    const double delay = fields.number("delay_s", "s", Allowed::finite);
    fields.finish();
    return to_json(response.remove_delay(delay));
}

// Frequency by frequency: the delay model of a sweep, as the sampled block has it.
Json delay_model_response(const Json& arguments) {
    FieldReader fields(arguments, "tb.delay_model_response");
    const double delay = fields.number("delay_s", "s", Allowed::non_negative);
    const int order = static_cast<int>(fields.integer("delay_order", 1, 10, SweepOptions{}.delay_order));
    const double sample_time = fields.number("sample_time_s", "s", Allowed::positive);
    FrequencyResponse response;
    response.frequency_hz = fields.numbers("frequency_hz", "Hz", Allowed::positive, {});
    fields.finish();
    const auto model = DiscreteTransferFunction::pade_delay(delay, order, sample_time);
    for (const double f : response.frequency_hz) response.value.push_back(model.response(f, sample_time));
    return to_json(response);
}

Json proposed(const Json& arguments) {
    FieldReader fields(arguments, "tb.proposed_response");
    const FrequencyResponse fra1 = response_of(fields, "fra1"), fra2 = response_of(fields, "fra2");
    const double delay = fields.number("delay_s", "s", Allowed::finite);
    fields.finish();
    return to_json(proposed_response(fra1, fra2, delay));
}

Json loop_delay(const Json& arguments) {
    FieldReader fields(arguments, "tb.estimate_delay");
    const FrequencyResponse fra1 = response_of(fields, "fra1"), fra2 = response_of(fields, "fra2");
    const double f_min = fields.number("f_min_hz", "Hz", Allowed::positive);
    const double f_max = fields.number("f_max_hz", "Hz", Allowed::positive);
    const double expected = fields.number("expected_s", "s", Allowed::finite, 0);
    fields.finish();
    const DelayEstimate estimate = estimate_delay(fra1, fra2, f_min, f_max, expected);
    return {{"delay_s", estimate.delay},
            {"spread_s", estimate.spread},
            {"frequency_hz", estimate.frequency_hz},
            {"delays_s", estimate.delays}};
}

// ---- friction ----------------------------------------------------------------------------------------------------

std::vector<MaxwellSlipElement> elements_of(FieldReader& fields) {
    std::vector<MaxwellSlipElement> elements;
    OptionReader(fields).list("elements", elements);
    return elements;
}

Json identify_friction(const Json& arguments) {
    FieldReader fields(arguments, "tb.fit_friction");
    const auto position = fields.numbers("position", "m", Allowed::finite, {});
    const auto force = fields.numbers("force", "N", Allowed::finite, {});
    FrictionFitOptions options;
    read_options(options, fields);
    fields.finish();
    const FrictionFit fit = fit_friction(position, force, options, "tb.fit_friction");
    Json json{{"elements", Json::array()}, {"residual_rms", fit.residual_rms}, {"residual_max", fit.residual_max}};
    for (const auto& element : fit.elements) {
        json["elements"].push_back({{"K", element.stiffness}, {"F", element.level}, {"D", element.damping}});
    }
    return json;
}

Json friction_force(const Json& arguments) {
    FieldReader fields(arguments, "tb.friction_force");
    if (fields.has("machine")) {
        const MachineModel machine = machine_of(fields);
        const auto position = fields.numbers("position", "m", Allowed::finite, {});
        const auto thrust = fields.numbers("thrust", "N", Allowed::finite, std::vector<double>(position.size(), 0.0));
        fields.finish();
        if (thrust.size() != position.size()) {
            throw InputError(fmt::format("tb.friction_force: {} values of thrust, must be as many as positions, {}",
                                         thrust.size(), position.size()));
        }
        MeasuredFriction friction(FrictionModel::of(machine), machine);
        std::vector<double> force;
        for (std::size_t k = 0; k < position.size(); ++k) force.push_back(friction.step(position[k], thrust[k]));
        return force;
    }
    const auto elements = elements_of(fields);
    const auto position = fields.numbers("position", "m", Allowed::finite, {});
    fields.finish();
    return rolling_force(elements, position);
}

// ---- signals -----------------------------------------------------------------------------------------------------

Json low_pass(const Json& arguments) {
    FieldReader fields(arguments, "tb.low_pass");
    const auto values = fields.numbers("values", "", Allowed::finite, {});
    const double sample_time = fields.number("sample_time_s", "s", Allowed::positive);
    const double corner = fields.number("corner_hz", "Hz", Allowed::positive);
    const int order = static_cast<int>(fields.integer("order", 2, 20, 4));
    fields.finish();
    return zero_phase_low_pass(values, sample_time, corner, order);
}

Json decimate(const Json& arguments) {
    FieldReader fields(arguments, "tb.decimate");
    const auto values = fields.numbers("values", "", Allowed::finite, {});
    const int factor = static_cast<int>(fields.integer("factor", 2, 1000, 10));
    fields.finish();
    return decimated(values, factor);
}

Json derivative(const Json& arguments) {
    FieldReader fields(arguments, "tb.derivative");
    const auto values = fields.numbers("values", "", Allowed::finite, {});
    const double sample_time = fields.number("sample_time_s", "s", Allowed::positive);
    fields.finish();
    return central_differences(values, sample_time);
}

Json least_squares(const Json& arguments) {
    FieldReader fields(arguments, "tb.least_squares");
    std::vector<std::vector<double>> columns;
    for (const auto& column : fields.value("columns")) {
        columns.emplace_back();
        for (const auto& entry : column) {
            if (!entry.is_number()) fields.fail("columns", "must be a list of lists of numbers");
            columns.back().push_back(entry.get<double>());
        }
    }
    const auto values = fields.numbers("values", "", Allowed::finite, {});
    fields.finish();
    const LinearFit fit = linear_fit(columns, values);
    return {{"coefficients", fit.coefficients},
            {"standard_errors", fit.standard_errors},
            {"residual", fit.residual},
            {"relative_error", fit.relative_error}};
}

} // namespace

const std::vector<LuaFunction>& analysis_functions() {
    static const std::vector<LuaFunction> functions = {
        {"phase_delay", read_phase_delay, "`tb.phase_delay{ response =, at_hz = }`",
         "the dead time [s] that eq. (18) reads from the phase at one frequency: L = (−180° − φ)/(360° f)"},
        {"remove_delay", remove_delay, "`tb.remove_delay{ response =, delay_s = }`",
         "the response times exp(+j2πf·delay_s)"},
        {"fit_modal", fit_modal, "`tb.fit_modal{ response =, modes = 2, … }`",
         "fits k0/s² + Σ k_j/(s² + 2ζ_jω_j s + ω_j²), with start values from the data: `{ k0, k1, f1_hz, zeta1, …, "
         "standard_errors = { same keys }, residual_rms, converged, message }` ([options](#tbfit_modal))",
         [] {
             return option_rows<ModalFitOptions>({{"response", "", "table", "required", "a response"}});
         }},
        {"model_response", model_response, "`tb.model_response{ model =, frequency_hz = {…} }`",
         "response of such a model"},
        {"estimate_delay", loop_delay, "`tb.estimate_delay{ fra1 =, fra2 =, f_min_hz =, f_max_hz =, expected_s = 0 }`",
         "the delay from the responses `\"FRA-1\"` and `\"FRA-2\"` of one sweep, friction taken into account "
         "([how](delay.md)): `{ delay_s, spread_s, frequency_hz, delays_s }`, the median over the band, its spread, "
         "and the value at each frequency (NaN where friction takes all of the thrust)"},
        {"proposed_response", proposed, "`tb.proposed_response{ fra1 =, fra2 =, delay_s = }`",
         "the proposed analysis of the same sweep with a pure dead time of any length"},
        {"delay_model_response", delay_model_response,
         "`tb.delay_model_response{ delay_s =, delay_order = 4, sample_time_s =, frequency_hz = {…} }`",
         "response of the delay model C_dly as used in the sweep: the sampled Padé approximant"},
        {"fit_friction", identify_friction, "`tb.fit_friction{ position = {…}, force = {…}, elements = 20, … }`",
         "Maxwell-slip elements from positions [m] and friction forces [N] at the same instants "
         "([how](friction.md#identification)): `{ elements, residual_rms, residual_max }` [N] "
         "([options](#tbfit_friction))",
         [] {
             return option_rows<FrictionFitOptions>(
                 {{"position", "m", "list of numbers", "required", "positions"},
                  {"force", "N", "list of numbers", "required", "friction forces at the same instants"}});
         }},
        {"friction_force", friction_force, "`tb.friction_force{ elements = {…}, position = {…} }`",
         "list of the forces of the elements along the positions, relaxed at the first; without damping [N]. With "
         "`machine` in place of `elements` those of its friction model, as `tb.fra` subtracts it, along positions at "
         "its sample time; `thrust` is that of the motor, for `load_dependent_friction`"},
        {"low_pass", low_pass, "`tb.low_pass{ values = {…}, sample_time_s =, corner_hz =, order = 4 }`",
         "list filtered by a Butterworth low-pass filter run forward and backward: no phase, a gain of 1/2 at the "
         "corner. `order` is even"},
        {"decimate", decimate, "`tb.decimate{ values = {…}, factor = 10 }`",
         "every tenth value up to the last, after a Chebyshev filter of order 8 (0.05 dB, corner at 0.8 of half the "
         "new rate) run in the same way"},
        {"derivative", derivative, "`tb.derivative{ values = {…}, sample_time_s = }`",
         "list of central differences, one-sided at the ends"},
        {"least_squares", least_squares, "`tb.least_squares{ columns = { {…}, … }, values = {…} }`",
         "values as a sum of coefficients times columns: `coefficients`, `standard_errors` (for a white residual), "
         "`residual` (list), `relative_error` (its norm divided by that of the values). Refused: columns of different "
         "lengths or linearly dependent columns"},
    };
    return functions;
}

} // namespace tribode
