#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/analysis/sine_fit.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"
#include "tribode/base/text.hpp"
#include "tribode/control/discrete_transfer_function.hpp"
#include "tribode/experiment/improved_analysis.hpp"
#include "tribode/experiment/sweep_checkpoint.hpp"
#include "tribode/solver/prepared_steps.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <optional>

namespace tribode {

namespace {

using std::numbers::pi;

// The loop's signals from sample `first` on, and what the sampled blocks make of them [N].
struct LoopSignals {
    std::vector<double> friction_estimate, delayed_thrust, before_feedback;
    std::array<std::vector<double>, analysis_count> input; // of each analysis

    LoopSignals(const ServoTrace& trace, const MachineModel& machine, const SweepOptions& options,
                std::size_t first = 0) {
        const FrictionModel model = options.friction_model.value_or(FrictionModel::of(machine));
        MeasuredFriction friction_model(model, machine);
        auto delay_model = DiscreteTransferFunction::pade_delay(options.delay.value_or(loop_dead_time(machine)),
                                                                options.delay_order, machine.sample_time);
        const std::size_t kept = trace.u.size() - first;
        for (auto* signal : {&friction_estimate, &delayed_thrust, &before_feedback}) signal->reserve(kept);
        for (auto& signal : input) signal.reserve(kept);
        for (std::size_t k = 0; k < trace.u.size(); ++k) {
            const double delayed = delay_model.step(trace.u[k]);
            const double friction = friction_model.step(trace.y[k], delayed);
            if (k < first) continue;
            friction_estimate.push_back(friction);
            delayed_thrust.push_back(delayed);
            before_feedback.push_back(trace.u[k] - trace.fed_back[k]);
            input[0].push_back(trace.u[k]);
            input[1].push_back(trace.u[k] - friction);
            input[2].push_back(delayed - friction);
        }
    }
};

// The path along which the reference moves the axis meanwhile.
class Path {
  public:
    Path(const SweepOptions& options, double frequency, double sample_time)
        : step_(options.bias_velocity * sample_time),
          amplitude_(options.carrier_amplitude) {
        if (amplitude_ == 0) return;
        // Two periods of the carrier are this odd number of periods of the sine.
        periods_ = 2 * std::lround(frequency / options.carrier_hz - 0.5) + 1;
        turn_ = 2 * pi * 2 * frequency / static_cast<double>(periods_) * sample_time;
    }

    double at(long k) const {
        const auto n = static_cast<double>(k);
        return step_ * n + (amplitude_ == 0 ? 0.0 : amplitude_ * (1 - std::cos(turn_ * n)));
    }

    // As few periods of the sine, at least, as hold whole periods of the path.
    long whole(long periods) const { return (periods + periods_ - 1) / periods_ * periods_; }

    bool moves() const { return step_ != 0 || amplitude_ != 0; }

  private:
    double step_, amplitude_; // [m]
    long periods_ = 1;
    double turn_ = 0; // of the carrier, per sample
};

// A sin(phase) beside the controller's output, in closed loop along a path.
template <class Phase>
ClosedLoop sine_drive(const SweepOptions& options, double amplitude, const Path& path, Phase phase) {
    const auto input = [amplitude, path, phase](long k) {
        return LoopInput{path.at(k), amplitude * std::sin(phase(static_cast<double>(k)))};
    };
    return {input, options.friction_feedback, options.friction_model};
}

double amplitude_at(const SweepOptions& options, std::size_t index) {
    return options.amplitudes.empty() ? options.amplitude : options.amplitudes[index];
}

// One frequency: the run and its windows.
class SinglePoint {
  public:
    SinglePoint(const MachineModel& machine, const SweepOptions& options, std::size_t index, std::uint64_t seed,
                const RunControl& control)
        : machine_(machine),
          options_(options),
          frequency_(options.frequency_hz[index]),
          amplitude_(amplitude_at(options, index)),
          ts_(machine.sample_time),
          path_(options, frequency_, ts_),
          run_(machine,
               sine_drive(options, amplitude_, path_,
                          [f = frequency_, ts = ts_](double k) { return 2 * pi * f * k * ts; }),
               {.solver = options.solver,
                .seed = seed,
                .channels = {.t = false, .r = false, .motion = false, .fed_back = true}},
               control) {}

