// The methods of a fixed step: what one step does, how the error falls with the step, what happens to events.
#include "function_system.hpp"
#include "tribode/hybrid/piecewise_affine.hpp"
#include "tribode/solver/fixed_step_integrator.hpp"
#include "tribode/solver/simulator.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

constexpr std::array methods = {Method::fixed, Method::euler, Method::semi_implicit_euler, Method::zoh};

// x'' = force(t, x, v): one position, whose rate is the velocity. The linear part is that of a damped oscillator.
class Particle final : public HybridSystem, public PiecewiseAffine {
  public:
    std::vector<double> start;                                 // x, v
    std::function<double(double t, double x, double v)> force; // the whole of it
    double stiffness = 0, damping = 0;                         // of the linear part
    std::function<double(double t, double x)> guard;           // empty: none

    const std::vector<StateVariable>& states() const override {
        static const std::vector<StateVariable> variables = {{"x", "m", 1}, {"v", "m/s"}};
        return variables;
    }
    const std::vector<SampleClock>& clocks() const override {
        static const std::vector<SampleClock> none;
        return none;
    }
    std::size_t guard_count() const override { return guard ? 1 : 0; }
    SystemState initial_state() const override { return {0.0, start, std::make_unique<FunctionSystem::Memory>()}; }
    void derivative(double t, std::span<const double> x, const DiscreteState&, std::span<double> dxdt) const override {
        dxdt[0] = x[1];
        dxdt[1] = force(t, x[0], x[1]);
    }
    void guards(double t, std::span<const double> x, const DiscreteState&, std::span<double> g) const override {
        if (guard) g[0] = guard(t, x[0]);
    }
    const PiecewiseAffine* piecewise_affine() const override { return this; }
    std::optional<std::string> why_not_affine() const override { return "its force is not"; }
    void linear_part(std::span<double> matrix) const override {
        matrix[1] = -stiffness;
        matrix[2] = 1;
        matrix[3] = -damping;
    }
    EventEffect on_crossing(GuardId, SystemState& state, EventLog& log) const override {
        log.push_back({state.t, 0, 0});
        return EventEffect::none;
    }
    EventEffect on_sample(ClockId, long, SystemState&) const override { return EventEffect::none; }
    std::string guard_name(GuardId, const SystemState&) const override { return "the guard"; }
};

// x'' = 2 x^3, x(0) = 1, v(0) = -1: x = 1/(1 + t).
Particle falling_hyperbola() {
    Particle p;
    p.start = {1.0, -1.0};
    p.force = [](double, double x, double) { return 2 * x * x * x; };
    return p;
}

// x'' = 3 - w^2 x - 2 zeta w v, w = 5 rad/s, zeta = 0.1, from x = 1 at rest; all of it but the 3 is the linear part.
Particle damped_oscillator() {
    Particle p;
    p.start = {1.0, 0.0};
    p.stiffness = 25;
    p.damping = 1;
    p.force = [](double, double x, double v) { return 3 - 25 * x - v; };
    return p;
}

double damped_position(double t) {
    const double rest = 3.0 / 25, omega = std::sqrt(25 - 0.25);
    return rest + (1 - rest) * std::exp(-0.5 * t) * (std::cos(omega * t) + 0.5 / omega * std::sin(omega * t));
}

std::vector<double> end_of(const HybridSystem& system, Method method, double step, double t_end) {
    Simulator run(system, {.method = method, .fixed_step = step});
    EXPECT_TRUE(run.advance_to(t_end).ok());
    EXPECT_EQ(run.state().t, t_end);
    return run.state().x;
}

struct Order {
    Method method;
    double order;
};

class ConvergenceOrder : public testing::TestWithParam<Order> {};
INSTANTIATE_TEST_SUITE_P(Methods, ConvergenceOrder,
                         testing::Values(Order{Method::fixed, 4}, Order{Method::euler, 1},
                                         Order{Method::semi_implicit_euler, 1}, Order{Method::zoh, 1}),
                         [](const auto& test) { return name_of(test.param.method); });

