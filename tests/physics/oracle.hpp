#pragma once
#include "physics/reference_machine.hpp"
#include "problems/exact_servo.hpp"
#include "problems/golden_runs.hpp"
#include "tribode/experiment/simulation.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {

// The machine description of an oracle's problem.
inline Json description_of(const problems::ServoProblem& p) {
    Json d;
    d["Ts"] = p.sample_time;
    d["rigid_gain_per_kg"] = p.rigid_gain;
    d["modes"] = Json::array();
    for (const auto& m : p.modes) d["modes"].push_back({{"gain", m.gain}, {"freq_hz", m.freq_hz}, {"zeta", m.zeta}});
    d["friction"] = {{"viscous", p.viscous}, {"coulomb", p.coulomb}, {"elements", Json::array()}};
    for (const auto& e : p.elements) d["friction"]["elements"].push_back({{"K", e.K}, {"F", e.F}, {"D", e.D}});
    if (p.lag_hz > 0) d["current_loop_hz"] = p.lag_hz;
    return d;
}

inline void add_loop(Json& d, const problems::LoopSettings& loop) {
    d["controller"] = {{"type", "pid"}, {"kp", loop.kp}, {"ki", loop.ki}, {"kd", loop.kd}};
    if (loop.derivative_filter_hz > 0) d["controller"]["derivative_filter_hz"] = loop.derivative_filter_hz;
    d["input_delay_s"] = loop.input_delay;
    d["output_delay_s"] = loop.output_delay;
    d["encoder_resolution_m"] = loop.encoder_resolution;
}

inline std::vector<double> instants(std::size_t count, double sample_time = 5e-4) {
    std::vector<double> t(count);
    for (std::size_t k = 0; k < count; ++k) t[k] = static_cast<double>(k) * sample_time;
    return t;
}

inline Simulation run_open_loop(const Json& description, const std::vector<double>& u, const SolverOptions& solver) {
    const MachineModel machine = machine_of(description);
    DriveRecord record;
    record.t = instants(u.size(), machine.sample_time);
    record.u = u;
    Simulation run = simulate(machine, record, {.solver = solver});
    EXPECT_TRUE(run.outcome.ok()) << run.outcome.message;
    return run;
}

inline Simulation run_closed_loop(const Json& description, const std::vector<double>& reference,
                                  const std::vector<double>& excitation, const SolverOptions& solver) {
    const MachineModel machine = machine_of(description);
    DriveRecord record;
    record.t = instants(reference.size(), machine.sample_time);
    record.reference = reference;
    record.excitation = excitation;
    Simulation run = simulate(machine, record, {.solver = solver});
    EXPECT_TRUE(run.outcome.ok()) << run.outcome.message;
    return run;
}

inline double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
    EXPECT_EQ(a.size(), b.size());
    double largest = 0;
    for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
    return largest;
}

// The largest difference of the times, after a check that both logs tell of the same changes in the same
// order.
inline double largest_time_difference(const EventLog& events, const std::vector<problems::ServoEvent>& exact) {
    const auto kind_of = [](problems::EventKind kind) {
        switch (kind) {
        case problems::EventKind::slip_forward: return SlipState::slip_forward;
        case problems::EventKind::slip_backward: return SlipState::slip_backward;
        case problems::EventKind::stick: break;
        }
        return SlipState::stick;
    };
    EXPECT_EQ(events.size(), exact.size());
    double largest = 0;
    for (std::size_t i = 0; i < std::min(events.size(), exact.size()); ++i) {
        const bool same =
            events[i].subject == exact[i].element && events[i].kind == static_cast<int>(kind_of(exact[i].kind));
        EXPECT_TRUE(same) << "event " << i << " at " << exact[i].t << " s: element " << events[i].subject << " against "
                          << exact[i].element << ", kind " << events[i].kind << " at " << events[i].t;
        if (!same) return 1;
        largest = std::max(largest, std::abs(events[i].t - exact[i].t));
    }
    return largest;
}

} // namespace tribode
