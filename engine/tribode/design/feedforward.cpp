#include "tribode/design/feedforward.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/design/deadbeat_feedforward.hpp"
#include "tribode/design/s_curve_feedforward.hpp"
#include "tribode/design/zero_phase_feedforward.hpp"

#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace tribode {

std::size_t MoveTask::settling_sample() const { return static_cast<std::size_t>(std::round(duration / sample_time)); }

std::size_t MoveTask::length() const { return static_cast<std::size_t>(std::round(horizon / sample_time)) + 1; }

std::complex<double> Feedforward::thrust_response(double frequency_hz) const {
    const double step = -2 * std::numbers::pi * frequency_hz * task.sample_time; // phase of z^-1
    std::complex<double> sum = 0;
    for (std::size_t k = 0; k < thrust.size(); ++k) {
        const double change = thrust[k] - (k > 0 ? thrust[k - 1] : 0.0);
        sum += change * std::polar(1.0, step * static_cast<double>(k));
    }
    return sum / task.distance;
}

const std::vector<std::string>& FeedforwardOptions::methods() {
    static const std::vector<std::string> names = {"deadbeat", "zero_phase", "s_curve", "input_shaping"};
    return names;
}

Json to_json(const Feedforward& feedforward) {
    return {{"method", feedforward.method},
            {"sample_time_s", feedforward.task.sample_time},
            {"distance_m", feedforward.task.distance},
            {"duration_s", feedforward.task.duration},
            {"horizon_s", feedforward.task.horizon},
            {"reference_m", feedforward.reference},
            {"thrust_N", feedforward.thrust}};
}

Feedforward feedforward_from_json(const Json& json, const std::string& where) {
    FieldReader fields(json, where, "feedforward");
    Feedforward result;
    result.method = fields.text("method", "");
    result.task.sample_time = fields.number("sample_time_s", "s", Allowed::positive);
    result.task.distance = fields.number("distance_m", "m", Allowed::finite);
    result.task.duration = fields.number("duration_s", "s", Allowed::positive);
    fields.value("horizon_s");
    fields.value("response");
    result.reference = fields.numbers("reference_m", "m", Allowed::finite, {});
    result.thrust = fields.numbers("thrust_N", "N", Allowed::finite, {});
    fields.finish();
    if (result.reference.empty() || result.reference.size() != result.thrust.size()) {
        fields.fail("reference_m", fmt::format("has {} values and thrust_N {}, must have as many, and one at least",
                                               result.reference.size(), result.thrust.size()));
    }
    result.task.horizon = static_cast<double>(result.reference.size() - 1) * result.task.sample_time;
    return result;
}

void FeedforwardOptions::check(const FieldReader& fields) const {
    if (task.distance == 0) fields.fail("distance_m", "= 0 m, must not be zero");
    if (task.horizon < task.duration) {
        fields.fail("horizon_s", fmt::format("= {} s, must not be shorter than duration_s = {} s",
                                             to_text(task.horizon), to_text(task.duration)));
    }
    if (task.horizon > 1e6 * task.sample_time) {
        fields.fail("horizon_s", fmt::format("= {} s, must not exceed 1e6 samples of {} s", to_text(task.horizon),
                                             to_text(task.sample_time)));
    }
}

Feedforward design_feedforward(const ModalModel& model, const FeedforwardOptions& options) {
    if (options.method == "zero_phase") return zero_phase_feedforward(model, options.task);
    if (options.method == "s_curve") return s_curve_feedforward(model, options.task);
    if (options.method == "input_shaping") {
        const int derivatives = options.shaper == "zvd" ? 1 : 0;
        return shaped_feedforward(model, options.task, derivatives, options.shaped_modes);
    }
    return deadbeat_feedforward(model, options.task, options.smoothness);
}

} // namespace tribode
