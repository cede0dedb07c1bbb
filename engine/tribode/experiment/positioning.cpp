#include "tribode/experiment/positioning.hpp"
#include "tribode/analysis/spectrum.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/control/discrete_transfer_function.hpp"
#include "tribode/control/sampled_friction.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/experiment/friction_margins.hpp"
#include "tribode/experiment/improved_analysis.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

void check_controller(const MachineModel& machine) {
    if (!machine.has_controller()) throw InputError("positioning: the machine has no controller, must have one");
}

void check(const MachineModel& machine, const MoveTask& task, const PositioningOptions& options) {
    check_controller(machine);
    if (std::abs(task.sample_time / machine.sample_time - 1) > 1e-9) {
        throw InputError(
            fmt::format("positioning: the feedforward has the sample time {} s, must be the machine's {} s",
                        to_text(task.sample_time), to_text(machine.sample_time)));
    }
    constexpr double min_tail = 4; // samples after the move, for its spectrum
    if (options.duration < task.duration + min_tail * task.sample_time) {
        throw InputError(
            fmt::format("positioning: duration_s = {} s, must be longer than the move of {} s by 4 samples",
                        to_text(options.duration), to_text(task.duration)));
    }
}

// What the loop is given, sample by sample.
struct Inputs {
    std::vector<double> delayed_reference, feedforward, friction, velocity;
};

// Dry friction against the velocity of the reference; within 10 um/s of rest, where it takes any value, in proportion.
double dry_friction(const DryFriction& dry, double velocity) {
    constexpr double rest = 1e-5; // [m/s]
    return dry.level(velocity) * std::clamp(velocity / rest, -1.0, 1.0);
}

// The friction model along the reference.
class ReferenceFriction {
  public:
    ReferenceFriction(const FrictionModel& model, double sample_time)
        : elements_(model.elements, model.viscous, sample_time),
          dry_(model.dry),
          laws_(model.laws, sample_time),
          sample_time_(sample_time) {}

    // thrust: of the feedforward, friction apart [N].
    double step(double reference, double thrust) {
        double force = elements_.step(reference);
        const double velocity = (reference - previous_) / sample_time_;
        if (dry_.present()) force += dry_friction(dry_, velocity);
        previous_ = reference;
        if (laws_.empty()) return force;
        constexpr double no_load = 0;
        laws_.step(reference, no_load);
        force += laws_.force(velocity);
        return force + under_load(thrust + force, laws_.force_per_load(velocity));
    }

  private:
    // Friction that grows with the motor force Fm, which it is itself a part of: Fm = without + per_load abs(Fm).
    static double under_load(double without, double per_load) {
        if (per_load == 0) return 0;
        if (!(std::abs(per_load) < 1)) {
            throw InputError(
                fmt::format("positioning: friction takes {} of the motor force, must be less than all of it",
                            to_text(std::abs(per_load))));
        }
        return per_load * std::abs(without) / (1 - std::copysign(per_load, per_load * without));
    }

    SampledFriction elements_;
    DryFriction dry_;
    SampledLaws laws_;
    double sample_time_;  // [s]
    double previous_ = 0; // the reference begins at zero [m]
};

Inputs inputs_of(const MachineModel& machine, const Feedforward& feedforward, const PositioningOptions& options) {
    const auto count = static_cast<std::size_t>(std::round(options.duration / machine.sample_time)) + 1;
    auto delay = DiscreteTransferFunction::pade_delay(options.delay.value_or(loop_dead_time(machine)),
                                                      options.delay_order, machine.sample_time);
    ReferenceFriction friction(options.friction_model.value_or(FrictionModel::of(machine)), machine.sample_time);
    // What the velocity loop of a cascade brakes the reference by, to be added again. It comes from the same controller, so
    // that it has the same filter and delay.
    std::optional<CascadeController> velocity_loop;
    if (const auto* cascade = std::get_if<CascadeController>(&machine.controller)) {
        velocity_loop = *cascade;
        velocity_loop->kp = 0;
        velocity_loop->kv *= options.velocity_feedforward;
        velocity_loop->limit = CascadeController::no_limit;
    }
    CascadeController::State velocity_state;
    Inputs inputs;
    for (std::size_t k = 0; k < count; ++k) {
        const double reference = feedforward.reference[std::min(k, feedforward.reference.size() - 1)];
        inputs.delayed_reference.push_back(delay.step(reference));
        inputs.feedforward.push_back(feedforward.thrust[std::min(k, feedforward.thrust.size() - 1)]);
        inputs.friction.push_back(0.0);
        if (options.friction_compensation && options.friction_feedback == 0) {
            inputs.friction.back() = friction.step(reference, inputs.feedforward.back());
        }
        inputs.velocity.push_back(
            velocity_loop
                ? -velocity_loop->step(velocity_state, 0, inputs.delayed_reference.back(), machine.sample_time)
                : 0.0);
    }
    return inputs;
}

