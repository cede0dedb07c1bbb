#include "tribode/plant/servo_plant.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <ostream>
#include <random>
#include <utility>

namespace tribode {
namespace {

using Vector = std::vector<double>;

constexpr double two_pi = 2 * std::numbers::pi;
constexpr double per_second = 1 / two_pi; // 1 rad/s in Hz

// The guards in their declared order.
enum : GuardId { forward_limit, backward_limit, reversal, release_forward, release_backward };

constexpr DryFriction coulomb(double level) { return {.coulomb = level, .stribeck = {}}; }
constexpr DryFriction stribeck{.coulomb = 2, .stribeck = Stribeck{4, 0.02, 1}};

// Rigid gain 1/2; one mode of gain 1/4, 10 rad/s and zeta 0.1: q'' = u_e/4 - 2 q' - 100 q.
// Friction: one element of 100 N/m, 1 N (limit 10 mm) and 3 N s/m; 2 N s/m viscous.
ServoPlant::Parameters simple(DryFriction dry, double current_loop_hz = 0) {
    return {.rigid_gain = 0.5,
            .modes = {{0.25, 10 * per_second, 0.1}},
            .rolling = RollingFriction({{100, 1, 3}}),
            .dry = dry,
            .viscous = 2,
            .current_loop_hz = current_loop_hz};
}

// Without elements and without lag.
ServoPlant::Parameters plain(double rigid_gain, std::vector<VibrationMode> modes, DryFriction dry, double viscous = 0) {
    return {.rigid_gain = rigid_gain,
            .modes = std::move(modes),
            .rolling = {},
            .dry = dry,
            .viscous = viscous,
            .current_loop_hz = 0};
}

struct Machine {
    explicit Machine(ServoPlant::Parameters parameters, double v = 0)
        : plant(std::move(parameters)),
          x(plant.states().size()),
          state(plant.start(0, v, x)) {}

    Vector derivative(double t = 0) const {
        Vector dxdt(x.size());
        plant.derivative(t, x, state, dxdt);
        return dxdt;
    }
    Vector guards(double t = 0) const {
        Vector g(plant.guard_count());
        plant.guards(t, x, state, g);
        return g;
    }
    double guard(GuardId id) const { return guards().at(id); }
    double force() const { return plant.outputs(0, x, state).friction; }
    double velocity() const { return plant.velocity(x); }
    void push(double thrust) { state.input.coefficient[0] = thrust; }
    // Handles the event; what went to the log as {subject, kind}.
    std::vector<std::pair<int, int>> handle(GuardId id) {
        EventLog log;
        EXPECT_EQ(plant.on_crossing(id, 7.0, x, state, log), EventEffect::restart);
        std::vector<std::pair<int, int>> entries;
        for (const Event& event : log) {
            EXPECT_EQ(event.t, 7.0);
            entries.emplace_back(event.subject, event.kind);
        }
        return entries;
    }

    ServoPlant plant;
    Vector x;
    ServoPlant::State state;
};

using Log = std::vector<std::pair<int, int>>;

void expect_near(const Vector& found, const Vector& expected, double tolerance) {
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], tolerance) << i;
}

// Numbers below 100 in a handful of operations.
constexpr double rounding = 1e-13;

// y = 3 mm, v = 0.3 m/s: f = 0.3 + 0.9 (element) + 0.6 (viscous) + 4 (Coulomb) = 5.8 N; u_e = 20 + 0.5 - 5.8
// = 14.7 N.
TEST(ServoPlant, DerivativeInSlipByHand) {
    Machine m(simple(coulomb(4)), 0.3);
    m.x = {0.003, 0.3, 0.002, 0.1};
    m.push(20);
    m.state.disturbance = 0.5;
    const double restoring = 0.2 + 0.2; // of the mode
    expect_near(m.derivative(), {0.3, 0.75 * 14.7 - restoring, 0.1, 0.25 * 14.7 - restoring}, rounding);
    const auto out = m.plant.outputs(0, m.x, m.state);
    expect_near({out.position, out.velocity, out.friction, out.thrust}, {0.003, 0.3, 5.8, 20}, rounding);
}

