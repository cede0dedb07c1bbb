#include "tribode/plant/servo_plant_tangent.hpp"
#include "tribode/base/constants.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

namespace {
constexpr double contact_margin = ServoPlant::contact_margin;
} // namespace

ServoPlantNumbers ServoPlantNumbers::of(ServoPlant::Parameters plant) {
    ServoPlantNumbers n{{}, plant.rolling.elements()};
    const auto collect = [](const auto& all, std::vector<std::vector<double>>& numbers) {
        for (const auto& one : all) numbers.push_back(one->numbers().value_or(std::vector<double>{}));
    };
    collect(plant.forces, n.forces);
    collect(plant.friction_scales, n.scales);
    n.plant = std::move(plant);
    return n;
}

ServoPlantTangent::ServoPlantTangent(const ServoPlant& plant, std::span<const ServoPlantNumbers* const> derivatives)
    : plant_(plant),
      modes_(plant.p_.modes.size()),
      elements_(plant.p_.rolling.elements().size()),
      sines_(plant.p_.sine_forces.size()) {
    for (std::size_t lane = 0; lane < derivatives.size(); ++lane) set(lane, *derivatives[lane]);
}

void ServoPlantTangent::set(std::size_t lane, const ServoPlantNumbers& by) {
    const auto &p = plant_.p_, &p_by = by.plant;
    double modes_by = 0; // of the gains of all modes
    for (std::size_t j = 0; j < modes_.size(); ++j) {
        const auto& [gain, freq_hz, zeta] = p.modes[j];
        const auto& own = p_by.modes[j];
        const double omega = two_pi * freq_hz, omega_by = two_pi * own.freq_hz;
        const double damping = 2 * (own.zeta * omega + zeta * omega_by), stiffness = 2 * omega * omega_by;
        modes_[j].gain[lane] = own.gain;
        modes_[j].damping[lane] = damping;
        modes_[j].stiffness[lane] = stiffness;
        modes_by += own.gain;
        moves_modes_ = moves_modes_ || own.gain != 0 || damping != 0 || stiffness != 0;
    }
    const auto& elements = p.rolling.elements();
    for (std::size_t i = 0; i < elements.size(); ++i) {
        const auto& own = by.elements[i];
        elements_[i].stiffness[lane] = own.stiffness;
        elements_[i].level[lane] = own.level;
        elements_[i].damping[lane] = own.damping;
        elements_[i].limit[lane] = (own.level - elements[i].limit() * own.stiffness) / elements[i].stiffness;
        moves_elements_ = moves_elements_ || own.stiffness != 0 || own.level != 0 || own.damping != 0;
    }
    for (std::size_t i = 0; i < sines_.size(); ++i) {
        sines_[i].amplitude[lane] = p_by.sine_forces[i].amplitude;
        sines_[i].freq_hz[lane] = p_by.sine_forces[i].freq_hz;
        sines_[i].phase[lane] = p_by.sine_forces[i].phase;
    }
    coulomb_[lane] = p_by.dry.coulomb;
    viscous_[lane] = p_by.viscous;
    constant_force_[lane] = p_by.constant_force;
    spring_[lane] = p_by.spring;
    forward_.level[lane] = p_by.forward.level;
    forward_.viscous[lane] = p_by.forward.viscous;
    backward_.level[lane] = p_by.backward.level;
    backward_.viscous[lane] = p_by.backward.viscous;
    corner_[lane] = two_pi * p_by.current_loop_hz;
    total_gain_[lane] = p_by.rigid_gain + modes_by;
    set_curves(lane, by);
    if (!p.backlash) return;
    const Backlash &b = *p.backlash, &b_by = *p_by.backlash;
    const double part = b.load_fraction, rest = 1 - part;
    const double load = p.rigid_gain / part, motor = p.rigid_gain / rest;
    const double load_by = (p_by.rigid_gain - load * b_by.load_fraction) / part;
    const double motor_by = (p_by.rigid_gain + motor * b_by.load_fraction) / rest;
    total_gain_[lane] = (b.load_side ? load_by : motor_by) + modes_by;
    other_gain_[lane] = b.load_side ? motor_by : load_by;
    const double reduced = 1 / (load + motor), reduced_by = -reduced * reduced * (load_by + motor_by);
    const double omega = two_pi * b.contact_hz, omega_by = two_pi * b_by.contact_hz;
    contact_stiffness_[lane] = reduced_by * omega * omega + 2 * reduced * omega * omega_by;
    contact_damping_[lane] =
        2 * (b_by.contact_zeta * omega * reduced + b.contact_zeta * (omega_by * reduced + omega * reduced_by));
    gap_[lane] = b_by.gap;
}

