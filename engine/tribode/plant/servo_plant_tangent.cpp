#include "tribode/plant/servo_plant_tangent.hpp"
#include "tribode/base/constants.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

namespace {
constexpr double contact_margin = ServoPlant::contact_margin;
} // namespace

ServoPlantTangent::ServoPlantTangent(const ServoPlant& plant, const ServoPlantNumbers& derivatives)
    : plant_(plant),
      of_(derivatives),
      total_gain_(derivatives.plant.rigid_gain) {
    const auto& p = plant.p_;
    double modes_by = 0; // of the gains of all modes
    for (std::size_t j = 0; j < p.modes.size(); ++j) {
        const auto& [gain, freq_hz, zeta] = p.modes[j];
        const auto& by = of_.plant.modes[j];
        const double omega = two_pi * freq_hz, omega_by = two_pi * by.freq_hz;
        damping_of_.push_back(2 * (by.zeta * omega + zeta * omega_by));
        stiffness_of_.push_back(2 * omega * omega_by);
        total_gain_ += by.gain;
        modes_by += by.gain;
        moves_modes_ = moves_modes_ || by.gain != 0 || damping_of_.back() != 0 || stiffness_of_.back() != 0;
    }
    const auto& elements = p.rolling.elements();
    for (std::size_t i = 0; i < elements.size(); ++i) {
        const auto& by = of_.elements[i];
        moves_elements_ = moves_elements_ || by.stiffness != 0 || by.level != 0 || by.damping != 0;
        limits_.push_back((by.level - elements[i].limit() * by.stiffness) / elements[i].stiffness);
    }
    z_.assign(elements.size(), 0.0);
    corner_ = two_pi * of_.plant.current_loop_hz;
    if (!p.backlash) return;
    const Backlash &b = *p.backlash, &by = *of_.plant.backlash;
    const double part = b.load_fraction, rest = 1 - part;
    const double load = p.rigid_gain / part, motor = p.rigid_gain / rest;
    const double load_by = (of_.plant.rigid_gain - load * by.load_fraction) / part;
    const double motor_by = (of_.plant.rigid_gain + motor * by.load_fraction) / rest;
    total_gain_ = (b.load_side ? load_by : motor_by) + modes_by;
    other_gain_ = b.load_side ? motor_by : load_by;
    const double reduced = 1 / (load + motor), reduced_by = -reduced * reduced * (load_by + motor_by);
    const double omega = two_pi * b.contact_hz, omega_by = two_pi * by.contact_hz;
    contact_stiffness_ = reduced_by * omega * omega + 2 * reduced * omega * omega_by;
    contact_damping_ =
        2 * (by.contact_zeta * omega * reduced + b.contact_zeta * (omega_by * reduced + omega * reduced_by));
}

void ServoPlantTangent::start(double position, double velocity, const ServoPlant::State& s, std::span<double> dx) {
    std::fill(dx.begin(), dx.end(), 0.0);
    dx[0] = position;
    dx[1] = velocity;
    if (plant_.p_.rigid_gain == 0) std::copy_n(dx.begin(), 2, dx.begin() + 2);
    if (plant_.p_.backlash) std::copy_n(dx.begin(), 2, dx.begin() + static_cast<std::ptrdiff_t>(plant_.other_));
    refresh_sines(0, dx);
    reference_ = position;
    sum_up(s);
}

void ServoPlantTangent::refresh_sines(double t, std::span<double> dx) const {
    double* state = dx.data() + plant_.first_sine_;
    for (std::size_t i = 0; i < plant_.p_.sine_forces.size(); ++i) {
        const auto& [amplitude, freq_hz, phase] = plant_.p_.sine_forces[i];
        const auto& by = of_.plant.sine_forces[i];
        const double angle = two_pi * freq_hz * t + phase, angle_by = two_pi * by.freq_hz * t + by.phase;
        *state++ = by.amplitude * std::sin(angle) + amplitude * std::cos(angle) * angle_by;
        *state++ = by.amplitude * std::cos(angle) - amplitude * std::sin(angle) * angle_by;
    }
}