// The same with v < 0: f = 0.3 - 0.9 - 0.6 - 4 = -5.2 N; u_e = 25.7 N.
TEST(ServoPlant, DerivativeInBackwardSlipByHand) {
    Machine m(simple(coulomb(4)), -0.3);
    m.x = {0.003, -0.3, 0.002, -0.1};
    m.push(20);
    m.state.disturbance = 0.5;
    const double restoring = -0.2 + 0.2;
    expect_near(m.derivative(), {-0.3, 0.75 * 25.7 - restoring, -0.1, 0.25 * 25.7 - restoring}, rounding);
}

// The thrust lags: Fm = 15 N acts, so u_e = 15 + 0.5 - 5.8 = 9.7 N.
TEST(ServoPlant, DerivativeWithTheCurrentLoopByHand) {
    Machine m(simple(coulomb(4), 5), 0.3);
    m.x = {0.003, 0.3, 0.002, 0.1, 15};
    m.push(20);
    m.state.disturbance = 0.5;
    expect_near(m.derivative(), {0.3, 0.75 * 9.7 - 0.4, 0.1, 0.25 * 9.7 - 0.4, two_pi * 5 * (20 - 15)}, rounding);
    EXPECT_EQ(m.plant.outputs(0, m.x, m.state).thrust, 15);
}

// v = 0 with the mode in motion: (2 z w q' + w^2 q)/sum k = (0.2 + 0.2)/0.75 N is the effective thrust that keeps the
// driven point where it is, and friction is the rest of 20.5 N, of which the element holds 0.3 N.
TEST(ServoPlant, DerivativeInStickByHand) {
    Machine m(simple(coulomb(40)));
    m.x = {0.003, 0, 0.002, 0.1};
    m.push(20);
    m.state.disturbance = 0.5;
    const double restoring = 0.4 / 0.75;
    expect_near(m.derivative(), {0, 0, 0.1, 0.25 * restoring - 0.4}, rounding);
    EXPECT_NEAR(m.force(), 20.5 - restoring, rounding);
}

TEST(ServoPlant, TheInputBetweenSamplesDrivesThePlant) {
    Machine m(plain(0.5, {}, {}));
    m.state.input = {.coefficient = {1, 2, 0, 0}, .start = 3, .rate = 4};
    EXPECT_EQ(m.derivative(3.125)[1], 0.5 * (1 + 2 * 0.5));
}

TEST(ServoPlant, StatesAreTheDrivenPointTheModesAndTheThrust) {
    std::vector<std::string> names;
    const ServoPlant plant(simple({}, 5));
    for (const auto& state : plant.states()) names.push_back(state.name + " " + state.unit);
    EXPECT_EQ(names, (std::vector<std::string>{"driven point position m", "driven point velocity m/s",
                                               "mode 1 position m", "mode 1 velocity m/s", "thrust N"}));
    EXPECT_EQ(ServoPlant(simple({})).states().size(), 4u);
    EXPECT_EQ(ServoPlant(simple({})).guard_count(), 3u);
    EXPECT_EQ(ServoPlant(simple(coulomb(1))).guard_count(), 5u);
}

TEST(ServoPlant, StartTakesTheFirstModeAlongWhereThereIsNoRigidBody) {
    ServoPlant rigid(simple(coulomb(1), 5));
    Vector x(5, 99.0);
    EXPECT_EQ(rigid.start(0.2, -0.3, x).dry, SlipState::slip_backward);
    EXPECT_EQ(x, (Vector{0.2, -0.3, 0, 0, 0}));
    EXPECT_EQ(rigid.start(0.2, 0, x).dry, SlipState::stick);

    auto parameters = simple({});
    parameters.rigid_gain = 0;
    ServoPlant flexible(parameters);
    x.assign(4, 99.0);
    const auto state = flexible.start(0.2, 0.3, x);
    EXPECT_EQ(x, (Vector{0.2, 0.3, 0.2, 0.3}));
    EXPECT_EQ(state.rolling.force, 0); // relaxed where it stands
    EXPECT_EQ(state.rolling.reference, 0.2);
}

