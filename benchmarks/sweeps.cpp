#include "sweeps.hpp"

#include "machine_of.hpp"
#include "tribode/analysis/modal_fit.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/script/machine_file.hpp"

#include <limits>
#include <stdexcept>

namespace tribode::bench {

namespace {

// The fits of scripts/fra_comparison.lua: the delay, read at 120 Hz, is taken out of the first two.
void fit_all(const SweepResult& sweep) {
    for (std::size_t a = 0; a < analysis_count; ++a) {
        FrequencyResponse response = sweep.response(a);
        if (analysis_names[a] != "Proposed") response = response.remove_delay(phase_delay(response, 120));
        if (!fit_modal_model(response).converged) throw std::runtime_error("a fit did not converge");
    }
}

Run run_of(const SweepResult& sweep) {
    const RunStatistics statistics = sweep.statistics();
    // Each sample of the controller is three clock instants: encoder, controller, hold.
    return {{}, statistics.samples / 3, statistics.steps, statistics.events};
}

} // namespace

Run analysed_sweep(Method method) {
    SweepOptions options;
    for (const Scenario& s : s3()) options.frequency_hz.push_back(s.frequency_hz);
    options.settle_periods = 5;
    options.settle_time = 0;
    options.settle_tolerance = std::numeric_limits<double>::max();
    options.measure_periods = 10;
    options.measure_time = 0;
    options.solver.method = method;
    const SweepResult sweep = run_sweep(machine_of(s1()), options);
    fit_all(sweep);
    return run_of(sweep);
}

Run judged_sweep(unsigned workers) {
    const std::string file = TRIBODE_SOURCE_DIR "/models/linear_motor_table.lua";
    const MachineModel machine = MachineModel::from_description(read_description(file), file);
    SweepOptions options;
    constexpr int count = 400;
    for (int i = 0; i < count; ++i) options.frequency_hz.push_back(10 + 190.0 * i / (count - 1));
    RunControl control;
    control.workers = workers;
    const SweepResult sweep = run_sweep(machine, options, control);
    if (!sweep.warnings().empty()) throw std::runtime_error(sweep.warnings().front());
    return run_of(sweep);
}

} // namespace tribode::bench
