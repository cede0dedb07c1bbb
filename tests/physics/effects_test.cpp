// The effects a machine may have: each against a closed form or a small integrator written for it alone, and the exact
// method against the variable-step one on random machines with random effects.
#include "physics/oracle.hpp"
#include "tribode/base/error.hpp"
#include "tribode/solver/simulator.hpp"

#include <functional>
#include <numbers>
#include <random>

namespace tribode {
namespace {

constexpr SolverOptions exact_solver{.method = Method::exact};
constexpr SolverOptions fine_erk{.method = Method::erk, .relative_tolerance = 1e-11, .absolute_tolerance = 1e-15};
constexpr double pi = std::numbers::pi;
constexpr double ts = 5e-4;

Json mass_with(const std::vector<Json>& effects) { return {{"rigid_gain_per_kg", 0.1}, {"effects", effects}}; }

Json effect(const char* name, Json parameters) { return {{"name", name}, {"parameters", std::move(parameters)}}; }

// y of a mass of 10 kg under u(t) held over samples and a force F(t, y, v), by the classical method in steps of 5 us.
std::vector<double> by_hand(const std::vector<double>& u, const std::function<double(double, double, double)>& force) {
    constexpr int parts = 100;
    constexpr double h = ts / parts;
    std::vector<double> position;
    double y = 0, v = 0;
    for (std::size_t k = 0; k < u.size(); ++k) {
        position.push_back(y);
        for (int i = 0; i < parts; ++i) {
            const double t = static_cast<double>(k) * ts + i * h;
            const auto a = [&](double at, double p, double w) { return 0.1 * (u[k] + force(at, p, w)); };
            const double k1 = a(t, y, v);
            const double k2 = a(t + h / 2, y + h / 2 * v, v + h / 2 * k1);
            const double k3 = a(t + h / 2, y + h / 2 * v + h * h / 4 * k1, v + h / 2 * k2);
            const double k4 = a(t + h, y + h * v + h * h / 2 * k2, v + h * k3);
            y += h * v + h * h / 6 * (k1 + k2 + k3);
            v += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
        }
    }
    return position;
}

// Steps of 5 us leave errors far below the tolerance of erk over 0.5 s and some millimeters.
constexpr double hand_bound = 1e-12;

TEST(Effects, smooth_forces_move_a_mass_as_a_small_program_says) {
    struct Case {
        Json effect;
        std::function<double(double, double, double)> force;
        bool affine;
    };
    const std::vector<Case> cases = {
        {effect("spring_force", {{"k", 2e3}, {"y0", 1e-3}}), [](double, double y, double) { return -2e3 * (y - 1e-3); },
         true},
        {effect("constant_force", {{"F", -1.5}}), [](double, double, double) { return -1.5; }, true},
        {effect("periodic_disturbance", {{"F", 3}, {"freq_hz", 17}, {"phase", 0.7}}),
         [](double t, double, double) { return 3 * std::sin(2 * pi * 17 * t + 0.7); }, true},
        {effect("viscous_friction", {{"dD", 30}}), [](double, double, double v) { return -30 * v; }, true},
        {effect("cubic_stiffness", {{"k3", 4e8}, {"y0", -1e-3}}),
         [](double, double y, double) { return -4e8 * std::pow(y + 1e-3, 3); }, false},
        {effect("quadratic_drag", {{"c", 800}}), [](double, double, double v) { return -800 * v * std::abs(v); },
         false},
        {effect("force_ripple",
                {{"harmonics", {{{"F", 2}, {"period_m", 2e-3}, {"phase", 1}}, {{"F", 1}, {"period_m", 1e-3}}}}}),
         [](double, double y, double) { return 2 * std::sin(2e3 * pi / 2 * y + 1) + std::sin(2e3 * pi * y); }, false}};
    const auto u = problems::sampled_sine(15, 5, ts, 1001);
    for (const auto& c : cases) {
        const auto expected = by_hand(u, c.force);
        const Json machine = mass_with({c.effect});
        EXPECT_LT(largest_difference(run_open_loop(machine, u, fine_erk).trace.x, expected), hand_bound) << c.effect;
        if (c.affine) {
            EXPECT_LT(largest_difference(run_open_loop(machine, u, exact_solver).trace.x, expected), hand_bound)
                << c.effect;
        } else {
            EXPECT_THROW(run_open_loop(machine, u, exact_solver), InputError) << c.effect;
        }
    }
}

// Each of these effects is a machine that could have been described without it.
TEST(Effects, changed_fields_are_the_machine_with_these_fields) {
    Json plain = bare_description();
    plain["input_delay_s"] = 3e-4;
    plain["current_loop_hz"] = 500;
    plain["friction"]["coulomb"] = 2.0;
    const auto u = problems::sampled_sine(20, 8, ts, 601);
    const std::vector<std::pair<Json, std::function<void(Json&)>>> cases = {
        {effect("payload_mass", {{"ratio", 0.25}}), [](Json& m) { m["rigid_gain_per_kg"] = 94.28e-3 / 1.25; }},
        {effect("viscous_friction", {{"dD", -1}}), [](Json& m) { m["friction"]["viscous"] = 1.35; }},
        {effect("coulomb_friction", {{"dF", -2}}), [](Json& m) { m["friction"]["coulomb"] = 0; }},
        {effect("coulomb_friction", {{"dF", 1}}), [](Json& m) { m["friction"]["coulomb"] = 3; }},
        {effect("input_delay", {{"extra_s", 7e-4}}), [](Json& m) { m["input_delay_s"] = 1e-3; }},
        {effect("actuator_lag", {{"current_loop_hz", 120}}), [](Json& m) { m["current_loop_hz"] = 120; }},
        {effect("encoder_quantization", {{"resolution_m", 1e-5}}), [](Json& m) { m["encoder_resolution_m"] = 1e-5; }},
        {effect("resonant_mode", {{"gain", 0.01}, {"freq_hz", 60}, {"zeta", 0.02}}),
         [](Json& m) {
             m["modes"].push_back({{"gain", 0.01}, {"freq_hz", 60}, {"zeta", 0.02}});
         }},
        {effect("presliding_hysteresis",
                {{"elements", Json::array({{{"K", 1e5}, {"F", 2.0}}})}, {"replace_coulomb", true}}),
         [](Json& m) {
             m["friction"]["coulomb"] = 0;
             m["friction"]["elements"].push_back({{"K", 1e5}, {"F", 2.0}});
         }}};
    for (const auto& [added, change] : cases) {
        Json with = plain, described = plain;
        with["effects"] = Json::array({added});
        change(described);
        const auto a = run_open_loop(with, u, exact_solver), b = run_open_loop(described, u, exact_solver);
        EXPECT_EQ(a.trace.y, b.trace.y) << added;
    }
}

// A slide with 4 N forward and 1 N backward that is thrown forward comes to rest after v^2/(2 a), and holds a force of
// 3 N forward, but not 2 N backward.
TEST(Effects, friction_may_differ_by_direction_and_hold_a_different_force_on_each_side) {
    Json machine = mass_with({effect("asymmetric_friction", {{"dF_pos", 2}, {"dF_neg", -1}})});
    machine["friction"]["coulomb"] = 2.0;
    const auto pushed = [&](double force) {
        std::vector<double> u(801, 0.0);
        for (std::size_t k = 0; k < 100; ++k) u[k] = 14; // 10 N beyond the level: 1 m/s^2 for 50 ms
        for (std::size_t k = 600; k < u.size(); ++k) u[k] = force;
        return run_open_loop(machine, u, exact_solver).trace;
    };
    const auto held = pushed(3.0);
    const double rest = 0.5 * 0.05 * 0.05 + 0.05 * 0.05 / (2 * 0.4);
    EXPECT_NEAR(held.x.back(), rest, 1e-15); // rounding
    const double t = 200 * ts;
    EXPECT_NEAR(pushed(-2.0).x.back(), rest - 0.5 * 0.1 * t * t, 1e-15);
}

// Two halves of 5 kg without friction, thrust on the motor, play of 1 mm: nothing happens to the load until the gap
// closes at d = 0.5 mm; from then on nothing is lost but in the damper, and momentum is that of the thrust alone.
TEST(Effects, backlash_keeps_momentum_and_never_pulls) {
    for (const char* sensor : {"motor", "load"}) {
        const Json machine = mass_with({effect("backlash", {{"gap_m", 1e-3},
                                                            {"load_fraction", 0.5},
                                                            {"contact_hz", 150},
                                                            {"contact_zeta", 0.0},
                                                            {"sensor", sensor}})});
        std::vector<double> u(1001, 0.0);
        for (std::size_t k = 0; k < 200; ++k) u[k] = 10; // the impulse of 1 N s
        const ServoSystem system(
            machine_of(machine), OpenLoop{[&](long k) {
                return std::array{u[std::min<std::size_t>(static_cast<std::size_t>(k), 1000)], 0.0, 0.0, 0.0};
            }});
        Simulator run(system, exact_solver);
        ASSERT_TRUE(run.advance_to(0.02).ok());
        const double d = 0.5 * (10.0 / 5) * 0.02 * 0.02; // 0.4 mm: still free
        const bool load = std::string(sensor) == "load";
        EXPECT_NEAR(run.state().x[0], load ? 0 : d, 1e-17);
        EXPECT_NEAR(run.state().x[2], load ? d : 0, 1e-17);
        ASSERT_TRUE(run.advance_to(0.1).ok());
        const auto momentum = [&] { return 5 * (run.state().x[1] + run.state().x[3]); };
        EXPECT_NEAR(momentum(), 1, 1e-12);
        // Without damping the energy after the impulse is that between contacts: seen from both sides of many bounces.
        const auto energy = [&] {
            const auto& x = run.state().x;
            const double w = 2 * pi * 150, stiffness = 2.5 * w * w;
            const double depth = std::max(0.0, std::abs(x[0] - x[2]) - 0.5e-3);
            return 2.5 * (x[1] * x[1] + x[3] * x[3]) + stiffness / 2 * depth * depth;
        };
        const double before = energy();
        ASSERT_TRUE(run.advance_to(0.5).ok());
        EXPECT_NEAR(momentum(), 1, 1e-12);
        EXPECT_NEAR(energy(), before, 1e-8 * before); // the margin at which contacts part
        EXPECT_GT(run.statistics().events, 4);
    }
}

// Random machines with random effects that keep them affine: the two methods share the equations and nothing else.
TEST(Effects, exact_and_variable_step_agree_on_random_machines) {
    std::mt19937 random(20241);
    const auto between = [&](double least, double most) {
        return std::uniform_real_distribution<double>(least, most)(random);
    };
    const auto chance = [&] { return between(0, 1) < 0.5; };
    for (int round = 0; round < 40; ++round) {
        Json m = {{"rigid_gain_per_kg", between(0.05, 0.2)}, {"friction", {{"viscous", between(1, 20)}}}};
        if (chance()) m["friction"]["coulomb"] = between(1, 5);
        if (chance()) m["friction"]["elements"] = Json::array({{{"K", between(1e4, 1e5)}, {"F", between(0.5, 2)}}});
        if (chance()) m["current_loop_hz"] = between(200, 800);
        if (chance()) m["input_delay_s"] = between(0, 1e-3);
        Json effects = Json::array();
        if (chance())
            effects.push_back(effect("spring_force", {{"k", between(10, 1e4)}, {"y0", between(-1e-3, 1e-3)}}));
        if (chance()) effects.push_back(effect("constant_force", {{"F", between(-2, 2)}}));
        if (chance())
            effects.push_back(effect("periodic_disturbance", {{"F", between(0, 5)}, {"freq_hz", between(3, 80)}}));
        if (chance()) {
            effects.push_back(effect("asymmetric_friction", {{"dF_pos", between(0, 2)},
                                                             {"dF_neg", between(0, 2)},
                                                             {"dD_pos", between(0, 10)},
                                                             {"dD_neg", between(0, 10)}}));
        }
        if (chance()) effects.push_back(effect("dead_zone", {{"half_width", between(0, 2)}}));
        if (chance()) effects.push_back(effect("thrust_saturation", {{"limit", between(10, 25)}}));
        if (chance()) effects.push_back(effect("payload_mass", {{"ratio", between(-0.3, 0.5)}}));
        if (chance()) effects.push_back(effect("encoder_periodic_error", {{"A", 1e-6}, {"period_m", 1e-3}}));
        if (round % 2)
            effects.push_back(effect("resonant_mode", {{"gain", 0.02}, {"freq_hz", between(20, 90)}, {"zeta", 0.02}}));
        m["effects"] = effects;
        const auto u = problems::sampled_sine(between(10, 25), between(3, 15), ts, 601);
        const auto a = run_open_loop(m, u, exact_solver), b = run_open_loop(m, u, fine_erk);
        // erk's tolerance over some thousand steps; a slip located late moves all that follows by as much.
        EXPECT_LT(largest_difference(a.trace.x, b.trace.x), 1e-10) << m;
    }
}

// The damper takes what each bounce has too much, so errors die out and the two methods stay together.
TEST(Effects, exact_and_variable_step_agree_on_backlash) {
    for (const char* sensor : {"motor", "load"}) {
        Json m = mass_with({effect("backlash", {{"gap_m", 1e-4},
                                                {"load_fraction", 0.4},
                                                {"contact_hz", 120},
                                                {"contact_zeta", 0.3},
                                                {"sensor", sensor}})});
        m["friction"] = {{"viscous", 5}, {"coulomb", 1}};
        const auto u = problems::sampled_sine(15, 6, ts, 401);
        const auto a = run_open_loop(m, u, exact_solver), b = run_open_loop(m, u, fine_erk);
        EXPECT_LT(largest_difference(a.trace.x, b.trace.x), 1e-9) << sensor;
    }
}

// Backlash and a mode against three masses in a row, written for this test alone: motor, play, driven body, and a second body
// on a spring and a damper behind it, whose modal form is
//
//     1/((m1 + m2) s^2) + m2/(m1 (m1 + m2)) / (s^2 + 2 zeta w s + w^2),   w^2 = k/m,   2 zeta w = c/m,   m = m1 m2/(m1 + m2)
struct ThreeMasses {
    double motor = 6, driven = 2.5, behind = 1.5;                  // [kg]
    double stiffness = 0, damping = 0;                             // between driven and behind
    double gap = 1e-4, contact_stiffness = 0, contact_damping = 0; // of the play
    double viscous = 5;                                            // of the driven body
    bool load_side = false; // the driven body is the load; else the motor's body is driven