// One mode alone: the axis is an oscillator, and the driven point goes with it.
TEST(ServoPlant, WithoutRigidGainTheModeMovesAlone) {
    Machine m(plain(0, {{0.25, 10 * per_second, 0.1}}, coulomb(4), 2), 0.3);
    m.x = {0.002, 0.3, 0.002, 0.3};
    m.push(20);
    const double acceleration = 0.25 * (20 - 0.6 - 4) - 0.6 - 0.2;
    expect_near(m.derivative(), {0.3, acceleration, 0.3, acceleration}, rounding);
    m.handle(reversal);
    EXPECT_EQ(m.x[1], 0);
    EXPECT_NEAR(m.x[3], 0, rounding);
    // 19.2 N are beyond 4 N: it slips on.
    expect_near(m.derivative(), {0, 0.25 * (20 - 4) - 0.2, 0, 0.25 * (20 - 4) - 0.2}, rounding);
}

// ---- Jacobian

struct Variant {
    const char* name;
    DryFriction dry;
    double v; // forward, backward or zero: the slip state
    double current_loop_hz;
    double rigid_gain;
};

std::ostream& operator<<(std::ostream& stream, const Variant& variant) { return stream << variant.name; }

ServoPlant::Parameters variant_parameters(const Variant& variant) {
    return {.rigid_gain = variant.rigid_gain,
            .modes = {{0.013, 33, 0.025}, {0.005, 82, 0.003}},
            .rolling = RollingFriction({{2e4, 0.5, 0}, {1e3, 1, 10}}),
            .dry = variant.dry,
            .viscous = 2.35,
            .current_loop_hz = variant.current_loop_hz};
}

class Jacobian : public ::testing::TestWithParam<Variant> {};
INSTANTIATE_TEST_SUITE_P(Kinds, Jacobian,
                         ::testing::Values(Variant{"Frictionless", {}, 0.05, 0, 0.09},
                                           Variant{"Lag", {}, 0.05, 750, 0.09},
                                           Variant{"CoulombForward", coulomb(2), 0.05, 0, 0.09},
                                           Variant{"CoulombStick", coulomb(2), 0, 0, 0.09},
                                           Variant{"CoulombStickLag", coulomb(2), 0, 750, 0.09},
                                           Variant{"StribeckForward", stribeck, 0.05, 0, 0.09},
                                           Variant{"StribeckBackwardLag", stribeck, -0.05, 750, 0.09},
                                           Variant{"StribeckStick", stribeck, 0, 0, 0.09},
                                           Variant{"StribeckForwardModesOnly", stribeck, 0.05, 750, 0}),
                         [](const auto& variant) { return std::string(variant.param.name); });

TEST_P(Jacobian, AgreesWithCentralDifferences) {
    const Variant& variant = GetParam();
    Machine m(variant_parameters(variant), variant.v);
    std::mt19937_64 random(5);
    std::normal_distribution<double> normal;
    const std::size_t n = m.x.size();
    for (int draw = 0; draw < 20; ++draw) {
        for (std::size_t i = 0; i < n; ++i) m.x[i] = normal(random) * (i == 6 ? 1.0 : i % 2 ? 0.002 : 1e-4);
        m.x[1] = variant.v == 0 ? 0 : variant.v + m.x[1];
        if (draw == 10 && variant.v > 0) m.handle(forward_limit); // one element slips from here on
        Vector matrix(n * n, 0.0);
        EXPECT_TRUE(m.plant.jacobian(0, m.x, m.state, matrix));
        for (std::size_t column = 0; column < n; ++column) {
            // The only curve is the Stribeck one: its third derivative, 2.5e5 N s^3/m^3, times h^2/6 is 4e-8
            // N s/m; accelerations below 100 m/s^2, rounded and divided by 2h, 1e-8/s. The smallest entries
            // are of 0.01.
            const double h = 1e-6, middle = m.x[column];
            m.x[column] = middle + h;
            const Vector above = m.derivative();
            const double step = m.x[column];
            m.x[column] = middle - h;
            const Vector below = m.derivative();
            for (std::size_t row = 0; row < n; ++row) {
                const double difference = (above[row] - below[row]) / (step - m.x[column]);
                EXPECT_NEAR(matrix[column * n + row], difference, 1e-6 + 1e-9 * std::abs(difference))
                    << "row " << row << ", column " << column;
            }
            m.x[column] = middle;
        }
    }
}

// ---- series in time

