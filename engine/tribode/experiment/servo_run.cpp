#include "tribode/experiment/servo_run.hpp"

namespace tribode {

namespace {

// By its name: `automatic` would go on by BDF where a problem is stiff, which a search gives up instead.
SolverOptions solver_of(const ServoRunOptions& options, Method method) {
    SolverOptions solver = options.solver;
    if (options.purpose == Purpose::search) solver.method = method;
    return solver;
}

} // namespace

ServoRun::ServoRun(const MachineModel& machine, Drive drive, const ServoRunOptions& options, const RunControl& control)
    : system_(machine, std::move(drive), options.seed, options.start),
      method_(resolved(options.solver.method, system_, options.purpose)),
      simulator_(system_, solver_of(options, method_), control),
      recorder_(system_, options.channels) {
    simulator_.observe(&recorder_);
}

RunOutcome ServoRun::advance_to(long k) {
    return simulator_.advance_to(static_cast<double>(k) * system_.sample_time());
}

} // namespace tribode
