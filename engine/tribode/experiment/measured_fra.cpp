#include "tribode/experiment/measured_fra.hpp"
#include "tribode/analysis/signal.hpp"
#include "tribode/analysis/signal_fit.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/control/discrete_transfer_function.hpp"
#include "tribode/experiment/improved_analysis.hpp"
#include "tribode/machine/friction_model.hpp"
#include "tribode/machine/machine_controller.hpp"
#include "tribode/record/time_grid.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <numbers>

namespace tribode {

namespace {

using std::numbers::pi;

constexpr std::size_t min_fra_samples = 64;

double range_of(const std::vector<double>& values) {
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    return *high - *low;
}

bool has_friction(const MachineModel& machine) {
    return !machine.elements.empty() || machine.viscous > 0 || machine.dry.present() ||
           !FrictionModel::of(machine).laws.empty();
}

void refuse_clipped(const std::vector<double>& x, double step, const std::string& name, const std::string& where) {
    const std::size_t samples = clipped_samples(x, step);
    if (samples == 0) return;
    const auto [low, high] = std::minmax_element(x.begin(), x.end());
    throw InputError(
        fmt::format("{}: {} stands at its largest values ({:.6g} and {:.6g}) in {} samples and breaks off on the way "
                    "there: it seems clipped, a record below the limit is needed",
                    where, name, *low, *high, samples));
}

// A record with the signals of all analyses.
struct FraRecord {
    std::string source;
    std::vector<double> excitation, thrust, position;
    std::string excited_by; // the column
    bool loop_closed = false;
    bool excitation_is_thrust = false;
    std::array<std::vector<double>, 4> inputs; // of fra1, fra2, proposed, improved
    std::vector<double> driving;               // the thrust that acts, A u
    Excitation form;
    std::vector<Observation> observations;