    // Runs until both u and y repeat themselves. The outcome is not ok where the run failed.
    RunOutcome settle() {
        const double earliest = std::max(options_.settle_periods / frequency_, options_.settle_time);
        // Windows of whole periods, long enough to tell a slow change from rounding of the encoder.
        const long periods = path_.whole(std::max(1L, std::lround(std::ceil(0.05 * frequency_))));
        const auto length = static_cast<double>(periods) / frequency_;
        std::optional<std::array<std::complex<double>, 2>> previous;
        // The first window must have begun.
        for (double t = std::max(earliest - length, length);; t += length) {
            RunOutcome outcome = advance_to(t);
            if (!outcome.ok()) return outcome;
            const ServoTrace& seen = run_.trace();
            const std::size_t end = seen.y.size();
            const Window window = whole_periods(0, periods, ts_, frequency_);
            const std::size_t first = end - window.count;
            const SineBasis basis(window.count, ts_, frequency_, static_cast<double>(first) * ts_);
            const std::vector<double> position = beside_path(seen.y, {first, window.count});
            const std::array latest = {basis.fundamental(std::span(seen.u).subspan(first)),
                                       basis.fundamental(position)};
            settled_ = previous && tribode::settled((*previous)[0], latest[0], options_.settle_tolerance) &&
                       tribode::settled((*previous)[1], latest[1], options_.settle_tolerance);
            if (settled_ || t > options_.settle_time_limit) return outcome;
            previous = latest;
        }
    }

    // Runs on over the window to be measured; the signals then end with it.
    RunOutcome measure(long periods) {
        window_ = whole_periods(run_.trace().y.size(), path_.whole(periods), ts_, frequency_);
        return run_.advance_to(static_cast<long>(window_.first + window_.count) - 1);
    }

    SweepPoint point() const {
        SweepPoint point;
        point.frequency_hz = frequency_;
        const std::vector<double> position = beside_path(run_.trace().y, window_);
        const LoopSignals signals(run_.trace(), machine_, options_, window_.first); // the window is at the end
        const SineBasis basis(window_.count, ts_, frequency_, static_cast<double>(window_.first) * ts_,
                              options_.harmonics);
        const SineFit y = basis.fit(position), u = basis.fit(signals.input[0]);
        std::array<std::span<const double>, analysis_count> inputs;
        for (std::size_t a = 0; a < analysis_count; ++a) {
            inputs[a] = signals.input[a];
            point.response[a] = y.fundamental() / (a == 0 ? u.fundamental() : basis.fundamental(inputs[a]));
        }
        const std::vector<double> coherences = coherence(inputs, position, ts_, frequency_);
        std::ranges::copy(coherences, point.coherence.begin());
        if (options_.improved) {
            const FrictionModel model = options_.friction_model.value_or(FrictionModel::of(machine_));
            point.improved = improved_response(machine_, model, frequency_, u.fundamental(), y.harmonics);
        }
        if (options_.friction_feedback > 0) {
            point.add_on = y.fundamental() / basis.fundamental(signals.before_feedback);
        }
        // The phasor of A sin is -jA.
        point.loop_gain = std::complex(0.0, -amplitude_) / u.fundamental() - 1.0;
        point.thrust = u.fundamental();
        point.position = y.fundamental();
        point.thrust_distortion = u.total_harmonic_distortion();
        point.position_distortion = y.total_harmonic_distortion();
        point.settling_time = static_cast<double>(window_.first) * ts_;
        point.settled = settled_;
        return point;
    }

