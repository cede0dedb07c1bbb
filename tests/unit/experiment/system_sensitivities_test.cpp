#include "tribode/base/error.hpp"
#include "tribode/experiment/system_run.hpp"
#include "tribode/system/contacts.hpp"
#include "tribode/system/sensitivities.hpp"
#include "tribode/system/system_builder.hpp"

#include <cmath>
#include <complex>
#include <functional>
#include <gtest/gtest.h>
#include <map>

namespace tribode {
namespace {

using Complex = std::complex<double>;
using Values = std::map<std::string, Complex>; // of what the run is differentiated by

// What a column is at one instant, from parameters that may be complex: the imaginary part is its derivative by the one that
// has a small imaginary part, without a difference.
using ClosedForm = std::function<Complex(const std::string& column, double t, const Values& values)>;

struct Comparison {
    Equations equations;
    Values values; // all that it is to be differentiated by, as the equations have them
    std::vector<std::string> columns;
    ClosedForm closed_form;
    double end = 1;
    Method method = Method::automatic;
    double tolerance = 1e-9; // of the greatest derivative by a parameter
    std::size_t events = 0;  // at least
};

void compare(const Comparison& c) {
    constexpr double tiny = 1e-40;
    std::vector<std::string> names;
    for (const auto& [name, value] : c.values) names.push_back(name);
    SystemRunOptions options;
    options.end = c.end;
    options.output_step = c.end / 97;
    options.solver.method = c.method;
    options.solver.relative_tolerance = 1e-13;
    options.solver.absolute_tolerance = 1e-15;
    const SystemRun run = run_system(EquationSystem(with_sensitivities(c.equations, names)), options);
    ASSERT_TRUE(run.outcome.ok()) << run.outcome.message;
    ASSERT_GE(run.events.size(), c.events);
    ASSERT_EQ(run.sensitivities.size(), names.size());
    const auto& t = run.table.find("t")->values;
    for (const auto& by : run.sensitivities) {
        SCOPED_TRACE(by.name);
        for (const auto& column : c.columns) {
            SCOPED_TRACE(column);
            Values moved = c.values;
            moved[by.name] += Complex(0, tiny);
            const auto& found = by.table[column].values;
            ASSERT_EQ(found.size(), t.size());
            double largest = 0, off = 0, value_off = 0;
            for (std::size_t k = 0; k < t.size(); ++k) {
                const Complex wanted = c.closed_form(column, t[k], moved);
                largest = std::max(largest, std::abs(wanted.imag() / tiny));
                off = std::max(off, std::abs(found[k] - wanted.imag() / tiny));
                value_off = std::max(value_off, std::abs(run.table[column].values[k] - wanted.real()));
            }
            EXPECT_LT(value_off, 1e-9); // the run itself is the closed form
            EXPECT_LE(off, c.tolerance * largest);
        }
    }
}

// Classical Runge-Kutta with steps so short that its error is rounding.
Complex van_der_pol(const std::string& column, double t, const Values& values) {
    Complex x = values.at("x.start"), v = values.at("v.start"), mu = values.at("mu");
    const auto steps = static_cast<int>(std::ceil(t / 1e-3));
    const double h = steps == 0 ? 0 : t / steps;
    const auto rate = [&](Complex a, Complex b) { return std::pair(b, mu * (1.0 - a * a) * b - a); };
    for (int i = 0; i < steps; ++i) {
        const auto [x1, v1] = rate(x, v);
        const auto [x2, v2] = rate(x + h / 2 * x1, v + h / 2 * v1);
        const auto [x3, v3] = rate(x + h / 2 * x2, v + h / 2 * v2);
        const auto [x4, v4] = rate(x + h * x3, v + h * v3);
        x += h / 6 * (x1 + 2.0 * x2 + 2.0 * x3 + x4);
        v += h / 6 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
    }
    return column == "x" ? x : column == "v" ? v : mu * x * v;
}

TEST(SystemSensitivities, AreThoseOfASmoothSystemByStepsThatAreComplex) {
    SystemBuilder b("van der Pol");
    const Expression x = b.state("x", 2), v = b.state("v", 0.1);
    const Expression mu = b.parameter("mu", 1.3);
    b.rate(x, v);
    b.rate(v, mu * (1 - x * x) * v - x);
    b.output("power", mu * x * v);
    for (const Method method : {Method::automatic, Method::adams}) {
        compare({.equations = b.equations(),
                 .values = {{"mu", 1.3}, {"x.start", 2}, {"v.start", 0.1}},
                 .columns = {"x", "v", "power"},
                 .closed_form = van_der_pol,
                 .end = 6,
                 .method = method});
    }
}

// Bounces at times that follow from one another; the height of the floor is a parameter as well.
Complex bouncing_ball(const std::string& column, double t, const Values& values) {
    const Complex g = values.at("g"), e = values.at("e"), floor = values.at("floor"), h0 = values.at("h.start");
    Complex from = std::sqrt(2.0 * (h0 - floor) / g), w = e * g * from;
    if (t <= from.real()) return column == "h" ? h0 - g / 2.0 * t * t : -g * t;
    while (t > (from + 2.0 * w / g).real()) {
        from += 2.0 * w / g;
        w *= e;
    }
    const Complex since = t - from;
    return column == "h" ? floor + w * since - g / 2.0 * since * since : w - g * since;
}

TEST(SystemSensitivities, AreThoseOfABouncingBall) {
    SystemBuilder b("ball");
    const Expression h = b.state("h", 1), v = b.state("v", 0);
    const Expression g = b.parameter("g", 9.81), e = b.parameter("e", 0.8), floor = b.parameter("floor", 0.2);
    b.rate(h, v);
    b.rate(v, -g);
    b.when("impact", h < floor, {{h, floor}, {v, -e * v}});
    for (const Method method : {Method::exact, Method::erk, Method::bdf}) {
        compare({.equations = b.equations(),
                 .values = {{"g", 9.81}, {"e", 0.8}, {"floor", 0.2}, {"h.start", 1}},
                 .columns = {"h", "v"},
                 .closed_form = bouncing_ball,
                 .end = 2.5,
                 .method = method,
                 .tolerance = method == Method::bdf ? 1e-7 : 1e-9,
                 .events = 5});
    }
}

// A block on a surface is pulled by a spring whose end moves. It sticks until the spring takes the static friction, and
// slips with the harmonic motion about the level.
Complex stick_slip(const std::string& column, double t, const Values& values) {
    const Complex m = values.at("m"), k = values.at("k"), speed = values.at("speed"), level = values.at("level"),
                  release = values.at("release");
    const Complex omega = std::sqrt(k / m), a = (release - level) / k;
    const double pi = std::acos(-1);
    const Complex slip = 2.0 * (pi - std::atan(a * omega / speed)) / omega;
    const auto lag = [&](Complex since) { // x - speed t + level/k
        return -a * std::cos(omega * since) - speed / omega * std::sin(omega * since);
    };
    Complex x = values.at("x.start");
    for (;;) {
        const Complex begins = (x + release / k) / speed, ends = begins + slip;
        if (t <= begins.real()) return column == "x" ? x : 0;
        if (t < ends.real()) {
            const Complex since = t - begins;
            if (column == "x") return lag(since) + speed * t - level / k;
            return a * omega * std::sin(omega * since) - speed * std::cos(omega * since) + speed;
        }
        x = lag(slip) + speed * ends - level / k;
    }
}

TEST(SystemSensitivities, AreThoseOfDryFrictionThatSticksAndSlips) {
    SystemBuilder b("block");
    const Expression x = b.state("x", 0.01), v = b.state("v", 0), force = b.discrete("force", 0),
                     mode = b.discrete("mode", 0);
    const Expression m = b.parameter("m", 0.7), k = b.parameter("k", 50), speed = b.parameter("speed", 0.1),
                     level = b.parameter("level", 2), release = b.parameter("release", 2.5);
    b.rate(x, v);
    b.rate(v, (k * (speed * b.time() - x) - force) / m);
    Equations equations = b.equations();
    equations.contacts.push_back({.name = "friction",
                                  .force = equations.discrete[0].symbol,
                                  .mode = equations.discrete[1].symbol,
                                  .quantity = equations.states[1].symbol,
                                  .level = equations.parameters[3].symbol,
                                  .release = equations.parameters[4].symbol});
    equations.discrete.erase(equations.discrete.begin()); // the force follows from the others
    close_contacts(equations);
    for (const Method method : {Method::exact, Method::erk}) {
        compare({.equations = equations,
                 .values = {{"m", 0.7}, {"k", 50}, {"speed", 0.1}, {"level", 2}, {"release", 2.5}, {"x.start", 0.01}},
                 .columns = {"x", "v"},
                 .closed_form = stick_slip,
                 .end = 3,
                 .method = method,
                 .events = 6});
    }
}

// A lag that a controller with an integrator and a limit moves, sampled and held: its recursion is exact.
Complex sampled_loop(const std::string& column, double t, const Values& values) {
    const Complex a = values.at("a"), kp = values.at("kp"), ki = values.at("ki"), limit = values.at("limit");
    const double period = 0.1;
    Complex x = values.at("x.start"), u = 0, sum = 0;
    double now = 0;
    for (int i = 0;; ++i) {
        const double next = i * period;
        const double to = std::min(t, next);
        const Complex decay = std::exp(-a * (to - now));
        x = decay * x + (1.0 - decay) / a * u;
        now = to;
        if (next >= t * (1 - 1e-12)) break;
        const Complex e = 1.0 - x;
        const Complex wanted = kp * e + sum;
        u = wanted.real() > limit.real() ? limit : wanted;
        sum += ki * e;
    }
    return column == "x" ? x : column == "u" ? u : sum;
}

TEST(SystemSensitivities, AreThoseOfASampledController) {
    for (const bool affine : {true, false}) {
        SystemBuilder b("loop");
        const Expression x = b.state("x", 0.1), u = b.discrete("u", 0), sum = b.discrete("sum", 0);
        const Expression a = b.parameter("a", 0.6), kp = b.parameter("kp", 3), ki = b.parameter("ki", 0.4),
                         limit = b.parameter("limit", 1.7);
        b.rate(x, affine ? u - a * x : u - a * x * exp(log(x + 2)) / (x + 2));
        const Expression e = 1 - x, wanted = kp * e + sum;
        b.sample("controller", 0.1, 0, {{u, where(limit < wanted, limit, wanted)}, {sum, sum + ki * e}});
        compare({.equations = b.equations(),
                 .values = {{"a", 0.6}, {"kp", 3}, {"ki", 0.4}, {"limit", 1.7}, {"x.start", 0.1}},
                 .columns = {"x", "u", "sum"},
                 .closed_form = sampled_loop,
                 .end = 3,
                 .method = affine ? Method::exact : Method::erk});
    }
}

// What jumps in what a clock sets is no event: its derivative is zero.
TEST(SystemSensitivities, PassOverRoundingInASample) {
    SystemBuilder b("quantized");
    const Expression x = b.state("x", 0.3), y = b.discrete("y", 0), k = b.parameter("k", 2);
    b.rate(x, k);
    b.sample("encoder", 0.1, 0, {{y, floor(x / 0.01) * 0.01 + k}});
    SystemRunOptions options;
    options.end = 1;
    const SystemRun run = run_system(EquationSystem(with_sensitivities(b.equations(), {"k"})), options);
    ASSERT_TRUE(run.outcome.ok()) << run.outcome.message;
    EXPECT_EQ(run.sensitivities[0].table["y"].values.back(), 1);
    EXPECT_NEAR(run.sensitivities[0].table["x"].values.back(), 1, 1e-15);
}

// x x = p; an event at the time q sets x' anew, and moves the algebraic variable with it.
TEST(SystemSensitivities, AreThoseOfAlgebraicVariables) {
    SystemBuilder b("root");
    const Expression x = b.state("x", 1), z = b.algebraic("z", 1), fast = b.discrete("fast", 0);
    const Expression p = b.parameter("p", 2), q = b.parameter("q", 0.5);
    b.rate(x, where(fast < 0.5, 1, p * z));
    b.residual("square", z * z - p * (x + b.time()));
    b.when("later", q < b.time(), {{fast, 1}, {x, x + z}});
    // In front of it x = 1 + t. Behind it with y = x + t: y' = 1 + p sqrt(p y), implicit in y.
    const ClosedForm closed_form = [](const std::string& column, double t, const Values& values) {
        const Complex slope = values.at("p"), turn = values.at("q");
        if (t <= turn.real()) {
            const Complex y = values.at("x.start") + 2 * t;
            return column == "x" ? y - t : std::sqrt(slope * y);
        }
        const Complex before = values.at("x.start") + 2.0 * turn, c = slope * std::sqrt(slope);
        const Complex start = before + std::sqrt(slope * before);
        // Of r = sqrt(y): 2 r r'/(1 + c r) = 1.
        const auto time = [&](Complex r) { return 2.0 * (r / c - std::log(1.0 + c * r) / (c * c)); };
        Complex r = std::sqrt(start);
        const Complex end = time(r) + t - turn;
        for (int i = 0; i < 50; ++i) r -= (time(r) - end) * (1.0 + c * r) / (2.0 * r);
        return column == "x" ? r * r - t : std::sqrt(slope) * r;
    };
    compare({.equations = b.equations(),
             .values = {{"p", 2}, {"q", 0.5}, {"x.start", 1}},
             .columns = {"x", "z"},
             .closed_form = closed_form,
             .end = 1.2,
             .tolerance = 2e-8, // of backward differentiation formulas
             .events = 1});
}

std::string refusal(const SystemBuilder& b, const std::vector<std::string>& names) {
    try {
        const EquationSystem system(with_sensitivities(b.equations(), names));
    } catch (const InputError& error) {
        return error.what();
    }
    return "none";
}

TEST(SystemSensitivities, RefuseWhatHasNone) {
    SystemBuilder b("hidden");
    const Expression x = b.state("x", 1), k = b.parameter("k", 2);
    b.rate(x, Expression::make(Op::no_event, where(x < 2, k, 3)));
    EXPECT_NE(refusal(b, {"k"}).find("x < 2 stands below no_event"), std::string::npos) << refusal(b, {"k"});
    EXPECT_NE(refusal(b, {"kk"}).find("sensitivities[1] = \"kk\""), std::string::npos) << refusal(b, {"kk"});
    EXPECT_NE(refusal(b, {"k", "k"}).find("twice"), std::string::npos);

    SystemBuilder smooth("smooth");
    const Expression y = smooth.state("y", 1), c = smooth.parameter("c", 2);
    smooth.rate(y, Expression::make(Op::no_event, where(y < 0, -y, y)) * c);
    EXPECT_EQ(refusal(smooth, {"c"}), "none");

    SystemRunOptions options;
    options.end = 1;
    options.solver.method = Method::fixed;
    EXPECT_THROW(run_system(EquationSystem(with_sensitivities(smooth.equations(), {"c"})), options), InputError);
}

// Two events at one instant, which a parameter would put in the one order or the other.
TEST(SystemSensitivities, AreRefusedWhereEventsComeApart) {
    SystemBuilder b("race");
    const Expression x = b.state("x", 0), y = b.state("y", 0), a = b.parameter("a", 1), c = b.parameter("c", 1);
    const Expression winner = b.discrete("winner", 0);
    b.rate(x, a);
    b.rate(y, c);
    b.when("x first", 0.5 < x && winner < 0.5, {{winner, 1}, {x, 0}});
    b.when("y first", 0.5 < y && winner < 0.5, {{winner, 2}, {y, 0}});
    SystemRunOptions options;
    options.end = 0.9;
    const SystemRun run = run_system(EquationSystem(with_sensitivities(b.equations(), {"a"})), options);
    EXPECT_FALSE(run.outcome.ok());
    EXPECT_NE(run.outcome.message.find("come apart with a"), std::string::npos) << run.outcome.message;
    EXPECT_NEAR(run.outcome.t, 0.5, 1e-12);
}

} // namespace
} // namespace tribode
