#include "tribode/experiment/friction_margins.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/experiment/friction_describing_function.hpp"
#include "tribode/machine/friction_model.hpp"

#include <cmath>
#include <fmt/format.h>
#include <map>
#include <memory>
#include <numbers>

namespace tribode {

using std::numbers::pi;

LoopDelays loop_delays_of(const MachineModel& machine) {
    return {machine.sample_time, machine.input_delay + machine.output_delay, machine.current_loop_hz};
}

static std::complex<double> filters_response(const std::vector<LoopFilter>& filters, double sample_time,
                                             double frequency_hz) {
    std::complex<double> response = 1;
    for (const auto& filter : filters) response *= filter.response(frequency_hz, sample_time);
    return response;
}

std::complex<double> pid_response(const PidController& pid, double sample_time, double frequency_hz) {
    const double a = pid.derivative_filter_hz > 0 ? std::exp(-2 * pi * pid.derivative_filter_hz * sample_time) : 0.0;
    const auto d = std::polar(1.0, -2 * pi * frequency_hz * sample_time); // z^-1
    const auto own =
        pid.kp + pid.ki * sample_time / (1.0 - d) + pid.kd * (1 - a) / sample_time * (1.0 - d) / (1.0 - a * d);
    return own * filters_response(pid.filters, sample_time, frequency_hz);
}

std::complex<double> controller_response(const MachineModel& machine, double frequency_hz) {
    const double ts = machine.sample_time;
    if (const auto* pid = std::get_if<PidController>(&machine.controller)) return pid_response(*pid, ts, frequency_hz);
    const auto* cascade = std::get_if<CascadeController>(&machine.controller);
    if (!cascade) return 0;
    const auto d = std::polar(1.0, -2 * pi * frequency_hz * ts); // z^-1
    const auto late = std::polar(1.0, -2 * pi * frequency_hz * ts * static_cast<double>(cascade->delay_samples));
    const auto integral = 1.0 + cascade->ki * ts / (1.0 - d);
    return late * cascade->kv * integral * (cascade->kp + (1.0 + d) / 2.0 * (1.0 - d) / ts) *
           filters_response(cascade->filters, ts, frequency_hz);
}

FrictionLoop friction_loop_of(const MachineModel& machine) {
    if (!machine.has_controller()) throw InputError("the machine has no controller, must have one to close a loop");
    FrictionLoop loop;
    loop.plant = modal_model_of(machine);
    loop.delays = loop_delays_of(machine);
    loop.controller = [machine](double f) { return controller_response(machine, f); };
    loop.elements = machine.elements;
    loop.viscous = machine.viscous;
    const std::vector<Effect> laws = FrictionModel::of(machine).laws;
    if (laws.empty()) return loop;
    if (const auto names = load_dependent(laws); !names.empty()) {
        throw InputError(fmt::format("the friction of {} grows with the load, which a loop gain does not know; "
                                     "tb.describing_function takes a load",
                                     names.front()));
    }
    using OverFrequency = std::function<std::complex<double>(double)>;
    auto tables = std::make_shared<std::map<double, OverFrequency>>(); // those made so far, by amplitude
    loop.laws = [laws, tables, ts = machine.sample_time](double amplitude) {
        constexpr double stuck = 1e-10; // [m], far below where a law begins to yield
        // As high as sampled_response() sums the images of the hold, as low as margins go.
        OverFrequency& table = (*tables)[amplitude];
        if (!table) table = law_describing_table(laws, amplitude > 0 ? amplitude : stuck, 0.05, 10.5 / ts);
        return table;
    };
    return loop;
}

FrictionMargins friction_margins(const MachineModel& machine, double friction_feedback, double amplitude) {
    constexpr double lowest = 0.05; // [Hz], below the crossover of the integrator and a stuck spring
    const double nyquist = 0.5 / machine.sample_time;
    const FrictionLoop loop = friction_loop_of(machine);
    if (loop.elements.empty() && loop.viscous == 0 && !loop.laws) {
        throw InputError(
            "the machine has no friction.elements, friction.viscous or friction law, must have one to feed "
            "back");
    }
    const auto stability = loop.stability(friction_feedback, amplitude, lowest, nyquist);
    return {stability_margins(loop.loop_gain(friction_feedback, amplitude), lowest, nyquist), stability.stable,
            stability.critical};
}

FrequencyResponse friction_loop_gain(const MachineModel& machine, double friction_feedback,
                                     const std::vector<double>& amplitude, const std::vector<double>& frequency_hz) {
    const double nyquist = 0.5 / machine.sample_time;
    const FrictionLoop loop = friction_loop_of(machine);
    if (amplitude.size() != 1 && amplitude.size() != frequency_hz.size()) {
        throw InputError(fmt::format("amplitude_m has {} entries, must be one or {}, as many as frequency_hz has",
                                     amplitude.size(), frequency_hz.size()));
    }
    FrequencyResponse response;
    std::function<std::complex<double>(double)> gain; // of the amplitude that it was made for
    for (std::size_t i = 0; i < frequency_hz.size(); ++i) {
        const double f = frequency_hz[i];
        if (!(f < nyquist)) {
            throw InputError(fmt::format("frequency {} Hz, must be below the Nyquist frequency of {} Hz", to_text(f),
                                         to_text(nyquist)));
        }
        response.frequency_hz.push_back(f);
        if (i == 0 || amplitude.size() > 1) {
            gain = loop.loop_gain(friction_feedback, amplitude[amplitude.size() == 1 ? 0 : i]);
        }
        response.value.push_back(gain(f));
    }
    return response;
}

} // namespace tribode