ServoPlantTangent::Here ServoPlantTangent::here(const ServoPlant& plant, std::span<const double> x,
                                                const ServoPlant::State& s, double one) {
    Here here{.stuck = plant.is_stuck(s)};
    here.input = one * s.input.coefficient[0];
    here.thrust = plant.corner_ > 0 ? x.back() : here.input;
    if (here.stuck) {
        here.effective = plant.restoring(x);
    } else {
        here.from_reference = x[0] - one * s.rolling.reference;
        here.effective = plant.pushing(here.thrust, x, s, one) + one * (s.disturbance - s.rolling.force) -
                         s.rolling.stiffness * here.from_reference - (s.rolling.damping + plant.viscous(s)) * x[1];
        if (plant.has_dry_) here.effective -= one * sign(s.dry) * plant.dry_level(x[1], s);
    }
    return here;
}

void ServoPlantTangent::rates(const Here& here, std::span<const double> x, const ServoPlant::State& s, double one,
                              std::span<double> dxdt) const {
    const auto& by = of_.plant;
    const bool lag = plant_.corner_ > 0;
    const double thrust_by = lag ? 0 : one * input;
    double restoring_by = 0; // sum r_j
    for (std::size_t j = 0; moves_modes_ && j < stiffness_of_.size(); ++j) {
        restoring_by += damping_of_[j] * x[2 * j + 3] + stiffness_of_[j] * x[2 * j + 2];
    }
    double effective_by; // u_e
    if (here.stuck) {
        effective_by = (restoring_by - here.effective * total_gain_) / plant_.total_gain_;
    } else {
        const double towards = sign(s.dry);
        const auto& direction = towards > 0 ? by.forward : by.backward;
        effective_by = thrust_by + one * (by.constant_force + disturbance - force_) - by.spring * x[0] -
                       stiffness_ * here.from_reference + one * s.rolling.stiffness * reference_ -
                       (damping_ + by.viscous + (towards == 0 ? 0 : direction.viscous)) * x[1];
        if (plant_.has_dry_) effective_by -= one * towards * (by.dry.coulomb + direction.level);
    }
    std::fill(dxdt.begin(), dxdt.end(), 0.0);
    if (plant_.p_.backlash) {
        const double contact_by = contact_force(x, s, one), contact = plant_.contact_force(x, s, one);
        const bool load_side = plant_.p_.backlash->load_side;
        // The thrust acts on the motor's body. While the driven point sticks, neither moves it or its modes.
        if (!here.stuck) effective_by += load_side ? contact_by - thrust_by : -contact_by;
        dxdt[plant_.other_ + 1] =
            load_side ? other_gain_ * (here.thrust - contact) + plant_.other_gain_ * (thrust_by - contact_by)
                      : other_gain_ * contact + plant_.other_gain_ * contact_by;
    }
    dxdt[1] = here.stuck ? 0 : plant_.total_gain_ * effective_by + total_gain_ * here.effective - restoring_by;
    for (std::size_t j = 0; j < stiffness_of_.size(); ++j) {
        dxdt[2 * j + 3] = plant_.gain_[j] * effective_by;
        if (!moves_modes_) continue;
        dxdt[2 * j + 3] +=
            by.modes[j].gain * here.effective - (damping_of_[j] * x[2 * j + 3] + stiffness_of_[j] * x[2 * j + 2]);
    }
    for (std::size_t i = 0; i < by.sine_forces.size(); ++i) {
        const std::size_t state = plant_.first_sine_ + 2 * i;
        const double omega_by = two_pi * by.sine_forces[i].freq_hz;
        dxdt[state] = omega_by * x[state + 1];
        dxdt[state + 1] = -omega_by * x[state];
    }
    if (lag) dxdt.back() = corner_ * (here.input - x.back()) + plant_.corner_ * one * input;
}