// The force is no part of the linear one, so zoh holds it and is of first order too.
TEST_P(ConvergenceOrder, is_that_of_the_textbook_on_a_nonlinear_system) {
    const Particle p = falling_hyperbola();
    const auto error = [&](double step) {
        const auto x = end_of(p, GetParam().method, step, 1.0);
        return std::hypot(x[0] - 0.5, x[1] + 0.25);
    };
    double coarse = error(1.0 / 32);
    for (const int n : {64, 128, 256}) {
        const double fine = error(1.0 / n);
        // The next term of the error is h times smaller; 0.1 is three times what it makes here.
        EXPECT_NEAR(std::log2(coarse / fine), GetParam().order, 0.1) << n;
        coarse = fine;
    }
}

TEST(ZeroOrderHold, is_exact_for_any_step_where_all_but_a_constant_is_linear) {
    const Particle p = damped_oscillator();
    for (const double step : {0.01, 0.3, 2.0}) {
        // Rounding of some hundred steps of numbers of order one.
        EXPECT_NEAR(end_of(p, Method::zoh, step, 2.0)[0], damped_position(2.0), 1e-13) << step;
    }
    // The same steps by Euler's method are far off: the exactness is the propagator's.
    EXPECT_GT(std::abs(end_of(p, Method::euler, 0.01, 2.0)[0] - damped_position(2.0)), 1e-2);
}

TEST(ZeroOrderHold, without_a_linear_part_is_explicit_euler) {
    const FunctionSystem system = oscillator();
    EXPECT_EQ(end_of(system, Method::zoh, 0.1, 1.0), end_of(system, Method::euler, 0.1, 1.0));
}

TEST(SemiImplicitEuler, moves_the_position_with_the_new_velocity) {
    Particle p = falling_hyperbola();
    const double h = 0.125;
    const auto x = end_of(p, Method::semi_implicit_euler, h, h);
    EXPECT_EQ(x[1], -1 + h * 2); // powers of two: no rounding
    EXPECT_EQ(x[0], 1 + h * x[1]);
    EXPECT_EQ(end_of(p, Method::euler, h, h), (std::vector{1 - h, -1 + 2 * h}));
}

// x'' = -x: x^2 + v^2 - h x v stays as it is, while explicit Euler multiplies x^2 + v^2 by 1 + h^2 at each step.
TEST(SemiImplicitEuler, keeps_an_oscillation_where_explicit_euler_blows_it_up) {
    Particle p;
    p.start = {1.0, 0.0};
    p.force = [](double, double x, double) { return -x; };
    const double h = 0.125; // a power of two: all steps are of one length
    const auto kept = end_of(p, Method::semi_implicit_euler, h, 1000.0), blown = end_of(p, Method::euler, h, 100.0);
    // Rounding of 8000 and of 800 steps.
    EXPECT_NEAR(kept[0] * kept[0] + kept[1] * kept[1] - h * kept[0] * kept[1], 1.0, 1e-12);
    EXPECT_NEAR((blown[0] * blown[0] + blown[1] * blown[1]) / std::pow(1 + h * h, 800), 1.0, 1e-12);
}

TEST(FixedSteps, that_do_not_divide_the_interval_end_with_a_shorter_one) {
    const FunctionSystem system = decay();
    const auto runge_kutta = [](double h) { return 1 - h * (1 - h / 2 * (1 - h / 3 * (1 - h / 4))); };
    // Three steps of 0.3 and one of 0.1; rounding.
    for (const Method method : {Method::euler, Method::semi_implicit_euler, Method::zoh}) {
        EXPECT_NEAR(end_of(system, method, 0.3, 1.0)[0], 0.7 * 0.7 * 0.7 * 0.9, 1e-15) << name_of(method);
    }
    EXPECT_NEAR(end_of(system, Method::fixed, 0.3, 1.0)[0], std::pow(runge_kutta(0.3), 3) * runge_kutta(0.1), 1e-15);
    // The propagator of zoh is that of the shorter step then.
    EXPECT_NEAR(end_of(damped_oscillator(), Method::zoh, 0.3, 1.0)[0], damped_position(1.0), 1e-14);
}

