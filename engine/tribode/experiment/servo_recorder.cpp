#include "tribode/experiment/servo_recorder.hpp"

namespace tribode {

void ServoRecorder::sampled(ClockId clock, long k, const SystemState& state) {
    if (clock != ServoSystem::controller) return;
    const auto& values = ServoSystem::values(state);
    if (channels_.t) trace_.t.push_back(static_cast<double>(k) * system_.sample_time());
    if (channels_.r) trace_.r.push_back(values.reference);
    if (channels_.u) trace_.u.push_back(values.thrust);
    if (channels_.y) trace_.y.push_back(values.detected);
    if (channels_.fed_back) trace_.fed_back.push_back(values.friction_fed_back);
    if (!channels_.motion) return;
    trace_.x.push_back(before_.position);
    trace_.v.push_back(before_.velocity);
    trace_.f.push_back(before_.friction);
}

void ServoRecorder::reserve(std::size_t samples, ServoTrace memory) {
    trace_ = std::move(memory);
    for (const auto column : ServoTrace::columns) (trace_.*column).clear();
    const auto room = [&](bool recorded, std::initializer_list<std::vector<double>*> columns) {
        for (auto* column : columns) {
            if (recorded) column->reserve(samples);
        }
    };
    room(channels_.t, {&trace_.t});
    room(channels_.r, {&trace_.r});
    room(channels_.u, {&trace_.u});
    room(channels_.y, {&trace_.y});
    room(channels_.fed_back, {&trace_.fed_back});
    room(channels_.motion, {&trace_.x, &trace_.v, &trace_.f});
}

} // namespace tribode
