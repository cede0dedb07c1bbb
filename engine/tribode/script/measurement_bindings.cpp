#include "tribode/analysis/multisine.hpp"
#include "tribode/analysis/spectral_estimate.hpp"
#include "tribode/analysis/test_signals.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/experiment/identification.hpp"
#include "tribode/experiment/measured_fra.hpp"
#include "tribode/record/record_file.hpp"
#include "tribode/script/conversions.hpp"
#include "tribode/script/lua_function.hpp"

#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <numbers>

namespace tribode {

namespace {

// As other functions take a response, with the uncertainty beside it; points without a value are left out.
Json to_json(const std::vector<MeasuredPoint>& points) {
    const FrequencyResponse response = response_of(points);
    Json json{{"frequency_hz", response.frequency_hz},
              {"gain_db", response.gain_db()},
              {"phase_deg", response.size() > 0 ? response.phase_deg() : std::vector<double>()},
              {"missing", Json::array()}};
    const auto list = [&](const char* name, auto value) {
        std::vector<double> values;
        for (const auto& point : points) {
            if (point.missing.empty()) values.push_back(value(point));
        }
        json[name] = values;
    };
    list("real", [](const MeasuredPoint& p) { return p.value.real(); });
    list("imag", [](const MeasuredPoint& p) { return p.value.imag(); });
    list("std_gain_db", [](const MeasuredPoint& p) { return p.standard_gain_db(); });
    list("std_phase_deg", [](const MeasuredPoint& p) { return p.standard_phase_deg(); });
    list("coherence", [](const MeasuredPoint& p) { return p.coherence; });
    list("odd_distortion_db", [](const MeasuredPoint& p) { return 20 * std::log10(p.odd_distortion); });
    list("even_distortion_db", [](const MeasuredPoint& p) { return 20 * std::log10(p.even_distortion); });
    list("settled", [](const MeasuredPoint& p) { return p.settled ? 1.0 : 0.0; });
    for (const auto& point : points) {
        if (!point.missing.empty()) {
            json["missing"].push_back({{"frequency_hz", point.frequency_hz}, {"reason", point.missing}});
        }
    }
    return json;
}

// Names of files, and tables with the lists u, y and, where the loop was closed, r or exc.
std::vector<GivenRecord> records_of(const ScriptContext& script, FieldReader& fields) {
    const Json& list = fields.value("records");
    if (!list.is_array() || list.empty()) {
        fields.fail("records", "must be a list of files or of tables with the lists u, y and r or exc");
    }
    std::vector<GivenRecord> records;
    for (const auto& entry : list) {
        if (entry.is_string()) {
            records.push_back(given_file(script, entry.get<std::string>()));
            continue;
        }
        const std::string place = fmt::format("records[{}]", records.size() + 1);
        FieldReader one(entry, fields.name_of(place));
        records.push_back(given_lists(one, fra_columns(), place));
        for (const char* other : {"x", "v", "f", "ok", "message", "statistics", "events"}) one.value(other);
        one.finish();
    }
    return records;
}

Json measure(const ScriptContext& script, const Json& arguments) {
    ScriptRun& run = script.run;
    FieldReader fields(arguments, "tb.fra");
    FraRequest request;
    request.machine = machine_of(fields);
    request.columns = RecordOptions::read(fields);
    request.records = records_of(script, fields);
    read_options(request.options, fields);
    const std::string report = fields.text("report", "");
    fields.finish();
    const MeasuredFra fra = measure_fra(request);
    if (!report.empty()) {
        RunFolder folder(run.folder().path(report));
        write_measured_fra(fra, folder, run.control());
        for (const auto& [name, hash] : folder.files()) run.folder().add(report + "/" + name);
    }
    run.note_work({{"function", "fra"}, {"machine", request.machine.hash()}, {"records", fra.records}});
    Json json{{"records", fra.records}, {"notes", fra.notes}, {"delay_s", fra.delay}, {"text", fra.text()}};
    json["loops"] = Json::array();
    for (const auto& loop : fra.loops) {
        json["loops"].push_back({{"frequency_hz", loop.frequency_hz},
                                 {"position", loop.position},
                                 {"measured", loop.measured},
                                 {"modeled", loop.modeled}});
    }
    json["residuals"] = Json::array();
    for (const auto& residual : fra.residuals) {
        json["residuals"].push_back({{"record", residual.record},
                                     {"position", residual.position},
                                     {"velocity", residual.velocity},
                                     {"force", residual.force},
                                     {"rms", residual.rms},
                                     {"friction_rms", residual.friction_rms},
                                     {"explained", residual.explained}});
    }
    for (const auto& analysis : fra.analyses) {
        json["responses"][analysis.method] = to_json(analysis.points);
        if (analysis.fit) json["fits"][analysis.method] = to_json(*analysis.fit);
    }
    return json;
}

Json identify_machine(const ScriptContext& script, const Json& arguments) {
    ScriptRun& run = script.run;
    FieldReader fields(arguments, "tb.identify");
    const MachineModel machine = machine_of(fields);
    const RecordOptions columns = RecordOptions::read(fields);
    const auto records = records_of(script, fields);
    IdentifyOptions options;
    read_options(options, fields);
    fields.finish();
    const Identification found = identify(machine, records, columns, options, run.control());
    Json names = Json::array();
    for (const auto& record : records) names.push_back(record.name());
    run.note_work({{"function", "identify"}, {"machine", machine.hash()}, {"records", names}});
    Json json = found.json();
    json["residuals"] = found.residuals;
    return json;
}

Json response_between(const Json& arguments) {
    FieldReader fields(arguments, "tb.frf");
    const auto input = fields.numbers("input", "", Allowed::finite, {});
    const auto output = fields.numbers("output", "", Allowed::finite, {});
    const auto excitation = fields.numbers("excitation", "", Allowed::finite, input);
    const double sample_time = fields.number("sample_time_s", "s", Allowed::positive);
    const long window = fields.integer("window_samples", 0, 1L << 24, 0);
    fields.finish();
    if (input.size() != output.size() || input.size() != excitation.size()) {
        throw InputError(
            fmt::format("tb.frf: {} samples of input, {} of output, {} of excitation, must be as many of each",
                        input.size(), output.size(), excitation.size()));
    }
    for (const auto& [name, values] : {std::pair{"input", &input}, {"excitation", &excitation}}) {
        if (std::adjacent_find(values->begin(), values->end(), std::not_equal_to<>()) != values->end()) continue;
        throw InputError(fmt::format("tb.frf: {} is the same number throughout, must excite the frequencies", name));
    }
    const MeasuredSignals signals{sample_time, excitation, output, {input}, 0};
    return to_json(cross_spectra({signals}, static_cast<std::size_t>(window)).front());
}

// One list of numbers, or a list of such lists.
std::vector<std::vector<double>> inputs_of(FieldReader& fields) {
    std::vector<std::vector<double>> inputs;
    if (fields.has("input")) inputs.push_back(fields.numbers("input", "", Allowed::finite, {}));
    const Json& list = fields.value("inputs");
    if (list.is_null()) return inputs;
    if (!inputs.empty() || !list.is_array())
        fields.fail("inputs", "must be a list of lists of numbers, in place of input");
    for (const auto& entry : list) {
        const Json one{{"values", entry}};
        FieldReader reader(one, fields.name_of(fmt::format("inputs[{}]", inputs.size() + 1)));
        inputs.push_back(reader.numbers("values", "", Allowed::finite, {}));
    }
    return inputs;
}

Json spectrum(const Json& arguments) {
    FieldReader fields(arguments, "tb.spectrum");
    const auto output = fields.numbers("output", "", Allowed::finite, {});
    const auto inputs = inputs_of(fields);
    SpectrumOptions options;
    read_options(options, fields);
    fields.finish();
    const SpectralEstimate found = spectral_estimate(inputs, output, options);
    Json json{{"frequency_hz", found.frequency_hz}, {"power", found.power},
              {"windows", found.windows},           {"averages", found.averages},
              {"bandwidth_hz", found.bandwidth},    {"power_low", found.power_low},
              {"power_high", found.power_high},     {"inputs", Json::array()}};
    if (inputs.empty()) return json;
    json["coherence"] = found.coherence;
    json["coherence_threshold"] = found.coherence_threshold;
    json["noise_power"] = found.noise;
    for (const auto& input : found.inputs) {
        std::vector<double> real, imag, gain_error, phase_error;
        for (const auto& value : input.cross) {
            real.push_back(value.real());
            imag.push_back(value.imag());
        }
        for (const double error : input.standard_deviation) {
            gain_error.push_back(20 / std::numbers::ln10 * error);
            phase_error.push_back(180 / std::numbers::pi * error);
        }
        const auto response = [&](const std::vector<std::complex<double>>& values) {
            Json one = to_json(FrequencyResponse{found.frequency_hz, values});
            one["std_gain_db"] = gain_error;
            one["std_phase_deg"] = phase_error;
            return one;
        };
        Json one{{"power", input.power},
                 {"cross_power", {{"real", real}, {"imag", imag}}},
                 {"coherence", input.coherence},
                 {"h1", response(input.h1)}};
        if (!input.h2.empty()) {
            one["h2"] = response(input.h2);
            one["hv"] = response(input.hv);
        }
        json["inputs"].push_back(std::move(one));
    }
    return json;
}

// A signal from its options alone.
template <class Options, class Signal>
Signal signal_of(const Json& arguments, const char* function, Signal (*make)(const Options&)) {
    FieldReader fields(arguments, function);
    Options options;
    read_options(options, fields);
    fields.finish();
    return make(options);
}

Json multisine(const Json& arguments) {
    const Multisine made = signal_of(arguments, "tb.multisine", make_multisine);
    return {{"values", made.values},
            {"period_samples", made.period},
            {"frequency_hz", made.frequency_hz},
            {"crest_factor", made.crest_factor}};
}

Json chirp(const Json& arguments) {
    const Chirp made = signal_of(arguments, "tb.chirp", make_chirp);
    return {{"values", made.values}, {"frequency_hz", made.frequency_hz}};
}

Json binary_sequence(const Json& arguments) {
    const BinarySequence made = signal_of(arguments, "tb.binary_sequence", make_binary_sequence);
    return {{"values", made.values}, {"period_samples", made.period}};
}

} // namespace

const std::vector<LuaFunction>& measurement_functions() {
    static const std::vector<LuaFunction> functions = {
        {"fra", measure, "`tb.fra{ machine =, records = {…}, … }`",
         "frequency responses of measured records with their uncertainty, as `tribode fra` ([how](measured-"
         "frequency-response.md), [options](#tbfra)). Returns `responses` by method (`frequency_hz, real, imag, "
         "gain_db, "
         "phase_deg, std_gain_db, std_phase_deg, coherence, odd_distortion_db, even_distortion_db, settled`, and "
         "`missing`), `fits` by method, `records`, `notes`, `delay_s`, `text`; with a fit of `improved` or `proposed` "
         "also "
         "`loops` (of single sines `frequency_hz`, and over a period `position` [m], `measured` and `modeled` friction "
         "[N]) "
         "and `residuals` (of each record `position`, `velocity`, `force` [N] that is left, `rms`, `friction_rms`, and "
         "`explained`, its share that is a function of position and velocity)",
         [] {
             return option_rows<MeasuredFraOptions>(
                 with_columns({machine_row(),
                               {"records", "", "list", "required",
                                "files, or tables with the lists `u`, `y` and, if the loop was closed, `exc` or `r`"}},
                              {{"report", "", "text", "none", "a folder for the files of `tribode fra`"}}));
         }},
        {"identify", identify_machine, "`tb.identify{ machine =, records = {…}, … }`",
         "the parameters of a machine from one or several records at once, by its simulated position ([how](measured-"
         "frequency-response.md#joint-estimation), [options](#tbidentify)). `machine` has the start values. Returns "
         "`machine`, `parameters` (list of `name, unit, start, value, standard_error`, the last infinite where the "
         "records do not determine it), `covariance`, `residuals` (list of each record, m), `residual_rms_m`, `excess` "
         "(of the standard errors over those of pure noise), `objective` (for comparing structures), `iterations`, "
         "`simulations` (of a record), `converged`, `notes`",
         [] {
             return option_rows<IdentifyOptions>(with_columns(
                 {machine_row(),
                  {"records", "", "list", "required",
                   "files, or tables with the lists `y` and `u`, or `y` and `r` or `exc` in a closed loop"}}));
         }},
        {"frf", response_between,
         "`tb.frf{ input = {…}, output = {…}, sample_time_s =, excitation = input, window_samples = 0 }`",
         "the response between any two signals by averaged cross spectra; in a closed loop with the "
         "`excitation` as reference. A response as in `tb.fra`. `window_samples` = 0: an eighth of the "
         "signals, at most 8192"},
        {"spectrum", spectrum, "`tb.spectrum{ output = {…}, input = {…}, sample_time_s =, … }`",
         "power spectrum of a signal and, with `input` or a list `inputs` of several, its relation to them, by "
         "averages "
         "over windows ([how](measured-frequency-response.md#spectra-and-coherence), [options](#tbspectrum)). Returns "
         "`frequency_hz`, `power` (of the output, one-sided density, unit²/Hz), `windows`, `averages` (as many windows "
         "without overlap would be worth), `bandwidth_hz`, `power_low`, `power_high` (the true power is that times "
         "these, "
         "with 95 %); with inputs `coherence` (multiple), `coherence_threshold` (chance stays below it, with 95 %), "
         "`noise_power` (what the inputs do not explain), and `inputs`: of each `power`, `cross_power` (`real`, "
         "`imag`), "
         "`coherence` (ordinary) and `h1`, of one input also `h2` and `hv`: responses with `std_gain_db` and "
         "`std_phase_deg`",
         [] {
             return option_rows<SpectrumOptions>(
                 {{"output", "", "list of numbers", "required", "a signal"},
                  {"input", "", "list of numbers", "none", "the signal that it answers"},
                  {"inputs", "", "list of lists", "none", "several of them, in place of `input`"}});
         }},
        {"multisine", multisine, "`tb.multisine{ f_min_hz = 10, f_max_hz = 200, … }`",
         "a random-phase multisine: `values`, `period_samples`, `frequency_hz` of its lines, `crest_factor` "
         "([options](#tbmultisine))",
         [] { return option_rows<MultisineOptions>({}); }},
        {"chirp", chirp, "`tb.chirp{ f_start_hz = 1, f_end_hz = 200, … }`",
         "a sine whose frequency runs through a band: `values`, `frequency_hz` at each sample ([options](#tbchirp))",
         [] { return option_rows<ChirpOptions>({}); }},
        {"binary_sequence", binary_sequence, "`tb.binary_sequence{ order = 10, … }`",
         "a pseudo-random binary sequence (PRBS) of maximum length: `values`, `period_samples` "
         "([options](#tbbinary_sequence))",
         [] { return option_rows<BinarySequenceOptions>({}); }},
    };
    return functions;
}

} // namespace tribode