TEST(FixedSteps, leave_no_step_of_rounding_at_the_end) {
    const FunctionSystem system = decay();
    for (const Method method : methods) {
        Simulator run(system, {.method = method, .fixed_step = 0.1});
        ASSERT_TRUE(run.advance_to(1.0).ok());
        EXPECT_EQ(run.statistics().steps, 10) << name_of(method); // ten times 0.1 is not 1 in doubles
        EXPECT_EQ(run.statistics().derivative_evaluations, method == Method::fixed ? 40 : 10) << name_of(method);
    }
    FixedStepIntegrator integrator(system, Method::euler, 0.1);
    SystemState state = system.initial_state();
    integrator.restart(state);
    for (int step = 0; step < 9; ++step) ASSERT_EQ(integrator.step(1.0), Integrator::Progress::stepped) << step;
    ASSERT_GT(1.0 - state.t, 0.1); // by rounding, and yet it is one step
    EXPECT_EQ(integrator.step(1.0), Integrator::Progress::stopped);
    EXPECT_EQ(state.t, 1.0);
}

class OneStep : public testing::TestWithParam<Method> {
  protected:
    void take(const HybridSystem& system, double step) {
        integrator = std::make_unique<FixedStepIntegrator>(system, GetParam(), step);
        state = system.initial_state();
        integrator->restart(state);
        before = state.x;
        progress = integrator->step(1.0);
    }

    std::unique_ptr<FixedStepIntegrator> integrator;
    SystemState state;
    std::vector<double> before;
    Integrator::Progress progress{};
};
INSTANTIATE_TEST_SUITE_P(Methods, OneStep, testing::ValuesIn(methods), method_of);

TEST_P(OneStep, is_interpolated_between_its_ends) {
    take(falling_hyperbola(), 0.25);
    EXPECT_EQ(progress, Integrator::Progress::stepped);
    EXPECT_EQ(state.t, 0.25);
    std::vector<double> x(2);
    integrator->interpolate(0.0, x);
    EXPECT_EQ(x, before);
    integrator->interpolate(0.25, x);
    EXPECT_EQ(x, state.x);
    integrator->interpolate(0.0625, x);
    if (GetParam() == Method::fixed) {
        // h^4/384 of the fourth derivative, 24, is 2.4e-4 at most; a straight line is 0.04 off.
        EXPECT_NEAR(x[0], 1 / 1.0625, 2.4e-4);
    } else {
        EXPECT_EQ(x[0], before[0] + 0.25 * (state.x[0] - before[0]));
    }
}

// x = t^3 - t + 1: both the method and its interpolation are exact.
TEST(RungeKutta, interpolates_a_cubic_exactly) {
    FunctionSystem system;
    system.start = {1.0};
    system.slope = [](double t, auto, auto&, auto dxdt) { dxdt[0] = 3 * t * t - 1; };
    FixedStepIntegrator integrator(system, Method::fixed, 0.5);
    SystemState state = system.initial_state();
    integrator.restart(state);
    for (int step = 0; step < 2; ++step) {
        ASSERT_EQ(integrator.step(2.0), Integrator::Progress::stepped);
        std::vector<double> x(1);
        for (const double s : {0.1, 0.25, 0.5, 0.9}) {
            const double t = 0.5 * (step + s);
            integrator.interpolate(t, x);
            EXPECT_NEAR(x[0], t * t * t - t + 1, 1e-15) << t; // rounding
        }
    }
}

TEST_P(OneStep, that_ends_with_a_guard_below_zero_says_so_at_its_end) {
    Particle p = falling_hyperbola();
    p.guard = [](double t, double) { return 0.1 - t; };
    take(p, 0.25);
    EXPECT_EQ(progress, Integrator::Progress::crossing);
    EXPECT_EQ(integrator->crossed(), std::vector<GuardId>{0});
    EXPECT_EQ(state.t, 0.25);
}

TEST_P(OneStep, does_not_see_what_a_guard_does_meanwhile) {
    Particle p = falling_hyperbola();
    p.guard = [](double t, double) { return std::abs(t - 0.125) - 0.1; };
    take(p, 0.25);
    EXPECT_EQ(progress, Integrator::Progress::stepped);
    EXPECT_TRUE(integrator->crossed().empty());
}

