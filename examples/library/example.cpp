// A machine and a system of its own, simulated with the library and compared with what one calculates by hand.
#include <tribode/tribode.hpp>

#include <cmath>
#include <cstdio>
#include <vector>

using namespace tribode;

// A slide of 2 kg with 4 N of dry friction is pushed by 10 N for half a second, and slides until it sticks.
void slide() {
    const Json description = {{"Ts", 1e-3}, {"rigid_gain_per_kg", 1 / 2.0}, {"friction", {{"coulomb", 4}}}};
    const MachineModel machine = MachineModel::from_description(description, "slide");

    DriveRecord push;
    for (int k = 0; k <= 2000; ++k) {
        push.t.push_back(k * machine.sample_time);
        push.u.push_back(k < 500 ? 10 : 0);
    }
    const Simulation run = simulate(machine, push);
    if (!run.outcome.ok()) throw Error(run.outcome.message);

    const double v = (10 - 4) / 2.0 * 0.5; // at the end of the push [m/s]
    std::printf("slide: comes to rest at [s] %.12f %.12f\n", run.events.back().t, 0.5 + v / (4 / 2.0));
    std::printf("slide: after [m] %.12f %.12f\n", run.trace.x.back(), v / 2 * (0.5 + v / (4 / 2.0)));
}

// A ball falls from 1 m and leaves the floor with 0.8 of its speed each time.
void ball() {
    const double g = 9.81, restitution = 0.8;
    SystemBuilder equations("ball");
    const Expression h = equations.state("h", 1, "m"), v = equations.state("v", 0, "m/s");
    equations.rate(h, v);
    equations.rate(v, -g);
    equations.when("impact", h < 0, {{h, 0}, {v, -restitution * v}});
    equations.output("energy", v * v / 2 + g * h, "J/kg");

    const EquationSystem system(equations.equations());
    const SystemRun run = run_system(system, {.end = 3});
    if (!run.outcome.ok()) throw Error(run.outcome.message);

    double impact = std::sqrt(2 / g), flight = 2 * impact; // [s]
    for (const Event& event : run.events) {
        std::printf("ball: impact at [s] %.12f %.12f\n", event.t, impact);
        impact += flight *= restitution;
    }
    const double lost = std::pow(restitution, 2.0 * static_cast<double>(run.events.size()));
    std::printf("ball: energy [J/kg] %.12f %.12f\n", run.table["energy"].values.back(), g * lost);
}

int main() {
    try {
        slide();
        ball();
    } catch (const Error& error) {
        std::fprintf(stderr, "example: %s\n", error.what());
        return 1;
    }
}
