#include "machine.hpp"
#include "target.hpp"
#include "tribode/base/error.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/machine/machine_model.hpp"

#include <cmath>

namespace tribode::fuzz {

namespace {

DriveRecord drive(const MachineModel& machine, bool closed_loop) {
    DriveRecord record;
    for (int k = 0; k < 20; ++k) {
        const double value = k % 5 - 2;
        record.t.push_back(k * machine.sample_time);
        record.measured.push_back(1e-3 * value);
        (closed_loop ? record.reference : record.u).push_back(closed_loop ? 1e-3 * value : 10 * value);
    }
    return record;
}

void simulate_shortly(const MachineModel& machine, bool closed_loop) {
    const DriveRecord record = drive(machine, closed_loop);
    RunControl control;
    control.stop = &Patience::over();
    Patience::begin();
    try {
        const Simulation run = simulate(machine, record, {.seed = 1}, control);
        if (!run.outcome.ok()) return require(!run.outcome.message.empty(), "a reason for an early end");
        require(run.trace.t.size() == record.t.size(), "a row per sample");
        for (const auto* values : {&run.trace.u, &run.trace.y, &run.trace.x, &run.trace.v, &run.trace.f}) {
            for (const double value : *values) require(std::isfinite(value), "finite numbers of a run that says ok");
        }
    } catch (const InputError&) {
    }
}

} // namespace

void run_machine(const Json& description) {
    const MachineModel machine = MachineModel::from_description(description, "a.json");
    require(MachineModel::from_description(machine.description(), "again").hash() == machine.hash(),
            "the same machine");
    simulate_shortly(machine, false);
    if (machine.has_controller()) simulate_shortly(machine, true);
}

} // namespace tribode::fuzz