ServoTrace run(const MachineModel& machine, const Inputs& inputs, const PositioningOptions& options,
               const RunControl& control, PositioningResult& result) {
    const auto input = [&inputs](long k) {
        const auto i = static_cast<std::size_t>(k);
        return LoopInput{inputs.delayed_reference[i], inputs.feedforward[i] + inputs.friction[i] + inputs.velocity[i]};
    };
    ServoRun run(machine, ClosedLoop{input, options.friction_feedback, options.friction_model},
                 {.solver = options.solver, .seed = options.seed, .channels = {.fed_back = true}}, control);
    result.outcome = run.advance_to(static_cast<long>(inputs.feedforward.size()) - 1);
    result.statistics = run.statistics();
    if (result.outcome.end == RunEnd::interrupted) throw EndedEarly(result.outcome.message);
    if (!result.outcome.ok()) throw Error("positioning: " + result.outcome.message);
    return run.trace();
}

double max_abs(const std::vector<double>& values) {
    double max = 0;
    for (const double value : values) max = std::max(max, std::abs(value));
    return max;
}

std::optional<double> settled_from(const std::vector<double>& t, const std::vector<double>& error, double band) {
    std::optional<double> since;
    for (std::size_t k = error.size(); k-- > 0 && std::abs(error[k]) <= band;) since = t[k];
    return since;
}

} // namespace

Table PositioningResult::table() const {
    Table table = {};
    table.add("t_s", "s", trace.t);
    table.add("reference_delayed_m", "m", trace.r);
    table.add("detected_m", "m", trace.y);
    table.add("position_m", "m", trace.x);
    table.add("error_m", "m", error);
    table.add("tracking_error_m", "m", tracking_error);
    table.add("thrust_N", "N", trace.u);
    table.add("feedforward_N", "N", feedforward);
    table.add("friction_compensation_N", "N", friction_compensation);
    table.add("friction_N", "N", trace.f);
    return table;
}

PositioningResult run_positioning(const MachineModel& given, const Feedforward& feedforward,
                                  const PositioningOptions& options, const RunControl& control) {
    const MoveTask& task = feedforward.task;
    check(given, task, options);
    // The limit of a cascade holds for its sum with the feedforward of the velocity, which is added outside of it here.
    MachineModel machine = given;
    double limit = CascadeController::no_limit;
    auto* cascade = std::get_if<CascadeController>(&machine.controller);
    if (cascade && options.velocity_feedforward > 0) std::swap(limit, cascade->limit);
    Inputs inputs = inputs_of(machine, feedforward, options);
    PositioningResult result;
    result.trace = run(machine, inputs, options, control, result);
    const ServoTrace& seen = result.trace;
    double squares = 0;
    for (std::size_t k = 0; k < seen.y.size(); ++k) {
        result.error.push_back(seen.y[k] - task.distance);
        result.tracking_error.push_back(seen.r[k] - seen.y[k]);
        squares += result.tracking_error.back() * result.tracking_error.back();
    }
    result.rmse = std::sqrt(squares / static_cast<double>(seen.y.size()));
    result.max_error = max_abs(result.tracking_error);
    result.settling_time = settled_from(seen.t, result.error, options.band);
    result.peak_thrust = max_abs(seen.u);
    result.peak_position = max_abs(seen.x);
    if (result.peak_thrust > limit) {
        throw InputError(
            fmt::format("positioning: the thrust reaches {:.4g} N, above the controller's limit of {} N; the "
                        "move must be longer",
                        result.peak_thrust, to_text(limit)));
    }
    result.within_rating = result.peak_thrust <= options.rated_thrust;
    result.within_stroke = result.peak_position <= options.stroke;
    result.feedforward = std::move(inputs.feedforward);
    result.friction_compensation = options.friction_feedback > 0 ? seen.fed_back : inputs.friction;
    for (int i = 1; 0.5 * i <= options.spectrum_max_hz; ++i) result.spectrum_hz.push_back(0.5 * i);
    const auto end = static_cast<std::ptrdiff_t>(task.settling_sample());
    result.spectrum =
        amplitude_spectrum({result.error.begin() + end, result.error.end()}, machine.sample_time, result.spectrum_hz);
    return result;
}

StabilityMargins positioning_margins(const MachineModel& machine) {
    check_controller(machine);
    const ModalModel plant = modal_model_of(machine);
    const LoopDelays delays = loop_delays_of(machine);
    const auto loop_gain = [&](double f) {
        return controller_response(machine, f) * sampled_response(plant, delays, f);
    };
    return stability_margins(loop_gain, 0.5, 0.5 / delays.sample_time);
}

} // namespace tribode