    // known: the response to each input.
    MeasuredSignals signals(const MachineModel& machine, std::vector<KnownResponse> known = {}) const {
        const bool added = loop_closed && !excitation_is_thrust && excited_by != "r";
        return {machine.sample_time,
                excitation,
                position,
                {inputs[0], inputs[1], inputs[2], inputs[3]},
                machine.encoder_resolution,
                added ? std::span<const double>(thrust) : std::span<const double>(),
                std::move(known)};
    }
};

// What u has besides the output of the controller on r and y; empty where the machine has no controller.
std::vector<double> recovered_excitation(const MachineModel& machine, const std::vector<double>& reference,
                                         const FraRecord& record) {
    if (!machine.has_controller()) return {};
    const MachineController controller(machine);
    MachineController::State state;
    std::vector<double> excitation(record.thrust.size());
    const double rounding = 1e-7 * rms(record.thrust);
    for (std::size_t k = 0; k < excitation.size(); ++k) {
        const double rest =
            record.thrust[k] - controller.step(state, reference.empty() ? 0 : reference[k], record.position[k]);
        excitation[k] = std::abs(rest) < rounding ? 0 : rest;
    }
    return excitation;
}

void choose_excitation(const MachineModel& machine, const Table& table, FraRecord& record) {
    const auto column = [&](const char* name) {
        const Column* found = table.find(name);
        return found ? found->values : std::vector<double>();
    };
    const std::vector<double> reference = column("r"), given = column("exc");
    record.loop_closed = machine.in_closed_loop() || !given.empty();
    if (record.loop_closed) {
        if (!given.empty() && range_of(given) > 0) {
            record.excitation = given;
            record.excited_by = "exc";
            return;
        }
        const std::vector<double> rest = recovered_excitation(machine, reference, record);
        const bool from_reference = !reference.empty() && range_of(reference) > 0;
        // Where the controller is another one, the rest holds what the loop made of the noise, and a response that is taken by it is
        // as biased as Y/U. A reference that moves the axis is free of noise whatever the controller.
        const double least = from_reference ? 0.2 : 1e-3;
        if (!rest.empty() && rms(rest) > least * rms(record.thrust)) {
            record.excitation = rest;
            record.excited_by = "u less the output of the controller";
            return;
        }
        if (from_reference) {
            record.excitation = reference;
            record.excited_by = "r";
            return;
        }
        // Y/U would be the inverse of the controller.
        throw InputError(record.source + (rest.empty()
                                              ? ": exc is constant: a record with an excitation is needed"
                                              : ": neither r nor exc changes and u is what the controller makes of "
                                                "y: a record with an excitation is needed"));
    }
    record.excitation = record.thrust;
    record.excited_by = "u";
    record.excitation_is_thrust = true;
}

FraRecord prepared(const MachineModel& machine, const Table& table, const MeasuredFraOptions& options, double delay) {
    FraRecord record;
    record.source = table.source.empty() ? "record" : table.source;
    const std::string& where = record.source;
    for (const char* name : {"t", "u", "y"}) table[name];
    if (table.rows() < min_fra_samples) {
        throw InputError(fmt::format("{}: {} samples, must be {} at least", where, table.rows(), min_fra_samples));
    }
    const double own = time_grid(table).sample_time;
    if (std::abs(own / machine.sample_time - 1) > 1e-3) {
        throw InputError(fmt::format(
            "{}: the sample time is {:.6g} s and that of the machine {:.6g} s; {}", where, own, machine.sample_time,
            own > machine.sample_time ? "what lies above half the record's rate is aliased in it, so the record "
                                        "must have the machine's"
                                      : "the record must have the machine's"));
    }
    require_uniform_time(table, machine.sample_time);
    const double duration = static_cast<double>(table.rows()) * machine.sample_time;
    if (delay >= duration) {
        throw InputError(
            fmt::format("{}: the delay of {:.6g} s is longer than the record of {:.6g} s", where, delay, duration));
    }
    record.thrust = table["u"].values;
    record.position = table["y"].values;
    if (range_of(record.thrust) == 0) {
        throw InputError(where + ": u is constant: a record with an excitation is needed");
    }
    if (range_of(record.position) == 0) throw InputError(where + ": y is constant: nothing moves in this record");
    refuse_clipped(record.position, machine.encoder_resolution, "y", where);
    const auto* cascade = std::get_if<CascadeController>(&machine.controller);
    if (!cascade || cascade->limit == CascadeController::no_limit) refuse_clipped(record.thrust, 0, "u", where);
    choose_excitation(machine, table, record);

    MeasuredFriction model(FrictionModel::of(machine), machine);
    auto delay_model = DiscreteTransferFunction::pade_delay(delay, options.delay_order, machine.sample_time);
    record.inputs[0] = record.thrust;
    record.inputs[3] = record.driving = actuator_thrust(machine, record.thrust);
    const std::vector<double> friction_between =
        friction_along(machine, FrictionModel::of(machine), record.position, record.driving);
    for (std::size_t k = 0; k < record.thrust.size(); ++k) {
        const double friction = model.step(record.position[k], record.inputs[3][k]);
        record.inputs[1].push_back(record.thrust[k] - friction);
        record.inputs[2].push_back(delay_model.step(record.thrust[k]) - friction);
        record.inputs[3][k] -= friction_between[k];
    }
    return record;
}

constexpr std::size_t improved_input = 3; // of an observation

// Of single sines friction is known between the samples as well, from their harmonics.
void improve_sines(const MachineModel& machine, std::vector<Observation>& observations) {
    const FrictionModel model = FrictionModel::of(machine);
    for (auto& o : observations) {
        if (!o.missing.empty()) continue;
        // Friction is that of the steady motion: the harmonics of a transient are not those of the friction that it causes.
        const std::complex<double> steady = 1.0 - o.output_transient;
        auto harmonics = o.output_harmonics;
        harmonics.front() *= steady;
        const std::complex<double> thrust =
            improved_thrust(machine, model, o.frequency_hz, o.inputs[0] * steady, harmonics);
        // The response is Y over this; noise and transient are about those of the proposed analysis.
        const std::complex<double> late = std::polar(1.0, -2 * pi * o.frequency_hz * machine.output_delay);
        o.inputs[improved_input] = thrust * late / steady;
        for (auto* list : {&o.variance, &o.coherence, &o.transient, &o.bias}) (*list)[improved_input] = (*list)[2];
    }
}

std::string range_text(double low, double high) { return fmt::format("{:.6g} to {:.6g} Hz", low, high); }

std::string describe(const FraRecord& record, double sample_time) {
    const Excitation& excitation = record.form;
    const std::vector<Observation>& found = record.observations;
    std::string text =
        fmt::format("{}: {} samples, excitation {}, ", record.source, record.thrust.size(), record.excited_by);
    if (excitation.kind == ExcitationKind::broadband) {
        return text + "neither single sines nor periodic: windowed cross spectra";
    }
    double low = found.front().frequency_hz, high = low;
    for (const auto& o : found) {
        low = std::min(low, o.frequency_hz);
        high = std::max(high, o.frequency_hz);
    }
    if (excitation.kind == ExcitationKind::stepped_sine) {
        return text + fmt::format("{} single sine{} from {}", found.size(), found.size() > 1 ? "s in turn" : "",
                                  range_text(low, high));
    }
    return text + fmt::format("multisine with {} lines from {}, {} periods of {:.6g} s", found.size(),
                              range_text(low, high), record.thrust.size() / excitation.period,
                              static_cast<double>(excitation.period) * sample_time);
}

// The points less what sampling adds: components of the position above half the sampling rate, which the steps of u excite there,
// count as components at f. There the machine is nearly a rigid body with the gains of all modes.
std::vector<MeasuredPoint> unfolded(const MachineModel& machine, const ModalModel& model,
                                    std::vector<MeasuredPoint> points, const std::vector<MeasuredPoint>& by_thrust) {
    double gain = model.rigid_gain;
    for (const auto& mode : model.modes) gain += mode.gain;
    constexpr int most = 8;
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (!points[i].missing.empty() || !by_thrust[i].missing.empty()) continue;
        std::complex<double> sum = 0; // of the position by u
        for (int m = -most; m <= most; ++m) {
            if (m == 0) continue;
            const double f = points[i].frequency_hz + m / machine.sample_time, omega = 2 * pi * f;
            sum -=
                actuator_response(machine, f) * std::polar(1.0, -omega * machine.output_delay) * gain / (omega * omega);
        }
        points[i].value -= sum * points[i].value / by_thrust[i].value;
    }
    return points;
}

// by_thrust: FRA-1. Adds to the notes what is to be known of the fit.
void fit_analysis(const MachineModel& machine, const MeasuredFraOptions& options, double delay,
                  const std::vector<MeasuredPoint>& by_thrust, MeasuredAnalysis& analysis,
                  std::vector<std::string>& notes) {
    WeightedFitOptions fit;
    fit.modes = options.modes.value_or(static_cast<int>(machine.modes.size()));
    const double low = 0.01 / machine.sample_time, high = 0.1 / machine.sample_time;
    const auto usual = std::ranges::count_if(analysis.points, [&](const MeasuredPoint& p) {
        return p.missing.empty() && p.frequency_hz >= low && p.frequency_hz <= high;
    });
    const bool enough = usual >= 4 + 4 * fit.modes;
    fit.f_min_hz = options.fit_min_hz.value_or(enough ? low : 0);
    fit.f_max_hz = options.fit_max_hz.value_or(enough ? high : 0.5 / machine.sample_time);
    try {
        if (analysis.method != "proposed" && analysis.method != "improved") {
            const FrequencyResponse response = response_of(analysis.points);
            if (response.size() == 0) throw InputError("no frequency has a value");
            const double top = std::min(response.frequency_hz.back(), fit.f_max_hz);
            const double at =
                std::clamp(std::min(120.0, top), response.frequency_hz.front(), response.frequency_hz.back());
            fit.delay = phase_delay(response, at, 5, delay);
        }
        analysis.fit = fit_weighted(analysis.points, fit);
        if (analysis.method == "improved" && machine.input == InputKind::hold) {
            analysis.fit = fit_weighted(unfolded(machine, analysis.fit->model, analysis.points, by_thrust), fit);
        }
        if (!analysis.fit->message.empty()) {
            notes.push_back(title_of_method(analysis.method) + ", fit: " + analysis.fit->message + ".");
        }
    } catch (const InputError& problem) {
        notes.push_back(fmt::format("{}: no model is fitted: {}.", title_of_method(analysis.method), problem.what()));
    }
}

void observe(const MachineModel& machine, const MeasuredFraOptions& options, const std::vector<KnownResponse>& known,
             FraRecord& record) {
    if (record.form.kind == ExcitationKind::stepped_sine) {
        record.observations = sine_observations(record.signals(machine, known), record.form.segments, options.sine);
    } else if (record.form.kind == ExcitationKind::multisine) {
        record.observations = multisine_observations(record.signals(machine), record.form.period, record.source);
    }
}

std::size_t input_of(const std::string& method) {
    return method == "fra2" ? 1 : method == "proposed" ? 2 : method == "improved" ? improved_input : 0;
}

// Of all records, in the place of the analyses that `fra` has. Returns notes.
std::vector<std::string> analyze(const MachineModel& machine, const MeasuredFraOptions& options,
                                 const std::vector<FraRecord>& records, MeasuredFra& fra) {
    fra.analyses.clear();
    std::vector<std::string> notes;
    const bool only_sines = std::ranges::all_of(
        records, [](const FraRecord& record) { return record.form.kind == ExcitationKind::stepped_sine; });
    std::vector<std::vector<MeasuredPoint>> responses;
    if (records.front().form.kind == ExcitationKind::broadband) {
        std::vector<MeasuredSignals> signals;
        for (const auto& record : records) signals.push_back(record.signals(machine));
        responses = cross_spectra(signals);
    } else {
        std::vector<Observation> observations;
        for (const auto& record : records) {
            observations.insert(observations.end(), record.observations.begin(), record.observations.end());
        }
        if (std::ranges::all_of(observations, [](const auto& o) { return !o.missing.empty(); })) {
            throw InputError(fmt::format("{}: no frequency can be analyzed; at {} Hz: {}", records.front().source,
                                         to_text(observations.front().frequency_hz), observations.front().missing));
        }
        if (only_sines && !machine.dry.present()) improve_sines(machine, observations);
        responses = merged(observations, options.sine);
    }
    for (const auto& method : fra_methods) {
        if (std::ranges::find(options.methods, method) == options.methods.end()) continue;
        if (method == "bla" && only_sines) {
            notes.push_back("BLA is left out: single sines give the response at their own amplitude, the best linear "
                            "approximation needs multisines or a broadband excitation.");
            continue;
        }
        MeasuredAnalysis analysis;
        analysis.method = method;
        analysis.points = responses.at(input_of(method));
        const auto with_value =
            std::ranges::count_if(analysis.points, [](const auto& point) { return point.missing.empty(); });
        if (with_value == 0) {
            throw InputError(fmt::format("{}: {} has no value at any frequency: {}", records.front().source,
                                         title_of_method(method), analysis.points.front().missing));
        }
        fit_analysis(machine, options, fra.delay, responses.front(), analysis, notes);
        fra.analyses.push_back(std::move(analysis));
    }
    if (fra.analyses.empty()) throw InputError("none of the methods can be used with these records: " + notes.back());
    return notes;
}

// What was fitted to the response to each input, or else to that of the best analysis; empty where nothing was.
std::vector<KnownResponse> fitted_responses(const MeasuredFra& fra) {
    const auto fitted = [&](const std::string& method) -> KnownResponse {
        const MeasuredAnalysis* analysis = fra.find(method);
        if (!analysis || !analysis->fit) return {};
        KnownResponse known;
        for (const auto& mode : analysis->fit->model.modes) {
            if (!(mode.zeta > 0 && mode.zeta < 1)) continue;
            known.poles.push_back(2 * pi * mode.freq_hz *
                                  std::complex<double>(-mode.zeta, std::sqrt(1 - mode.zeta * mode.zeta)));
        }
        known.response = [model = analysis->fit->model, delay = analysis->fit->delay](double f) {
            return model.response(f) * std::polar(1.0, -2 * pi * f * delay);
        };
        return known;
    };
    std::vector<KnownResponse> known(improved_input + 1);
    KnownResponse best;
    for (const char* method : {"fra1", "fra2", "proposed", "improved"}) {
        auto& own = known[input_of(method)] = fitted(method);
        if (own.response) best = own;
    }
    if (!best.response) return {};
    for (auto& own : known) {
        if (!own.response) own = best;
    }
    return known;
}

// Loops and residuals, by the model that was fitted.
void map_friction(const MachineModel& machine, const MeasuredFraOptions& options, const std::vector<FraRecord>& records,
                  MeasuredFra& fra) {
    const MeasuredAnalysis* analysis = nullptr;
    for (const char* method : {"improved", "proposed"}) {
        if (!analysis || !analysis->fit) analysis = fra.find(method);
    }
    if (!analysis || !analysis->fit) return;
    const ModalModel& model = analysis->fit->model;
    const double limit = options.fit_max_hz.value_or(0.1 / machine.sample_time);
    for (const auto& record : records) {
        const ForceSignals signals{record.position, record.driving, record.inputs[improved_input], machine.sample_time};
        fra.residuals.push_back(force_residual(signals, record.form.period, model, limit));
        fra.residuals.back().record = record.source;
        for (const auto& o : record.observations) {
            // With a few harmonics below the limit.
            if (o.is_line || !o.missing.empty() || 3 * o.frequency_hz > limit) continue;
            auto loop = measured_loop(fra.residuals.back(), o.window, o.frequency_hz, machine.sample_time);
            if (!loop.position.empty()) fra.loops.push_back(std::move(loop));
        }
    }
    // Some of them, over all frequencies.
    std::ranges::stable_sort(fra.loops, {}, &MeasuredLoop::frequency_hz);
    constexpr std::size_t most = 6;
    if (fra.loops.size() <= most) return;
    std::vector<MeasuredLoop> some;
    for (std::size_t i = 0; i < most; ++i) some.push_back(fra.loops[i * (fra.loops.size() - 1) / (most - 1)]);
    fra.loops = std::move(some);
}

void note_what_is_missing(const MachineModel& machine, const MeasuredFraOptions& options, MeasuredFra& fra) {
    const auto asked = [&](const char* method) {
        return std::ranges::find(options.methods, method) != options.methods.end();
    };
    if (!has_friction(machine) && (asked("fra2") || asked("proposed") || asked("improved"))) {
        fra.notes.push_back(
            "The machine file has no friction: FRA-2 is FRA-1, and Proposed and Improved take out the delay "
            "alone.");
    }
    if (!options.delay && loop_dead_time(machine) <= machine.sample_time / 2 && asked("proposed")) {
        fra.notes.push_back("The machine file has no delays: the delay model of Proposed is the hold alone.");
    }
    std::vector<std::string> others;
    for (const auto& effect : machine.effects) {
        if (!effect.kind().is_friction_law) others.push_back(effect.kind().name);
    }
    if (!others.empty()) {
        fra.notes.push_back(fmt::format("Effects in the machine file that are no part of the friction model: {}.",
                                        fmt::join(others, ", ")));
    }
}

void require_allowed(const MeasuredFraOptions& options) {
    const Json given = options_json(options);
    FieldReader fields(given, "a frequency response");
    MeasuredFraOptions read;
    read_options(read, fields);
}

} // namespace

