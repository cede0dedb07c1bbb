// What the derivatives of a run cost: S1 of docs/benchmarks.md, and systems of equations, alone and with some parameters, in
// turn, in processor time. Alone means that of a run by the same classes; nothing is kept from one run to the next, and
// recording and differentiating count.

#include "tribode/system/sensitivities.hpp"
#include "tribode/experiment/servo_run.hpp"
#include "tribode/experiment/system_run.hpp"
#include "tribode/script/machine_file.hpp"
#include "tribode/system/system_builder.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <fmt/format.h>
#include <numbers>

namespace {

using namespace tribode;

constexpr long samples = 4000;

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

// A smooth oscillator.
Equations van_der_pol() {
    SystemBuilder b("van der Pol");
    const Expression x = b.state("x", 2), v = b.state("v", 0);
    const Expression mu = b.parameter("mu", 1.3), a = b.parameter("a", 1), k = b.parameter("k", 1),
                     c = b.parameter("c", 0.1);
    b.rate(x, v);
    b.rate(v, mu * (a - x * x) * v - k * x + c);
    return b.equations();
}

// A mass with a vibration mode, an elastic stop and a lag of its thrust, under a sampled controller.
Equations axis() {
    SystemBuilder b("axis");
    const Expression x = b.state("x", 0), v = b.state("v", 0), y = b.state("y", 0), w = b.state("w", 0),
                     f = b.state("f", 0), u = b.discrete("u", 0), sum = b.discrete("sum", 0),
                     last = b.discrete("last", 0);
    const Expression m = b.parameter("m", 20), d = b.parameter("d", 30), k = b.parameter("k", 4e5),
                     c = b.parameter("c", 8), kp = b.parameter("kp", 2e4), ki = b.parameter("ki", 2e5),
                     kd = b.parameter("kd", 600), stop = b.parameter("stop", 1e-3);
    const double period = 5e-4;
    const Expression spring = k * (y - x) + c * (w - v);
    b.rate(x, v);
    b.rate(v, (f - d * v - where(stop < x, 1e5 * (x - stop), 0) + spring) / m);
    b.rate(y, w);
    b.rate(w, -spring / 3);
    b.rate(f, 4700 * (u - f));
    const Expression e = 1e-3 - x;
    b.sample("controller", period, 0,
             {{u, kp * e + sum + kd * (e - last) / period + 15 * sin(20 * std::numbers::pi * b.time())},
              {sum, sum + ki * period * e},
              {last, e}});
    return b.equations();
}

double seconds(const Equations& equations, double end, const std::vector<std::string>& names) {
    const double start = processor_time();
    SystemRunOptions options;
    options.end = end;
    const EquationSystem system(with_sensitivities(equations, names));
    if (!run_system(system, options).outcome.ok()) std::exit(1);
    return processor_time() - start;
}

double median(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

// Runs alone and with more and more of the names, in turn.
template <class Run>
void measure(const std::string& title, const std::vector<std::string>& names, int repetitions, const Run& run) {
    std::vector<std::vector<double>> times(names.size() + 1);
    for (int repetition = 0; repetition < repetitions; ++repetition) {
        for (std::size_t count = 0; count <= names.size(); count = count == 0 ? 1 : 2 * count) {
            times[count].push_back(run({names.begin(), names.begin() + static_cast<std::ptrdiff_t>(count)}));
        }
    }
    for (std::size_t count = 0; count < times.size(); ++count) {
        if (times[count].empty()) continue;
        std::vector<double> ratios;
        for (std::size_t i = 0; i < times[count].size(); ++i) ratios.push_back(times[count][i] / times[0][i]);
        fmt::print("{},{},{:.3f},{:.2f}\n", title, count, 1e3 * median(times[count]), median(ratios));
    }
}

} // namespace

int main() {
    fmt::print("run,parameters,ms,runs\n");
    const MachineModel machine = table();
    measure("machine",
            {"rigid_gain_per_kg", "modes[1].freq_hz", "modes[1].gain", "modes[2].zeta", "friction.viscous",
             "friction.elements[3].K", "friction.elements[5].F", "friction.elements[12].F"},
            51, [&](const std::vector<std::string>& names) { return seconds(machine, names); });
    measure("van der Pol", {"mu", "a", "k", "c"}, 21,
            [](const std::vector<std::string>& names) { return seconds(van_der_pol(), 200, names); });
    measure("axis", {"m", "d", "k", "c", "kp", "ki", "kd", "stop"}, 21,
            [](const std::vector<std::string>& names) { return seconds(axis(), 2, names); });
    return 0;
}