// Of the contact, on the load.
double ServoPlantTangent::contact_force(std::span<const double> x, const ServoPlant::State& s, double one) const {
    if (std::abs(static_cast<int>(s.contact)) != 1) return 0;
    const double side = one * static_cast<double>(s.contact);
    return contact_stiffness_ * (plant_.separation(x, 0) - side * plant_.p_.backlash->gap / 2) -
           plant_.contact_stiffness_ * side * of_.plant.backlash->gap / 2 + contact_damping_ * plant_.separation(x, 1);
}

// Of the friction at the reference, from the elements.
void ServoPlantTangent::sum_up(const ServoPlant::State& s) {
    const auto& elements = plant_.p_.rolling.elements();
    force_ = stiffness_ = damping_ = 0;
    for (std::size_t i = 0; i < elements.size(); ++i) {
        if (s.rolling.slip[i] != SlipState::stick) {
            force_ += sign(s.rolling.slip[i]) * of_.elements[i].level;
            continue;
        }
        force_ += elements[i].stiffness * z_[i];
        if (!moves_elements_) continue;
        force_ += of_.elements[i].stiffness * s.rolling.z[i];
        stiffness_ += of_.elements[i].stiffness;
        damping_ += of_.elements[i].damping;
    }
}

void ServoPlantTangent::after_slips(std::span<const Event> log, const ServoPlant::State& s, std::span<double> dx) {
    const auto& elements = plant_.p_.rolling.elements();
    double jump = 0; // of the effective thrust, times dt*
    for (const auto& event : log) {
        const auto i = static_cast<std::size_t>(event.subject) - 1;
        force_ -= elements[i].stiffness * z_[i]; // for those that nothing moves; the others are summed up
        const double towards = sign(s.rolling.slip[i]);
        // The position at which it slips is reference + towards (X_i - towards z_i).
        const double limit = reference_ + towards * limits_[i] - z_[i];
        jump -= elements[i].damping * (limit - dx[0]);
        z_[i] = towards * limits_[i];
    }
    if (jump != 0) plant_.push(jump, dx);
    if (moves_elements_) sum_up(s);
}

void ServoPlantTangent::after_reversal(std::span<const Event> log, const ServoPlant::State& s,
                                       std::span<const double> dx) {
    // The velocity is zero there: the position does not depend on when it is.
    const double travel = dx[0] - reference_;
    for (double& z : z_) z += travel;
    for (const auto& event : log) { // those in slip stay at their limit
        if (event.subject == ServoPlant::coulomb_subject) continue;
        z_[static_cast<std::size_t>(event.subject) - 1] -= travel;
    }
    reference_ = dx[0];
    sum_up(s);
}

void ServoPlantTangent::after_contact(ContactState before, std::span<const double> x, std::span<const double> f,
                                      const ServoPlant::State& s, std::span<double> dx) const {
    // The force is continuous but where a contact closes.
    if (std::abs(static_cast<int>(s.contact)) != 1) return;
    const auto& b = *plant_.p_.backlash;
    const double side = static_cast<double>(s.contact);
    const double half_by = of_.plant.backlash->gap / 2;
    const double stiffness = plant_.contact_stiffness_, damping = plant_.contact_damping_;
    double jump; // (force before - force after) dt*, on the load
    if (before == ContactState::open) {
        // The damper has its force at once; dt* = (side gap/2 - separation) / its rate
        jump = -damping * (side * half_by - plant_.separation(dx, 0));
    } else {
        // Pressed again while parting: a little force is there, as this guard stands a little outside the other.
        const double outside = b.gap / 2 * (1 + contact_margin);
        const double inside = outside - side * plant_.separation(x, 0), rate = side * plant_.separation(x, 1);
        const double by = contact_stiffness_ * inside +
                          stiffness * (half_by * (1 + contact_margin) - side * plant_.separation(dx, 0)) -
                          contact_damping_ * rate - damping * side * plant_.separation(dx, 1);
        const double falls = stiffness * rate + damping * side * plant_.separation(f, 1);
        jump = -plant_.contact_force(x, s, 1) * by / falls;
    }
    if (!plant_.is_stuck(s)) plant_.push(b.load_side ? jump : -jump, dx);
    dx[plant_.other_ + 1] += plant_.other_gain_ * (b.load_side ? -jump : jump);
}

} // namespace tribode
