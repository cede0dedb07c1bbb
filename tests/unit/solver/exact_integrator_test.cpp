// The exact integrator on small affine systems with a closed form, and the search for the first zero crossing of a polynomial.
#include "affine_system.hpp"
#include "function_system.hpp"
#include "tribode/base/error.hpp"
#include "tribode/solver/exact_integrator.hpp"
#include "tribode/solver/prepared_steps.hpp"
#include "tribode/solver/simulator.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace tribode {
namespace {

// ---- first_crossing_below_zero

constexpr double none = 2;

using Polynomial = std::vector<double>;

double value_at(const Polynomial& p, double s) {
    double value = 0;
    for (std::size_t n = p.size(); n-- > 0;) value = value * s + p[n];
    return value;
}

// a product (s - root), times `factor`.
Polynomial with_roots(const std::vector<double>& roots, double factor) {
    Polynomial p = {factor};
    for (const double root : roots) {
        p.push_back(0);
        for (std::size_t n = p.size(); n-- > 0;) p[n] = (n > 0 ? p[n - 1] : 0) - root * p[n];
    }
    return p;
}

TEST(FirstCrossing, a_polynomial_that_stays_above_has_none) {
    for (const Polynomial& p : {Polynomial{1}, {0}, {0, 0, 0}, {1, -0.5}, {1, 2, 3}, {0, 1}, {0, 0, 1}, {1, -2, 1.5}}) {
        EXPECT_EQ(first_crossing_below_zero(p), none);
    }
}

TEST(FirstCrossing, a_line_falls_at_its_root) {
    for (const double root : {1e-9, 0.1, 0.5, 0.75, 0.999}) {
        EXPECT_NEAR(first_crossing_below_zero(Polynomial{root, -1}), root, 1e-16);
        EXPECT_NEAR(first_crossing_below_zero(Polynomial{1e6 * root, -1e6}), root, 1e-16);
    }
}

TEST(FirstCrossing, a_fall_right_in_the_middle_is_found_exactly) {
    EXPECT_EQ(first_crossing_below_zero(Polynomial{1, -2}), 0.5);
    EXPECT_EQ(first_crossing_below_zero(with_roots({0.5, 1.5, 2.5}, -1)), 0.5);           // degree 3
    EXPECT_EQ(first_crossing_below_zero(with_roots({0.5, 0, -1}, -1)), 0.5);              // begins at zero and rises
    EXPECT_DOUBLE_EQ(first_crossing_below_zero(with_roots({0.25, 0.5, 0.75}, -1)), 0.25); // rounding of the evaluation
}

TEST(FirstCrossing, from_zero_over_a_top_to_zero_falls_at_the_end_alone) {
    EXPECT_EQ(first_crossing_below_zero(Polynomial{0, 1, -1}), 1);
    const double length = 2 * 0.7 / 1.2; // of a throw, which ends below zero by rounding
    EXPECT_NEAR(first_crossing_below_zero(Polynomial{0, 0.7 * length, -0.6 * length * length}), 1, 1e-15);
    std::mt19937 random(7);
    for (int i = 0; i < 10000; ++i) {
        const double speed = static_cast<double>(1 + random() % 100) / 10;
        const double half = static_cast<double>(1 + random() % 100) / 20;
        const double time = speed / half;
        EXPECT_NEAR(first_crossing_below_zero(Polynomial{0, speed * time, -half * time * time}), 1, 1e-15);
    }
}

TEST(FirstCrossing, one_that_falls_to_zero_at_the_end_crosses_there) {
    EXPECT_EQ(first_crossing_below_zero(Polynomial{1, -1}), 1);
    EXPECT_EQ(first_crossing_below_zero(Polynomial{0.1 + 0.2, -0.3}), 1); // 5e-17 above zero at the end
    EXPECT_EQ(first_crossing_below_zero(Polynomial{1, 0, -1}), 1);
    EXPECT_EQ(first_crossing_below_zero(Polynomial{1, -2, 1}), none); // it touches zero
    EXPECT_EQ(first_crossing_below_zero(Polynomial{1, -1 + 1e-12}), none);
}

TEST(FirstCrossing, one_that_begins_below_zero_falls_at_once) {
    EXPECT_EQ(first_crossing_below_zero(Polynomial{-1e-300, 1}), 0);
    EXPECT_EQ(first_crossing_below_zero(Polynomial{-1, 0.5, 3}), 0);
}

TEST(FirstCrossing, one_that_begins_at_zero_falls_at_once_or_rises_first) {
    EXPECT_EQ(first_crossing_below_zero(Polynomial{0, -1}), 0);
    EXPECT_EQ(first_crossing_below_zero(Polynomial{0, 0, -1}), 0);
    EXPECT_EQ(first_crossing_below_zero(Polynomial{0, -1, 4}), 0); // above again at the end
    EXPECT_EQ(first_crossing_below_zero(Polynomial{0, -1e-12, 1}), 0);
    EXPECT_EQ(first_crossing_below_zero(Polynomial{0, 1, -4}), 0.25);
    EXPECT_NEAR(first_crossing_below_zero(Polynomial{0, 0, 1, -1.6}), 0.625, 1e-16);
    EXPECT_EQ(first_crossing_below_zero(Polynomial{0, 1, -0.9}), none);
}

TEST(FirstCrossing, touching_zero_from_above_is_no_fall) {
    EXPECT_EQ(first_crossing_below_zero(Polynomial{0.25, -1, 1}), none);     // (s - 1/2)^2
    EXPECT_EQ(first_crossing_below_zero(Polynomial{0.0625, -0.5, 1}), none); // (s - 1/4)^2
    EXPECT_EQ(first_crossing_below_zero(with_roots({0.5, 0.5, 0.75, 0.75}, 1)), none);
    EXPECT_EQ(first_crossing_below_zero(Polynomial{1, -2, 1}), none); // at the end
    EXPECT_EQ(first_crossing_below_zero(Polynomial{0, 0, 1}), none);  // at the beginning
    // A little above zero is no crossing whatever the rounding, a touch before a crossing does not hide it.
    for (double lift = 1e-15; lift < 1e-3; lift *= 10) {
        Polynomial p = with_roots({0.375, 0.375, -0.5, 2}, -1);
        p[0] += lift;
        EXPECT_EQ(first_crossing_below_zero(p), none) << lift;
        p = with_roots({0.25, 0.25, 0.75}, -1);
        p[0] += lift;
        EXPECT_GT(first_crossing_below_zero(p), 0.74) << lift;
    }
}

// Below zero for a short while only, down to -depth: shorter than any scan would see.
TEST(FirstCrossing, two_roots_near_each_other_are_told_apart) {
    for (const double gap : {1e-2, 1e-4, 1e-6, 1e-7}) {
        for (const double middle : {0.3, 0.5, 0.7531}) {
            const double low = middle - gap / 2, high = middle + gap / 2;
            // The coefficients round to 1e-16; with the slope `gap` there, the root to 1e-16/gap.
            EXPECT_NEAR(first_crossing_below_zero(with_roots({low, high}, 1)), low, 4e-16 / gap) << gap;
            EXPECT_NEAR(first_crossing_below_zero(with_roots({low, high, -1, 3}, -1)), low, 4e-15 / gap) << gap;
        }
    }
}

TEST(FirstCrossing, the_degree_may_be_thirty) {
    Polynomial p(31, 0.0); // 1 - 2^30 s^30 crosses at 1/2
    p[0] = 1;
    p[30] = -std::ldexp(1.0, 30);
    EXPECT_NEAR(first_crossing_below_zero(p), 0.5, 1e-15);
    // cos(9 s) in powers of s, as the series of an oscillation gives them, crosses at pi/18 and not at 5 pi/18 first.
    Polynomial wave(31, 0.0);
    double term = 1;
    for (int n = 0; n <= 30; n += 2) {
        wave[static_cast<std::size_t>(n)] = term;
        term *= -81.0 / ((n + 1) * (n + 2));
    }
    // Terms up to 81^4/8! = 1068 round to 1e-13, divided by the slope, 9.
    EXPECT_NEAR(first_crossing_below_zero(wave), std::numbers::pi / 18, 1e-13);
}

struct Scan {
    double first_above, first_below; // the polynomial is clearly above before, and clearly below at the second
};

// Where the polynomial is clearly below zero first, in steps of 1/2000, and the last instant before at which it was
// clearly above; "clearly" beyond rounding of the evaluation.
Scan scan(const Polynomial& p) {
    double size = 0;
    for (const double c : p) size += std::abs(c);
    Scan result{-1, none};
    for (int i = 0; i <= 2000; ++i) {
        const double s = i / 2000.0, value = value_at(p, s);
        if (value < -1e-13 * size) {
            result.first_below = s;
            break;
        }
    }
    return result;
}

// Random polynomials of all degrees: no crossing is missed, and where one is found the sign does change there.
TEST(FirstCrossing, is_that_of_a_fine_scan_on_thousands_of_random_polynomials) {
    std::mt19937_64 random(11);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(0, 1);
    int crossings = 0, missed_by_the_scan = 0;
    for (int draw = 0; draw < 6000; ++draw) {
        const std::size_t degree = 1 + random() % 30;
        Polynomial p;
        if (draw % 3 == 1) { // of given roots, so that several lie in the interval
            std::vector<double> roots(std::min<std::size_t>(degree, 8));
            for (double& root : roots) root = 1.5 * uniform(random) - 0.25;
            p = with_roots(roots, normal(random));
            if (p[0] < 0) std::transform(p.begin(), p.end(), p.begin(), std::negate<>());
        } else { // falling like those of a series; of every other one the first three terms outweigh the rest
            p.resize(degree + 1);
            double scale = 1;
            for (std::size_t n = 0; n <= degree; ++n) {
                p[n] = n == 0 ? 0.2 * std::abs(normal(random)) : normal(random) * scale;
                if (n == 2 && draw % 3 == 2) scale = 0.05;
                if (n > 2) scale *= 3.0 / static_cast<double>(n);
            }
        }
        double size = 0, largest_slope = 0;
        for (std::size_t n = 0; n < p.size(); ++n) {
            size += std::abs(p[n]);
            largest_slope += static_cast<double>(n) * std::abs(p[n]);
        }
        const double s = first_crossing_below_zero(p);
        const Scan seen = scan(p);
        if (s == none) {
            EXPECT_EQ(seen.first_below, none) << "draw " << draw;
            continue;
        }
        ++crossings;
        ASSERT_GE(s, 0) << "draw " << draw;
        ASSERT_LE(s, 1) << "draw " << draw;
        // Nothing clearly below before it, and it is a zero: by rounding of the value and of s.
        EXPECT_GE(seen.first_below, s) << "draw " << draw;
        EXPECT_NEAR(value_at(p, s), 0, 1e-14 * size + 2e-16 * largest_slope) << "draw " << draw;
        // Behind it the polynomial is below zero: at once, unless it is back before the next point of the scan.
        if (seen.first_below - s > 1.0 / 2000) ++missed_by_the_scan;
    }
    EXPECT_GT(crossings, 1500);
    EXPECT_LT(missed_by_the_scan, crossings / 20); // short ones are rare, and there are some
    EXPECT_GT(missed_by_the_scan, 0);
}

// ---- the integrator

constexpr SolverOptions exact{.method = Method::exact};

AffineSystem affine_oscillator() {
    AffineSystem system;
    system.start = {1, 0};
    system.a = {{0, 1}, {-1, 0}};
    return system;
}

double oscillator_error(const SystemState& state) {
    return std::hypot(state.x[0] - std::cos(state.t), state.x[1] + std::sin(state.t));
}

TEST(ExactIntegrator, an_oscillation_is_that_of_the_closed_form_after_ten_thousand_steps) {
    for (const bool patterns : {true, false}) {
        AffineSystem system = affine_oscillator();
        system.patterns = patterns;
        system.sample_clocks = {{"tick", 1.0, 0.0}};
        Simulator run(system, exact);
        ASSERT_TRUE(run.advance_to(1e4).ok());
        EXPECT_EQ(run.statistics().steps, 10000);
        // A step rounds by one or two units in the last place, 2e-16, most of which do not add up.
        EXPECT_LT(oscillator_error(run.state()), 1e-12);
    }
}

// Sample instants far from zero are rounded, and so are the lengths of the steps between them: the prepared step takes
// them for one another, and the differences must not add up.
TEST(ExactIntegrator, rounded_sample_instants_do_not_add_up_to_a_drift) {
    for (const double begin : {0.0, 100.0, 1e4}) {
        AffineSystem system = affine_oscillator();
        system.sample_clocks = {{"tick", 1e-3, 0.0}};
        SystemState start = system.initial_state();
        start.t = begin;
        start.x = {std::cos(begin), -std::sin(begin)};
        Simulator run(system, exact, start);
        ASSERT_TRUE(run.advance_to(begin + 20).ok());
        // 2e4 steps round to 1e-13 or so; time itself to a few units in its last place. Drift would be 2e4 such units.
        EXPECT_LT(oscillator_error(run.state()), 5e-13 + 8 * 0x1p-52 * begin) << begin;
    }
}

TEST(ExactIntegrator, propagated_steps_take_fewer_evaluations_and_come_to_the_same) {
    std::vector<double> reached;
    std::vector<long> evaluations;
    for (const bool patterns : {true, false}) {
        AffineSystem system = affine_oscillator();
        system.a = {{-0.1, 1}, {-4, -0.3}};
        system.b = {0.3, 1};
        system.patterns = patterns;
        system.sample_clocks = {{"tick", 0.25, 0.0}};
        system.sample = [](ClockId, long k, SystemState& state) {
            AffineSystem::memory(state).u.coefficient[0] = std::sin(static_cast<double>(k));
            return EventEffect::restart;
        };
        Simulator run(system, exact);
        ASSERT_TRUE(run.advance_to(500).ok());
        reached.insert(reached.end(), run.state().x.begin(), run.state().x.end());
        evaluations.push_back(run.statistics().derivative_evaluations);
    }
    EXPECT_NEAR(reached[0], reached[2], 2e-15); // damped: a few roundings of numbers below one
    EXPECT_NEAR(reached[1], reached[3], 2e-15);
    EXPECT_LT(evaluations[0], 2100);  // one a propagated step
    EXPECT_GT(evaluations[1], 10000); // one a term
}

// Lags in a row behind a step: x_k = 1 - e^{-t} sum t^j/j!, j < k. From rest the last ones have no term among the first, and
// their largest comes late: the series must see that all the same, and not halve its step.
TEST(ExactIntegrator, a_chain_from_rest_ends_as_soon_as_its_last_states_do) {
    constexpr std::size_t count = 12;
    AffineSystem system;
    system.start.assign(count, 0);
    system.a.assign(count, std::vector<double>(count));
    for (std::size_t k = 0; k < count; ++k) {
        system.a[k][k] = -1;
        if (k > 0) system.a[k][k - 1] = 1;
    }
    system.b.assign(count, 0);
    system.b[0] = 1;
    system.u.coefficient[0] = 1;
    system.sample_clocks = {{"tick", 0.5, 0.0}};
    Simulator run(system, exact);
    ASSERT_TRUE(run.advance_to(10).ok());
    EXPECT_EQ(run.statistics().steps, 20);
    double sum = 0, part = std::exp(-10.0);
    for (std::size_t k = 0; k < count; ++k) {
        sum += part;
        part *= 10 / static_cast<double>(k + 1);
        EXPECT_NEAR(run.state().x[k], 1 - sum, 5e-15) << k; // some twenty steps of numbers below one
    }
}

// x' = -r x with a rate r of its own for each of 5000 samples, then the same ones again: more patterns than are kept, those
// that are kept in the places of others.
TEST(ExactIntegrator, more_patterns_than_are_kept_are_each_themselves) {
    constexpr long count = 5000;
    const auto rate = [](long k) { return 1 + static_cast<double>(k % count) / count; };
    AffineSystem system;
    system.start = {1};
    system.a = {{-1}};
    system.scaled = true;
    system.start_memory = {1};
    system.sample_clocks = {{"tick", 1e-3, 0.0}};
    system.sample = [&](ClockId, long k, SystemState& state) {
        AffineSystem::memory(state).value[0] = rate(k);
        return EventEffect::derivative;
    };
    Simulator run(system, exact);
    double exponent = 0;
    for (long k = 0; k < 2 * count; ++k) exponent += 1e-3 * rate(k);
    ASSERT_TRUE(run.advance_to(1e-3 * 2 * count).ok());
    // 1e4 steps round by half a unit in the last place each, and so do the sums of the exponent.
    EXPECT_NEAR(run.state().x[0] / std::exp(-exponent), 1, 1e-12);
}

// Three patterns that recur at two lengths of steps, from instants that round these lengths in their own ways.
std::vector<double> run_of_many(double begin, PreparedSteps* shared, double damping = -0.3, double weight = 1) {
    AffineSystem system = affine_oscillator();
    system.a = {{-0.1, 1}, {-4, damping}};
    system.b = {0.3, 1};
    system.scaled = true;
    system.start_memory = {1};
    system.guard = {{{weight, 0}, 10}};
    system.sample_clocks = {{"tick", 0.25, 0.0}, {"tock", 0.25, 0.1}};
    system.sample = [](ClockId, long k, SystemState& state) {
        AffineSystem::memory(state).u.coefficient[0] = std::sin(static_cast<double>(k));
        AffineSystem::memory(state).value[0] = static_cast<double>(1 + k % 3);
        return EventEffect::restart;
    };
    SystemState start = system.initial_state();
    start.t = begin;
    SolverOptions options = exact;
    options.prepared_steps = shared;
    Simulator run(system, options, start);
    EXPECT_TRUE(run.advance_to(begin + 50).ok());
    return run.state().x;
}

TEST(PreparedSteps, runs_that_share_them_come_to_the_same_bits_as_alone) {
    PreparedSteps shared;
    for (const double begin : {0.0, 3.3, 100.1, 1e4 + 0.7, 100.1, 0.0}) {
        EXPECT_EQ(run_of_many(begin, &shared), run_of_many(begin, nullptr)) << begin;
    }
}

// Systems with the same keys and other matrices, A or those of a guard.
TEST(PreparedSteps, of_one_system_are_not_taken_for_those_of_another) {
    PreparedSteps shared;
    for (const double damping : {-0.3, -0.4, -0.3, -0.2, -0.4}) {
        for (const double weight : {1.0, -2.0}) {
            EXPECT_EQ(run_of_many(3.3, &shared, damping, weight), run_of_many(3.3, nullptr, damping, weight))
                << damping;
        }
    }
    EXPECT_NE(run_of_many(3.3, nullptr, -0.4), run_of_many(3.3, nullptr, -0.3));
}

TEST(PreparedSteps, are_made_once_for_each_form_and_each_length_to_the_bit) {
    PreparedSteps steps;
    int made = 0;
    const auto pattern = [&](std::uint64_t part, double a, double g = 1) {
        AffineKey key;
        key.push_back(part);
        return steps.pattern(key, {.a = {a}, .g = {g}, .b = {}, .c = {}}, [&] {
            ++made;
            return PreparedSteps::Matrices{};
        });
    };
    const auto propagation = [&](const auto& of, double h) {
        return of->propagation(h, [&] {
            ++made;
            return PreparedSteps::Propagation{};
        });
    };
    const auto one = pattern(1, 0.5), other = pattern(2, 0.5);
    EXPECT_NE(other, one);
    EXPECT_EQ(pattern(1, 0.5), one);
    EXPECT_EQ(made, 2);
    const auto another = pattern(1, std::nextafter(0.5, 1));
    EXPECT_NE(another, one);
    EXPECT_NE(pattern(1, 0.5, 2), one);
    EXPECT_NE(pattern(3, 0.0), pattern(3, -0.0));
    EXPECT_EQ(made, 6);
    const auto step = propagation(one, 0.1);
    EXPECT_EQ(propagation(one, 0.1), step);
    EXPECT_NE(propagation(one, std::nextafter(0.1, 1)), step);
    EXPECT_NE(propagation(other, 0.1), step);
    EXPECT_NE(propagation(another, 0.1), step);
    EXPECT_EQ(made, 10);
}

// x' = -x + u(t), u cubic between its samples: x = e^{-t} (x0 - p(0)) + p(t) with p' + p = u.
TEST(ExactIntegrator, a_cubic_input_is_integrated_exactly) {
    AffineSystem system;
    system.start = {0.7};
    system.a = {{-1}};
    system.b = {1};
    const double period = 0.5;
    system.sample_clocks = {{"tick", period, 0.0}};
    const auto piece = [](long k) {
        const double at = static_cast<double>(k);
        return std::array{std::sin(at), std::cos(2 * at), 0.5 - std::sin(3 * at), std::cos(at)};
    };
    system.sample = [&](ClockId, long k, SystemState& state) {
        AffineSystem::memory(state).u = {piece(k), static_cast<double>(k) * period, 1 / period};
        return EventEffect::restart;
    };
    double x = 0.7;
    Simulator run(system, exact);
    for (long k = 0; k < 200; ++k) {
        ASSERT_TRUE(run.advance_to(static_cast<double>(k) * period).ok());
        EXPECT_NEAR(run.state().x[0], x, 2e-14) << k; // p is a sum of numbers of a hundred or so
        // p = sum p_n (t/period)^n from the highest power down: p_n = u_n - (n + 1) p_{n+1}/period.
        const auto u = piece(k);
        std::array<double, 5> p{};
        for (std::size_t n = 4; n-- > 0;) p[n] = u[n] - static_cast<double>(n + 1) * p[n + 1] / period;
        x = std::exp(-period) * (x - p[0]) + (p[0] + p[1] + p[2] + p[3]);
    }
}

// Records the dense output.
struct Outputs final : Observer {
    std::vector<SystemState> states;
    void output(const SystemState& state) override { states.push_back(state); }
};

TEST(ExactIntegrator, dense_output_is_exact_after_a_leap_and_after_a_series) {
    for (const bool patterns : {true, false}) {
        AffineSystem system = affine_oscillator();
        system.patterns = patterns;
        system.sample_clocks = {{"tick", 0.5, 0.0}};
        Simulator run(system, exact);
        std::vector<double> grid;
        for (int i = 0; i < 500; ++i) grid.push_back(0.0473 * i);
        Outputs seen;
        run.observe(&seen);
        run.set_output_grid(grid);
        ASSERT_TRUE(run.advance_to(25).ok());
        ASSERT_EQ(seen.states.size(), grid.size());
        for (std::size_t i = 0; i < grid.size(); ++i) {
            EXPECT_EQ(seen.states[i].t, grid[i]);
            EXPECT_LT(oscillator_error(seen.states[i]), 1e-14) << grid[i]; // 50 steps of 2e-16
        }
    }
}

TEST(ExactIntegrator, dense_output_changes_no_step) {
    const auto reached = [](bool output) {
        AffineSystem system = affine_oscillator();
        system.guard = {{{1, 0.2}, 0.3}};
        system.sample_clocks = {{"tick", 0.3, 0.0}};
        system.crossing = [](GuardId, SystemState& state) {
            state.x = {0.9, 0.1};
            return EventEffect::restart;
        };
        Simulator run(system, exact);
        Outputs seen;
        run.observe(&seen);
        if (output) run.set_output_grid({0.1, 0.7, 0.71, 2.0, 5.5, 9.9});
        EXPECT_TRUE(run.advance_to(20).ok());
        EXPECT_GT(run.events().size(), 3u);
        return run.state().x;
    };
    EXPECT_EQ(reached(false), reached(true));
}

TEST(ExactIntegrator, a_system_that_is_not_affine_is_refused_with_its_reason) {
    const FunctionSystem system = decay();
    try {
        Simulator run(system, exact);
        FAIL() << "nothing was thrown";
    } catch (const InputError& error) {
        EXPECT_EQ(std::string(error.what()), "solver \"exact\" cannot be used: its equations are not known to be "
                                             "affine between events; choose erk, adams or bdf");
    }
    EXPECT_EQ(resolved(Method::automatic, system), Method::erk);
    EXPECT_EQ(resolved(Method::automatic, affine_oscillator()), Method::exact);
}

// x'' = -w^2 x with w h = 100, and x' = -100/h x: the series of a whole step has no end in thirty terms.
TEST(ExactIntegrator, a_stiff_step_is_halved_until_its_series_ends) {
    for (const bool patterns : {true, false}) {
        AffineSystem system;
        system.start = {1, 0, 1};
        system.a = {{0, 100, 0}, {-100, 0, 0}, {0, 0, -100}};
        system.patterns = patterns;
        system.sample_clocks = {{"tick", 1.0, 0.0}};
        Simulator run(system, exact);
        for (int k = 1; k <= 10; ++k) {
            ASSERT_TRUE(run.advance_to(k).ok());
            // 64 substeps a step or so, each rounding by a few units in the last place.
            EXPECT_NEAR(run.state().x[0], std::cos(100.0 * k), 1e-13 * k) << k;
            EXPECT_NEAR(run.state().x[2], std::exp(-100.0 * k), 1e-16) << k;
        }
        EXPECT_GT(run.statistics().steps, 10 * 16); // of w h = 6 at most
        EXPECT_LT(run.statistics().steps, 10 * 256);
    }
}

// At rest every series ends at once; a step prepared there must serve the motion that follows, or not be used.
TEST(ExactIntegrator, a_length_met_at_rest_is_right_in_motion) {
    for (const double omega : {0.5, 3.0, 5.0, 10.0, 30.0}) {
        AffineSystem system;
        system.start = {0, 0};
        system.a = {{0, omega}, {-omega, 0}};
        system.b = {0, omega};
        system.sample_clocks = {{"tick", 1.0, 0.0}};
        system.sample = [](ClockId, long k, SystemState& state) {
            AffineSystem::memory(state).u.coefficient[0] = k < 10 ? 0 : 1;
            return EventEffect::restart;
        };
        Simulator run(system, exact);
        ASSERT_TRUE(run.advance_to(60).ok()) << omega;
        // Some 16 substeps a second of 2e-16 each.
        EXPECT_NEAR(run.state().x[0], 1 - std::cos(50 * omega), 2e-13 * std::max(1.0, omega)) << omega;
        EXPECT_NEAR(run.state().x[1], std::sin(50 * omega), 2e-13 * std::max(1.0, omega)) << omega;
    }
}

TEST(ExactIntegrator, a_fall_in_a_substep_is_found) {
    AffineSystem system;
    system.start = {1, 0};
    system.a = {{0, 100}, {-100, 0}};
    system.guard = {{{1, 0}, 0}}; // crosses where 100 t = pi/2
    system.crossing = [](GuardId, SystemState& state) {
        state.x = {1, 0};
        return EventEffect::restart;
    };
    Simulator run(system, exact);
    ASSERT_TRUE(run.advance_to(1.0).ok());
    ASSERT_EQ(run.events().size(), 63u);
    for (std::size_t i = 0; i < 63; ++i) {
        EXPECT_NEAR(run.events()[i].t, static_cast<double>(i + 1) * std::numbers::pi / 200, 1e-14) << i;
    }
}

TEST(ExactIntegrator, the_earliest_of_several_guards_falls_alone) {
    AffineSystem system = affine_oscillator();
    system.guard = {{{1, 0}, -0.1}, {{1, 0}, -0.5}, {{1, 0}, 2}};
    std::vector<std::pair<GuardId, double>> crossed;
    system.crossing = [&](GuardId id, SystemState& state) {
        crossed.emplace_back(id, state.t);
        state.x = {1, 0}; // anew
        return EventEffect::restart;
    };
    Simulator run(system, exact);
    ASSERT_TRUE(run.advance_to(10).ok());
    ASSERT_EQ(crossed.size(), 9u); // every pi/3
    for (std::size_t i = 0; i < crossed.size(); ++i) {
        EXPECT_EQ(crossed[i].first, 1u);
        EXPECT_NEAR(crossed[i].second, static_cast<double>(i + 1) * std::numbers::pi / 3, 1e-14);
    }
}

TEST(ExactIntegrator, guards_that_fall_together_are_handled_together_in_declared_order) {
    AffineSystem system;
    system.start = {0, 0};
    system.a = {{0, 0}, {0, 0}};
    system.b = {-1, -2};
    system.u.coefficient[0] = 1; // x = {-t, -2 t}
    system.guard = {{{0, 1}, 1}, {{1, 0}, 7}, {{1, 0}, 0.5}};
    system.crossing = [](GuardId, SystemState& state) {
        if (AffineSystem::memory(state).value.size() == 1) state.x = {0, 0};
        AffineSystem::memory(state).value.push_back(0);
        return EventEffect::restart;
    };
    Simulator run(system, exact);
    ASSERT_TRUE(run.advance_to(0.9).ok());
    ASSERT_EQ(run.events().size(), 2u);
    EXPECT_EQ(run.events()[0].subject, 0);
    EXPECT_EQ(run.events()[1].subject, 2);
    EXPECT_EQ(run.events()[0].t, 0.5);
    EXPECT_EQ(run.events()[1].t, 0.5);
}

// The guard comes to zero at a sample instant: it crosses once, and the sample is taken once.
TEST(ExactIntegrator, a_fall_at_a_sample_instant_happens_once) {
    for (const double period : {0.125, 0.1}) { // with and without rounding
        AffineSystem system;
        system.start = {8 * period};
        system.a = {{0}};
        system.b = {-1};
        system.u.coefficient[0] = 1;
        system.guard = {{{1}, 0}};
        system.sample_clocks = {{"tick", period, 0.0}};
        long samples = 0;
        system.crossing = [&](GuardId, SystemState& state) {
            state.x[0] = 100;
            return EventEffect::restart;
        };
        system.sample = [&](ClockId, long, SystemState&) {
            ++samples;
            return EventEffect::none;
        };
        Simulator run(system, exact);
        ASSERT_TRUE(run.advance_to(16 * period).ok());
        EXPECT_EQ(samples, 17);
        ASSERT_EQ(run.events().size(), 1u);
        EXPECT_NEAR(run.events()[0].t, 8 * period, 1e-15);
    }
}

// x = (t - 1)^2 + lift comes near zero at t = 1, in the midst of a step and at the end of one.
TEST(ExactIntegrator, a_guard_that_all_but_touches_zero_does_not_fall) {
    for (const double lift : {1e-14, -1e-14}) {
        for (const double period : {0.75, 0.5}) {
            AffineSystem system;
            system.start = {1, -2};
            system.a = {{0, 1}, {0, 0}};
            system.b = {0, 2};
            system.u.coefficient[0] = 1;
            system.guard = {{{1, 0}, lift}};
            system.sample_clocks = {{"tick", period, 0.0}};
            system.crossing = [](GuardId, SystemState& state) {
                state.x = {100, 0};
                return EventEffect::restart;
            };
            Simulator run(system, exact);
            ASSERT_TRUE(run.advance_to(3).ok());
            EXPECT_EQ(run.events().empty(), lift > 0) << lift << " " << period;
        }
    }
}

// A step is propagated only where no guard can cross: a short crossing, long after propagated steps have become the rule.
TEST(ExactIntegrator, no_fall_is_leapt_over) {
    AffineSystem system = affine_oscillator();
    const double depth = 1e-9; // below zero for 2 acos(1 - depth) = 9e-5 s, twice in 8 s
    system.start = {0, 1, 20};
    system.a = {{0, 1, 0}, {-1, 0, 0}, {0, 0, 0}};
    system.guard = {{{0, 1, 0}, 1 - depth}};
    system.sample_clocks = {{"tick", 0.3, 0.0}};
    std::vector<double> crossed;
    system.crossing = [&](GuardId, SystemState& state) {
        crossed.push_back(state.t);
        return EventEffect::none; // goes on: the guard stays below for its moment
    };
    Simulator run(system, exact);
    const RunOutcome outcome = run.advance_to(2 * std::numbers::pi * 3);
    ASSERT_FALSE(crossed.empty()) << outcome.message;
    EXPECT_NEAR(crossed.front(), std::numbers::pi - std::acos(1 - depth), 1e-11); // 1e-16 over the slope there, 5e-5
}

TEST(ExactIntegrator, a_solution_that_grows_without_bound_ends_the_run) {
    for (const bool patterns : {true, false}) {
        AffineSystem system;
        system.start = {1};
        system.a = {{1}};
        system.patterns = patterns;
        system.sample_clocks = {{"tick", 1.0, 0.0}};
        Simulator run(system, exact);
        const RunOutcome outcome = run.advance_to(1000);
        EXPECT_EQ(outcome.end, RunEnd::diverged);
        EXPECT_NE(outcome.message.find("the solution diverges"), std::string::npos) << outcome.message;
        EXPECT_NEAR(outcome.t, 100 * std::log(10.0), 101); // it is looked at every hundred steps
    }
}

TEST(ExactIntegrator, a_system_without_continuous_states_counts) {
    AffineSystem counter;
    counter.sample_clocks = {{"count", 0.25, 0.0}};
    counter.start_memory = {0};
    counter.sample = [](ClockId, long, SystemState& state) {
        AffineSystem::memory(state).value[0] += 1;
        return EventEffect::restart;
    };
    Simulator run(counter, exact);
    ASSERT_TRUE(run.advance_to(2).ok());
    EXPECT_EQ(AffineSystem::memory(*run.state().discrete).value[0], 9);
}

} // namespace
} // namespace tribode