    using State = std::array<double, 6>; // driven, behind, other: position and velocity each
    State rates(const State& x, double u) const {
        const double spring = stiffness * (x[2] - x[0]) + damping * (x[3] - x[1]);
        const double d = load_side ? x[4] - x[0] : x[0] - x[4], rate = load_side ? x[5] - x[1] : x[1] - x[5];
        double contact = 0; // on the load
        if (d > gap / 2) contact = std::max(0.0, contact_stiffness * (d - gap / 2) + contact_damping * rate);
        if (d < -gap / 2) contact = std::min(0.0, contact_stiffness * (d + gap / 2) + contact_damping * rate);
        const double on_driven = (load_side ? contact : u - contact) - viscous * x[1] + spring;
        const double on_other = load_side ? u - contact : contact;
        return {x[1], on_driven / driven, x[3], -spring / behind, x[5], on_other / motor};
    }
};

TEST(Effects, backlash_with_a_mode_moves_as_three_masses_in_a_row) {
    for (const char* sensor : {"motor", "load"}) {
        ThreeMasses row;
        row.load_side = std::string(sensor) == "load";
        const double with_mode = row.driven + row.behind, total = row.motor + with_mode;
        const double reduced = row.driven * row.behind / with_mode, w = 2 * pi * 70, zeta = 0.02;
        row.stiffness = reduced * w * w;
        row.damping = 2 * zeta * w * reduced;
        const double contact_hz = 120, contact_zeta = 0.3, wc = 2 * pi * contact_hz;
        const double between = row.motor * with_mode / total;
        row.contact_stiffness = between * wc * wc;
        row.contact_damping = 2 * contact_zeta * wc * between;
        Json m = {
            {"rigid_gain_per_kg", 1 / total},
            {"modes",
             Json::array({{{"gain", row.behind / (row.driven * with_mode)}, {"freq_hz", 70}, {"zeta", zeta}}})},
            {"friction", {{"viscous", row.viscous}}},
            {"effects",
             Json::array({effect("backlash", {{"gap_m", row.gap},
                                              {"load_fraction", row.load_side ? with_mode / total : row.motor / total},
                                              {"contact_hz", contact_hz},
                                              {"contact_zeta", contact_zeta},
                                              {"sensor", sensor}})})}};
        const auto u = problems::sampled_sine(15, 6, ts, 401);
        std::vector<double> expected;
        ThreeMasses::State x{};
        constexpr int parts = 2000;
        constexpr double h = ts / parts;
        const auto moved = [](const ThreeMasses::State& from, const ThreeMasses::State& slope, double by) {
            ThreeMasses::State to = from;
            for (std::size_t i = 0; i < to.size(); ++i) to[i] += by * slope[i];
            return to;
        };
        double most_apart = 0;
        for (const double thrust : u) {
            expected.push_back(x[0]);
            for (int i = 0; i < parts; ++i) {
                const auto k1 = row.rates(x, thrust), k2 = row.rates(moved(x, k1, h / 2), thrust);
                const auto k3 = row.rates(moved(x, k2, h / 2), thrust), k4 = row.rates(moved(x, k3, h), thrust);
                for (std::size_t j = 0; j < x.size(); ++j) x[j] += h / 6 * (k1[j] + 2 * k2[j] + 2 * k3[j] + k4[j]);
                most_apart = std::max(most_apart, std::abs(x[2] - x[0]));
            }
        }
        ASSERT_GT(most_apart, 2e-6); // the mode takes part
        // The steps of the reference go over the edges of the contact.
        constexpr double bound = 2e-9;
        const auto exact = run_open_loop(m, u, exact_solver).trace.x;
        EXPECT_LT(largest_difference(exact, expected), bound) << sensor;
        for (const Method method : {Method::erk, Method::adams, Method::bdf}) {
            SolverOptions solver = fine_erk;
            solver.method = method;
            EXPECT_LT(largest_difference(run_open_loop(m, u, solver).trace.x, expected), bound)
                << sensor << " " << name_of(method);
        }
        const SolverOptions steps{.method = Method::fixed, .fixed_step = 2e-6};
        EXPECT_LT(largest_difference(run_open_loop(m, u, steps).trace.x, expected), 1e-7) << sensor;
    }
}

TEST(Effects, scaled_friction_slows_a_slide_as_a_small_program_says) {
    Json machine = mass_with(
        {effect("position_dependent_friction", {{"mode", "sine"}, {"a", 0.5}, {"period_m", 2e-3}, {"phase", 1}}),
         effect("time_varying_friction", {{"kind", "exp"}, {"a", 0.4}, {"T", 0.1}})});
    machine["friction"] = {{"viscous", 20}, {"coulomb", 2}};
    const std::vector<double> u(301, 20.0); // always forward
    const auto expected = by_hand(u, [](double t, double y, double v) {
        return -(1 + 0.5 * std::sin(pi * 1e3 * y + 1)) * (1 + 0.4 * (1 - std::exp(-t / 0.1))) * (2 + 20 * v);
    });
    EXPECT_LT(largest_difference(run_open_loop(machine, u, fine_erk).trace.x, expected), hand_bound);
}

TEST(Effects, the_machine_with_other_effects_says_so_and_has_another_hash) {
    const MachineModel plain = machine_of({{"rigid_gain_per_kg", 0.1}});
    const MachineModel with = plain.with_effects({Effect(effect_kind("constant_force"), {{.number = 2}})});
    EXPECT_NE(with.hash(), plain.hash());
    const MachineModel again = machine_of(with.description());
    EXPECT_EQ(again.hash(), with.hash());
    EXPECT_EQ(again.axis().plant.constant_force, 2);
    EXPECT_THROW(plain.with_effects({Effect(effect_kind("input_delay"), {{.number = -1e-3}})}), InputError);
}

} // namespace
} // namespace tribode
