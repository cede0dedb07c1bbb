#pragma once
#include "tribode/hybrid/observer.hpp"
#include "tribode/machine/servo_system.hpp"

#include <vector>

namespace tribode {

// What was seen at each sample instant t_k of the controller: r[k], u[k], y[k] as the controller had them, and the
// true position x, velocity v and friction f as left limits. All columns have the same length.
struct ServoTrace {
    std::vector<double> t; // [s]
    std::vector<double> r; // [m]
    std::vector<double> u; // [N]
    std::vector<double> y; // [m]
    std::vector<double> x; // [m]
    std::vector<double> v; // [m/s]
    std::vector<double> f; // [N]
};

class ServoRecorder final : public Observer {
  public:
    explicit ServoRecorder(const ServoSystem& system) : system_(system) {}

    void left_limit(const SystemState& state) override { before_ = system_.outputs(state); }
    void sampled(ClockId clock, long k, const SystemState& state) override;

    const ServoTrace& trace() const { return trace_; }

  private:
    const ServoSystem& system_;
    ServoPlant::Outputs before_{};
    ServoTrace trace_;
};

} // namespace tribode
