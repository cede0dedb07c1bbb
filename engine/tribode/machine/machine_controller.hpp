#pragma once
#include "tribode/machine/machine_model.hpp"

namespace tribode {

// The controller of a machine, sample by sample: PID or cascade.
class MachineController {
  public:
    struct State {
        PidController::State pid;
        CascadeController::State cascade;
    };

    explicit MachineController(const MachineModel& machine)
        : controller_(machine.controller),
          sample_time_(machine.sample_time) {}

    // Output at one sample [N] from r[k] and y[k] [m]; zero without a controller.
    double step(State& s, double reference, double position) const {
        if (const auto* pid = std::get_if<PidController>(&controller_)) {
            return pid->step(s.pid, reference - position, sample_time_);
        }
        const auto* cascade = std::get_if<CascadeController>(&controller_);
        return cascade ? cascade->step(s.cascade, reference, position, sample_time_) : 0.0;
    }

  private:
    Controller controller_;
    double sample_time_; // [s]
};

} // namespace tribode
