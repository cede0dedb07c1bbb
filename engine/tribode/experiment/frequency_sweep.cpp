#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/analysis/periodic_friction.hpp"
#include "tribode/analysis/sine_fit.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"
#include "tribode/base/text.hpp"
#include "tribode/control/discrete_transfer_function.hpp"
#include "tribode/control/sampled_friction.hpp"
#include "tribode/experiment/sweep_checkpoint.hpp"
#include "tribode/solver/simulator.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <optional>

namespace tribode {

namespace {

using std::numbers::pi;

// The loop's signals and what the sampled blocks make of them, sample by sample.
class LoopSignals final : public Observer {
  public:
    LoopSignals(const MachineModel& machine, const SweepOptions& options)
        : LoopSignals(machine.sample_time, options, options.friction_model.value_or(FrictionModel::of(machine))) {}

    LoopSignals(double sample_time, const SweepOptions& options, const FrictionModel& friction)
        : friction_model_(friction.elements, friction.viscous, sample_time),
          delay_model_(DiscreteTransferFunction::pade_delay(options.delay, options.delay_order, sample_time)) {}

    void sampled(ClockId clock, long, const SystemState& state) override {
        if (clock != ServoSystem::controller) return;
        const auto& values = ServoSystem::values(state);
        const double friction = friction_model_.step(values.detected);
        const double delayed = delay_model_.step(values.thrust);
        position.push_back(values.detected);
        friction_estimate.push_back(friction);
        delayed_thrust.push_back(delayed);
        input[0].push_back(values.thrust);
        input[1].push_back(values.thrust - friction);
        before_feedback.push_back(values.thrust - values.friction_fed_back);
        input[2].push_back(delayed - friction);
    }

    std::vector<double> position, friction_estimate, delayed_thrust, before_feedback;
    std::array<std::vector<double>, analysis_count> input; // of each analysis [N]

  private:
    SampledFriction friction_model_;
    DiscreteTransferFunction delay_model_;
};

// A: what the actuator makes of a phasor of u, with hold, dead time and thrust lag.
std::complex<double> actuator_response(const MachineModel& machine, double frequency) {
    const ServoAxis axis = machine.axis(); // as it is, with its effects
    const double half_turn = pi * frequency * machine.sample_time;
    const double late = half_turn + 2 * pi * frequency * axis.input_delay;
    std::complex<double> response = std::polar(std::sin(half_turn) / half_turn, -late);
    const double corner = axis.plant.current_loop_hz;
    if (corner > 0) response /= std::complex(1.0, frequency / corner);
    return response;
}

std::complex<double> improved_response(const MachineModel& machine, const FrictionModel& model, double frequency,
                                       std::complex<double> thrust, std::vector<std::complex<double>> position) {
    for (std::size_t n = 0; n < position.size(); ++n) {
        position[n] *= std::polar(1.0, 2 * pi * static_cast<double>(n + 1) * frequency * machine.output_delay);
    }
    const auto friction = friction_phasor(position, frequency, model.elements, model.viscous);
    return position.front() / (actuator_response(machine, frequency) * thrust - friction);
}

// One frequency: the run and its windows.
class SinglePoint {
  public:
    SinglePoint(const MachineModel& machine, const SweepOptions& options, double frequency, std::uint64_t seed,
                const RunControl& control)
        : machine_(machine),
          options_(options),
          frequency_(frequency),
          ts_(machine.sample_time),
          system_(machine,
                  ClosedLoop{[this](long k) {
                                 return LoopInput{0.0, excitation(k)};
                             },
                             options.friction_feedback},
                  seed),
          simulator_(system_, options.solver, control),
          signals_(machine, options) {
        simulator_.observe(&signals_);
    }

    // Runs until both u and y repeat themselves. The outcome is not ok where the run failed.
    RunOutcome settle() {
        const double earliest = std::max(options_.settle_periods / frequency_, options_.settle_time);
        // Windows of whole periods, long enough to tell a slow change from rounding of the encoder.
        const long periods = std::max(1L, std::lround(std::ceil(0.05 * frequency_)));
        const auto length = static_cast<double>(periods) / frequency_;
        std::optional<std::array<std::complex<double>, 2>> previous;
        // The first window must have begun.
        for (double t = std::max(earliest - length, length);; t += length) {
            const RunOutcome outcome = advance_to(t);
            if (!outcome.ok()) return outcome;
            const std::size_t end = signals_.position.size();
            const Window window = whole_periods(0, periods, ts_, frequency_);
            const std::size_t first = end - window.count;
            const SineBasis basis(window.count, ts_, frequency_, static_cast<double>(first) * ts_);
            const auto phasor = [&](const std::vector<double>& signal) {
                return basis.fit(std::span(signal).subspan(first, window.count)).fundamental();
            };
            const std::array latest = {phasor(signals_.input[0]), phasor(signals_.position)};
            settled_ = previous && tribode::settled((*previous)[0], latest[0], options_.settle_tolerance) &&
                       tribode::settled((*previous)[1], latest[1], options_.settle_tolerance);
            if (settled_ || t > options_.settle_time_limit) return outcome;
            previous = latest;
        }
    }

    // Runs on over the window to be measured; signals() then end with it.
    RunOutcome measure(long periods) {
        window_ = whole_periods(signals_.position.size(), periods, ts_, frequency_);
        return advance_to(static_cast<double>(window_.first + window_.count - 1) * ts_);
    }

