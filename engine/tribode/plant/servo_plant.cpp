#include "tribode/plant/servo_plant.hpp"
#include "tribode/base/constants.hpp"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <fmt/format.h>
#include <numeric>

namespace tribode {

namespace {
// Absolute tolerances of the other states where that of a position is one metre: a velocity of the order of
// displacement times 100 rad/s, a force of the order of displacement times the stiffness of rolling friction.
constexpr double velocity_scale = 100;
constexpr double force_scale = 1e6;
constexpr double position_limit = 1e9; // [m]: an axis that got there has an unstable loop
} // namespace

ServoPlant::ServoPlant(Parameters parameters) : p_(std::move(parameters)), total_gain_(p_.rigid_gain) {
    const auto add_states = [&](const std::string& name) {
        states_.push_back({name + " position", "m", states_.size() + 1, 1.0, position_limit});
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
    if (p_.backlash) {
        assert(p_.rigid_gain > 0);
        other_ = states_.size();
        add_states("other body");
        const Backlash& b = *p_.backlash;
        const double load = p_.rigid_gain / b.load_fraction, motor = p_.rigid_gain / (1 - b.load_fraction);
        total_gain_ = std::accumulate(gain_.begin(), gain_.end(), b.load_side ? load : motor);
        other_gain_ = b.load_side ? motor : load;
        const double reduced = 1 / (load + motor), omega = two_pi * b.contact_hz;
        contact_stiffness_ = reduced * omega * omega;
        contact_damping_ = 2 * b.contact_zeta * omega * reduced;
    }
    first_sine_ = states_.size();
    for (std::size_t i = 1; i <= p_.sine_forces.size(); ++i) {
        states_.push_back({fmt::format("sine force {}", i), "N", std::nullopt, force_scale});
        states_.push_back({fmt::format("sine force {}, a quarter later", i), "N", std::nullopt, force_scale});
    }
    first_own_ = states_.size();
    for (const auto& force : p_.forces) {
        own_count_.push_back(force->states().size());
        own_states_ += own_count_.back();
        own_guards_ += force->guard_count();
        laws_.push_back(dynamic_cast<const FrictionLaw*>(force.get()));
        for (auto& state : force->states()) states_.push_back(std::move(state));
    }
    const auto& [forward, backward] = std::pair{p_.forward, p_.backward};
    viscous_ = {p_.viscous + backward.viscous, p_.viscous, p_.viscous + forward.viscous};
    has_dry_ = p_.dry.present() || forward.level != 0 || backward.level != 0 || forward.viscous != backward.viscous;
    scaled_ = !p_.friction_scales.empty();
    curved_ = why_not_affine().has_value();
    added_ = p_.constant_force != 0 || p_.spring != 0 || p_.backlash || !p_.sine_forces.empty() || !p_.forces.empty();
    if (p_.current_loop_hz > 0) {
        states_.push_back({"thrust", "N", std::nullopt, force_scale});
        corner_ = two_pi * p_.current_loop_hz;
    }
    assert(total_gain_ > 0);
    release_margin_ = 1e-12 * (1 + p_.dry.static_level() + std::max(p_.forward.level, p_.backward.level) +
                               p_.rolling.coulomb_level());
}

ServoPlant::State ServoPlant::start(double y, double v, std::span<double> x) const {
    std::fill(x.begin(), x.end(), 0.0);
    x[0] = y;
    x[1] = v;
    // Without a rigid body the first mode is all that can be there; a second body comes along.
    if (p_.rigid_gain == 0) std::copy_n(x.begin(), 2, x.begin() + 2);
    if (p_.backlash) std::copy_n(x.begin(), 2, x.begin() + static_cast<std::ptrdiff_t>(other_));
    refresh_sines(0, x);
    State s;
    s.rolling = p_.rolling.at_rest(y);
    s.dry = v == 0 ? SlipState::stick : slip_towards(v);
    return s;
}

double ServoPlant::thrust(double t, std::span<const double> x, const State& s) const {
    return corner_ > 0 ? x.back() : s.input(t);
}

bool ServoPlant::refresh_sines(double t, std::span<double> x) const {
    if (p_.sine_forces.empty()) return false;
    double* state = x.data() + first_sine_;
    for (const auto& [amplitude, freq_hz, phase] : p_.sine_forces) {
        const double angle = two_pi * freq_hz * t + phase;
        *state++ = amplitude * std::sin(angle);
        *state++ = amplitude * std::cos(angle);
    }
    return true;
}

// What pushes the driven point, but for forces that are not affine. `one` = 0: the part linear in x and thrust.
double ServoPlant::pushing(double thrust, std::span<const double> x, const State& s, double one) const {
    if (!added_) return thrust;
    double sum = one * p_.constant_force - p_.spring * position(x);
    for (std::size_t i = 0; i < p_.sine_forces.size(); ++i) sum += x[first_sine_ + 2 * i];
    if (!p_.backlash) return thrust + sum;
    const double contact = contact_force(x, s, one);
    return sum + (p_.backlash->load_side ? contact : thrust - contact);
}

double ServoPlant::own_forces(double t, std::span<const double> x, const State& s) const {
    double sum = 0;
    std::size_t own = first_own_;
    for (std::size_t i = 0; i < p_.forces.size(); ++i) {
        double force = p_.forces[i]->force(t, position(x), velocity(x), x.subspan(own, own_count_[i]));
        if (laws_[i] && laws_[i]->per_load()) force *= std::abs(thrust(t, x, s));
        sum += force;
        own += own_count_[i];
    }
    return sum;
}

double ServoPlant::law_friction(double t, std::span<const double> x, const State& s) const {
    double sum = 0;
    std::size_t own = first_own_;
    for (std::size_t i = 0; i < p_.forces.size(); ++i) {
        if (laws_[i]) {
            const double friction = laws_[i]->friction(velocity(x), x.subspan(own, own_count_[i]));
            sum += laws_[i]->per_load() ? std::abs(thrust(t, x, s)) * friction : friction;
        }
        own += own_count_[i];
    }
    return sum;
}

double ServoPlant::driving(double t, std::span<const double> x, const State& s) const {
    if (!added_) return thrust(t, x, s) + s.disturbance;
    return pushing(thrust(t, x, s), x, s, 1) + s.disturbance + own_forces(t, x, s);
}

// y_motor - y_load (of = 0), or its rate (of = 1).
double ServoPlant::separation(std::span<const double> x, std::size_t of) const {
    const double ahead = x[of] - x[other_ + of];
    return p_.backlash->load_side ? -ahead : ahead;
}

// On the load, as the spring and damper would have it, whether they press or pull.
double ServoPlant::contact_force(std::span<const double> x, const State& s, double one) const {
    if (s.contact != ContactState::pressing_forward && s.contact != ContactState::pressing_backward) return 0;
    const double side = static_cast<double>(s.contact);
    return contact_stiffness_ * (separation(x, 0) - one * side * p_.backlash->gap / 2) +
           contact_damping_ * separation(x, 1);
}

void ServoPlant::contact_guards(std::span<const double> x, const State& s, double one, std::span<double> g) const {
    const double d = separation(x, 0), half = one * p_.backlash->gap / 2;
    const double side = s.contact > ContactState::open ? 1 : -1;
    switch (s.contact) {
    case ContactState::open:
        g[0] = half - d;
        g[1] = half + d;
        break;
    case ContactState::pressing_forward:
    case ContactState::pressing_backward:
        g[0] = side * contact_force(x, s, one);
        g[1] = one;
        break;
    case ContactState::parting_forward:
    case ContactState::parting_backward:
        // A little beyond, so that rounding does not take it back at once.
        g[0] = side * d - half * (1 - contact_margin);
        g[1] =
            contact_stiffness_ * (half * (1 + contact_margin) - side * d) - contact_damping_ * side * separation(x, 1);
        break;
    }
}

void ServoPlant::contact_crossing(bool first, State& s) const {
    const bool forward = s.contact > ContactState::open;
    switch (s.contact) {
    case ContactState::open:
        s.contact = first ? ContactState::pressing_forward : ContactState::pressing_backward;
        break;
    case ContactState::pressing_forward: s.contact = ContactState::parting_forward; break;
    case ContactState::pressing_backward: s.contact = ContactState::parting_backward; break;
    case ContactState::parting_forward:
    case ContactState::parting_backward:
        s.contact = first     ? ContactState::open
                    : forward ? ContactState::pressing_forward
                              : ContactState::pressing_backward;
        break;
    }
}

double ServoPlant::friction_factor(double t, std::span<const double> x) const {
    if (!scaled_) return 1;
    double factor = 1;
    for (const auto& scale : p_.friction_scales) factor *= scale->factor(t, position(x));
    return factor;
}

// In the direction of the slip, before it is scaled.
double ServoPlant::dry_level(double v, const State& s) const {
    return p_.dry.level(v) + (s.dry == SlipState::slip_forward ? p_.forward : p_.backward).level;
}

// The axis is let go a little above the static level, so that rounding does not stop it again at once [N].
double ServoPlant::release_level(double towards, double t, std::span<const double> x) const {
    const double level = p_.dry.static_level() + (towards > 0 ? p_.forward : p_.backward).level;
    return (level + release_margin_) * friction_factor(t, x);
}

double ServoPlant::restoring(std::span<const double> x) const {
    double sum = 0;
    for (std::size_t j = 0; j < gain_.size(); ++j) sum += damping_[j] * x[2 * j + 3] + stiffness_[j] * x[2 * j + 2];
    return sum / total_gain_;
}

// Inlined: it is part of every evaluation, and friction is seldom scaled.
[[gnu::always_inline]] inline double ServoPlant::smooth_friction(double t, std::span<const double> x,
                                                                 const State& s) const {
    const double v = velocity(x), friction = p_.rolling.force(s.rolling, position(x), v) + viscous(s) * v;
    return scaled_ ? friction_factor(t, x) * friction : friction;
}

// The part of smooth_friction that is linear in x.
double ServoPlant::linear_friction(std::span<const double> x, const State& s) const {
    return s.rolling.stiffness * position(x) + (s.rolling.damping + viscous(s)) * velocity(x);
}

double ServoPlant::holding_force(double t, std::span<const double> x, const State& s) const {
    return driving(t, x, s) - smooth_friction(t, x, s) - restoring(x);
}

ServoPlant::Outputs ServoPlant::outputs(double t, std::span<const double> x, const State& s) const {
    const double v = velocity(x);
    double f = smooth_friction(t, x, s);
    if (has_dry_) {
        f += s.dry == SlipState::stick ? holding_force(t, x, s) : sign(s.dry) * dry_level(v, s) * friction_factor(t, x);
    }
    if (!p_.forces.empty()) f += law_friction(t, x, s);
    return {position(x), v, f, thrust(t, x, s)};
}

// dx/dt of all but own states of forces, under an effective thrust. Each part is stated here alone; it is linear in x, thrust,
// input and `one`, so that `one` = 0 gives the linear part. Inlined, so that `one` costs nothing.
[[gnu::always_inline]] inline void ServoPlant::rates(double effective, double thrust, double input,
                                                     std::span<const double> x, const State& s, double one,
                                                     std::span<double> dxdt) const {
    double acceleration = total_gain_ * effective;
    // In pointers, as dxdt might overwrite the vectors for all the compiler knows.
    const double *gain = gain_.data(), *damping = damping_.data(), *stiffness = stiffness_.data();
    for (std::size_t j = 0, modes = gain_.size(); j < modes; ++j) {
        const double restoring = damping[j] * x[2 * j + 3] + stiffness[j] * x[2 * j + 2];
        dxdt[2 * j + 2] = x[2 * j + 3];
        dxdt[2 * j + 3] = gain[j] * effective - restoring;
        acceleration -= restoring;
    }
    dxdt[0] = x[1];
    dxdt[1] = is_stuck(s) ? 0 : acceleration; // exactly
    if (added_ && p_.backlash) {
        const double contact = contact_force(x, s, one);
        dxdt[other_] = x[other_ + 1];
        dxdt[other_ + 1] = other_gain_ * (p_.backlash->load_side ? thrust - contact : contact);
    }
    for (std::size_t i = 0; added_ && i < p_.sine_forces.size(); ++i) {
        const std::size_t state = first_sine_ + 2 * i;
        const double omega = two_pi * p_.sine_forces[i].freq_hz;
        dxdt[state] = omega * x[state + 1];
        dxdt[state + 1] = -omega * x[state];
    }
    if (corner_ > 0) dxdt.back() = corner_ * (input - x.back());
}

// Adds what a force on the driven point does to dx/dt.
void ServoPlant::push(double force, std::span<double> dxdt) const {
    dxdt[1] += total_gain_ * force;
    for (std::size_t j = 0; j < gain_.size(); ++j) dxdt[2 * j + 3] += gain_[j] * force;
}

void ServoPlant::derivative(double t, std::span<const double> x, const State& s, std::span<double> dxdt) const {
    double effective;
    if (is_stuck(s)) {
        effective = restoring(x);
    } else {
        effective = driving(t, x, s) - smooth_friction(t, x, s);
        if (has_dry_) effective -= sign(s.dry) * dry_level(velocity(x), s) * friction_factor(t, x);
    }
    const double input = corner_ > 0 || added_ ? s.input(t) : 0;
    rates(effective, corner_ > 0 ? x.back() : input, input, x, s, 1, dxdt);
    if (p_.forces.empty()) return;
    std::size_t own = first_own_;
    for (std::size_t i = 0; i < p_.forces.size(); ++i) {
        const std::size_t count = own_count_[i];
        p_.forces[i]->rates(t, position(x), velocity(x), x.subspan(own, count), dxdt.subspan(own, count));
        own += count;
    }
}

// The part of derivative() that is linear in x and in the input.
void ServoPlant::linear_derivative(double input, std::span<const double> x, const State& s,
                                   std::span<double> dxdt) const {
    const double thrust = corner_ > 0 ? x.back() : input;
    const double effective = is_stuck(s) ? restoring(x) : pushing(thrust, x, s, 0) - linear_friction(x, s);
    rates(effective, thrust, input, x, s, 0, dxdt);
    std::ranges::fill(dxdt.subspan(first_own_, own_states_), 0.0);
}

namespace {

// A matrix column by column, as the images of the unit vectors.
template <class Image>
void put_images(std::size_t states, std::size_t rows, std::span<double> matrix, const Image& image) {
    std::vector<double> unit(states);
    for (std::size_t j = 0; j < states; ++j) {
        unit[j] = 1;
        image(unit, matrix.subspan(j * rows, rows));
        unit[j] = 0;
    }
}

} // namespace

void ServoPlant::linear_derivatives(const State& s, std::span<double> matrix) const {
    put_images(states_.size(), states_.size(), matrix,
               [&](std::span<const double> unit, std::span<double> column) { linear_derivative(0, unit, s, column); });
}

void ServoPlant::linear_part(std::span<double> matrix) const {
    State sliding; // without friction: the rolling friction of this state has no stiffness
    sliding.dry = SlipState::slip_forward;
    put_images(states_.size(), states_.size(), matrix, [&](std::span<const double> unit, std::span<double> column) {
        const double thrust = corner_ > 0 ? unit.back() : 0;
        rates(pushing(thrust, unit, sliding, 0), thrust, 0, unit, sliding, 0, column);
    });
}

std::optional<std::string> ServoPlant::why_not_affine() const {
    if (!p_.forces.empty()) return p_.forces.front()->reason();
    if (!p_.friction_scales.empty()) return p_.friction_scales.front()->reason();
    if (p_.dry.velocity_dependent()) return "the Stribeck level of the friction is not linear in the velocity";
    return std::nullopt;
}

bool ServoPlant::jacobian(double t, std::span<const double> x, const State& s, std::span<double> matrix) const {
    const std::size_t n = states_.size();
    linear_derivatives(s, matrix);
    if (is_stuck(s) || !curved_) return true;
    const double v = velocity(x);
    auto [by_position, by_velocity] = friction_slopes(t, x, s, dry_level(v, s), p_.dry.slope(v));
    for (const auto& force : p_.forces) {
        const auto slopes = force->slopes(t, position(x), v);
        if (!slopes) return false;
        by_position += slopes->position;
        by_velocity += slopes->velocity;
    }
    push(by_position, matrix.first(n));
    push(by_velocity, matrix.subspan(n, n));
    return true;
}

// In slip d u_e/dy and d u_e/dv of what friction has beyond its linear part, with the dry level and its slope by the speed.
PointForce::Slopes ServoPlant::friction_slopes(double t, std::span<const double> x, const State& s, double level,
                                               double slope) const {
    const double y = position(x), v = velocity(x);
    double by_position = s.rolling.stiffness, by_velocity = s.rolling.damping + viscous(s);
    const double factor = friction_factor(t, x);
    by_position *= 1 - factor;
    by_velocity *= 1 - factor;
    double friction = p_.rolling.force(s.rolling, y, v) + viscous(s) * v;
    if (has_dry_) {
        friction += sign(s.dry) * level;
        by_velocity -= factor * slope;
    }
    for (const auto& scale : p_.friction_scales) {
        const double own = scale->factor(t, y);
        // The product rule; a factor that is zero has no slope, for it never falls below.
        if (own > 0) by_position -= friction * factor / own * scale->slope(t, y);
    }
    return {by_position, by_velocity};
}

// The way in which whatever slips does so.
SlipState ServoPlant::direction(const State& s) const { return has_dry_ ? s.dry : s.rolling.direction; }

// With dry friction the way of the motion is known, and an axis that sticks has none: only the limit ahead matters.
ServoPlant::Watched ServoPlant::watched(const State& s) const {
    Watched w;
    w.forward = (!has_dry_ || s.dry == SlipState::slip_forward) && std::isfinite(s.rolling.forward_limit);
    w.backward = (!has_dry_ || s.dry == SlipState::slip_backward) && std::isfinite(s.rolling.backward_limit);
    w.towards = sign(direction(s));
    w.release = has_dry_ && s.dry == SlipState::stick;
    return w;
}

// Linear in the force that holds the axis, in levels, x and `one`, as rates() is.
[[gnu::always_inline]] inline void ServoPlant::guards_of(double holding, double forward_level, double backward_level,
                                                         std::span<const double> x, const State& s, double one,
                                                         std::span<double> g) const {
    const Watched w = watched(s);
    const double y = position(x);
    g[forward_limit] = w.forward ? one * s.rolling.forward_limit - y : one;
    g[backward_limit] = w.backward ? y - one * s.rolling.backward_limit : one;
    g[reversal] = w.towards != 0 ? w.towards * velocity(x) : one;
    if (p_.backlash) contact_guards(x, s, one, g.subspan(first_contact_guard()));
    if (!has_dry_) return;
    g[release_forward] = w.release ? forward_level - holding : one;
    g[release_backward] = w.release ? backward_level + holding : one;
}

void ServoPlant::guards(double t, std::span<const double> x, const State& s, std::span<double> g) const {
    if (own_guards_ > 0) {
        each_force([&](const PointForce& force, std::size_t state, std::size_t count, std::size_t guard) {
            force.guards(velocity(x), x.subspan(state, count), g.subspan(guard, force.guard_count()));
        });
    }
    if (!is_stuck(s)) return guards_of(0, 0, 0, x, s, 1, g);
    guards_of(holding_force(t, x, s), release_level(1, t, x), release_level(-1, t, x), x, s, 1, g);
}

void ServoPlant::linear_guards(double input, std::span<const double> x, const State& s, std::span<double> g) const {
    const double thrust = corner_ > 0 ? x.back() : input;
    const double holding = is_stuck(s) ? pushing(thrust, x, s, 0) - linear_friction(x, s) - restoring(x) : 0;
    guards_of(holding, 0, 0, x, s, 0, g);
    std::ranges::fill(g.subspan(first_own_guard()), 0.0);
}

// Takes the velocity of the driven point to exactly zero, by an impulse there.
void ServoPlant::stop(std::span<double> x) const {
    const double impulse = velocity(x) / total_gain_;
    for (std::size_t j = 0; j < gain_.size(); ++j) x[2 * j + 3] -= gain_[j] * impulse;
    x[1] = 0;
}

AffineForm ServoPlant::affine_form(const State& s) const {
    const std::size_t n = states_.size(), guards = guard_count(), forcings = forcing_count();
    AffineForm form{std::vector<double>(n * n), std::vector<double>(guards * n), std::vector<double>(n * forcings),
                    std::vector<double>(guards * forcings)};
    linear_derivatives(s, form.a);
    put_images(n, guards, form.g,
               [&](std::span<const double> unit, std::span<double> column) { linear_guards(0, unit, s, column); });
    if (forcings == 0) return form;
    const std::size_t first = forcings - own_states_ - own_guards_;
    for (std::size_t i = 0; i < own_states_; ++i) form.b[(first + i) * n + first_own_ + i] = 1;
    for (std::size_t i = 0; i < own_guards_; ++i)
        form.c[(first + own_states_ + i) * guards + first_own_guard() + i] = 1;
    if (!is_stuck(s)) {
        push(1, std::span(form.b).first(n));
        return form;
    }
    form.c[release_forward] = -1;
    form.c[release_backward] = 1;
    if (first > 1) {
        form.c[guards + release_forward] = p_.dry.static_level() + p_.forward.level + release_margin_;
        form.c[guards + release_backward] = p_.dry.static_level() + p_.backward.level + release_margin_;
    }
    return form;
}

void ServoPlant::append_affine_key(const State& s, AffineKey& key) const {
    const Watched w = watched(s);
    const int watch = static_cast<int>(w.towards) + 1 + 3 * w.forward + 6 * w.backward + 12 * w.release +
                      24 * (static_cast<int>(s.contact) + 2);
    key.push_back(std::bit_cast<std::uint64_t>(s.rolling.stiffness));
    key.push_back(std::bit_cast<std::uint64_t>(s.rolling.damping));
    key.push_back(static_cast<std::uint64_t>(watch));
}

std::optional<std::string> ServoPlant::why_not_nearly_affine() const {
    for (const auto& force : p_.forces) {
        if (!force->is_nearly_affine()) return force->reason();
    }
    return std::nullopt;
}

std::optional<std::string> ServoPlant::why_not_differentiable() const {
    for (const auto& force : p_.forces) {
        if (!force->numbers()) return force->reason();
    }
    for (const auto& scale : p_.friction_scales) {
        if (!scale->numbers()) return scale->reason();
    }
    if (p_.dry.velocity_dependent() && p_.dry.stribeck->exponent < 1) {
        return "the Stribeck level has no finite slope at rest (its exponent is below one)";
    }
    return std::nullopt;
}

std::size_t ServoPlant::forcing_count() const {
    if (!curved_) return 0;
    return (has_dry_ && scaled_ ? 2 : 1) + own_states_ + own_guards_;
}

void ServoPlant::forcing(double t, std::span<const double> x, const State& s, std::span<double> w) const {
    const double v = velocity(x), factor = friction_factor(t, x);
    double sum = own_forces(t, x, s);
    double affine = p_.rolling.force(s.rolling, position(x), v) + viscous(s) * v;
    if (has_dry_ && s.dry != SlipState::stick) {
        const double towards = sign(s.dry);
        affine += towards * (p_.dry.coulomb + (towards > 0 ? p_.forward : p_.backward).level);
        if (p_.dry.velocity_dependent()) sum -= towards * factor * p_.dry.above_coulomb(towards * v);
    }
    w[0] = sum + (1 - factor) * affine;
    const std::size_t first = w.size() - own_states_ - own_guards_;
    if (first > 1) w[1] = factor - 1;
    if (own_states_ == 0) return;
    std::span<double> rates = w.subspan(first, own_states_), guards = w.subspan(first + own_states_);
    each_force([&](const PointForce& force, std::size_t state, std::size_t count, std::size_t) {
        const auto own = x.subspan(state, count);
        force.rates(t, position(x), v, own, rates.first(count));
        force.guards(v, own, guards.first(force.guard_count()));
        rates = rates.subspan(count);
        guards = guards.subspan(force.guard_count());
    });
}

EventEffect ServoPlant::on_crossing(GuardId guard, double t, std::span<double> x, State& s, EventLog& log) const {
    const auto report = [&](std::size_t element, SlipState now) {
        log.push_back({t, static_cast<int>(element) + 1, static_cast<int>(now)});
    };
    const auto set_dry = [&](SlipState now) {
        log.push_back({t, coulomb_subject, static_cast<int>(now)});
        s.dry = now;
    };
    if (guard >= first_own_guard()) {
        each_force([&](const PointForce& force, std::size_t state, std::size_t count, std::size_t first) {
            if (guard < first || guard >= first + force.guard_count()) return;
            force.on_crossing(guard - first, velocity(x), x.subspan(state, count));
        });
        return EventEffect::restart;
    }
    if (guard >= first_contact_guard()) {
        contact_crossing(guard == first_contact_guard(), s);
        return EventEffect::restart;
    }
    switch (guard) {
    case forward_limit: p_.rolling.slip(s.rolling, position(x), SlipState::slip_forward, report); break;
    case backward_limit: p_.rolling.slip(s.rolling, position(x), SlipState::slip_backward, report); break;
    case reversal: {
        // The velocity is zero but for rounding. Where that leaves it on this side it is made exactly zero, lest elements
        // that now stand on their limit slip again at once; beyond, as at the end of a fixed step, it is right as it is.
        const bool turned = sign(direction(s)) * velocity(x) <= 0;
        if (has_dry_) {
            const double towards = sign(s.dry);
            stop(x);
            // A force beyond the level in the direction of motion never let it stop: the velocity is zero, as it is
            // after a release, and is below zero by rounding.
            if (towards * holding_force(t, x, s) > release_level(towards, t, x)) break;
            set_dry(SlipState::stick);
        }
        p_.rolling.stick(s.rolling, position(x), report);
        if (!turned) stop(x);
        if (has_dry_) {
            // Where the force is beyond the static level, the axis goes straight over into slip the other way.
            const double holding = holding_force(t, x, s);
            if (std::abs(holding) > release_level(holding, t, x)) set_dry(slip_towards(holding));
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
    if (guard >= first_own_guard()) return "an element of a friction law";
    if (guard >= first_contact_guard()) return "the contact of the backlash";
    switch (guard) {
    case forward_limit: return fmt::format("friction element {}", s.rolling.next_forward + 1);
    case backward_limit: return fmt::format("friction element {}", s.rolling.next_backward + 1);
    case reversal: return "the reversal of the velocity";
    default: return "the Coulomb level";
    }
}

} // namespace tribode