class Series : public ::testing::TestWithParam<Variant> {};
INSTANTIATE_TEST_SUITE_P(Kinds, Series,
                         ::testing::Values(Variant{"Frictionless", {}, 0.05, 0, 0.09},
                                           Variant{"Lag", {}, 0.05, 750, 0.09},
                                           Variant{"CoulombForward", coulomb(2), 0.05, 0, 0.09},
                                           Variant{"CoulombBackwardLag", coulomb(2), -0.05, 750, 0},
                                           Variant{"CoulombStick", coulomb(2), 0, 0, 0.09},
                                           Variant{"CoulombStickLag", coulomb(2), 0, 750, 0.09}),
                         [](const auto& variant) { return std::string(variant.param.name); });

// A cubic x(t0 + s h) put into derivative and guards is the sum of their coefficients' powers.
TEST_P(Series, OfDerivativeAndGuardsSumUpToTheirValues) {
    const Variant& variant = GetParam();
    Machine m(variant_parameters(variant), variant.v);
    if (!variant.dry.present()) m.handle(forward_limit); // one element slips
    m.state.input = {.coefficient = {3, -2, 5, 7}, .start = 0.2, .rate = 2000};
    m.state.disturbance = 0.7;
    const double t0 = 0.2001, h = 0.0003;
    const std::size_t n = m.x.size();
    std::mt19937_64 random(9);
    std::normal_distribution<double> normal(0, 0.01);
    std::vector<Vector> c(4, Vector(n));
    for (auto& power : c) {
        for (double& value : power) value = normal(random);
    }
    for (const double share : {0.0, 0.3, 1.0}) {
        m.x.assign(n, 0.0);
        Vector slope(n, 0.0), guards(m.plant.guard_count(), 0.0), term(n), guard_term(guards.size());
        for (int k = 0; k <= 3; ++k) {
            const auto& power = c[static_cast<std::size_t>(k)];
            if (k == 0) {
                m.plant.derivative(t0, power, m.state, term);
                m.plant.guards(t0, power, m.state, guard_term);
            } else {
                m.plant.rate_coefficient(k, t0, h, power, m.state, term);
                m.plant.guard_coefficient(k, t0, h, power, m.state, guard_term);
            }
            for (std::size_t i = 0; i < n; ++i) m.x[i] += power[i] * std::pow(share, k);
            for (std::size_t i = 0; i < n; ++i) slope[i] += term[i] * std::pow(share, k);
            for (std::size_t i = 0; i < guards.size(); ++i) guards[i] += guard_term[i] * std::pow(share, k);
        }
        // The time within a period is known to 1e-13 of it; times 20 N and 5000/s that is 1e-8 N/s in the
        // current loop. Accelerations of 1e4 m/s^2 and forces of 1e5 N in stick round to less.
        expect_near(m.derivative(t0 + share * h), slope, 1e-7);
        expect_near(m.guards(t0 + share * h), guards, 1e-7);
    }
}

TEST(ServoPlant, IsPiecewiseAffineWithoutTheStribeckEffectOnly) {
    EXPECT_EQ(ServoPlant(simple({})).why_not_affine(), std::nullopt);
    EXPECT_EQ(ServoPlant(simple(coulomb(4), 5)).why_not_affine(), std::nullopt);
    EXPECT_TRUE(ServoPlant(simple(stribeck)).why_not_affine().has_value());
}

// ---- guards

TEST(ServoPlantGuards, InStickTheLimitsOfTheElementsAreWatched) {
    Machine m(simple({})); // limit 10 mm
    m.x = {0.004, 0.5, 0, 0};
    expect_near(m.guards(), {0.006, 0.014, 1}, 1e-17);
    m.x[0] = 0.011;
    EXPECT_LT(m.guard(forward_limit), 0);
    EXPECT_GT(m.guard(backward_limit), 0);
    m.x[0] = -0.011;
    EXPECT_GT(m.guard(forward_limit), 0);
    EXPECT_LT(m.guard(backward_limit), 0);
}

TEST(ServoPlantGuards, InSlipTheVelocityInItsDirectionIsWatched) {
    for (const double towards : {1.0, -1.0}) {
        Machine m(simple({}));
        m.x = {towards * 0.01, towards * 0.5, 0, 0};
        m.handle(towards > 0 ? forward_limit : backward_limit);
        expect_near(m.guards(), {1, 1, 0.5}, rounding);
        m.x[1] = -towards * 0.5;
        EXPECT_NEAR(m.guard(reversal), -0.5, rounding);
    }
}