TEST(FixedSteps, handle_an_event_up_to_one_step_late) {
    FunctionSystem system = decay();
    system.start_memory = {1};
    system.guard = {[](double, auto x, auto& d) { return d[0] * (x[0] - 0.7); }}; // exp(-t) = 0.7 at t = 0.357
    system.crossing = [](GuardId, double, auto&, auto& d) {
        d[0] = -1;
        return EventEffect::restart;
    };
    for (const Method method : methods) {
        Simulator run(system, {.method = method, .fixed_step = 0.1});
        ASSERT_TRUE(run.advance_to(1.0).ok());
        ASSERT_EQ(run.events().size(), 1u) << name_of(method);
        EXPECT_NEAR(run.events().front().t, 0.4, 1e-15) << name_of(method); // the sum of four steps
    }
}

// x' = -1000 x with h = 0.1 s: explicit Euler multiplies by -99 at each step, and 1e100 is passed at the 51st; it is looked
// at every hundred steps.
TEST(FixedSteps, too_long_for_a_stiff_system_end_the_run_and_name_the_step) {
    FunctionSystem system = decay();
    system.slope = [](double, auto x, auto&, auto dxdt) { dxdt[0] = -1000 * x[0]; };
    Simulator run(system, {.method = Method::euler, .fixed_step = 0.1});
    const RunOutcome outcome = run.advance_to(100.0);
    EXPECT_EQ(outcome.end, RunEnd::diverged);
    EXPECT_NE(outcome.message.find("fixed step of 0.1 s"), std::string::npos) << outcome.message;
    EXPECT_NEAR(outcome.t, 10, 0.2);
}

// ---- integral_of_exponential -------------------------------------------------------------------------------------

using Matrix = std::vector<double>; // column-major

void expect_near(const Matrix& found, const Matrix& wanted, double relative) {
    ASSERT_EQ(found.size(), wanted.size());
    for (std::size_t i = 0; i < wanted.size(); ++i) {
        EXPECT_NEAR(found[i], wanted[i], relative * std::abs(wanted[i])) << "entry " << i;
    }
}

TEST(IntegralOfExponential, of_a_zero_matrix_is_the_length) {
    EXPECT_EQ(integral_of_exponential(Matrix(9), 3, 0.7), (Matrix{0.7, 0, 0, 0, 0.7, 0, 0, 0, 0.7}));
}

TEST(IntegralOfExponential, of_a_double_integrator_is_a_polynomial) {
    const double h = 0.3;
    // By columns: L = [0 1; 0 0] gives [h h^2/2; 0 h].
    expect_near(integral_of_exponential({0, 0, 1, 0}, 2, h), {h, 0, h * h / 2, h}, 1e-15);
}

TEST(IntegralOfExponential, of_a_diagonal_is_that_of_each_exponential_also_where_it_is_stiff) {
    for (const double h : {1e-6, 5e-4, 0.1, 3.0}) {
        const Matrix psi = integral_of_exponential({-1e5, 0, 0, 0, -4, 0, 0, 0, 2}, 3, h);
        // Each doubling adds a rounding: up to nineteen of them here.
        expect_near(psi,
                    {std::expm1(-1e5 * h) / -1e5, 0, 0, 0, std::expm1(-4 * h) / -4, 0, 0, 0, std::expm1(2 * h) / 2},
                    1e-12);
    }
}

TEST(IntegralOfExponential, of_an_oscillator_is_sine_and_cosine) {
    for (const double h : {1e-3, 0.5, 2.0, 20.0}) {
        const Matrix psi = integral_of_exponential({0, -1, 1, 0}, 2, h);
        const double s = std::sin(h), c = 1 - std::cos(h);
        const Matrix wanted = {s, -c, c, s};
        // Absolute: at 20 s sine and cosine remain of five doublings.
        for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(psi[i], wanted[i], 1e-13) << h;
    }
}

} // namespace
} // namespace tribode
