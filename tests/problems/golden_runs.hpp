#pragma once
#include "problems/exact_servo.hpp"

#include <string>
#include <utility>
#include <vector>

namespace tribode::problems {

// A run of the linear-motor-driven table whose solution is kept in tests/golden: 0.5 s from rest, every 10th
// sample instant, and every event.
struct GoldenRun {
    std::string name;                                                 // of the files: <name>.csv, <name>_events.csv
    std::vector<std::pair<std::string, std::vector<double>>> columns; // name and values; the first is t
    std::vector<ServoEvent> events;
};

// Solves all of them: g1 (open loop, 15 N, 10 Hz), g2 (open loop, 30 N, 34 Hz), loop (closed loop with
// delays, lag and encoder, 15 N, 10 Hz). They are described in full in tests/golden/README.md.
std::vector<GoldenRun> golden_runs();

// amplitude sin(2 pi frequency_hz k sample_time), k = 0 .. count-1.
std::vector<double> sampled_sine(double amplitude, double frequency_hz, double sample_time, std::size_t count);

// slip_forward, slip_backward, stick.
std::string to_string(EventKind kind);

// The text of the files, each number as the shortest text that reads back to the same double.
std::string trace_csv(const GoldenRun& run);
std::string events_csv(const GoldenRun& run);

} // namespace tribode::problems
