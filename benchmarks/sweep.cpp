// A frequency sweep of the linear-motor-driven table: 40 frequencies from 10 to 200 Hz at 15 N, with one
// worker and with two. Frequencies are independent, so that two workers should take half the time where there
// are two processors.

#include "experiment/frequency_sweep.hpp"
#include "ratio_report.hpp"
#include "script/machine_file.hpp"

namespace tribode {
namespace {

void sweep(benchmark::State& state) {
    const std::string file = TRIBODE_SOURCE_DIR "/models/linear_motor_table.lua";
    const MachineModel machine = MachineModel::from_description(read_description(file), file);
    SweepOptions options;
    constexpr int count = 40;
    for (int i = 0; i < count; ++i) options.frequency_hz.push_back(10 + 190.0 * i / (count - 1));
    RunControl control;
    control.workers = static_cast<unsigned>(state.range(0));
    long samples = 0;
    for (auto _ : state) {
        const SweepResult result = run_sweep(machine, options, control);
        if (!result.complete || !result.warnings().empty()) {
            state.SkipWithError("the sweep has points that failed or did not settle");
            return;
        }
        samples += result.statistics().samples;
    }
    // Each controller sample is three clock instants: encoder, controller, hold.
    state.counters["s_per_sample"] = benchmark::Counter(
        static_cast<double>(samples) / 3, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

} // namespace
} // namespace tribode

int main(int argc, char** argv) {
    benchmark::RegisterBenchmark("sweep", tribode::sweep)
        ->Arg(1)
        ->Arg(2)
        ->UseRealTime()
        ->MeasureProcessCPUTime()
        ->Unit(benchmark::kMillisecond);
    return tribode::run_with_ratios(argc, argv, "sweep/1", tribode::Time::wall);
}
