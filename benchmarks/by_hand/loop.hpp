#pragma once
#include "scenario.hpp"

#include <cmath>

namespace tribode::bench {

// The sampled part of a scenario, one call per sample: the position in, the thrust to hold until the next sample out.
// Delays of one whole sample on either side are the values of the last call.
class Loop {
  public:
    explicit Loop(const Scenario& scenario) : scenario_(scenario) {}

    double thrust(double position) {
        const double excitation = scenario_.excitation(k_++);
        if (!scenario_.loop) return excitation;
        const problems::LoopSettings& loop = *scenario_.loop;
        const double ts = scenario_.table.sample_time;
        const double error = -detected_;
        detected_ = loop.encoder_resolution * std::floor(position / loop.encoder_resolution + 0.5);
        integral_ += loop.ki * ts * error;
        const double computed = loop.kp * error + integral_ + loop.kd * (error - last_error_) / ts + excitation;
        last_error_ = error;
        const double acting = waiting_;
        waiting_ = computed;
        return acting;
    }

  private:
    const Scenario& scenario_;
    std::size_t k_ = 0;
    double detected_ = 0, integral_ = 0, last_error_ = 0, waiting_ = 0;
};

} // namespace tribode::bench
