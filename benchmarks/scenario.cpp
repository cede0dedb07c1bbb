#include "scenario.hpp"

#include <cmath>
#include <numbers>

namespace tribode::bench {

double Scenario::excitation(std::size_t k) const {
    return 15 * std::sin(2 * std::numbers::pi * frequency_hz * (static_cast<double>(k) * table.sample_time));
}

Scenario s1() {
    Scenario s{.name = "S1", .table = problems::linear_motor_table(), .samples = 4000};
    s.table.lag_hz = 750;
    s.loop = {.kp = 2.05e4,
              .ki = 1.8e5,
              .kd = 653,
              .input_delay = s.table.sample_time,
              .output_delay = s.table.sample_time,
              .encoder_resolution = 1e-7};
    return s;
}

Scenario s2() { return {.name = "S2", .table = problems::linear_motor_table(), .samples = 1000}; }

std::vector<Scenario> s3() {
    constexpr int count = 400;
    std::vector<Scenario> all;
    for (int i = 0; i < count; ++i) {
        Scenario s = s1();
        s.name = "S3";
        s.frequency_hz = 10 * std::pow(20.0, static_cast<double>(i) / (count - 1));
        s.samples = static_cast<std::size_t>(std::ceil(15 / s.frequency_hz / s.table.sample_time));
        all.push_back(std::move(s));
    }
    return all;
}

Scenario with_elements(std::size_t count) {
    Scenario s = s2();
    s.name = "elements";
    double force = 0;
    for (const auto& element : s.table.elements) force += element.F;
    const double stiffest = s.table.elements.front().K, softest = s.table.elements.back().K;
    s.table.elements.clear();
    for (std::size_t i = 0; i < count; ++i) {
        const double share = static_cast<double>(i) / static_cast<double>(count - 1);
        // With the stiffness of each in proportion to its force, the loop is as stiff for any number.
        const double stiffness = stiffest * std::pow(softest / stiffest, share) * 20 / static_cast<double>(count);
        s.table.elements.push_back({.K = stiffness, .F = force / static_cast<double>(count)});
    }
    return s;
}

Reference reference(const Scenario& scenario) {
    std::vector<double> excitation;
    for (std::size_t k = 0; k <= scenario.samples; ++k) excitation.push_back(scenario.excitation(k));
    Reference result;
    std::vector<problems::ServoEvent> events;
    if (scenario.loop) {
        const std::vector<double> rest(excitation.size());
        auto solution = problems::solve_loop_exactly(scenario.table, *scenario.loop, rest, excitation);
        result.x = std::move(solution.x);
        events = std::move(solution.events);
    } else {
        auto solution = problems::solve_exactly(scenario.table, excitation);
        result.x = std::move(solution.x);
        events = std::move(solution.events);
    }
    for (std::size_t i = 0; i < events.size(); ++i) {
        if (i == 0 || events[i].t != events[i - 1].t) ++result.events;
    }
    return result;
}

} // namespace tribode::bench
