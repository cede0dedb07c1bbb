#include "tribode/experiment/servo_run.hpp"
#include "tribode/base/error.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

// By its name: `automatic` would go on by BDF where a problem is stiff, which a search gives up instead.
SolverOptions solver_of(const ServoRunOptions& options, Method method) {
    SolverOptions solver = options.solver;
    if (options.purpose == Purpose::search) solver.method = method;
    return solver;
}

std::unique_ptr<const ServoSystem> system_of(const MachineModel& machine, Drive drive, const ServoRunOptions& options) {
    if (options.sensitivities.empty()) {
        return std::make_unique<ServoSystem>(machine, std::move(drive), options.seed, options.start);
    }
    auto system = std::make_unique<SensitiveServoSystem>(machine, std::move(drive), options.seed, options.start,
                                                         options.sensitivities, options.channels);
    const Method method = resolved(options.solver.method, *system, options.purpose);
    const bool is_affine = !why_not_affine(*system);
    if (is_affine ? method == Method::exact : !has_fixed_step(method)) return system;
    throw InputError(fmt::format("sensitivities: {}, not \"{}\"",
                                 is_affine ? "they need the solver \"exact\" (or \"auto\")"
                                           : "they need a solver that locates events (\"auto\" or \"collocation\")",
                                 name_of(method)));
}

} // namespace

ServoRun::ServoRun(const MachineModel& machine, Drive drive, const ServoRunOptions& options, const RunControl& control)
    : system_(system_of(machine, std::move(drive), options)),
      sensitive_(dynamic_cast<const SensitiveServoSystem*>(system_.get())),
      method_(resolved(options.solver.method, *system_, options.purpose)),
      simulator_(*system_, solver_of(options, method_), control),
      recorder_(*system_, options.channels) {
    simulator_.observe(&recorder_);
}

RunOutcome ServoRun::advance_to(long k) {
    if (sensitive_) sensitive_->expect_samples(k + 1);
    return simulator_.advance_to(static_cast<double>(k) * system_->sample_time());
}

const std::vector<ServoSensitivity>& ServoRun::sensitivities() const {
    static const std::vector<ServoSensitivity> none;
    return sensitive_ ? sensitive_->sensitivities() : none;
}

} // namespace tribode
