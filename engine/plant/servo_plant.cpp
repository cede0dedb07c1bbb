#include "plant/servo_plant.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace tribode {

namespace {
constexpr double two_pi = 2 * std::numbers::pi;
// Absolute tolerances of the other states where that of a position is one metre: a velocity of the order of
// displacement times 100 rad/s, a force of the order of displacement times the stiffness of rolling friction.
constexpr double velocity_scale = 100;
constexpr double force_scale = 1e6;
} // namespace

ServoPlant::ServoPlant(Parameters parameters) : p_(std::move(parameters)), total_gain_(p_.rigid_gain) {
    const auto add_states = [&](const std::string& name) {
        states_.push_back({name + " position", "m", states_.size() + 1, 1.0});
        states_.push_back({name + " velocity", "m/s", std::nullopt, velocity_scale});
    };
    add_states("driven point");
    for (const auto& mode : p_.modes) {
        add_states(fmt::format("mode {}", gain_.size() + 1));
        const double omega = two_pi * mode.freq_hz;
        gain_.push_back(mode.gain);
        damping_.push_back(2 * mode.zeta * omega);
        stiffness_.push_back(omega * omega);
        total_gain_ += mode.gain;
    }
    if (p_.current_loop_hz > 0) {
        states_.push_back({"thrust", "N", std::nullopt, force_scale});
        corner_ = two_pi * p_.current_loop_hz;
    }
    assert(total_gain_ > 0);
}

ServoPlant::State ServoPlant::start(double y, double v, std::span<double> x) const {
    std::fill(x.begin(), x.end(), 0.0);
    x[0] = y;
    x[1] = v;
    if (p_.rigid_gain == 0) std::copy_n(x.begin(), 2, x.begin() + 2); // then the first mode is all that can be there
    State s;
    s.rolling = p_.rolling.at_rest(y);
    s.dry = v == 0 ? SlipState::stick : slip_towards(v);
    return s;
}

double ServoPlant::thrust(double t, std::span<const double> x, const State& s) const {
    return corner_ > 0 ? x.back() : s.input(t);
}

double ServoPlant::restoring(std::span<const double> x) const {
    double sum = 0;
    for (std::size_t j = 0; j < gain_.size(); ++j) sum += damping_[j] * x[2 * j + 3] + stiffness_[j] * x[2 * j + 2];
    return sum / total_gain_;
}

double ServoPlant::smooth_friction(std::span<const double> x, const State& s) const {
    const double v = velocity(x);
    return p_.rolling.force(s.rolling, position(x), v) + p_.viscous * v;
}