std::string title_of_method(const std::string& method) {
    static const std::vector<std::string> titles = {"FRA-1", "FRA-2", "Proposed", "Improved", "BLA"};
    const auto place = std::ranges::find(fra_methods, method) - fra_methods.begin();
    return titles.at(static_cast<std::size_t>(place));
}

MeasuredFra measure_fra(const FraRequest& request) {
    std::vector<Table> tables;
    for (const auto& record : request.records) {
        tables.push_back(record.read(request.columns, fra_columns(), request.machine.sample_time));
    }
    return measure_fra(request.machine, tables, request.options);
}

const std::vector<std::string>& fra_columns() {
    static const std::vector<std::string> names = {"t", "r", "exc", "u", "y"};
    return names;
}

const MeasuredAnalysis* MeasuredFra::find(const std::string& method) const {
    const auto found = std::ranges::find(analyses, method, &MeasuredAnalysis::method);
    return found == analyses.end() ? nullptr : &*found;
}

MeasuredFra measure_fra(const MachineModel& machine, const std::vector<Table>& tables,
                        const MeasuredFraOptions& options) {
    require_allowed(options);
    if (tables.empty()) throw InputError("a frequency response needs at least one record");
    MeasuredFra fra;
    fra.delay = options.delay.value_or(loop_dead_time(machine));
    note_what_is_missing(machine, options, fra);

    std::vector<FraRecord> records;
    for (const auto& table : tables) {
        FraRecord record = prepared(machine, table, options, fra.delay);
        for (const auto& earlier : records) {
            refuse_repeated_record(record.source, record.position, earlier.source, earlier.position);
        }
        record.form = recognize_excitation(record.excitation, machine.sample_time, record.source);
        observe(machine, options, {}, record);
        if (record.form.kind == ExcitationKind::broadband && record.loop_closed) {
            fra.notes.push_back(fmt::format("{}: the loop is closed; the response is that of the joint input-output "
                                            "method, with {} as reference.",
                                            record.source, record.excited_by));
        }
        fra.records.push_back(describe(record, machine.sample_time));
        records.push_back(std::move(record));
    }
    const auto count_of = [&](ExcitationKind kind) {
        return std::ranges::count_if(records, [&](const FraRecord& record) { return record.form.kind == kind; });
    };
    const auto broadband = count_of(ExcitationKind::broadband), all = std::ssize(records);
    if (broadband > 0 && broadband < all) {
        throw InputError(
            fmt::format("{} of {} records are neither single sines nor periodic; they cannot be combined with "
                        "the others, analyze them apart",
                        broadband, all));
    }
    std::vector<std::string> notes = analyze(machine, options, records, fra);
    // The transients of single sines are those of the modes, which are known by now.
    if (const auto known = fitted_responses(fra); !known.empty() && count_of(ExcitationKind::stepped_sine) > 0) {
        for (auto& record : records) observe(machine, options, known, record);
        notes = analyze(machine, options, records, fra);
    }
    fra.notes.insert(fra.notes.end(), notes.begin(), notes.end());
    if (std::ranges::any_of(fra.analyses, [](const auto& a) { return a.fit && a.fit->rounding; })) {
        fra.notes.push_back(
            "The noise is less than an eighth of an encoder step, so the rounding of the sines is not random: among "
            "its errors are "
            "a few large ones, and standard errors of the fits may be too small where such a frequency decides.");
    }
    if (fra.analyses.empty())
        throw InputError("none of the methods can be used with these records: " + fra.notes.back());

    map_friction(machine, options, records, fra);

    std::vector<std::string> missing, unsettled;
    for (const auto& point : fra.analyses.front().points) {
        if (!point.missing.empty()) {
            missing.push_back(fmt::format("{:.6g} Hz ({})", point.frequency_hz, point.missing));
        } else if (!point.settled) {
            unsettled.push_back(fmt::format("{:.6g} Hz", point.frequency_hz));
        }
    }
    const auto shortened = [](std::vector<std::string>& list) {
        const std::size_t count = list.size();
        constexpr std::size_t most = 8;
        if (count > most) list.resize(most);
        return fmt::format("{}{}", fmt::join(list, ", "),
                           count > most ? fmt::format(" and {} more", count - most) : "");
    };
    if (!missing.empty()) fra.notes.push_back("Without a value: " + shortened(missing) + ".");
    if (!unsettled.empty()) {
        fra.notes.push_back("A transient is left, for which the bounds are wider: " + shortened(unsettled) + ".");
    }
    return fra;
}

} // namespace tribode
