// Set-valued Coulomb friction: true sticking at v = 0.
#include "physics/oracle.hpp"

namespace tribode {
namespace {

constexpr double gain = 0.1, level = 2.0; // of the block [1/kg], [N]

Json block() { return {{"rigid_gain_per_kg", gain}, {"friction", {{"coulomb", level}}}}; }

Json block_with_modes() {
    Json d = block();
    d["modes"] = {{{"gain", 0.02}, {"freq_hz", 40.0}, {"zeta", 0.01}},
                  {{"gain", 0.01}, {"freq_hz", 90.0}, {"zeta", 0.005}}};
    return d;
}

class Coulomb : public testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Methods, Coulomb,
                         testing::Values(Method::exact, Method::erk, Method::adams, Method::bdf, Method::fixed),
                         [](const auto& test) { return name_of(test.param); });

SolverOptions tight(Method method) {
    return {.method = method, .relative_tolerance = 1e-9, .absolute_tolerance = 1e-13, .fixed_step = 5e-5};
}

// The thrust rises by 0.01 N a sample and passes the level at sample 201; from there each held step of the
// excess force adds its exact impulse.
TEST_P(Coulomb, a_block_sticks_exactly_until_the_level_and_then_moves_as_in_closed_form) {
    constexpr double ts = 5e-4, rise = 0.01;
    std::vector<double> u(401);
    for (std::size_t k = 0; k < u.size(); ++k) u[k] = rise * static_cast<double>(k);
    const auto run = run_open_loop(block(), u, tight(GetParam()));
    double x = 0, v = 0;
    for (std::size_t k = 0; k < u.size(); ++k) {
        if (u[k] <= level) {
            EXPECT_EQ(run.trace.v[k], 0.0) << k;
            EXPECT_EQ(run.trace.x[k], 0.0) << k;
        }
        EXPECT_NEAR(run.trace.x[k], x, 1e-9) << k; // the tolerances; erk and fixed are exact here
        EXPECT_NEAR(run.trace.v[k], v, 1e-8) << k;
        const double a = gain * std::max(u[k] - level, 0.0);
        x += v * ts + a * ts * ts / 2;
        v += a * ts;
    }
    ASSERT_EQ(run.events.size(), 1u);
    EXPECT_EQ(run.events[0].subject, ServoPlant::coulomb_subject);
    EXPECT_EQ(run.events[0].kind, static_cast<int>(SlipState::slip_forward));
}

TEST_P(Coulomb, friction_balances_the_thrust_while_the_block_sticks) {
    const auto u = problems::sampled_sine(0.9 * level, 10, 5e-4, 201);
    const auto run = run_open_loop(block(), u, tight(GetParam()));
    // Left limits: the thrust held before the instant.
    for (std::size_t k = 1; k < u.size(); ++k) EXPECT_EQ(run.trace.f[k], u[k - 1]) << k;
}

TEST_P(Coulomb, a_force_below_the_level_moves_nothing_for_a_second) {
    for (const Json& machine : {block(), block_with_modes()}) {
        const auto run =
            run_open_loop(machine, problems::sampled_sine(0.999 * level, 17, 5e-4, 2001), tight(GetParam()));
        EXPECT_TRUE(run.events.empty());
        for (std::size_t k = 0; k < run.trace.t.size(); ++k) {
            ASSERT_EQ(run.trace.x[k], 0.0) << k;
            ASSERT_EQ(run.trace.v[k], 0.0) << k;
        }
    }
}

// Thrown into motion by a pulse, the axis comes to rest with its modes still ringing against each other.
TEST_P(Coulomb, the_driven_point_rests_while_the_modes_vibrate) {
    std::vector<double> u(2001, 0.0);
    std::fill(u.begin(), u.begin() + 20, 2.5 * level);
    const auto run = run_open_loop(block_with_modes(), u, tight(GetParam()));
    ASSERT_FALSE(run.events.empty());
    EXPECT_EQ(run.events.back().kind, static_cast<int>(SlipState::stick));
    std::size_t first = 0;
    while (run.trace.t[first] <= run.events.back().t) ++first;
    ASSERT_LT(first, 1000u);
    double force = 0;
    for (std::size_t k = first; k < run.trace.x.size(); ++k) {
        // Rounding of the sum of three positions and velocities, carried on by the integration.
        EXPECT_NEAR(run.trace.x[k], run.trace.x[first], 1e-15) << k;
        EXPECT_NEAR(run.trace.v[k], 0.0, 1e-13) << k;
        EXPECT_LE(std::abs(run.trace.f[k]), level) << k;
        force = std::max(force, std::abs(run.trace.f[k]));
    }
    EXPECT_GT(force, 0.01 * level); // the modes do ring
}

TEST_P(Coulomb, events_of_the_level_come_in_turns) {
    for (const Json& machine : {block(), block_with_modes()}) {
        const auto run = run_open_loop(machine, problems::sampled_sine(3 * level, 7, 5e-4, 1001), tight(GetParam()));
        ASSERT_GT(run.events.size(), 5u);
        for (std::size_t i = 1; i < run.events.size(); ++i) {
            const bool was_stuck = run.events[i - 1].kind == static_cast<int>(SlipState::stick);
            const bool is_stuck = run.events[i].kind == static_cast<int>(SlipState::stick);
            EXPECT_NE(was_stuck, is_stuck) << i << " at " << run.events[i].t;
        }
    }
}

struct Case {
    const char* name;
    bool modes, elements, lag;
    double amplitude; // of the thrust [N]
};

class CoulombOracle : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(
    Cases, CoulombOracle,
    testing::Values(Case{"block", false, false, false, 3.3}, Case{"block_with_lag", false, false, true, 3.3},
                    Case{"block_with_elements", false, true, false, 3.7},
                    Case{"elements_and_lag", false, true, true, 3.7}, Case{"modes", true, false, false, 3.3},
                    Case{"modes_and_elements", true, true, false, 3.7},
                    Case{"modes_elements_lag", true, true, true, 3.9}, Case{"hardly_let_go", true, true, true, 3.0}),
    [](const auto& test) { return std::string(test.param.name); });

// Pushed twice forward, twice backward, with rest in between: the second push finds elements at their limits.
std::vector<double> pushes(double amplitude) {
    constexpr std::array<double, 8> pattern = {1, 0, 1, 0, -1, 0, -1, 0};
    auto u = problems::sampled_sine(0.1, 7.3, 5e-4, 1401);
    for (std::size_t k = 0; k < u.size(); ++k) u[k] += amplitude * pattern[k / 80 % 8];
    return u;
}

// Stick-slip with elements that stand at their limits while the level holds, and modes that ring.
TEST_P(CoulombOracle, stick_slip_is_that_of_the_oracle) {
    const Case& c = GetParam();
    problems::ServoProblem p;
    p.rigid_gain = gain;
    p.coulomb = level;
    p.viscous = 3;
    if (c.modes) p.modes = {{0.02, 40.0, 0.01}, {0.01, 90.0, 0.005}};
    if (c.elements) p.elements = {{1e5, 0.3}, {3e4, 0.3, 5.0}, {5e3, 0.2}};
    if (c.lag) p.lag_hz = 300;
    const auto u = pushes(c.amplitude);
    const auto exact = problems::solve_exactly(p, u);
    ASSERT_GT(exact.events.size(), 10u);
    for (const Method method : {Method::exact, Method::erk, Method::adams, Method::bdf}) {
        const auto run = run_open_loop(description_of(p), u,
                                       {.method = method, .relative_tolerance = 1e-10, .absolute_tolerance = 1e-14});
        // The bounds of the smooth runs of these methods, trajectory_test.cpp.
        EXPECT_LT(largest_difference(run.trace.x, exact.x), method == Method::exact ? 1e-13
                                                            : method == Method::erk ? 1e-9
                                                                                    : 1e-8)
            << name_of(method);
        EXPECT_LT(largest_time_difference(run.events, exact.events), 1e-6) << name_of(method); // v passes zero slowly
    }
}

} // namespace
} // namespace tribode