// The part of smooth_friction that is linear in x.
double ServoPlant::linear_friction(std::span<const double> x, const State& s) const {
    return s.rolling.stiffness * position(x) + (s.rolling.damping + p_.viscous) * velocity(x);
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

// Driven point and modes under an effective thrust; linear in both.
void ServoPlant::motion(std::span<const double> x, double effective, std::span<double> dxdt) const {
    double acceleration = total_gain_ * effective;
    for (std::size_t j = 0; j < gain_.size(); ++j) {
        const double restoring = damping_[j] * x[2 * j + 3] + stiffness_[j] * x[2 * j + 2];
        dxdt[2 * j + 2] = x[2 * j + 3];
        dxdt[2 * j + 3] = gain_[j] * effective - restoring;
        acceleration -= restoring;
    }
    dxdt[0] = x[1];
    dxdt[1] = acceleration;
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
    if (stuck) dxdt[1] = 0; // exactly
    if (corner_ > 0) dxdt.back() = corner_ * (s.input(t) - x.back());
}

void ServoPlant::linear_part(std::span<double> matrix) const {
    const std::size_t n = states_.size();
    std::vector<double> unit(n);
    for (std::size_t j = 0; j < n; ++j) {
        unit[j] = 1;
        const std::span<double> column = matrix.subspan(j * n, n);
        motion(unit, corner_ > 0 ? unit[n - 1] : 0.0, column);
        if (corner_ > 0) column[n - 1] = -corner_ * unit[n - 1];
        unit[j] = 0;
    }
}

std::optional<std::string> ServoPlant::why_not_affine() const {
    if (!p_.dry.velocity_dependent()) return std::nullopt;
    return "the Stribeck level of the friction is not linear in the velocity";
}

void ServoPlant::affine_derivative(int n, double t0, double h, std::span<const double> c, const State& s,
                                   std::span<double> coefficient) const {
    if (n == 0) return derivative(t0, c, s, coefficient);
    const bool stuck = p_.dry.present() && s.dry == SlipState::stick;
    const double input = s.input.taylor(n, t0, h);
    const double effective = stuck ? restoring(c) : (corner_ > 0 ? c.back() : input) - linear_friction(c, s);
    motion(c, effective, coefficient);
    if (stuck) coefficient[1] = 0; // exactly
    if (corner_ > 0) coefficient.back() = corner_ * (input - c.back());
}

void ServoPlant::jacobian(std::span<const double> x, const State& s, std::span<double> matrix) const {
    const std::size_t n = states_.size();
    const auto entry = [&](std::size_t row, std::size_t column) -> double& { return matrix[column * n + row]; };
    const bool stuck = p_.dry.present() && s.dry == SlipState::stick;
    // d u_e / dx
    std::vector<double> effective(n);
    if (stuck) {
        for (std::size_t j = 0; j < gain_.size(); ++j) {
            effective[2 * j + 2] = stiffness_[j] / total_gain_;
            effective[2 * j + 3] = damping_[j] / total_gain_;
        }
    } else {
        effective[0] = -s.rolling.stiffness;
        effective[1] = -(s.rolling.damping + p_.viscous + (p_.dry.present() ? p_.dry.slope(velocity(x)) : 0));
        if (corner_ > 0) effective[n - 1] = 1;
    }
    entry(0, 1) = 1;
    for (std::size_t column = 0; column < n && !stuck; ++column) entry(1, column) = total_gain_ * effective[column];
    for (std::size_t j = 0; j < gain_.size(); ++j) {
        const std::size_t position = 2 * j + 2, velocity = 2 * j + 3;
        entry(position, velocity) = 1;
        for (std::size_t column = 0; column < n; ++column) entry(velocity, column) = gain_[j] * effective[column];
        for (const std::size_t row : {std::size_t{1}, velocity}) {
            if (row == 1 && stuck) continue;
            entry(row, position) -= stiffness_[j];
            entry(row, velocity) -= damping_[j];
        }
    }
    if (corner_ > 0) entry(n - 1, n - 1) = -corner_;
}

// The way in which whatever slips does so.
SlipState ServoPlant::direction(const State& s) const { return p_.dry.present() ? s.dry : s.rolling.direction; }

// With dry friction the way of the motion is known, and an axis that sticks has none: only the limit ahead matters.
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
    const double y = position(x);
    g[forward_limit] = w.forward ? s.rolling.forward_limit - y : 1;
    g[backward_limit] = w.backward ? y - s.rolling.backward_limit : 1;
    g[reversal] = w.towards != 0 ? w.towards * velocity(x) : 1;
    if (!p_.dry.present()) return;
    const double holding = w.release ? holding_force(t, x, s) : 0;
    g[release_forward] = w.release ? release_level() - holding : 1;
    g[release_backward] = w.release ? release_level() + holding : 1;
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
    for (std::size_t j = 0; j < gain_.size(); ++j) x[2 * j + 3] -= gain_[j] * impulse;
    x[1] = 0;
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
    case reversal: {
        // The velocity is zero but for rounding. Where that leaves it on this side it is made exactly zero, lest elements
        // that now stand on their limit slip again at once; beyond, as at the end of a fixed step, it is right as it is.
        const bool turned = sign(direction(s)) * velocity(x) <= 0;
        if (p_.dry.present()) {
            const double towards = sign(s.dry);
            stop(x);
            // A force beyond the level in the direction of motion never let it stop: the velocity is zero, as it is
            // after a release, and fell below by rounding.
            if (towards * holding_force(t, x, s) > release_level()) break;
            set_dry(SlipState::stick);
        }
        p_.rolling.stick(s.rolling, position(x), report);
        if (!turned) stop(x);
        if (p_.dry.present()) {
            // Where the force is beyond the static level, the axis goes straight over into slip the other way.
            const double holding = holding_force(t, x, s);
            if (std::abs(holding) > release_level()) set_dry(slip_towards(holding));
        }
        break;
    }
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