TEST(ServoPlantGuards, WithDryFrictionOnlyTheLimitAheadIsWatched) {
    for (const double towards : {1.0, -1.0}) {
        Machine m(simple(coulomb(4)), towards * 0.5);
        m.x[0] = towards * 0.004;
        const GuardId ahead = towards > 0 ? forward_limit : backward_limit;
        EXPECT_NEAR(m.guard(ahead), 0.006, 1e-17);
        EXPECT_EQ(m.guard(ahead == forward_limit ? backward_limit : forward_limit), 1);
        EXPECT_NEAR(m.guard(reversal), 0.5, rounding);
        EXPECT_EQ(m.guard(release_forward), 1);
        EXPECT_EQ(m.guard(release_backward), 1);
    }
}

// 20 N of thrust, no deflection: 20 N are held of 25 N; forward 5 N are left, backward 45 N.
TEST(ServoPlantGuards, InStickWhatIsLeftOfTheStaticLevelIsWatched) {
    Machine m(simple({.coulomb = 10, .stribeck = Stribeck{25, 0.01, 1}}));
    m.push(20);
    const double more = 25 * 1e-11; // the axis is let go a little above the level, by 1e-12 of it
    expect_near(m.guards(), {1, 1, 1, 5, 45}, more);
    EXPECT_GT(m.guard(release_forward), 5);
    m.push(-26);
    EXPECT_NEAR(m.guard(release_forward), 51, more);
    EXPECT_NEAR(m.guard(release_backward), -1, more);
}

// A force of just the static level still holds; rounding of it does not let go.
TEST(ServoPlantGuards, AForceOfTheStaticLevelHolds) {
    Machine m(simple(coulomb(4)));
    for (const double thrust : {4.0, -4.0, std::nextafter(4.0, 5.0), std::nextafter(-4.0, -5.0)}) {
        m.push(thrust);
        for (const double g : m.guards()) EXPECT_GT(g, 0) << thrust;
    }
    m.push(4 * (1 + 1e-11));
    EXPECT_LT(m.guard(release_forward), 0);
}

// An element stopped on its limit, and the driven point a rounding error beyond it: the modes go on swinging,
// so its position is constant within rounding only.
TEST(ServoPlantGuards, AnAxisThatSticksDoesNotSlipByRounding) {
    Machine m(simple(coulomb(4)), 0.3);
    m.x[0] = 0.01;
    m.handle(forward_limit);
    m.x[0] = 0.02;
    m.handle(reversal);
    ASSERT_EQ(m.state.dry, SlipState::stick);
    m.x[0] = std::nextafter(0.02, 1.0);
    for (const double g : m.guards()) EXPECT_GT(g, 0);
    // It goes backward from there, and the element with it.
    m.push(-8);
    m.handle(release_backward);
    for (const GuardId id : {forward_limit, backward_limit, reversal}) EXPECT_GE(m.guard(id), 0) << id;
    EXPECT_EQ(m.state.rolling.slip[0], SlipState::stick);
}

TEST(ServoPlantGuards, NamesSayWhatIsWatched) {
    auto parameters = simple(coulomb(4));
    parameters.rolling = RollingFriction({{100, 2, 0}, {100, 1, 0}});
    Machine m(parameters, 0.3);
    EXPECT_EQ(m.plant.guard_name(forward_limit, m.state), "friction element 2");
    EXPECT_EQ(m.plant.guard_name(backward_limit, m.state), "friction element 2");
    EXPECT_EQ(m.plant.guard_name(reversal, m.state), "the reversal of the velocity");
    EXPECT_EQ(m.plant.guard_name(release_forward, m.state), "the Coulomb level");
}

// ---- events

