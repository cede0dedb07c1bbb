#include "plant/servo_plant.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>

namespace tribode {

namespace {
constexpr double two_pi = 2 * std::numbers::pi;
// Absolute tolerances of the other states where that of a position is one metre: a velocity of the order of
// displacement times 100 rad/s, a force of the order of displacement times the stiffness of rolling friction.
constexpr double velocity_scale = 100;
constexpr double force_scale = 1e6;
} // namespace

// x = [x0, x0', q1, q1', ..., Fm]
ServoPlant::ServoPlant(Parameters parameters) : p_(std::move(parameters)) {
    const auto add_body = [&](const std::string& name, double gain, double omega, double zeta) {
        states_.push_back({name + " position", "m", 1.0});
        states_.push_back({name + " velocity", "m/s", velocity_scale});
        gain_.push_back(gain);
        damping_.push_back(2 * zeta * omega);
        stiffness_.push_back(omega * omega);
        total_gain_ += gain;
    };
    add_body("rigid body", p_.rigid_gain, 0.0, 0.0);
    for (std::size_t j = 0; j < p_.modes.size(); ++j) {
        const auto& mode = p_.modes[j];
        add_body(fmt::format("mode {}", j + 1), mode.gain, two_pi * mode.freq_hz, mode.zeta);
    }
    if (p_.current_loop_hz > 0) {
        states_.push_back({"thrust", "N", force_scale});
        corner_ = two_pi * p_.current_loop_hz;
    }
    assert(total_gain_ > 0);
}

ServoPlant::State ServoPlant::start(double y, double v, std::span<double> x) const {
    std::fill(x.begin(), x.end(), 0.0);
    const std::size_t moving = p_.rigid_gain > 0 ? 0 : 2; // the first body that can move
    x[moving] = y;
    x[moving + 1] = v;
    State s;
    s.rolling = p_.rolling.at_rest(y);
    s.dry = v == 0 ? SlipState::stick : slip_towards(v);
    return s;
}

double ServoPlant::position(std::span<const double> x) const {
    double sum = 0;
    for (std::size_t j = 0; j < bodies(); ++j) sum += x[2 * j];
    return sum;
}

double ServoPlant::velocity(std::span<const double> x) const {
    double sum = 0;
    for (std::size_t j = 0; j < bodies(); ++j) sum += x[2 * j + 1];
    return sum;
}

double ServoPlant::thrust(double t, std::span<const double> x, const State& s) const {
    return corner_ > 0 ? x.back() : s.input(t);
}

double ServoPlant::restoring(std::span<const double> x) const {
    double sum = 0;
    for (std::size_t j = 1; j < bodies(); ++j) sum += damping_[j] * x[2 * j + 1] + stiffness_[j] * x[2 * j];
    return sum / total_gain_;
}

double ServoPlant::smooth_friction(std::span<const double> x, const State& s) const {
    const double v = velocity(x);
    return p_.rolling.force(s.rolling, position(x), v) + p_.viscous * v;
}

// The part of smooth_friction that is linear in x; with constant_force it makes up the forces in slip.
double ServoPlant::linear_friction(std::span<const double> x, const State& s) const {
    return s.rolling.stiffness * position(x) + (s.rolling.damping + p_.viscous) * velocity(x);
}

double ServoPlant::constant_force(const State& s) const {
    return s.disturbance - s.rolling.force + s.rolling.stiffness * s.rolling.reference - sign(s.dry) * p_.dry.coulomb;
}

double ServoPlant::holding_force(double t, std::span<const double> x, const State& s) const {
    return thrust(t, x, s) + s.disturbance - smooth_friction(x, s) - restoring(x);
}

ServoPlant::Outputs ServoPlant::outputs(double t, std::span<const double> x, const State& s) const {
    const double v = velocity(x);
    double f = smooth_friction(x, s);
    if (p_.dry.present()) {
        f += s.dry == SlipState::stick ? holding_force(t, x, s) : sign(s.dry) * p_.dry.level(v);
    }
    return {position(x), v, f, thrust(t, x, s)};
}

// Positions and velocities of all bodies under an effective thrust; linear in both.
void ServoPlant::motion(std::span<const double> x, double effective, std::span<double> dxdt) const {
    for (std::size_t j = 0; j < bodies(); ++j) {
        dxdt[2 * j] = x[2 * j + 1];
        dxdt[2 * j + 1] = gain_[j] * effective - damping_[j] * x[2 * j + 1] - stiffness_[j] * x[2 * j];
    }
}

void ServoPlant::derivative(double t, std::span<const double> x, const State& s, std::span<double> dxdt) const {
    const bool stuck = p_.dry.present() && s.dry == SlipState::stick;
    double effective;
    if (stuck) {
        effective = restoring(x);
    } else {
        effective = thrust(t, x, s) + s.disturbance - smooth_friction(x, s);
        if (p_.dry.present()) effective -= sign(s.dry) * p_.dry.level(velocity(x));
    }
    motion(x, effective, dxdt);
    if (corner_ > 0) dxdt.back() = corner_ * (s.input(t) - x.back());
}

std::optional<std::string> ServoPlant::why_not_affine() const {
    if (!p_.dry.velocity_dependent()) return std::nullopt;
    return "the Stribeck level of the friction is not linear in the velocity";
}

void ServoPlant::affine_derivative(int n, double t0, double h, std::span<const double> c, const State& s,
                                   std::span<double> coefficient) const {
    const bool stuck = p_.dry.present() && s.dry == SlipState::stick;
    const double input = s.input.taylor(n, t0, h);
    double effective;
    if (stuck) {
        effective = restoring(c);
    } else {
        effective = (corner_ > 0 ? c.back() : input) - linear_friction(c, s);
        if (n == 0) effective += constant_force(s);
    }
    motion(c, effective, coefficient);
    if (corner_ > 0) coefficient.back() = corner_ * (input - c.back());
}

void ServoPlant::jacobian(std::span<const double> x, const State& s, std::span<double> matrix) const {
    const std::size_t n = states_.size();
    const auto entry = [&](std::size_t row, std::size_t column) -> double& { return matrix[column * n + row]; };
    const bool stuck = p_.dry.present() && s.dry == SlipState::stick;
    double damping = s.rolling.damping + p_.viscous;
    if (p_.dry.present() && !stuck) damping += p_.dry.slope(velocity(x));
    for (std::size_t row = 0; row < bodies(); ++row) {
        entry(2 * row, 2 * row + 1) = 1;
        for (std::size_t column = 0; column < bodies(); ++column) {
            // d u_e / d(position, velocity) of the column's body
            const double by_position = stuck ? stiffness_[column] / total_gain_ : -s.rolling.stiffness;
            const double by_velocity = stuck ? damping_[column] / total_gain_ : -damping;
            entry(2 * row + 1, 2 * column) = gain_[row] * by_position;
            entry(2 * row + 1, 2 * column + 1) = gain_[row] * by_velocity;
        }
        entry(2 * row + 1, 2 * row) -= stiffness_[row];
        entry(2 * row + 1, 2 * row + 1) -= damping_[row];
        if (corner_ > 0 && !stuck) entry(2 * row + 1, n - 1) = gain_[row];
    }
    if (corner_ > 0) entry(n - 1, n - 1) = -corner_;
}

// The way in which whatever slips does so.
SlipState ServoPlant::direction(const State& s) const {
    return p_.dry.present() ? s.dry : s.rolling.direction;
}

// With dry friction the way of the motion is known, and an axis that sticks has none: an element which stopped on its
// limit must not slip because the modes' motion sums to zero within rounding only.
ServoPlant::Watched ServoPlant::watched(const State& s) const {
    Watched w;
    w.forward = (!p_.dry.present() || s.dry == SlipState::slip_forward) && std::isfinite(s.rolling.forward_limit);
    w.backward = (!p_.dry.present() || s.dry == SlipState::slip_backward) && std::isfinite(s.rolling.backward_limit);
    w.towards = sign(direction(s));
    w.release = p_.dry.present() && s.dry == SlipState::stick;
    return w;
}

void ServoPlant::guards(double t, std::span<const double> x, const State& s, std::span<double> g) const {
    const Watched w = watched(s);
    // A fall within the rounding of the sums is none: after a reversal an element stands exactly on its limit.
    double size_of_y = 0, size_of_v = 0;
    for (std::size_t j = 0; j < bodies(); ++j) {
        size_of_y += std::abs(x[2 * j]);
        size_of_v += std::abs(x[2 * j + 1]);
    }
    constexpr double rounding = 4 * std::numeric_limits<double>::epsilon();
    const double y = position(x);
    g[forward_limit] = w.forward ? s.rolling.forward_limit - y + rounding * size_of_y : 1;
    g[backward_limit] = w.backward ? y - s.rolling.backward_limit + rounding * size_of_y : 1;
    g[reversal] = w.towards != 0 ? w.towards * velocity(x) + rounding * size_of_v : 1;
    if (!p_.dry.present()) return;
    const double holding = w.release ? holding_force(t, x, s) : 0;
    g[release_forward] = w.release ? p_.dry.static_level - holding : 1;
    g[release_backward] = w.release ? p_.dry.static_level + holding : 1;
}

void ServoPlant::affine_guards(int n, double t0, double h, std::span<const double> c, const State& s,
                               std::span<double> g) const {
    if (n == 0) return guards(t0, c, s, g);
    const Watched w = watched(s);
    const double y = position(c);
    g[forward_limit] = w.forward ? -y : 0;
    g[backward_limit] = w.backward ? y : 0;
    g[reversal] = w.towards * velocity(c);
    if (!p_.dry.present()) return;
    const double thrust = corner_ > 0 ? c.back() : s.input.taylor(n, t0, h);
    const double holding = w.release ? thrust - linear_friction(c, s) - restoring(c) : 0;
    g[release_forward] = -holding;
    g[release_backward] = holding;
}

// Takes the velocity of the driven point to exactly zero, by an impulse there.
void ServoPlant::stop(std::span<double> x) const {
    const double impulse = velocity(x) / total_gain_;
    for (std::size_t j = 0; j < bodies(); ++j) x[2 * j + 1] -= gain_[j] * impulse;
    // What rounding left goes to the last body, which always has a gain: its velocity is the last term of the sum, so
    // that taking it as minus the others' sum leaves no rounding at all.
    double& last = x[2 * bodies() - 1];
    last = 0;
    last = -velocity(x);
}

std::optional<AffinePattern> ServoPlant::affine_pattern(const State& s) const {
    if (s.input.rate != 0) return std::nullopt; // u varies between its samples
    const Watched w = watched(s);
    const double watch = w.towards + 3 * w.forward + 6 * w.backward + 12 * w.release;
    return AffinePattern{s.rolling.stiffness, s.rolling.damping, watch};
}

EventEffect ServoPlant::on_crossing(GuardId guard, double t, std::span<double> x, State& s, EventLog& log) const {
    const auto report = [&](std::size_t element, SlipState now) {
        log.push_back({t, static_cast<int>(element) + 1, static_cast<int>(now)});
    };
    const auto set_dry = [&](SlipState now) {
        log.push_back({t, coulomb_subject, static_cast<int>(now)});
        s.dry = now;
    };
    switch (guard) {
    case forward_limit: p_.rolling.slip(s.rolling, position(x), SlipState::slip_forward, report); break;
    case backward_limit: p_.rolling.slip(s.rolling, position(x), SlipState::slip_backward, report); break;
    case reversal:
        if (p_.dry.present()) set_dry(SlipState::stick);
        p_.rolling.stick(s.rolling, position(x), report);
        if (p_.dry.present()) {
            // Where the force is beyond the static level, the axis goes straight over into slip the other way.
            stop(x);
            const double holding = holding_force(t, x, s);
            if (std::abs(holding) > p_.dry.static_level) set_dry(slip_towards(holding));
        }
        break;
    case release_forward:
    case release_backward:
        stop(x);
        set_dry(guard == release_forward ? SlipState::slip_forward : SlipState::slip_backward);
        break;
    }
    return EventEffect::restart;
}

std::string ServoPlant::guard_name(GuardId guard, const State& s) const {
    switch (guard) {
    case forward_limit: return fmt::format("friction element {}", s.rolling.next_forward + 1);
    case backward_limit: return fmt::format("friction element {}", s.rolling.next_backward + 1);
    case reversal: return "the reversal of the velocity";
    default: return "the Coulomb level";
    }
}

} // namespace tribode
