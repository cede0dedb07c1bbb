#pragma once
#include "tribode/control/cascade_controller.hpp"
#include "tribode/control/pid_controller.hpp"
#include "tribode/machine/machine_model.hpp"

namespace tribode {

// The controller of a machine, sample by sample: PID or cascade.
class MachineController {
  public:
    struct State {
        PidController::State pid;
        CascadeController::State cascade;
    };

    explicit MachineController(const MachineModel& machine) : is_pid_(true) {
        if (const auto* pid = std::get_if<PidSettings>(&machine.controller)) {
            pid_ = {pid->kp, pid->ki, pid->kd, pid->derivative_filter_hz.value_or(0), machine.sample_time};
        } else if (const auto* cascade = std::get_if<CascadeSettings>(&machine.controller)) {
            is_pid_ = false;
            cascade_.kp = cascade->kp;
            cascade_.kv = cascade->kv;
            if (cascade->limit) cascade_.limit = *cascade->limit;
            cascade_.delay_samples = static_cast<std::size_t>(cascade->delay_samples);
            cascade_.sample_time = machine.sample_time;
        }
    }

    // Output at one sample [N] from r[k] and y[k] [m].
    double step(State& s, double reference, double position) const {
        return is_pid_ ? pid_.step(s.pid, reference - position) : cascade_.step(s.cascade, reference, position);
    }

  private:
    bool is_pid_;
    PidController pid_;
    CascadeController cascade_;
};

} // namespace tribode
