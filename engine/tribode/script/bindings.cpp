#include "tribode/script/bindings.hpp"
#include "tribode/analysis/delay_estimation.hpp"
#include "tribode/analysis/friction_identification.hpp"
#include "tribode/analysis/modal_fit.hpp"
#include "tribode/analysis/signal.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/text.hpp"
#include "tribode/control/discrete_transfer_function.hpp"
#include "tribode/design/feedforward.hpp"
#include "tribode/diagnosis/diagnosis_files.hpp"
#include "tribode/effect/effect.hpp"
#include "tribode/experiment/comparison.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/experiment/friction_margins.hpp"
#include "tribode/experiment/positioning.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/csv.hpp"
#include "tribode/record/hdf5.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/mat.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/plot.hpp"
#include "tribode/record/record_file.hpp"
#include "tribode/record/report.hpp"
#include "tribode/record/zip.hpp"
#include "tribode/script/batch_script.hpp"
#include "tribode/script/sampling_bindings.hpp"
#include "tribode/script/system_bindings.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>

namespace tribode {

namespace {

// ---- tables in and out -------------------------------------------------------------------------------------------

MachineModel machine_of(FieldReader& fields) {
    const Json& description = fields.value("machine");
    if (description.is_null()) fields.fail("machine", "is missing (a machine description, see tb.machine)");
    return MachineModel::from_description(description, fields.name_of("machine"));
}

FrequencyResponse response_of(FieldReader& fields, const char* key = "response") {
    FieldReader table = fields.table(key, true);
    FrequencyResponse response;
    response.frequency_hz = table.numbers("frequency_hz", "Hz", Allowed::positive, {});
    const auto real = table.numbers("real", "", Allowed::finite, {});
    const auto imag = table.numbers("imag", "", Allowed::finite, {});
    for (const char* shown : {"gain_db", "phase_deg"}) table.numbers(shown, "", Allowed::finite, {});
    table.finish();
    if (real.size() != response.size() || imag.size() != response.size()) {
        fields.fail(key, fmt::format("has {} frequencies, {} real and {} imaginary parts, must have as many of "
                                     "each",
                                     response.size(), real.size(), imag.size()));
    }
    for (std::size_t i = 0; i < real.size(); ++i) response.value.emplace_back(real[i], imag[i]);
    return response;
}

Json to_json(const FrequencyResponse& response) {
    std::vector<double> real, imag;
    for (const auto& value : response.value) {
        real.push_back(value.real());
        imag.push_back(value.imag());
    }
    return {{"frequency_hz", response.frequency_hz},
            {"real", real},
            {"imag", imag},
            {"gain_db", response.gain_db()},
            {"phase_deg", response.size() ? response.phase_deg() : std::vector<double>{}}};
}

Json to_json(const RunStatistics& s) {
    Json json;
    for (const auto& [name, count] : RunStatistics::counts) json[name] = s.*count;
    json["seconds_integrating"] = s.seconds_integrating;
    json["seconds_events"] = s.seconds_events;
    return json;
}

Json to_json(const ServoTrace& trace) {
    Json table;
    for (const auto& column : to_table(trace).columns) table[column.name] = column.values;
    return table;
}

Json to_json(const TimeGrid& grid) {
    Json json{{"sample_time_s", grid.sample_time},
              {"jitter_rms_s", grid.jitter_rms},
              {"jitter_max_s", grid.jitter_max},
              {"dropped", grid.dropped},
              {"gaps", Json::array()}};
    for (const auto& gap : grid.gaps) json["gaps"].push_back({{"row", gap.row + 1}, {"missing", gap.missing}});
    return json;
}

Json to_json(const StabilityMargins& margins) {
    const auto or_null = [](const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); };
    return {{"gain_margin", or_null(margins.gain_margin)},
            {"gain_reduction_margin", or_null(margins.gain_reduction_margin)},
            {"phase_crossover_hz", or_null(margins.phase_crossover_hz)},
            {"phase_margin_deg", or_null(margins.phase_margin_deg)},
            {"gain_crossover_hz", or_null(margins.gain_crossover_hz)},
            {"modulus_margin", margins.modulus_margin}};
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

// As tb.write_csv takes them.
Json columns_of(const Table& table) {
    Json columns = Json::array();
    for (const auto& column : table.columns) {
        columns.push_back({{"name", column.name}, {"unit", column.unit}, {"values", column.values}});
    }
    return columns;
}

// A list of {name=, unit=, values=}.
Table table_of(FieldReader& fields, const char* key) {
    Table table;
    fields.each(key, [&](FieldReader& column) {
        std::vector<double> values;
        for (const auto& entry : column.value("values")) {
            if (!entry.is_number()) column.fail("values", "must be a list of numbers");
            values.push_back(entry.get<double>());
        }
        table.add(column.text("name"), column.text("unit", ""), std::move(values));
    });
    return table;
}

// Positional arguments come as a list; the rest of a function's name is for messages.
double argument(const Json& arguments, std::size_t index, const char* what) {
    if (!arguments.is_array() || index >= arguments.size() || !arguments[index].is_number()) {
        throw InputError(fmt::format("{}: argument {} must be a number", what, index + 1));
    }
    return arguments[index].get<double>();
}

// ---- machines and runs -------------------------------------------------------------------------------------------

Json load_machine(ScriptRun& run, const Json& arguments) {
    if (arguments.is_array() && arguments.size() == 1 && arguments[0].is_string()) {
        return run.machine(arguments[0].get<std::string>(), nullptr);
    }
    FieldReader fields(arguments, "tb.machine");
    const std::string file = fields.text("file");
    const Json& argument = fields.value("argument");
    fields.finish();
    return run.machine(file, argument);
}

Json list_effects(const Json& arguments) {
    FieldReader(arguments, "tb.effects").finish();
    return effect_list();
}

// A record of the options `file_key`, columns and scale.
Record record_of(ScriptRun& run, const ScriptAccess& access, FieldReader& fields, const char* file_key,
                 const std::vector<std::string>& wanted) {
    const auto path = run.find_file(fields.text(file_key));
    const RecordOptions options = RecordOptions::read(fields);
    access.check_read(path);
    Record record = read_record(path, options, wanted);
    run.note_read(path);
    return record;
}

// The input of a run: a file, or lists u, or r and exc, one entry a sample; y where the start is fitted.
DriveRecord drive_of(ScriptRun& run, const ScriptAccess& access, FieldReader& fields, const MachineModel& machine,
                     const char* function) {
    if (fields.has("input")) {
        const Table table = record_of(run, access, fields, "input", DriveRecord::columns()).table;
        return DriveRecord::from_table(table, machine, table.source);
    }
    Table table;
    for (const char* name : {"u", "r", "exc", "y"}) {
        const auto values = fields.numbers(name, "", Allowed::finite, {});
        if (!values.empty()) table.add(name, "", values);
    }
    std::vector<double> t(table.rows());
    for (std::size_t k = 0; k < t.size(); ++k) t[k] = static_cast<double>(k) * machine.sample_time;
    table.add("t", "s", std::move(t));
    return DriveRecord::from_table(table, machine, function);
}

Json simulate_machine(ScriptRun& run, const ScriptAccess& access, const Json& arguments) {
    FieldReader fields(arguments, "tb.simulate");
    const MachineModel machine = machine_of(fields);
    const DriveRecord record = drive_of(run, access, fields, machine, "tb.simulate");
    SolverOptions solver;
    read_options(solver, fields);
    const auto seed = static_cast<std::uint64_t>(fields.integer("seed", 0, 1L << 53, 0));
    const double feedback = fields.number("friction_feedback", "", Allowed::non_negative, 0);
    fields.finish();
    const Simulation result = simulate(machine, record, solver, seed, run.control(), feedback);
    if (result.outcome.end == RunEnd::interrupted) throw EndedEarly(result.outcome.message);
    run.note_work({{"function", "simulate"},
                   {"machine", machine.hash()},
                   {"solver", name_of(result.method)},
                   {"seed", seed},
                   {"friction_feedback", feedback},
                   {"outcome", result.outcome.message},
                   {"statistics", to_json(result.statistics)}});
    Json json = to_json(result.trace);
    json["ok"] = result.outcome.ok();
    json["message"] = result.outcome.message;
    json["statistics"] = to_json(result.statistics);
    json["events"] = Json::array();
    for (const auto& event : result.events) {
        json["events"].push_back({{"t", event.t},
                                  {"element", event.subject},
                                  {"kind", std::string(name_of(static_cast<SlipState>(event.kind)))}});
    }
    return json;
}

Json compare_methods(ScriptRun& run, const ScriptAccess& access, const Json& arguments) {
    FieldReader fields(arguments, "tb.compare");
    const MachineModel machine = machine_of(fields);
    const DriveRecord record = drive_of(run, access, fields, machine, "tb.compare");
    ComparisonOptions options;
    options.read(fields);
    fields.finish();
    const Comparison comparison = compare(machine, record, options, run.control());
    write_comparison(comparison, machine, run.folder());
    run.note_work({{"function", "compare"}, {"machine", machine.hash()}, {"seed", options.seed}});
    Json json{{"text", comparison.text()},
              {"findings", comparison.findings()},
              {"reference", comparison.reference},
              {"methods", Json::array()}};
    if (comparison.excitation_hz) json["excitation_hz"] = *comparison.excitation_hz;
    for (const auto& m : comparison.methods) {
        Json method{{"name", m.name},
                    {"ok", m.outcome.ok()},
                    {"diverged", m.diverged},
                    {"max_difference", m.max_difference},
                    {"rms_difference", m.rms_difference},
                    {"events_found", m.events_found},
                    {"events_missed", m.events_missed},
                    {"events_extra", m.events_extra},
                    {"derivative_evaluations", m.statistics.derivative_evaluations},
                    {"steps", m.statistics.steps},
                    {"seconds", m.seconds}};
        const auto put = [&](const char* name, const std::optional<double>& value) {
            if (value) method[name] = *value;
        };
        put("gain_error", m.gain_error);
        put("phase_error_deg", m.phase_error_deg);
        put("stable_stiffness", m.stable_stiffness);
        json["methods"].push_back(std::move(method));
    }
    return json;
}

// ---- frequency response ------------------------------------------------------------------------------------------

Json sweep(ScriptRun& run, const Json& arguments) {
    FieldReader fields(arguments, "tb.sweep");
    const MachineModel machine = machine_of(fields);
    SweepOptions options;
    read_options(options, fields);
    const std::string checkpoint = fields.text("checkpoint", "sweep.resume.json");
    fields.finish();
    const SweepResult result = run_sweep(machine, options, run.control(),
                                         run.in_batch() ? std::filesystem::path() : run.folder().path(checkpoint));
    run.note_work({{"function", "sweep"},
                   {"machine", machine.hash()},
                   {"solver", name_of(resolved(options.solver.method, machine))},
                   {"relative_tolerance", options.solver.relative_tolerance},
                   {"absolute_tolerance_m", options.solver.absolute_tolerance},
                   {"amplitude_N", options.amplitude},
                   {"delay_s", options.delay},
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
    for (std::size_t a = 0; a < analysis_count; ++a) json["responses"][analysis_names[a]] = to_json(result.response(a));
    if (options.improved) json["responses"]["Improved"] = to_json(result.improved());
    if (options.friction_feedback > 0) json["responses"]["Add-on"] = to_json(result.add_on());
    json["loop_gain"] = to_json(result.loop_gain());
    json["warnings"] = result.warnings();
    json["statistics"] = to_json(result.statistics());
    return json;
}

Json single_frequency(ScriptRun& run, const Json& arguments) {
    FieldReader fields(arguments, "tb.single_frequency");
    const MachineModel machine = machine_of(fields);
    const double frequency = fields.number("excitation_hz", "Hz", Allowed::positive);
    const long periods = fields.integer("periods", 1, 1'000'000, 3);
    SweepOptions options;
    read_options(options, fields);
    fields.finish();
    const SweepSignals signals = run_single_frequency(machine, options, frequency, periods, run.control());
    Json json = to_json(signals.trace);
    json["delayed_thrust"] = signals.delayed_thrust;
    json["friction_estimate"] = signals.friction_estimate;
    json["effective_thrust"] = signals.effective_thrust;
    return json;
}

Json plant_response(const Json& arguments) {
    FieldReader fields(arguments, "tb.plant_response");
    const MachineModel machine = machine_of(fields);
    FrequencyResponse response;
    response.frequency_hz = fields.numbers("frequency_hz", "Hz", Allowed::positive, {});
    fields.finish();
    const ModalModel model = modal_model_of(machine);
    for (const double f : response.frequency_hz) response.value.push_back(model.response(f));
    return to_json(response);
}

Json plant_parameters(const Json& arguments) {
    FieldReader fields(arguments, "tb.plant_parameters");
    const MachineModel machine = machine_of(fields);
    fields.finish();
    return to_json(modal_model_of(machine));
}

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
    options.f_min_hz = fields.number("f_min_hz", "Hz", Allowed::positive, options.f_min_hz);
    options.f_max_hz = fields.number("f_max_hz", "Hz", Allowed::positive, options.f_max_hz);
    options.modes = static_cast<int>(fields.integer("modes", 0, 20, options.modes));
    options.robust_scale = fields.number("robust_scale", "", Allowed::non_negative, options.robust_scale);
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
    options.read(fields);
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

// ---- positioning -------------------------------------------------------------------------------------------------

Json feedforward(const Json& arguments) {
    FieldReader fields(arguments, "tb.feedforward");
    const ModalModel model = modal_model_from_json(fields.value("model"), "tb.feedforward");
    FeedforwardOptions options;
    options.read(fields);
    FrequencyResponse response{fields.numbers("frequency_hz", "Hz", Allowed::positive, {}), {}};
    fields.finish();
    const Feedforward designed = design_feedforward(model, options);
    for (const double f : response.frequency_hz) response.value.push_back(designed.thrust_response(f));
    Json json = to_json(designed);
    json["response"] = to_json(response);
    return json;
}

Json positioning(ScriptRun& run, const Json& arguments) {
    FieldReader fields(arguments, "tb.positioning");
    const MachineModel machine = machine_of(fields);
    const Feedforward designed = feedforward_from_json(fields.value("feedforward"), "tb.positioning");
    PositioningOptions options;
    read_options(options, fields);
    fields.finish();
    const PositioningResult result = run_positioning(machine, designed, options, run.control());
    run.note_work({{"function", "positioning"},
                   {"machine", machine.hash()},
                   {"feedforward", designed.method},
                   {"delay_s", options.delay},
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

Json loop_gain(const Json& arguments) {
    FieldReader fields(arguments, "tb.loop_gain");
    const MachineModel machine = machine_of(fields);
    const auto amplitude = fields.numbers("amplitude_m", "m", Allowed::non_negative, {0.0});
    const double feedback = fields.number("friction_feedback", "", Allowed::non_negative, 0);
    const auto frequency_hz = fields.numbers("frequency_hz", "Hz", Allowed::positive, {});
    fields.finish();
    return to_json(friction_loop_gain(machine, feedback, amplitude, frequency_hz));
}

// ---- results -----------------------------------------------------------------------------------------------------

Json run_script(ScriptRun& run, const Json& arguments) {
    FieldReader fields(arguments, "tb.run");
    const std::string script = fields.text("script"), folder = fields.text("folder");
    const Json& options = fields.value("options");
    std::optional<bool> quick;
    if (fields.has("quick")) quick = fields.boolean("quick", false);
    fields.finish();
    const NestedRun nested = run.run_nested(script, folder, options.is_null() ? Json::object() : options, quick);
    return {{"folder", nested.folder.string()}, {"repeated", nested.repeated}};
}

Json read_batch(const ScriptAccess& access, const Json& arguments) {
    FieldReader fields(arguments, "tb.read_batch");
    const std::filesystem::path folder = fields.text("folder");
    fields.finish();
    access.check_read(folder);
    return merged_batch(folder);
}

Json read_json_file(ScriptRun& run, const ScriptAccess& access, const Json& arguments) {
    FieldReader fields(arguments, "tb.read_json");
    const auto path = run.find_file(fields.text("file"));
    fields.finish();
    access.check_read(path);
    Json value = read_json(path);
    run.note_read(path);
    return value;
}

Json list_folder(ScriptRun& run, const ScriptAccess& access, const Json& arguments) {
    FieldReader fields(arguments, "tb.list_folder");
    const auto path = run.find_file(fields.text("folder"));
    fields.finish();
    access.check_read(path);
    std::vector<std::string> names;
    std::error_code problem;
    for (std::filesystem::directory_iterator entry(path, problem), end; !problem && entry != end;
         entry.increment(problem)) {
        names.push_back(entry->path().filename().string());
    }
    if (problem) throw InputError(fmt::format("{}: cannot be listed ({})", path.string(), problem.message()));
    std::sort(names.begin(), names.end());
    return names;
}

Json read_record_file(ScriptRun& run, const ScriptAccess& access, const Json& arguments) {
    FieldReader fields(arguments, "tb.read_record");
    const Record record = record_of(run, access, fields, "file", {});
    fields.finish();
    Json json{{"data", Json::object()}, {"units", Json::object()}, {"time", nullptr}};
    for (const auto& column : record.table.columns) {
        json["data"][column.name] = column.values;
        json["units"][column.name] = column.unit;
    }
    if (record.time) json["time"] = to_json(*record.time);
    return json;
}

Json diagnose_machine(ScriptRun& run, const ScriptAccess& access, const Json& arguments) {
    const auto start = std::chrono::steady_clock::now();
    FieldReader fields(arguments, "tb.diagnose");
    const MachineModel machine = machine_of(fields);
    const RecordOptions names = RecordOptions::read(fields);
    std::vector<std::string> hashes;
    const auto measurement = [&](const std::string& file) {
        const auto path = run.find_file(file);
        access.check_read(path);
        run.note_read(path);
        hashes.push_back(sha256(read_file(path)));
        return read_measurement(path, machine, names);
    };
    std::vector<Measurement> records;
    for (const auto& file : fields.texts("data", {})) records.push_back(measurement(file));
    if (records.empty()) fields.fail("data", "is empty: a list of files of measured records is needed");
    std::optional<Measurement> proof;
    if (fields.has("validate")) proof = measurement(fields.text("validate"));
    DiagnosisOptions options;
    options.max_effects = static_cast<std::size_t>(fields.integer("max_effects", 1, 6, 3));
    const std::string where = fields.text("folder", "diagnosis");
    fields.finish();
    const Diagnosis diagnosis = diagnose(machine, std::move(records), std::move(proof), options, run.control());
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    Json summary = diagnosis_json(diagnosis, hashes, machine.hash(), seconds);
    RunFolder folder(run.folder().path(where));
    write_diagnosis(diagnosis, summary, folder, run.control());
    for (const auto& [name, hash] : folder.files()) run.folder().add(where + "/" + name);
    run.note_work({{"function", "diagnose"}, {"machine", machine.hash()}, {"verdict", diagnosis.verdict}});
    summary["machine"] = diagnosis.after.description;
    return summary;
}

Json write_csv_file(ScriptRun& run, const Json& arguments) {
    FieldReader fields(arguments, "tb.write_csv");
    const std::string file = fields.text("file");
    const Table table = table_of(fields, "columns");
    fields.finish();
    run.folder().write(file, file.ends_with(".gz") ? gzip(to_csv(table)) : to_csv(table));
    return nullptr;
}

Json write_hdf5_file(ScriptRun& run, const Json& arguments) {
    FieldReader fields(arguments, "tb.write_hdf5");
    const std::string file = fields.text("file");
    std::vector<NamedTable> tables;
    fields.each("tables", [&](FieldReader& entry) {
        tables.push_back({entry.text("name"), table_of(entry, "columns")});
    });
    const Json& attributes = fields.value("attributes");
    fields.finish();
    run.folder().write(file, to_hdf5(tables, attributes.is_null() ? Json::object() : attributes));
    return nullptr;
}

Json write_mat_file(ScriptRun& run, const Json& arguments) {
    FieldReader fields(arguments, "tb.write_mat");
    const std::string file = fields.text("file");
    const Table table = table_of(fields, "columns");
    fields.finish();
    run.folder().write(file, to_mat(table));
    return nullptr;
}

Json write_json_file(ScriptRun& run, const Json& arguments) {
    FieldReader fields(arguments, "tb.write_json");
    const std::string file = fields.text("file");
    const Json& value = fields.value("value");
    fields.finish();
    run.folder().write_json(file, value);
    return nullptr;
}

Json write_text_file(ScriptRun& run, const Json& arguments) {
    FieldReader fields(arguments, "tb.write_text");
    const std::string file = fields.text("file"), text = fields.text("text");
    fields.finish();
    run.folder().write(file, text);
    return nullptr;
}

Json plot(ScriptRun& run, const Json& arguments) {
    Json figure = arguments;
    if (!figure.is_object() || !figure.contains("file")) throw InputError("tb.plot: file is missing (a text)");
    const std::string file = FieldReader(arguments, "tb.plot").text("file");
    figure.erase("file");
    draw_plot(run.folder().path(file), plot_from_json(figure, "tb.plot"));
    run.folder().add(file + ".png");
    run.folder().add(file + ".svg");
    if (run.keeps_plots()) run.folder().write(file + plot_data_extension, figure.dump() + "\n");
    return nullptr;
}

Json report(ScriptRun& run, const Json& arguments) {
    Json fields = arguments;
    if (!fields.is_object() || !fields.contains("file")) throw InputError("tb.report: file is missing (a text)");
    const std::string file = FieldReader(arguments, "tb.report").text("file");
    fields.erase("file");
    const auto page = run.folder().path(file);
    const Report contents = report_from_json(fields, "tb.report", page.parent_path());
    const auto beside = std::filesystem::path(file).parent_path();
    for (const auto& image : write_report(page, contents, run.control())) run.folder().add((beside / image).string());
    run.folder().add(file);
    return nullptr;
}

Json spaced(const Json& arguments, const char* what, bool logarithmic) {
    const double from = argument(arguments, 0, what), to = argument(arguments, 1, what);
    const double count = argument(arguments, 2, what);
    if (!(count >= 2 && count <= 1e7 && count == std::floor(count))) {
        throw InputError(
            fmt::format("{}: argument 3 = {}, must be a whole number from 2 to 1e7", what, to_text(count)));
    }
    if (logarithmic && !(from > 0 && to > 0)) throw InputError(fmt::format("{}: both ends must be positive", what));
    Json list = Json::array();
    for (double i = 0; i < count; ++i) {
        const double part = i / (count - 1);
        list.push_back(logarithmic ? from * std::pow(to / from, part) : from + (to - from) * part);
    }
    return list;
}

} // namespace

void add_bindings(LuaState& lua, ScriptRun& run) {
    lua.add_value("version", version());
    lua.add_value("quick", run.quick());
    lua.add_function("options", [&run](const Json& a) { return run.options(a); });
    lua.add_function("machine", [&run](const Json& a) { return load_machine(run, a); });
    lua.add_function("simulate", [&run, &lua](const Json& a) { return simulate_machine(run, lua.access(), a); });
    lua.add_function("compare", [&run, &lua](const Json& a) { return compare_methods(run, lua.access(), a); });
    lua.add_function("sweep", [&run](const Json& a) { return sweep(run, a); });
    lua.add_function("single_frequency", [&run](const Json& a) { return single_frequency(run, a); });
    lua.add_function("plant_response", plant_response);
    lua.add_function("plant_parameters", plant_parameters);
    lua.add_function("effects", list_effects);
    lua.add_function("model_response", model_response);
    lua.add_function("fit_modal", fit_modal);
    lua.add_function("phase_delay", read_phase_delay);
    lua.add_function("remove_delay", remove_delay);
    lua.add_function("proposed_response", proposed);
    lua.add_function("estimate_delay", loop_delay);
    lua.add_function("delay_model_response", delay_model_response);
    lua.add_function("fit_friction", identify_friction);
    lua.add_function("friction_force", friction_force);
    lua.add_function("low_pass", low_pass);
    lua.add_function("decimate", decimate);
    lua.add_function("derivative", derivative);
    lua.add_function("least_squares", least_squares);
    lua.add_function("feedforward", feedforward);
    lua.add_function("positioning", [&run](const Json& a) { return positioning(run, a); });
    lua.add_function("loop_margins", loop_margins);
    lua.add_function("loop_gain", loop_gain);
    lua.add_function("run", [&run](const Json& a) { return run_script(run, a); });
    lua.add_function("read_json", [&run, &lua](const Json& a) { return read_json_file(run, lua.access(), a); });
    lua.add_function("list_folder", [&run, &lua](const Json& a) { return list_folder(run, lua.access(), a); });
    lua.add_function("read_record", [&run, &lua](const Json& a) { return read_record_file(run, lua.access(), a); });
    lua.add_function("diagnose", [&run, &lua](const Json& a) { return diagnose_machine(run, lua.access(), a); });
    lua.add_function("read_batch", [&lua](const Json& a) { return read_batch(lua.access(), a); });
    lua.add_function("write_csv", [&run](const Json& a) { return write_csv_file(run, a); });
    lua.add_function("write_hdf5", [&run](const Json& a) { return write_hdf5_file(run, a); });
    lua.add_function("write_mat", [&run](const Json& a) { return write_mat_file(run, a); });
    lua.add_function("write_json", [&run](const Json& a) { return write_json_file(run, a); });
    lua.add_function("write_text", [&run](const Json& a) { return write_text_file(run, a); });
    lua.add_function("plot", [&run](const Json& a) { return plot(run, a); });
    lua.add_function("report", [&run](const Json& a) { return report(run, a); });
    lua.add_stack_function("batch", [&run](lua_State* state) { return describe_batch(state, run); });
    lua.add_function("linspace", [](const Json& a) { return spaced(a, "tb.linspace", false); });
    lua.add_function("logspace", [](const Json& a) { return spaced(a, "tb.logspace", true); });
    add_sampling_bindings(lua);
    add_system_bindings(lua, run);
}

} // namespace tribode