    RunStatistics statistics() const { return run_.statistics(); }

  private:
    // To the sample instant at or before t.
    RunOutcome advance_to(double t) { return run_.advance_to(std::lround(std::floor(t / ts_ + 1e-6))); }

    std::vector<double> beside_path(const std::vector<double>& position, const Window& window) const {
        const auto first = position.begin() + static_cast<std::ptrdiff_t>(window.first);
        std::vector<double> beside(first, first + static_cast<std::ptrdiff_t>(window.count));
        if (!path_.moves()) return beside;
        for (std::size_t k = 0; k < beside.size(); ++k) beside[k] -= path_.at(static_cast<long>(window.first + k));
        return beside;
    }

    const MachineModel& machine_;
    const SweepOptions& options_;
    double frequency_, amplitude_, ts_;
    Path path_;
    ServoRun run_;
    Window window_;
    bool settled_ = false;
};

long periods_to_measure(const SweepOptions& options, double frequency) {
    return std::max(options.measure_periods, std::lround(std::ceil(options.measure_time * frequency - 1e-9)));
}

void check(const MachineModel& machine, const SweepOptions& options) {
    // Nearer to the Nyquist frequency sine and cosine cannot be told apart within a few periods.
    const double highest = 0.45 / machine.sample_time;
    double previous = 0;
    for (const double f : options.frequency_hz) {
        if (!(f > previous) || !(f <= highest)) {
            throw InputError(fmt::format("frequency {} Hz, must be ascending and between 0 and {} Hz (0.45 of the "
                                         "sampling rate)",
                                         to_text(f), to_text(highest)));
        }
        previous = f;
    }
    if (!options.amplitudes.empty() && options.amplitudes.size() != options.frequency_hz.size()) {
        throw InputError(fmt::format("amplitudes_N has {} entries, must have {}, one for each frequency",
                                     options.amplitudes.size(), options.frequency_hz.size()));
    }
    if (options.carrier_amplitude > 0 && !options.frequency_hz.empty() &&
        options.carrier_hz > options.frequency_hz.front() / 2) {
        throw InputError(fmt::format("carrier_hz = {}, must be at most {}, half of the lowest frequency",
                                     to_text(options.carrier_hz), to_text(options.frequency_hz.front() / 2)));
    }
    if (options.improved && (options.bias_velocity != 0 || options.carrier_amplitude > 0)) {
        throw InputError(
            "\"Improved\" knows friction between the samples for motions about a point at rest, not along a "
            "bias velocity or a carrier; leave out one of them");
    }
    if (options.frequency_hz.empty()) throw InputError("a sweep needs at least one frequency");
    if (!machine.has_controller()) {
        throw InputError("a sweep runs in closed loop, and the machine has no controller");
    }
}

SweepPoint run_point(const MachineModel& machine, const SweepOptions& options, std::size_t index,
                     const RunControl& control) {
    const double frequency = options.frequency_hz[index];
    SinglePoint run(machine, options, index, derived_seed(options.seed, index), control);
    RunOutcome outcome = run.settle();
    if (outcome.ok()) outcome = run.measure(periods_to_measure(options, frequency));
    SweepPoint point;
    if (outcome.ok()) {
        point = run.point();
    } else {
        point.frequency_hz = frequency;
    }
    point.outcome = outcome;
    point.statistics = run.statistics();
    return point;
}

} // namespace

SweepResult run_sweep(const MachineModel& machine, const SweepOptions& options, const RunControl& control,
                      const std::filesystem::path& checkpoint) {
    check(machine, options);
    SweepCheckpoint kept(checkpoint, machine, options);
    std::vector<std::optional<SweepPoint>> points = kept.load();
    std::vector<std::size_t> missing;
    for (std::size_t i = 0; i < points.size(); ++i) {
        // One of another frequency is none of this sweep.
        if (points[i] && points[i]->frequency_hz != options.frequency_hz[i]) points[i].reset();
        if (!points[i]) missing.push_back(i);
    }

    RunControl shown = control;
    if (control.progress) {
        shown.progress = [&](const std::string& what, std::size_t done, std::size_t) {
            control.progress(what, points.size() - missing.size() + done, points.size());
        };
    }
    PreparedSteps prepared_steps; // one machine, many runs
    SweepOptions together = options;
    if (!together.solver.prepared_steps) together.solver.prepared_steps = &prepared_steps;
    for_each_index(missing.size(), shown, "frequencies", [&](std::size_t n) {
        SweepPoint point = run_point(machine, together, missing[n], control);
        if (point.outcome.end == RunEnd::interrupted) return;
        kept.add(missing[n], point);
        points[missing[n]] = std::move(point);
    });

    SweepResult result;
    result.with_improved = options.improved;
    result.with_add_on = options.friction_feedback > 0;
    for (auto& point : points) {
        if (point) result.points.push_back(std::move(*point));
    }
    result.complete = result.points.size() == points.size();
    if (result.complete) {
        kept.remove();
    } else {
        kept.save();
    }
    return result;
}

SweepSignals run_single_frequency(const MachineModel& machine, const SweepOptions& options, double frequency,
                                  long periods_shown, const RunControl& control) {
    SweepOptions one = options;
    one.frequency_hz = {frequency};
    check(machine, one);
    const double ts = machine.sample_time;
    ServoRun run(machine,
                 sine_drive(one, amplitude_at(one, 0), Path(one, frequency, ts),
                            [&](double k) { return 2 * pi * frequency * (k * ts); }),
                 {.solver = options.solver, .seed = options.seed, .channels = {.fed_back = true}}, control);
    const double settle = std::max(std::ceil(std::max(one.settle_periods, one.settle_time * frequency)), 1.0);
    const RunOutcome outcome =
        run.advance_to(std::lround(std::ceil((settle + static_cast<double>(periods_shown)) / frequency / ts)));
    if (outcome.end == RunEnd::interrupted) throw EndedEarly(outcome.message);
    if (!outcome.ok()) throw Error(outcome.message);

    const auto first = static_cast<std::ptrdiff_t>(std::ceil(settle / frequency / ts));
    const auto tail = [&](const std::vector<double>& v) { return std::vector<double>(v.begin() + first, v.end()); };
    const ServoTrace& all = run.trace();
    const LoopSignals signals(all, machine, one);
    return {{tail(all.t), tail(all.r), tail(all.u), tail(all.y), tail(all.x), tail(all.v), tail(all.f), {}},
            tail(signals.delayed_thrust),
            tail(signals.friction_estimate),
            tail(signals.input[2])};
}

ModalModel modal_model_of(const MachineModel& machine) {
    const ServoPlant::Parameters plant = machine.axis().plant; // as it is, with its effects
    return {plant.rigid_gain, plant.modes};
}

FrequencyResponse SweepResult::response(std::size_t analysis) const {
    FrequencyResponse response;
    for (const auto& point : points) {
        if (!point.outcome.ok()) continue;
        response.frequency_hz.push_back(point.frequency_hz);
        response.value.push_back(point.response[analysis]);
    }
    return response;
}

std::vector<std::pair<std::string, FrequencyResponse>> SweepResult::responses() const {
    std::vector<std::pair<std::string, FrequencyResponse>> all;
    for (std::size_t a = 0; a < analysis_count; ++a) all.emplace_back(analysis_names[a], response(a));
    if (with_improved) all.emplace_back("Improved", improved());
    if (with_add_on) all.emplace_back("Add-on", add_on());
    return all;
}

static FrequencyResponse response_where_known(const std::vector<SweepPoint>& points,
                                              std::optional<std::complex<double>> SweepPoint::*value) {
    FrequencyResponse response;
    for (const auto& point : points) {
        if (!(point.*value)) continue;
        response.frequency_hz.push_back(point.frequency_hz);
        response.value.push_back(*(point.*value));
    }
    return response;
}

FrequencyResponse SweepResult::improved() const { return response_where_known(points, &SweepPoint::improved); }

FrequencyResponse SweepResult::add_on() const { return response_where_known(points, &SweepPoint::add_on); }

FrequencyResponse SweepResult::loop_gain() const {
    FrequencyResponse response;
    for (const auto& point : points) {
        if (!point.outcome.ok()) continue;
        response.frequency_hz.push_back(point.frequency_hz);
        response.value.push_back(point.loop_gain);
    }
    return response;
}

RunStatistics SweepResult::statistics() const {
    RunStatistics all;
    for (const auto& point : points) all += point.statistics;
    return all;
}

std::vector<std::string> SweepResult::warnings() const {
    std::vector<std::string> texts;
    for (const auto& point : points) {
        const std::string f = to_text(point.frequency_hz);
        if (!point.outcome.ok()) {
            texts.push_back(fmt::format("{} Hz: {}", f, point.outcome.message));
        } else if (!point.settled) {
            texts.push_back(fmt::format("{} Hz: not settled after {} s", f, to_text(point.settling_time)));
        }
    }
    return texts;
}

Table SweepResult::table() const {
    Table table;
    const auto column = [&](const std::string& name, const std::string& unit, auto value) {
        std::vector<double> values;
        for (const auto& point : points) {
            values.push_back(point.outcome.ok() ? value(point) : std::numeric_limits<double>::quiet_NaN());
        }
        table.add(name, unit, std::move(values));
    };
    std::vector<double> frequency;
    for (const auto& point : points) frequency.push_back(point.frequency_hz);
    table.add("frequency_hz", "Hz", std::move(frequency));
    const std::array<std::string, analysis_count> prefix = {"fra1", "fra2", "proposed"};
    for (std::size_t a = 0; a < analysis_count; ++a) {
        column(prefix[a] + "_real_m_per_N", "m/N", [a](const SweepPoint& p) { return p.response[a].real(); });
        column(prefix[a] + "_imag_m_per_N", "m/N", [a](const SweepPoint& p) { return p.response[a].imag(); });
        column(prefix[a] + "_coherence", "", [a](const SweepPoint& p) { return p.coherence[a]; });
    }
    if (std::ranges::any_of(points, [](const SweepPoint& p) { return p.improved.has_value(); })) {
        column("improved_real_m_per_N", "m/N", [](const SweepPoint& p) { return p.improved->real(); });
        column("improved_imag_m_per_N", "m/N", [](const SweepPoint& p) { return p.improved->imag(); });
    }
    if (std::ranges::any_of(points, [](const SweepPoint& p) { return p.add_on.has_value(); })) {
        column("add_on_real_m_per_N", "m/N", [](const SweepPoint& p) { return p.add_on->real(); });
        column("add_on_imag_m_per_N", "m/N", [](const SweepPoint& p) { return p.add_on->imag(); });
    }
    column("loop_gain_real", "", [](const SweepPoint& p) { return p.loop_gain.real(); });
    column("loop_gain_imag", "", [](const SweepPoint& p) { return p.loop_gain.imag(); });
    column("u_amplitude_N", "N", [](const SweepPoint& p) { return std::abs(p.thrust); });
    column("y_amplitude_m", "m", [](const SweepPoint& p) { return std::abs(p.position); });
    column("u_distortion", "", [](const SweepPoint& p) { return p.thrust_distortion; });
    column("y_distortion", "", [](const SweepPoint& p) { return p.position_distortion; });
    column("settling_time_s", "s", [](const SweepPoint& p) { return p.settling_time; });
    column("settled", "", [](const SweepPoint& p) { return p.settled ? 1.0 : 0.0; });
    return table;
}

} // namespace tribode