    SweepPoint point() const {
        SweepPoint point;
        point.frequency_hz = frequency_;
        const SineBasis basis(window_.count, ts_, frequency_, static_cast<double>(window_.first) * ts_,
                              options_.harmonics);
        const SineFit y = basis.fit(cut(signals_.position)), u = basis.fit(cut(signals_.input[0]));
        std::array<std::span<const double>, analysis_count> inputs;
        for (std::size_t a = 0; a < analysis_count; ++a) {
            inputs[a] = cut(signals_.input[a]);
            point.response[a] = y.fundamental() / (a == 0 ? u : basis.fit(inputs[a])).fundamental();
        }
        const std::vector<double> coherences = coherence(inputs, cut(signals_.position), ts_, frequency_);
        std::ranges::copy(coherences, point.coherence.begin());
        if (options_.improved) {
            const FrictionModel model = options_.friction_model.value_or(FrictionModel::of(machine_));
            point.improved = improved_response(machine_, model, frequency_, u.fundamental(), y.harmonics);
        }
        if (options_.friction_feedback > 0) {
            point.add_on = y.fundamental() / basis.fit(cut(signals_.before_feedback)).fundamental();
        }
        // The phasor of A sin is -jA.
        point.loop_gain = std::complex(0.0, -options_.amplitude) / u.fundamental() - 1.0;
        point.thrust = u.fundamental();
        point.position = y.fundamental();
        point.thrust_distortion = u.total_harmonic_distortion();
        point.position_distortion = y.total_harmonic_distortion();
        point.settling_time = static_cast<double>(window_.first) * ts_;
        point.settled = settled_;
        return point;
    }

    RunStatistics statistics() const { return simulator_.statistics(); }

  private:
    double excitation(long k) const {
        return options_.amplitude * std::sin(2 * pi * frequency_ * static_cast<double>(k) * ts_);
    }
    // To the sample instant at or before t.
    RunOutcome advance_to(double t) { return simulator_.advance_to(std::floor(t / ts_ + 1e-6) * ts_); }

    std::span<const double> cut(const std::vector<double>& signal) const {
        return std::span(signal).subspan(window_.first, window_.count);
    }

    const MachineModel& machine_;
    const SweepOptions& options_;
    double frequency_, ts_;
    ServoSystem system_;
    Simulator simulator_;
    LoopSignals signals_;
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
    if (options.frequency_hz.empty()) throw InputError("a sweep needs at least one frequency");
    if (!machine.has_controller()) {
        throw InputError("a sweep runs in closed loop, and the machine has no controller");
    }
}

SweepPoint run_point(const MachineModel& machine, const SweepOptions& options, std::size_t index,
                     const RunControl& control) {
    const double frequency = options.frequency_hz[index];
    SinglePoint run(machine, options, frequency, derived_seed(options.seed, index), control);
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
    for_each_index(missing.size(), shown, "frequencies", [&](std::size_t n) {
        SweepPoint point = run_point(machine, options, missing[n], control);
        if (point.outcome.end == RunEnd::interrupted) return;
        kept.add(missing[n], point);
        points[missing[n]] = std::move(point);
    });

    SweepResult result;
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
    // The excitation goes on from the settled state, so the run is repeated with a recorder of the true signals.
    class Both final : public Observer {
      public:
        Both(const MachineModel& m, const SweepOptions& o, const ServoSystem& system)
            : signals(m, o),
              recorder(system) {}
        void left_limit(const SystemState& state) override { recorder.left_limit(state); }
        void sampled(ClockId clock, long k, const SystemState& state) override {
            signals.sampled(clock, k, state);
            recorder.sampled(clock, k, state);
        }
        LoopSignals signals;
        ServoRecorder recorder;
    };
    const double ts = machine.sample_time;
    const ServoSystem system(machine,
                             ClosedLoop{[&](long k) {
                                            const double t = static_cast<double>(k) * ts;
                                            return LoopInput{0.0, one.amplitude * std::sin(2 * pi * frequency * t)};
                                        },
                                        one.friction_feedback},
                             options.seed);
    Simulator simulator(system, options.solver, control);
    Both seen(machine, one, system);
    simulator.observe(&seen);
    const double settle = std::max(std::ceil(std::max(one.settle_periods, one.settle_time * frequency)), 1.0);
    const RunOutcome outcome =
        simulator.advance_to(std::ceil((settle + static_cast<double>(periods_shown)) / frequency / ts) * ts);
    if (outcome.end == RunEnd::interrupted) throw EndedEarly(outcome.message);
    if (!outcome.ok()) throw Error(outcome.message);

    const auto first = static_cast<std::ptrdiff_t>(std::ceil(settle / frequency / ts));
    const auto tail = [&](const std::vector<double>& v) { return std::vector<double>(v.begin() + first, v.end()); };
    const ServoTrace& all = seen.recorder.trace();
    return {{tail(all.t), tail(all.r), tail(all.u), tail(all.y), tail(all.x), tail(all.v), tail(all.f)},
            tail(seen.signals.delayed_thrust),
            tail(seen.signals.friction_estimate),
            tail(seen.signals.input[2])};
}

ModalModel modal_model_of(const MachineModel& machine) {
    const ServoPlant::Parameters plant = machine.axis().plant; // as it is, with its effects
    ModalModel model;
    model.rigid_gain = plant.rigid_gain;
    for (const auto& mode : plant.modes) model.modes.push_back({mode.gain, mode.freq_hz, mode.zeta});
    return model;
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

FrequencyResponse SweepResult::improved() const {
    FrequencyResponse response;
    for (const auto& point : points) {
        if (!point.improved) continue;
        response.frequency_hz.push_back(point.frequency_hz);
        response.value.push_back(*point.improved);
    }
    return response;
}

FrequencyResponse SweepResult::add_on() const {
    FrequencyResponse response;
    for (const auto& point : points) {
        if (!point.add_on) continue;
        response.frequency_hz.push_back(point.frequency_hz);
        response.value.push_back(*point.add_on);
    }
    return response;
}

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
