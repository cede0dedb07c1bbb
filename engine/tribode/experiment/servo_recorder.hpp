#pragma once
#include "tribode/hybrid/observer.hpp"
#include "tribode/machine/servo_system.hpp"

#include <cstddef>
#include <utility>
#include <vector>

namespace tribode {

// What was seen at each sample instant t_k of the controller: r[k], u[k], y[k] as the controller had them, and the
// true position x, velocity v and friction f as left limits. All channels that are recorded have the same length.
struct ServoTrace {
    std::vector<double> t;        // [s]
    std::vector<double> r;        // [m]
    std::vector<double> u;        // [N]
    std::vector<double> y;        // [m]
    std::vector<double> x;        // [m]
    std::vector<double> v;        // [m/s]
    std::vector<double> f;        // [N]
    std::vector<double> fed_back; // the part of u that is modeled friction, fed back [N]

    // Each of them, for what treats all alike.
    static constexpr std::vector<double> ServoTrace::*const columns[] = {
        &ServoTrace::t, &ServoTrace::r, &ServoTrace::u, &ServoTrace::y,
        &ServoTrace::x, &ServoTrace::v, &ServoTrace::f, &ServoTrace::fed_back};
};

// Which of them are recorded; the true motion is x, v and f.
struct ServoChannels {
    bool t = true, r = true, u = true, y = true, motion = true, fed_back = false;
};

class ServoRecorder final : public Observer {
  public:
    explicit ServoRecorder(const ServoSystem& system, ServoChannels channels = {})
        : system_(system),
          channels_(channels) {}

    void left_limit(const SystemState& state) override {
        if (channels_.motion) before_ = system_.outputs(state);
    }
    void sampled(ClockId clock, long k, const SystemState& state) override;

    // Room for so many samples, in the memory of columns that are not needed any more; before the first sample.
    void reserve(std::size_t samples, ServoTrace memory);

    const ServoTrace& trace() const { return trace_; }
    ServoTrace take_trace() { return std::move(trace_); }

  private:
    const ServoSystem& system_;
    const ServoChannels channels_;
    ServoPlant::Outputs before_{};
    ServoTrace trace_;
};

} // namespace tribode
