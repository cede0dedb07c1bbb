// What the derivatives of a run cost: S1 of docs/benchmarks.md alone and with eight parameters, in turn, in processor time.
// Alone means that of a run by the same classes; nothing is kept from one run to the next.

#include "tribode/experiment/servo_run.hpp"
#include "tribode/script/machine_file.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <fmt/format.h>
#include <numbers>

namespace {

using namespace tribode;

constexpr long samples = 4000;
constexpr int repetitions = 51;

double processor_time() {
    timespec t{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

MachineModel table() {
    const std::string file = TRIBODE_SOURCE_DIR "/models/linear_motor_table.lua";
    MachineModel machine = MachineModel::from_description(read_description(file), file);
    machine.controller = PidController{2.05e4, 1.8e5, 653};
    machine.closed_loop = true;
    machine.current_loop_hz = 750;
    machine.encoder_resolution = 1e-7;
    machine.input_delay = machine.output_delay = machine.sample_time;
    return machine;
}

double seconds(const MachineModel& machine, const std::vector<std::string>& names) {
    const double start = processor_time();
    ServoRunOptions options;
    for (const auto& name : names) options.sensitivities.push_back(servo_direction(machine, name));
    const auto excitation = [&](long k) {
        return LoopInput{0, 15 * std::sin(20 * std::numbers::pi * static_cast<double>(k) * machine.sample_time)};
    };
    ServoRun run(machine, ClosedLoop{excitation}, options);
    if (!run.advance_to(samples - 1).ok() || run.sensitivities().size() != names.size()) std::exit(1);
    return processor_time() - start;
}

double median(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

} // namespace

int main() {
    const MachineModel machine = table();
    const std::vector<std::string> names = {
        "rigid_gain_per_kg", "modes[1].freq_hz",       "modes[1].gain",          "modes[2].zeta",
        "friction.viscous",  "friction.elements[3].K", "friction.elements[5].F", "friction.elements[12].F"};
    std::vector<std::vector<double>> times(names.size() + 1);
    for (int repetition = 0; repetition < repetitions; ++repetition) {
        for (const std::size_t count : {0, 1, 2, 4, 8}) {
            times[count].push_back(
                seconds(machine, {names.begin(), names.begin() + static_cast<std::ptrdiff_t>(count)}));
        }
    }
    fmt::print("parameters,us_per_sample,runs\n");
    for (std::size_t count = 0; count < times.size(); ++count) {
        if (times[count].empty()) continue;
        std::vector<double> ratios;
        for (std::size_t i = 0; i < times[count].size(); ++i) ratios.push_back(times[count][i] / times[0][i]);
        fmt::print("{},{:.3f},{:.2f}\n", count, 1e6 * median(times[count]) / samples, median(ratios));
    }
    return 0;
}