void ServoPlantTangent::set_curves(std::size_t lane, const ServoPlantNumbers& by) {
    if (const auto& stribeck = by.plant.dry.stribeck) {
        stribeck_.static_level[lane] = stribeck->static_level;
        stribeck_.velocity[lane] = stribeck->velocity;
        stribeck_.exponent[lane] = stribeck->exponent;
    }
    const auto take = [&](const std::vector<std::vector<double>>& numbers, std::vector<std::vector<Lanes>>& own) {
        own.resize(numbers.size());
        for (std::size_t i = 0; i < own.size(); ++i) {
            own[i].resize(numbers[i].size());
            work_.resize(std::max(work_.size(), own[i].size()));
            for (std::size_t j = 0; j < own[i].size(); ++j) own[i][j][lane] = numbers[i][j];
        }
    };
    take(by.forces, forces_);
    take(by.scales, scales_);
    for (std::size_t i = 0; i < forces_.size(); ++i) { // of friction laws
        const std::size_t rows = 1 + plant_.own_count_[i];
        work_.resize(std::max(work_.size(), rows * (rows + forces_[i].size())));
    }
}

void ServoPlantTangent::start(const Lanes& position, const Lanes& velocity, const ServoPlant::State& s,
                              std::span<Lanes> dx) {
    std::fill(dx.begin(), dx.end(), Lanes{});
    dx[0] = position;
    dx[1] = velocity;
    if (plant_.p_.rigid_gain == 0) std::copy_n(dx.begin(), 2, dx.begin() + 2);
    if (plant_.p_.backlash) std::copy_n(dx.begin(), 2, dx.begin() + static_cast<std::ptrdiff_t>(plant_.other_));
    refresh_sines(0, dx);
    reference_ = position;
    sum_up(s);
}

void ServoPlantTangent::refresh_sines(double t, std::span<Lanes> dx) const {
    Lanes* state = dx.data() + plant_.first_sine_;
    for (std::size_t i = 0; i < sines_.size(); ++i) {
        const auto& [amplitude, freq_hz, phase] = plant_.p_.sine_forces[i];
        const Sine& by = sines_[i];
        const double angle = two_pi * freq_hz * t + phase, sine = std::sin(angle), cosine = std::cos(angle);
        const Lanes angle_by = two_pi * by.freq_hz * t + by.phase;
        *state++ = by.amplitude * sine + amplitude * cosine * angle_by;
        *state++ = by.amplitude * cosine - amplitude * sine * angle_by;
    }
}

[[gnu::always_inline]] inline Lanes ServoPlantTangent::restoring(std::span<const double> x) const {
    Lanes sum;
    for (std::size_t j = 0; moves_modes_ && j < modes_.size(); ++j) {
        sum += modes_[j].damping * x[2 * j + 3] + modes_[j].stiffness * x[2 * j + 2];
    }
    return sum;
}

[[gnu::always_inline]] inline void ServoPlantTangent::spread(double effective, const Lanes& without_contact,
                                                             const Lanes& restoring_by, std::span<const double> x,
                                                             const ServoPlant::State& s, double one,
                                                             std::span<Lanes> dxdt) const {
    const bool lag = plant_.corner_ > 0, stuck = plant_.is_stuck(s);
    const double input_force = one * s.input.coefficient[0], thrust = lag ? x.back() : input_force;
    const Lanes thrust_by = lag ? Lanes{} : one * input;
    Lanes effective_by = without_contact;
    std::fill(dxdt.begin(), dxdt.end(), Lanes{});
    if (plant_.p_.backlash) {
        const double contact = plant_.contact_force(x, s, one);
        const bool load_side = plant_.p_.backlash->load_side;
        const Lanes contact_by = contact_force(x, s, one);
        // The thrust acts on the motor's body. While the driven point sticks, neither moves it or its modes.
        if (!stuck) effective_by += load_side ? contact_by - thrust_by : -contact_by;
        dxdt[plant_.other_ + 1] = load_side
                                      ? other_gain_ * (thrust - contact) + plant_.other_gain_ * (thrust_by - contact_by)
                                      : other_gain_ * contact + plant_.other_gain_ * contact_by;
    }
    if (!stuck) dxdt[1] = plant_.total_gain_ * effective_by + total_gain_ * effective - restoring_by;
    for (std::size_t j = 0; j < modes_.size(); ++j) {
        const Mode& by = modes_[j];
        dxdt[2 * j + 3] = plant_.gain_[j] * effective_by;
        if (!moves_modes_) continue;
        dxdt[2 * j + 3] += by.gain * effective - (by.damping * x[2 * j + 3] + by.stiffness * x[2 * j + 2]);
    }
    for (std::size_t i = 0; i < sines_.size(); ++i) {
        const std::size_t state = plant_.first_sine_ + 2 * i;
        const Lanes omega_by = two_pi * sines_[i].freq_hz;
        dxdt[state] = omega_by * x[state + 1];
        dxdt[state + 1] = -omega_by * x[state];
    }
    if (lag) dxdt.back() = corner_ * (input_force - x.back()) + plant_.corner_ * one * input;
}

