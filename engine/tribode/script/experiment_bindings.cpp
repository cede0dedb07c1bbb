#include "tribode/base/error.hpp"
#include "tribode/experiment/comparison.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/experiment/friction_describing_function.hpp"
#include "tribode/experiment/friction_margins.hpp"
#include "tribode/experiment/improved_analysis.hpp"
#include "tribode/experiment/positioning.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/script/conversions.hpp"
#include "tribode/script/lua_function.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

// The input of a run: a file, or lists u, or r and exc, one entry a sample; y where the start is fitted.
DriveRecord drive_of(const ScriptContext& script, FieldReader& fields, const MachineModel& machine,
                     const char* function) {
    if (!fields.has("input")) {
        return DriveRecord::of(given_lists(fields, {"u", "r", "exc", "y"}, function), {}, machine);
    }
    const GivenRecord given = given_file(script, fields.text("input"));
    return DriveRecord::of(given, RecordOptions::read(fields), machine);
}

std::vector<FieldRow> drive_rows() {
    return with_columns({
        machine_row(),
        {"u", "N", "list of numbers", "none", "thrust reference: open loop"},
        {"r", "m", "list of numbers", "none", "closed loop: reference; zero if only `exc` is given"},
        {"exc", "N", "list of numbers", "none", "closed loop: excitation, added to the controller's output"},
        {"y", "m", "list of numbers", "none", "measured position, for a machine with `initial = \"fitted\"`"},
        {"input", "", "text", "none", "instead of these lists: the file of a [record](records.md) with them and t"},
    });
}

std::vector<FieldRow> simulation_rows() {
    std::vector<FieldRow> rows = option_rows<SimulationOptions>(drive_rows());
    rows.push_back({"sensitivities", "", "list of texts", "none",
                    "by what the run is differentiated ([sensitivities](sensitivities.md)), such as "
                    "`\"friction.coulomb\"`; not with fixed steps"});
    return rows;
}

Json simulate_machine(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.simulate");
    const MachineModel machine = machine_of(fields);
    const DriveRecord record = drive_of(script, fields, machine, "tb.simulate");
    SimulationOptions options;
    read_options(options, fields);
    options.sensitivities = fields.texts("sensitivities", {});
    fields.finish();
    const Simulation result = simulate(machine, record, options, script.run.control());
    if (result.outcome.end == RunEnd::interrupted) throw EndedEarly(result.outcome.message);
    script.run.note_work({{"function", "simulate"},
                          {"machine", machine.hash()},
                          {"solver", name_of(result.method)},
                          {"seed", options.seed},
                          {"friction_feedback", options.friction_feedback},
                          {"outcome", result.outcome.message},
                          {"statistics", to_json(result.statistics)}});
    Json json = to_json(result.trace);
    json["ok"] = result.outcome.ok();
    json["message"] = result.outcome.message;
    json["statistics"] = to_json(result.statistics);
    if (!result.sensitivities.empty()) json["sensitivities"] = Json::object();
    for (const auto& by : result.sensitivities) {
        json["sensitivities"][by.name] = {{"u", by.u}, {"y", by.y}, {"x", by.x}, {"v", by.v}};
    }
    json["events"] = Json::array();
    for (const auto& event : result.events) {
        json["events"].push_back({{"t", event.t},
                                  {"element", event.subject},
                                  {"kind", std::string(name_of(static_cast<SlipState>(event.kind)))}});
    }
    return json;
}

Json compare_methods(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.compare");
    const MachineModel machine = machine_of(fields);
    const DriveRecord record = drive_of(script, fields, machine, "tb.compare");
    ComparisonOptions options;
    read_options(options, fields);
    fields.finish();
    const Comparison comparison = compare(machine, record, options, script.run.control());
    write_comparison(comparison, machine, script.run.folder());
    script.run.note_work({{"function", "compare"}, {"machine", machine.hash()}, {"seed", options.seed}});
    Json json{{"text", comparison.text()}};
    json.update(comparison.json());
    return json;
}

