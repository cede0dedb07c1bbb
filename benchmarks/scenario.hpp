#pragma once
#include "problems/exact_servo.hpp"

#include <optional>
#include <string>
#include <vector>

namespace tribode::bench {

// What is run: the linear-motor-driven table from rest under 15 N sin(2 pi f t), sampled at 500 us. Everything that
// runs it, by the engine or by hand, takes its numbers from here and returns the true position at the sample instants
// 0 .. samples.
struct Scenario {
    std::string name;
    problems::ServoProblem table;
    std::optional<problems::LoopSettings> loop; // none: open loop, the excitation is the thrust
    double frequency_hz = 10;
    std::size_t samples = 0;

    double excitation(std::size_t k) const; // at sample k [N]
};

// Closed loop, 10 Hz, 2 s: 4000 samples; lag 750 Hz, encoder 1e-7 m, one sample of delay on either side.
Scenario s1();
// Open loop, 10 Hz, 0.5 s: 1000 samples; no lag, no rounding.
Scenario s2();
// S1 at 400 frequencies from 10 to 200 Hz, spaced logarithmically, 15 periods each.
std::vector<Scenario> s3();
// S2 with this many elements instead of twenty: the stiffness spaced logarithmically over the range of the table's, the
// total force that of the table, shared equally.
Scenario with_elements(std::size_t count);

// What a run should give, by the oracle of the tests, which shares no code with the engine.
struct Reference {
    std::vector<double> x; // [m], 0 .. samples
    long events = 0;       // instants at which elements slip or stick
};
Reference reference(const Scenario& scenario);

} // namespace tribode::bench
