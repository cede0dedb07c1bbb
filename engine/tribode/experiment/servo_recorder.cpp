#include "tribode/experiment/servo_recorder.hpp"

namespace tribode {

void ServoRecorder::sampled(ClockId clock, long k, const SystemState& state) {
    if (clock != ServoSystem::controller) return;
    const auto& values = ServoSystem::values(state);
    trace_.t.push_back(static_cast<double>(k) * system_.sample_time());
    trace_.r.push_back(values.reference);
    trace_.u.push_back(values.thrust);
    trace_.y.push_back(values.detected);
    trace_.x.push_back(before_.position);
    trace_.v.push_back(before_.velocity);
    trace_.f.push_back(before_.friction);
}

} // namespace tribode
