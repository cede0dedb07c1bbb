#include "tribode/experiment/positioning.hpp"
#include "tribode/analysis/spectrum.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/control/discrete_transfer_function.hpp"
#include "tribode/control/sampled_friction.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/experiment/friction_margins.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

const PidController& pid_of(const MachineModel& machine) {
    if (const auto* pid = std::get_if<PidController>(&machine.controller)) return *pid;
    throw InputError("positioning: the machine has no PID controller, must have one (controller.type = \"pid\")");
}

void check(const MachineModel& machine, const MoveTask& task, const PositioningOptions& options) {
    pid_of(machine);
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
    std::vector<double> delayed_reference, feedforward, friction;
};

Inputs inputs_of(const MachineModel& machine, const Feedforward& feedforward, const PositioningOptions& options) {
    const auto count = static_cast<std::size_t>(std::round(options.duration / machine.sample_time)) + 1;
    auto delay = DiscreteTransferFunction::pade_delay(options.delay, options.delay_order, machine.sample_time);
    const FrictionModel friction = options.friction_model.value_or(FrictionModel::of(machine));
    SampledFriction model(friction.elements, friction.viscous, machine.sample_time);
    Inputs inputs;
    for (std::size_t k = 0; k < count; ++k) {
        const double reference = feedforward.reference[std::min(k, feedforward.reference.size() - 1)];
        inputs.delayed_reference.push_back(delay.step(reference));
        inputs.feedforward.push_back(feedforward.thrust[std::min(k, feedforward.thrust.size() - 1)]);
        inputs.friction.push_back(options.friction_compensation ? model.step(reference) : 0.0);
    }
    return inputs;
}

ServoTrace run(const MachineModel& machine, const Inputs& inputs, const PositioningOptions& options,
               const RunControl& control, PositioningResult& result) {
    const auto input = [&inputs](long k) {
        const auto i = static_cast<std::size_t>(k);
        return LoopInput{inputs.delayed_reference[i], inputs.feedforward[i] + inputs.friction[i]};
    };
    ServoRun run(machine, ClosedLoop{input}, {.solver = options.solver, .seed = options.seed}, control);
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

PositioningResult run_positioning(const MachineModel& machine, const Feedforward& feedforward,
                                  const PositioningOptions& options, const RunControl& control) {
    const MoveTask& task = feedforward.task;
    check(machine, task, options);
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
    result.within_rating = result.peak_thrust <= options.rated_thrust;
    result.within_stroke = result.peak_position <= options.stroke;
    result.feedforward = std::move(inputs.feedforward);
    result.friction_compensation = std::move(inputs.friction);
    for (int i = 1; 0.5 * i <= options.spectrum_max_hz; ++i) result.spectrum_hz.push_back(0.5 * i);
    const auto end = static_cast<std::ptrdiff_t>(task.settling_sample());
    result.spectrum =
        amplitude_spectrum({result.error.begin() + end, result.error.end()}, machine.sample_time, result.spectrum_hz);
    return result;
}

StabilityMargins positioning_margins(const MachineModel& machine) {
    const ModalModel plant = modal_model_of(machine);
    const PidController& pid = pid_of(machine);
    const LoopDelays delays = loop_delays_of(machine);
    const auto loop_gain = [&](double f) {
        return pid_response(pid, delays.sample_time, f) * sampled_response(plant, delays, f);
    };
    return stability_margins(loop_gain, 0.5, 0.5 / delays.sample_time);
}

} // namespace tribode