Json sweep(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.sweep");
    const MachineModel machine = machine_of(fields);
    SweepOptions options;
    read_options(options, fields);
    const std::string checkpoint = fields.text("checkpoint", "sweep.resume.json");
    fields.finish();
    const SweepResult result =
        run_sweep(machine, options, script.run.control(),
                  script.run.in_batch() ? std::filesystem::path() : script.run.folder().path(checkpoint));
    script.run.note_work(
        {{"function", "sweep"},
         {"machine", machine.hash()},
         {"solver", name_of(resolved(options.solver.method, machine))},
         {"relative_tolerance", options.solver.relative_tolerance},
         {"absolute_tolerance_m", options.solver.absolute_tolerance},
         {"amplitude_N", options.amplitudes.empty() ? Json(options.amplitude) : Json(options.amplitudes)},
         {"bias_velocity_m_per_s", options.bias_velocity},
         {"carrier_amplitude_m", options.carrier_amplitude},
         {"delay_s", options.delay.value_or(loop_dead_time(machine))},
         {"friction_feedback", options.friction_feedback},
         {"seed", options.seed},
         {"frequencies", options.frequency_hz.size()},
         {"warnings", result.warnings()},
         {"statistics", to_json(result.statistics())}});
    if (!result.complete) {
        throw EndedEarly(fmt::format("interrupted after {} of {} frequencies; they are kept, and the same command goes "
                                     "on from there",
                                     result.points.size(), options.frequency_hz.size()));
    }
    Json json{{"columns", columns_of(result.table())}};
    for (const auto& [name, response] : result.responses()) json["responses"][name] = to_json(response);
    json["loop_gain"] = to_json(result.loop_gain());
    json["warnings"] = result.warnings();
    json["statistics"] = to_json(result.statistics());
    return json;
}

Json single_frequency(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.single_frequency");
    const MachineModel machine = machine_of(fields);
    const double frequency = fields.number("excitation_hz", "Hz", Allowed::positive);
    const long periods = fields.integer("periods", 1, 1'000'000, 3);
    SweepOptions options;
    read_options(options, fields);
    fields.finish();
    const SweepSignals signals = run_single_frequency(machine, options, frequency, periods, script.run.control());
    Json json = to_json(signals.trace);
    json["delayed_thrust"] = signals.delayed_thrust;
    json["friction_estimate"] = signals.friction_estimate;
    json["effective_thrust"] = signals.effective_thrust;
    return json;
}

Json positioning(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.positioning");
    const MachineModel machine = machine_of(fields);
    const Feedforward designed = feedforward_from_json(fields.value("feedforward"), "tb.positioning");
    PositioningOptions options;
    read_options(options, fields);
    fields.finish();
    const PositioningResult result = run_positioning(machine, designed, options, script.run.control());
    script.run.note_work({{"function", "positioning"},
                          {"machine", machine.hash()},
                          {"feedforward", designed.method},
                          {"delay_s", options.delay.value_or(loop_dead_time(machine))},
                          {"seed", options.seed},
                          {"statistics", to_json(result.statistics)}});
    Json json = to_json(result.trace);
    json["error"] = result.error;
    json["tracking_error"] = result.tracking_error;
    json["rmse_m"] = result.rmse;
    json["max_error_m"] = result.max_error;
    json["settling_s"] = result.settling_time ? Json(*result.settling_time) : Json(nullptr);
    json["peak_thrust_N"] = result.peak_thrust;
    json["peak_position_m"] = result.peak_position;
    json["within_rating"] = result.within_rating;
    json["within_stroke"] = result.within_stroke;
    json["spectrum"] = {{"frequency_hz", result.spectrum_hz}, {"amplitude_m", result.spectrum}};
    json["columns"] = columns_of(result.table());
    json["statistics"] = to_json(result.statistics);
    return json;
}

Json to_json(const FrictionMargins& margins) {
    Json json = to_json(margins.margins);
    json["stable"] = margins.stable;
    if (margins.critical) {
        json["critical_feedback"] = margins.critical->share;
        json["critical_hz"] = margins.critical->frequency_hz;
    }
    return json;
}

Json loop_margins(const Json& arguments) {
    FieldReader fields(arguments, "tb.loop_margins");
    const MachineModel machine = machine_of(fields);
    const auto amplitude = fields.optional_number("amplitude_m", "m", Allowed::non_negative);
    const double feedback = fields.number("friction_feedback", "", Allowed::non_negative, 0);
    if (!amplitude && feedback > 0) {
        fields.fail("amplitude_m", "is missing; friction_feedback needs one (0: the elements stick)");
    }
    fields.finish();
    return amplitude ? to_json(friction_margins(machine, feedback, *amplitude)) : to_json(positioning_margins(machine));
}

