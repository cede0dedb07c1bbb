#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/experiment/servo_recorder.hpp"
#include "tribode/experiment/servo_sensitivity.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/solver/simulator.hpp"

#include <cstdint>
#include <memory>
#include <vector>

namespace tribode {

struct ServoRunOptions {
    SolverOptions solver;
    std::uint64_t seed = 0; // of the noise
    ServoSystem::Start start{0.0, 0.0};
    ServoChannels channels;
    Purpose purpose = Purpose::result;              // what `automatic` is chosen for
    std::vector<ServoDirection> sensitivities = {}; // by what the channels are differentiated; not with fixed steps
};

// One run of a machine: its system, simulator and recorder. Whatever simulates a machine does it with this.
class ServoRun {
  public:
    // The drive's functions are called while the run lasts. Throws InputError where the method cannot run the machine, or not
    // differentiate it.
    ServoRun(const MachineModel& machine, Drive drive, const ServoRunOptions& options, const RunControl& control = {});

    ServoRun(const ServoRun&) = delete; // simulator and recorder refer to the system
    ServoRun& operator=(const ServoRun&) = delete;

    // To sample k of the controller, this sample included. Again and again, with growing k.
    RunOutcome advance_to(long k);

    // Before the first advance: the trace will have so many samples; columns that are not needed any more give their memory.
    void reserve(std::size_t samples, ServoTrace memory = {}) { recorder_.reserve(samples, std::move(memory)); }

    const ServoTrace& trace() const { return recorder_.trace(); } // of the samples reached
    ServoTrace take_trace() { return recorder_.take_trace(); }    // at the end
    const EventLog& events() const { return simulator_.events(); }
    RunStatistics statistics() const { return simulator_.statistics(); }
    Method method() const { return method_; }                   // the one used
    const std::vector<ServoSensitivity>& sensitivities() const; // at the samples reached, as asked for

  private:
    const std::unique_ptr<const ServoSystem> system_;
    const SensitiveServoSystem* sensitive_; // the same; null: without sensitivities
    const Method method_;
    Simulator simulator_;
    ServoRecorder recorder_;
};

} // namespace tribode