TRIBODE_CLONES void ServoPlantTangent::rates(std::span<const double> x, const ServoPlant::State& s, double one,
                                             std::span<Lanes> dxdt) const {
    const bool lag = plant_.corner_ > 0, stuck = plant_.is_stuck(s);
    const double input_force = one * s.input.coefficient[0], thrust = lag ? x.back() : input_force;
    const Lanes thrust_by = lag ? Lanes{} : one * input;
    const Lanes restoring_by = restoring(x);
    double effective; // u_e
    Lanes effective_by;
    if (stuck) {
        effective = plant_.restoring(x);
        effective_by = (restoring_by - effective * total_gain_) / plant_.total_gain_;
    } else {
        const double towards = sign(s.dry), from_reference = x[0] - one * s.rolling.reference;
        effective = plant_.pushing(thrust, x, s, one) + one * (s.disturbance - s.rolling.force) -
                    s.rolling.stiffness * from_reference - (s.rolling.damping + plant_.viscous(s)) * x[1];
        effective_by = thrust_by + one * (constant_force_ + disturbance - force_) - spring_ * x[0] -
                       stiffness_ * from_reference + one * s.rolling.stiffness * reference_ -
                       (damping_ + viscous_) * x[1];
        if (towards != 0) effective_by -= (towards > 0 ? forward_ : backward_).viscous * x[1];
        if (plant_.has_dry_) {
            effective -= one * towards * plant_.dry_level(x[1], s);
            effective_by -= one * towards * (coulomb_ + (towards > 0 ? forward_ : backward_).level);
        }
    }
    spread(effective, effective_by, restoring_by, x, s, one, dxdt);
}