Json describing_function_of(const Json& arguments) {
    FieldReader fields(arguments, "tb.describing_function");
    const MachineModel machine = machine_of(fields);
    const auto amplitude = fields.numbers("amplitude_m", "m", Allowed::positive, {});
    const auto frequency_hz = fields.numbers("frequency_hz", "Hz", Allowed::positive, {});
    const auto load = fields.optional_number("load_N", "N", Allowed::non_negative);
    const FrictionModel model = FrictionModel::of(machine);
    if (const auto names = load_dependent(model.laws); !load && !names.empty()) {
        fields.fail("load_N", "is missing; the friction of " + names.front() + " grows with the load");
    }
    fields.finish();
    return to_json(friction_describing_function(model, amplitude, frequency_hz, load.value_or(0)));
}

Json loop_gain(const Json& arguments) {
    FieldReader fields(arguments, "tb.loop_gain");
    const MachineModel machine = machine_of(fields);
    const auto amplitude = fields.numbers("amplitude_m", "m", Allowed::non_negative, {0.0});
    const double feedback = fields.number("friction_feedback", "", Allowed::non_negative, 0);
    const auto frequency_hz = fields.numbers("frequency_hz", "Hz", Allowed::positive, {});
    fields.finish();
    return to_json(friction_loop_gain(machine, feedback, amplitude, frequency_hz));
}

} // namespace

const std::vector<LuaFunction>& experiment_functions() {
    static const std::vector<LuaFunction> functions = {
        {"simulate", simulate_machine, "`tb.simulate{ machine =, … }`",
         "runs a machine from rest, one sample per entry of the input ([options and result](#tbsimulate))",
         simulation_rows},
        {"compare", compare_methods, "`tb.compare{ machine =, … }`",
         "runs the same machine under the same input with every method, one after another ([options and "
         "result](#tbcompare))",
         [] { return option_rows<ComparisonOptions>(drive_rows()); }},
        {"sweep", sweep, "`tb.sweep{ machine =, frequency_hz = {…}, … }`",
         "runs a sine sweep in closed loop and evaluates the three analyses from the same signals ([options and "
         "result](#tbsweep))",
         [] {
             return option_rows<SweepOptions>({machine_row(),
                                               {"checkpoint", "", "text", "`\"sweep.resume.json\"`",
                                                "file for the completed frequencies of an interrupted "
                                                "sweep"}});
         }},
        {"single_frequency", single_frequency, "`tb.single_frequency{ machine =, excitation_hz =, periods = 3, … }`",
         "the signals of one frequency after settling: the signals of `tb.simulate`, and `delayed_thrust` (C_dly u), "
         "`friction_estimate`, `effective_thrust` [N]. Options as for `tb.sweep`"},
        {"positioning", positioning, "`tb.positioning{ machine =, feedforward =, … }`",
         "runs a feedforward on a machine with a controller, from rest ([options and result](#tbpositioning))",
         [] {
             return option_rows<PositioningOptions>(
                 {machine_row(), {"feedforward", "", "table", "required", "a table as `tb.feedforward` returns it"}});
         }},
        {"loop_margins", loop_margins, "`tb.loop_margins{ machine =, amplitude_m =, friction_feedback = 0 }`",
         "margins of the loop, with an amplitude [m] including friction ([result](#stability-margins))"},
        {"loop_gain", loop_gain,
         "`tb.loop_gain{ machine =, frequency_hz = {…}, amplitude_m = {…}, friction_feedback = 0 }`",
         "the loop gain itself, a response without unit; `amplitude_m` has one entry (default 0) or one for each "
         "frequency"},
        {"describing_function", describing_function_of,
         "`tb.describing_function{ machine =, amplitude_m = {…}, frequency_hz = {…}, load_N = nil }`",
         "the fundamental of the friction force over that of a sinusoidal motion, a response [N/m]: elements, viscous, "
         "dry friction and friction laws; `amplitude_m` has one entry or one for each frequency; `load_N` is the "
         "constant motor force for friction that grows with it"},
    };
    return functions;
}

} // namespace tribode
