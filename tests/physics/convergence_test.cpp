// How fast the fixed-step methods come to the exact solution of the oracle on the reference machine, with friction and
// without; and the propagator of the zero-order hold beside a matrix exponential made elsewhere.
#include "physics/oracle.hpp"
#include "tribode/solver/fixed_step_integrator.hpp"

#include <Eigen/Dense>
#include <random>
#include <unsupported/Eigen/MatrixFunctions>

namespace tribode {
namespace {

using problems::ServoProblem;

struct DrivenTable {
    ServoProblem machine;
    std::vector<double> u;
    problems::ServoSolution exact;

    explicit DrivenTable(ServoProblem problem)
        : machine(std::move(problem)),
          u(problems::sampled_sine(15, 10, machine.sample_time, 1001)),
          exact(problems::solve_exactly(machine, u)) {}

    // rms over the sample instants, with steps of a sample time over n.
    double error(Method method, int n) const {
        const auto run =
            run_open_loop(description_of(machine), u, {.method = method, .fixed_step = machine.sample_time / n});
        double sum = 0;
        for (std::size_t k = 0; k < exact.x.size(); ++k) sum += std::pow(run.trace.x[k] - exact.x[k], 2);
        return std::sqrt(sum / static_cast<double>(exact.x.size()));
    }

    // Slope of the line through log(error) over log(step), steps halved from a sample time over `first` to one over
    // `last`.
    double order(Method method, int first, int last) const {
        std::vector<double> errors;
        for (int n = first; n <= last; n *= 2) errors.push_back(std::log2(error(method, n)));
        const double middle = 0.5 * static_cast<double>(errors.size() - 1);
        double product = 0, square = 0;
        for (std::size_t i = 0; i < errors.size(); ++i) {
            const double from_middle = static_cast<double>(i) - middle;
            product -= from_middle * errors[i];
            square += from_middle * from_middle;
        }
        return product / square;
    }
};

ServoProblem without_elements() {
    ServoProblem p = problems::linear_motor_table();
    p.elements.clear();
    return p;
}

const DrivenTable& frictionless() {
    static const DrivenTable run(without_elements());
    return run;
}

const DrivenTable& with_friction() {
    static const DrivenTable run(problems::linear_motor_table());
    return run;
}

// The steps are those where the next term of the error has come down and rounding has not come up: 1e-14 m here.
TEST(ConvergenceWithoutElements, is_of_the_order_of_the_method) {
    EXPECT_NEAR(frictionless().order(Method::fixed, 1, 8), 4.0, 0.05);
    EXPECT_NEAR(frictionless().order(Method::semi_implicit_euler, 1, 32), 1.0, 0.01);
    EXPECT_NEAR(frictionless().order(Method::zoh, 1, 32), 1.0, 0.01);     // the viscous force is held
    EXPECT_NEAR(frictionless().order(Method::euler, 32, 128), 1.0, 0.02); // the modes blow up with longer steps
}

TEST(ConvergenceWithoutElements, zero_order_hold_is_exact_where_nothing_is_held_but_the_thrust) {
    ServoProblem p = without_elements();
    p.viscous = 0;
    p.lag_hz = 750;
    const DrivenTable run(p);
    for (const int n : {1, 3, 10}) {
        // Rounding of a thousand samples, n steps each, of a motion of 1 mm.
        EXPECT_LT(run.error(Method::zoh, n), 1e-14) << n;
    }
}

// An element that slips or sticks a time tau late, some part of the step, meanwhile has the wrong stiffness: the force
// is wrong by an amount that grows from zero, its impulse by one with tau^2. That leaves the second order of
// Runge-Kutta's fourth: 1.8 as measured, with a scatter of one from halving to halving, as tau is now a small and now a
// large part of the step.
TEST(ConvergenceWithFriction, of_runge_kutta_is_of_second_order_for_events_are_handled_late) {
    const double order = with_friction().order(Method::fixed, 2, 128);
    EXPECT_GT(order, 1.5);
    EXPECT_LT(order, 2.5);
    EXPECT_GT(with_friction().error(Method::fixed, 8), 1e4 * frictionless().error(Method::fixed, 8));
}

// Below that the methods of first order keep theirs.
TEST(ConvergenceWithFriction, of_the_methods_of_first_order_is_of_first_order) {
    EXPECT_NEAR(with_friction().order(Method::semi_implicit_euler, 4, 64), 1.0, 0.05);
    EXPECT_NEAR(with_friction().order(Method::zoh, 4, 64), 1.0, 0.05);
    // The energy that Euler's method puts in goes with the stiffness of the friction: 1.18 from 32 to 64, 1.08 next.
    EXPECT_NEAR(with_friction().order(Method::euler, 64, 128), 1.0, 0.15);
}

// ---- the propagator ----------------------------------------------------------------------------------------------

using Eigen::MatrixXd;

// exp of [L h, I h; 0, 0] has the integral of exp(L s) over [0, h] at its upper right.
MatrixXd augmented_exponential(const MatrixXd& l, double h) {
    const auto n = l.rows();
    MatrixXd both = MatrixXd::Zero(2 * n, 2 * n);
    both.topLeftCorner(n, n) = l * h;
    both.topRightCorner(n, n) = MatrixXd::Identity(n, n) * h;
    return both.exp().topRightCorner(n, n);
}

double relative_difference(const MatrixXd& l, double h) {
    const std::vector<double> entries(l.data(), l.data() + l.size());
    const auto psi = integral_of_exponential(entries, static_cast<std::size_t>(l.rows()), h);
    const MatrixXd wanted = augmented_exponential(l, h);
    return (Eigen::Map<const MatrixXd>(psi.data(), l.rows(), l.cols()) - wanted).norm() / wanted.norm();
}

TEST(IntegralOfExponential, is_the_corner_of_an_augmented_exponential) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> entry(-1, 1);
    for (int trial = 0; trial < 200; ++trial) {
        const MatrixXd l = MatrixXd::NullaryExpr(1 + trial % 8, 1 + trial % 8, [&] { return entry(random); });
        // abs(L) h up to 80: seven doublings and as many digits of e^80 lost, by either road.
        for (const double h : {1e-4, 0.1, 1.0, 10.0}) EXPECT_LT(relative_difference(l, h), 1e-12) << trial << " " << h;
    }
}

TEST(IntegralOfExponential, of_the_reference_machine_is_the_same_by_both_roads) {
    Json description = reference_description();
    description["current_loop_hz"] = 7500.0; // stiff: ten steps of its time constant and more in a sample
    for (const Json& d : {reference_description(), description}) {
        const ServoPlant plant(machine_of(d).axis().plant);
        const auto n = static_cast<Eigen::Index>(plant.states().size());
        MatrixXd l = MatrixXd::Zero(n, n);
        plant.linear_part({l.data(), static_cast<std::size_t>(n * n)});
        for (const double h : {5e-6, 5e-4, 5e-3}) EXPECT_LT(relative_difference(l, h), 1e-12) << h; // as above
    }
}

} // namespace
} // namespace tribode