TRIBODE_CLONES void ServoPlantTangent::curved_rates(double t, std::span<const double> x, const ServoPlant::State& s,
                                                    std::span<const Lanes> dx, std::span<double> dxdt,
                                                    std::span<Lanes> by_p) const {
    const ServoPlant::Parameters& p = plant_.p_;
    const double y = x[0], v = x[1], towards = sign(s.dry), from_reference = y - s.rolling.reference;
    // All friction, before it is scaled.
    double friction = p.rolling.force(s.rolling, y, v) + plant_.viscous(s) * v, level = 0, slope = 0;
    Lanes friction_by =
        force_ + stiffness_ * from_reference - s.rolling.stiffness * reference_ + (damping_ + viscous_) * v;
    const bool forward = towards > 0;
    const Direction& direction = forward ? forward_ : backward_;
    if (towards != 0) friction_by += direction.viscous * v;
    if (plant_.has_dry_) {
        Lanes level_by = coulomb_ + direction.level;
        level = p.dry.coulomb + (forward ? p.forward : p.backward).level;
        if (p.dry.velocity_dependent()) {
            const auto by = p.dry.above_coulomb_by(towards * v);
            level += p.dry.above_coulomb(towards * v);
            slope = by.speed;
            level_by += by.static_level * (stribeck_.static_level - coulomb_) + by.velocity * stribeck_.velocity +
                        by.exponent * stribeck_.exponent;
        }
        friction += towards * level;
        friction_by += towards * level_by;
    }
    double factor = 1;
    Lanes factor_by;
    for (std::size_t i = 0; i < p.friction_scales.size(); ++i) {
        const double own = p.friction_scales[i]->factor(t, y);
        Lanes own_by;
        if (own > 0) { // else it stays zero
            p.friction_scales[i]->by_numbers(t, y, work_);
            for (std::size_t j = 0; j < scales_[i].size(); ++j) own_by += work_[j] * scales_[i][j];
        }
        factor_by = own * factor_by + factor * own_by;
        factor *= own;
    }
    auto slopes = plant_.friction_slopes(t, x, s, level, slope);
    Lanes forces_by;
    for (std::size_t i = 0; i < p.forces.size(); ++i) {
        if (plant_.laws_[i]) continue;
        const auto own = p.forces[i]->slopes(t, y, v).value_or(PointForce::Slopes{});
        slopes.position += own.position;
        slopes.velocity += own.velocity;
        p.forces[i]->by_numbers(t, y, v, work_);
        for (std::size_t j = 0; j < forces_[i].size(); ++j) forces_by += work_[j] * forces_[i][j];
    }
    const Lanes effective_by = (plant_.corner_ > 0 ? Lanes{} : input) + constant_force_ + disturbance - spring_ * y +
                               forces_by - factor * friction_by - factor_by * friction;
    plant_.derivative(t, x, s, dxdt);
    if (plant_.has_dry_ && towards * v < 0) plant_.push(factor * towards * (plant_.dry_level(v, s) - level), dxdt);
    spread(plant_.driving(t, x, s) - factor * friction, effective_by, restoring(x), x, s, 1, by_p);
    push(slopes.position * dx[0] + slopes.velocity * dx[1], by_p);
    if (plant_.own_states_ == 0) return;
    const bool lag = plant_.corner_ > 0;
    differentiate_laws(lag ? x.back() : s.input.coefficient[0], lag ? dx.back() : input, x, dx, by_p);
}

// Adds what changes with friction laws and their states. thrust_by: dFm/dp.
void ServoPlantTangent::differentiate_laws(double thrust, const Lanes& thrust_by, std::span<const double> x,
                                           std::span<const Lanes> dx, std::span<Lanes> by_p) const {
    std::size_t own = plant_.first_own_;
    for (std::size_t i = 0; i < plant_.laws_.size(); ++i) {
        const std::size_t states = plant_.own_count_[i], width = 1 + states + forces_[i].size();
        if (const FrictionLaw* law = plant_.laws_[i]) {
            law->differentiate(x[1], x.subspan(own, states), std::span(work_).first((1 + states) * width));
            const auto row = [&](std::size_t k) {
                const double* by = work_.data() + k * width;
                Lanes sum = *by++ * dx[1];
                for (std::size_t j = 0; j < states; ++j) sum += *by++ * dx[own + j];
                for (const Lanes& number : forces_[i]) sum += *by++ * number;
                return sum;
            };
            Lanes friction = row(0);
            if (law->per_load()) {
                friction = std::abs(thrust) * friction +
                           std::copysign(1.0, thrust) * law->friction(x[1], x.subspan(own, states)) * thrust_by;
            }
            push(-friction, by_p);
            for (std::size_t k = 0; k < states; ++k) by_p[own + k] += row(1 + k);
        }
        own += states;
    }
}

void ServoPlantTangent::push(const Lanes& force, std::span<Lanes> dxdt) const {
    dxdt[1] += plant_.total_gain_ * force;
    for (std::size_t j = 0; j < modes_.size(); ++j) dxdt[2 * j + 3] += plant_.gain_[j] * force;
}

Lanes ServoPlantTangent::separation(std::span<const Lanes> dx, std::size_t of) const {
    const Lanes ahead = dx[of] - dx[plant_.other_ + of];
    return plant_.p_.backlash->load_side ? -ahead : ahead;
}

// Of the contact, on the load.
Lanes ServoPlantTangent::contact_force(std::span<const double> x, const ServoPlant::State& s, double one) const {
    if (std::abs(static_cast<int>(s.contact)) != 1) return {};
    const double side = one * static_cast<double>(s.contact);
    return contact_stiffness_ * (plant_.separation(x, 0) - side * plant_.p_.backlash->gap / 2) -
           plant_.contact_stiffness_ * side * gap_ / 2 + contact_damping_ * plant_.separation(x, 1);
}