TEST(ServoPlantEvents, TheForceIsContinuousWhereAnElementSlips) {
    for (const double towards : {1.0, -1.0}) {
        auto parameters = simple({});
        parameters.rolling = RollingFriction({{100, 1, 0}, {50, 2, 0}});
        Machine m(parameters);
        m.x = {towards * 0.01, towards * 0.3, 0, 0};
        const double before = m.force();
        const int kind = static_cast<int>(towards);
        EXPECT_EQ(m.handle(towards > 0 ? forward_limit : backward_limit), (Log{{1, kind}}));
        EXPECT_NEAR(m.force(), before, rounding);
    }
}

TEST(ServoPlantEvents, WhereAnElementSlipsItsDampingEnds) {
    Machine m(simple({}));
    m.x = {0.01, 0.3, 0, 0};
    const double before = m.force();
    m.handle(forward_limit);
    EXPECT_NEAR(before - m.force(), 3 * 0.3, rounding);
}

TEST(ServoPlantEvents, AReversalMakesEveryElementStickWithoutAStepOfTheForce) {
    auto parameters = simple({});
    parameters.rolling = RollingFriction({{100, 1, 3}, {50, 2, 0}, {1000, 1, 0}});
    Machine m(parameters);
    m.x = {0.02, 0.3, 0, 0};
    EXPECT_EQ(m.handle(forward_limit), (Log{{3, 1}, {1, 1}})); // both are beyond their limits, 3 the sooner
    m.x = {0.03, 0, 0, -0.1};
    const double before = m.force();
    const Vector x = m.x;
    EXPECT_EQ(m.handle(reversal), (Log{{1, 0}, {3, 0}}));
    EXPECT_NEAR(m.force(), before, rounding);
    EXPECT_EQ(m.x, x); // the velocity was zero already
}

// Rounding may leave the velocity on this side of zero, with the acceleration away from the limit; it is the modes
// that give way to the driven point.
TEST(ServoPlantEvents, AReversalLeavesNoVelocityInTheOldDirection) {
    for (const double towards : {1.0, -1.0}) {
        Machine m(simple({}));
        m.x = {towards * 0.01, towards * 0.3, 0, 0};
        m.handle(towards > 0 ? forward_limit : backward_limit);
        m.x[1] = towards * 1e-16;
        EXPECT_EQ(m.handle(reversal), (Log{{1, 0}}));
        EXPECT_EQ(m.velocity(), 0);
        EXPECT_NEAR(m.x[3], -towards * 1e-16 * 0.25 / 0.75, 1e-30); // its share of the impulse
        for (const double g : m.guards()) EXPECT_GE(g, 0);
    }
}

// Let go, the velocity is zero and rises; where rounding puts it below, that is no reversal.
TEST(ServoPlantEvents, AVelocityBelowZeroByRoundingIsNoReversalWhereTheForceGoesOn) {
    Machine m(simple(coulomb(4)), 0.3);
    m.push(5);
    m.x[1] = -1e-17;
    EXPECT_EQ(m.handle(reversal), Log{});
    EXPECT_EQ(m.velocity(), 0);
    EXPECT_EQ(m.state.dry, SlipState::slip_forward);
    EXPECT_GT(m.derivative()[1], 0);
}

TEST(ServoPlantEvents, AReversalWithinTheStaticLevelSticks) {
    Machine m(simple(coulomb(4)), 0.3);
    m.x = {0.01, 0.3, 0, 0};
    EXPECT_EQ(m.handle(forward_limit), (Log{{1, 1}}));
    m.x = {0.03, -1e-7, 0.001, -0.1};
    m.push(2);
    EXPECT_EQ(m.handle(reversal), (Log{{0, 0}, {1, 0}}));
    EXPECT_EQ(m.velocity(), 0);
    EXPECT_EQ(m.state.dry, SlipState::stick);
    for (const double g : m.guards()) EXPECT_GT(g, 0);
    // Friction is what keeps v' = 0: thrust less the restoring force of the mode.
    EXPECT_NEAR(m.force(), 2 - (2 * m.x[3] + 100 * m.x[2]) / 0.75, rounding);
}

TEST(ServoPlantEvents, AReversalBeyondTheStaticLevelGoesOverIntoSlipTheOtherWay) {
    Machine m(simple(coulomb(4)), 0.3);
    m.push(-7);
    EXPECT_EQ(m.handle(reversal), (Log{{0, 0}, {0, -1}}));
    EXPECT_EQ(m.velocity(), 0);
    EXPECT_LT(m.derivative()[1], 0); // it does go that way
    for (const double g : m.guards()) EXPECT_GE(g, 0);
}

