#include "problems/golden_runs.hpp"

#include <charconv>
#include <cmath>
#include <numbers>

namespace tribode::problems {

namespace {

constexpr std::size_t samples = 1001; // 0.5 s and its end
constexpr std::size_t stride = 10;

std::vector<double> decimated(const std::vector<double>& values) {
    std::vector<double> kept;
    for (std::size_t k = 0; k < values.size(); k += stride) kept.push_back(values[k]);
    return kept;
}

GoldenRun open_loop(const std::string& name, double amplitude, double frequency_hz) {
    const ServoProblem table = linear_motor_table();
    const auto u = sampled_sine(amplitude, frequency_hz, table.sample_time, samples);
    const ServoSolution s = solve_exactly(table, u);
    return {
        name, {{"t", decimated(s.t)}, {"x", decimated(s.x)}, {"v", decimated(s.v)}, {"f", decimated(s.f)}}, s.events};
}

GoldenRun closed_loop(const std::string& name, double amplitude, double frequency_hz) {
    ServoProblem table = linear_motor_table();
    table.lag_hz = 750.0;
    const LoopSettings loop{.kp = 2.05e4,
                            .ki = 1.8e5,
                            .kd = 653.0,
                            .input_delay = 0.0005,
                            .output_delay = 0.000418,
                            .encoder_resolution = 1e-7};
    const auto exc = sampled_sine(amplitude, frequency_hz, table.sample_time, samples);
    const LoopSolution s = solve_loop_exactly(table, loop, std::vector<double>(samples, 0.0), exc);
    return {name,
            {{"t", decimated(s.t)},
             {"u", decimated(s.u)},
             {"y", decimated(s.y)},
             {"x", decimated(s.x)},
             {"v", decimated(s.v)},
             {"f", decimated(s.f)}},
            s.events};
}

void append(std::string& text, double value) {
    char digits[32];
    text.append(digits, std::to_chars(digits, digits + sizeof digits, value).ptr);
}

} // namespace

std::vector<GoldenRun> golden_runs() {
    return {open_loop("g1", 15.0, 10.0), open_loop("g2", 30.0, 34.0), closed_loop("loop", 15.0, 10.0)};
}

std::vector<double> sampled_sine(double amplitude, double frequency_hz, double sample_time, std::size_t count) {
    std::vector<double> u(count);
    for (std::size_t k = 0; k < count; ++k)
        u[k] = amplitude * std::sin(2 * std::numbers::pi * frequency_hz * (static_cast<double>(k) * sample_time));
    return u;
}

std::string to_string(EventKind kind) {
    switch (kind) {
    case EventKind::slip_forward: return "slip_forward";
    case EventKind::slip_backward: return "slip_backward";
    case EventKind::stick: break;
    }
    return "stick";
}

std::string trace_csv(const GoldenRun& run) {
    std::string text;
    for (const auto& [name, values] : run.columns) text += (text.empty() ? "" : ",") + name;
    text += '\n';
    for (std::size_t k = 0; k < run.columns.front().second.size(); ++k) {
        for (const auto& column : run.columns) {
            if (&column != &run.columns.front()) text += ',';
            append(text, column.second[k]);
        }
        text += '\n';
    }
    return text;
}

std::string events_csv(const GoldenRun& run) {
    std::string text = "t,element,kind\n";
    for (const auto& event : run.events) {
        append(text, event.t);
        text += ',' + std::to_string(event.element) + ',' + to_string(event.kind) + '\n';
    }
    return text;
}

} // namespace tribode::problems