// Of the friction at the reference, from the elements.
TRIBODE_CLONES void ServoPlantTangent::sum_up(const ServoPlant::State& s) {
    const auto& elements = plant_.p_.rolling.elements();
    Lanes force, stiffness, damping;
    for (std::size_t i = 0; i < elements.size(); ++i) {
        const Element& by = elements_[i];
        if (s.rolling.slip[i] != SlipState::stick) {
            force += sign(s.rolling.slip[i]) * by.level;
            continue;
        }
        force += elements[i].stiffness * by.z;
        if (!moves_elements_) continue;
        force += by.stiffness * s.rolling.z[i];
        stiffness += by.stiffness;
        damping += by.damping;
    }
    force_ = force;
    stiffness_ = stiffness;
    damping_ = damping;
}

void ServoPlantTangent::after_slips(std::span<const Event> log, double t, std::span<const double> x,
                                    const ServoPlant::State& s, std::span<Lanes> dx) {
    const auto& elements = plant_.p_.rolling.elements();
    Lanes jump; // of the effective thrust, times dt*
    for (const auto& event : log) {
        const auto i = static_cast<std::size_t>(event.subject) - 1;
        Element& by = elements_[i];
        force_ -= elements[i].stiffness * by.z; // for those that nothing moves; the others are summed up
        const double towards = sign(s.rolling.slip[i]);
        // The position at which it slips is reference + towards (X_i - towards z_i).
        jump -= elements[i].damping * (reference_ + towards * by.limit - by.z - dx[0]);
        by.z = towards * by.limit;
    }
    push(plant_.friction_factor(t, x) * jump, dx);
    if (moves_elements_) sum_up(s);
}

void ServoPlantTangent::after_reversal(std::span<const Event> log, const ServoPlant::State& s,
                                       std::span<const Lanes> dx) {
    // The velocity is zero there: the position does not depend on when it is.
    const Lanes travel = dx[0] - reference_;
    for (auto& element : elements_) element.z += travel;
    for (const auto& event : log) { // those in slip stay at their limit
        if (event.subject == ServoPlant::coulomb_subject) continue;
        elements_[static_cast<std::size_t>(event.subject) - 1].z -= travel;
    }
    reference_ = dx[0];
    sum_up(s);
}

bool ServoPlantTangent::has_closed(std::span<const double> x, const ServoPlant::State& s) const {
    if (!plant_.p_.backlash || std::abs(static_cast<int>(s.contact)) != 1) return false;
    const double half = plant_.p_.backlash->gap / 2, side = static_cast<double>(s.contact);
    return !(std::abs(side * plant_.separation(x, 0) - half) > contact_margin * half);
}

Lanes ServoPlantTangent::closing_shift(std::span<const double> x, const ServoPlant::State& s,
                                       std::span<const Lanes> dx) const {
    return (static_cast<double>(s.contact) * gap_ / 2 - separation(dx, 0)) / plant_.separation(x, 1);
}

void ServoPlantTangent::after_contact(ContactState before, std::span<const double> x, std::span<const double> f,
                                      const ServoPlant::State& s, std::span<Lanes> dx) const {
    // The force is continuous but where a contact closes.
    if (std::abs(static_cast<int>(s.contact)) != 1) return;
    const auto& b = *plant_.p_.backlash;
    const double side = static_cast<double>(s.contact);
    const Lanes half_by = gap_ / 2;
    const double stiffness = plant_.contact_stiffness_, damping = plant_.contact_damping_;
    const Lanes moved = separation(dx, 0);
    Lanes jump; // (force before - force after) dt*, on the load
    if (before == ContactState::open) {
        // The damper has its force at once; dt* = (side gap/2 - separation) / its rate
        jump = -damping * (side * half_by - moved);
    } else {
        // Pressed again while parting: a little force is there, as this guard stands a little outside the other.
        const double outside = b.gap / 2 * (1 + contact_margin);
        const double inside = outside - side * plant_.separation(x, 0), rate = side * plant_.separation(x, 1);
        const Lanes by = contact_stiffness_ * inside + stiffness * (half_by * (1 + contact_margin) - side * moved) -
                         contact_damping_ * rate - damping * side * separation(dx, 1);
        const double falls = stiffness * rate + damping * side * plant_.separation(f, 1);
        jump = -plant_.contact_force(x, s, 1) * by / falls;
    }
    if (!plant_.is_stuck(s)) push(b.load_side ? jump : -jump, dx);
    dx[plant_.other_ + 1] += plant_.other_gain_ * (b.load_side ? -jump : jump);
}

} // namespace tribode