// Just where the thrust exceeds the static level: friction is that level before and after.
TEST(ServoPlantEvents, TheForceIsContinuousAtRelease) {
    for (const double towards : {1.0, -1.0}) {
        Machine m(simple(stribeck)); // static level 4 N
        m.push(towards * 3.999);
        for (const double g : m.guards()) EXPECT_GT(g, 0);
        m.push(towards * 4);
        const double before = m.force();
        const int kind = static_cast<int>(towards);
        EXPECT_EQ(m.handle(towards > 0 ? release_forward : release_backward), (Log{{0, kind}}));
        EXPECT_NEAR(m.force(), before, rounding);
        EXPECT_NEAR(m.force(), towards * 4, rounding);
        EXPECT_GE(m.guard(reversal), 0);
    }
}

// A random plant of 2 to 5 modes, with and without a rigid body, in motion.
Machine random_machine(std::mt19937_64& random, bool rigid) {
    std::uniform_real_distribution<double> uniform(0.01, 1);
    std::normal_distribution<double> normal;
    std::vector<VibrationMode> modes(2 + random() % 4);
    for (auto& mode : modes) mode = {uniform(random), 100 * uniform(random), 0.1 * uniform(random)};
    Machine m(plain(rigid ? uniform(random) : 0.0, modes, coulomb(1e9)), 1.0);
    for (std::size_t i = 0; i < m.x.size(); ++i) m.x[i] = normal(random) * (i % 2 ? 0.1 : 1e-3);
    return m;
}

TEST(ServoPlantEvents, AfterAStopTheVelocityIsExactlyZero) {
    std::mt19937_64 random(6);
    for (int draw = 0; draw < 2000; ++draw) {
        Machine m = random_machine(random, draw % 2);
        m.handle(draw % 3 ? reversal : release_forward);
        ASSERT_EQ(m.velocity(), 0) << "draw " << draw << ", " << m.x.size() / 2 << " bodies";
    }
}

// An impulse at the driven point changes each velocity by its gain.
TEST(ServoPlantEvents, AStopIsAnImpulseAtTheDrivenPoint) {
    std::mt19937_64 random(7);
    for (int draw = 0; draw < 100; ++draw) {
        Machine m = random_machine(random, draw % 2);
        const Vector before = m.x;
        m.handle(reversal);
        const auto& parameters = m.plant.parameters();
        const std::size_t last = m.x.size() - 1;
        const double impulse = (m.x[last] - before[last]) / parameters.modes.back().gain;
        double total_gain = parameters.rigid_gain;
        for (std::size_t j = 0; j < parameters.modes.size(); ++j) {
            total_gain += parameters.modes[j].gain;
            EXPECT_NEAR(m.x[2 * j + 3] - before[2 * j + 3], parameters.modes[j].gain * impulse, 1e-13);
            EXPECT_EQ(m.x[2 * j + 2], before[2 * j + 2]);
        }
        // Gains of 0.01 and more: the impulse is known to a hundred roundings.
        EXPECT_NEAR(m.x[1] - before[1], total_gain * impulse, 1e-12);
        EXPECT_EQ(m.x[0], before[0]);
    }
}

TEST(ServoPlantEvents, InStickTheDrivenPointDoesNotAccelerateWhateverTheModesDo) {
    std::mt19937_64 random(8);
    for (int draw = 0; draw < 200; ++draw) {
        Machine m = random_machine(random, draw % 2);
        m.push(5);
        m.handle(reversal);
        const Vector dxdt = m.derivative();
        EXPECT_EQ(dxdt[0], 0);
        EXPECT_EQ(dxdt[1], 0);
        // The rigid body goes with what friction leaves of the thrust, and the modes against it.
        double sum = m.plant.parameters().rigid_gain * (5 - m.force()), size = std::abs(sum);
        for (std::size_t i = 3; i < dxdt.size(); i += 2) {
            sum += dxdt[i];
            size += std::abs(dxdt[i]);
        }
        EXPECT_NEAR(sum, 0, 1e-13 * size); // six sums of products of about that size
        EXPECT_GT(size, 0);
    }
}

} // namespace
} // namespace tribode
