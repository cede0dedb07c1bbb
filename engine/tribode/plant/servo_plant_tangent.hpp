#pragma once
#include "tribode/plant/servo_plant.hpp"

#include <span>
#include <vector>

namespace tribode {

// The numbers of a plant that is piecewise affine; or their derivatives by one parameter.
struct ServoPlantNumbers {
    ServoPlant::Parameters plant; // but for the elements
    std::vector<MaxwellSlipElement> elements;

    static void each(auto& numbers, const auto& act) {
        auto& p = numbers.plant;
        act(p.rigid_gain);
        for (auto& mode : p.modes) {
            act(mode.gain);
            act(mode.freq_hz);
            act(mode.zeta);
        }
        for (auto& element : numbers.elements) {
            act(element.stiffness);
            act(element.level);
            act(element.damping);
        }
        act(p.dry.coulomb);
        act(p.viscous);
        act(p.current_loop_hz);
        for (auto* direction : {&p.forward, &p.backward}) {
            act(direction->level);
            act(direction->viscous);
        }
        act(p.constant_force);
        act(p.spring);
        for (auto& sine : p.sine_forces) {
            act(sine.amplitude);
            act(sine.freq_hz);
            act(sine.phase);
        }
        if (!p.backlash) return;
        act(p.backlash->gap);
        act(p.backlash->load_fraction);
        act(p.backlash->contact_hz);
        act(p.backlash->contact_zeta);
    }
};

// What changes in a plant's run with one parameter p: the derivatives by p of its rates at fixed states, and of the discrete
// values that come from the states. s are the sensitivities dx/dp. At an event at time t*, which moves with p,
//
//     s+ = s- + (f- - f+) dt*/dp
//
// where x does not jump. Where the force is continuous an event leaves s as it is. The damping of elements and of a contact
// jumps in proportion to the velocity, of which dt*/dp is a fraction: there the product is finite however slow the motion is.
class ServoPlantTangent {
  public:
    // derivatives: of the plant's numbers by p. The plant must be affine and outlive it.
    ServoPlantTangent(const ServoPlant& plant, const ServoPlantNumbers& derivatives);

    // As ServoPlant::start, whose state s is.
    void start(double position, double velocity, const ServoPlant::State& s, std::span<double> dx);

    // What rates() of all parameters have in common.
    struct Here {
        bool stuck;
        double input = 0, thrust = 0; // u, Fm [N]
        double effective = 0;         // u_e [N]
        double from_reference = 0;    // of the elements [m]
    };
    static Here here(const ServoPlant& plant, std::span<const double> x, const ServoPlant::State& s, double one);
    // df/dp at fixed x; `one` = 0: the part linear in x. dxdt has an entry for each state.
    void rates(const Here& here, std::span<const double> x, const ServoPlant::State& s, double one,
               std::span<double> dxdt) const;

    // The derivatives of the elements' stiffness and damping in stick, on which rates() with `one` = 0 depends besides the
    // plant's key.
    double stiffness() const { return stiffness_; }
    double damping() const { return damping_; }

    // What on_crossing of the plant did, s being the state after it and log its entries. Slips of elements and contacts that
    // close change dx; at a reversal dx is that after it.
    void after_slips(std::span<const Event> log, const ServoPlant::State& s, std::span<double> dx);
    void after_reversal(std::span<const Event> log, const ServoPlant::State& s, std::span<const double> dx);
    // f: the rates before it.
    void after_contact(ContactState before, std::span<const double> x, std::span<const double> f,
                       const ServoPlant::State& s, std::span<double> dx) const;

    void refresh_sines(double t, std::span<double> dx) const;

    double input = 0, disturbance = 0; // du/dp after the delay, and of the disturbance [N by the unit of p]

  private:
    void sum_up(const ServoPlant::State& s);
    double contact_force(std::span<const double> x, const ServoPlant::State& s, double one) const;

    const ServoPlant& plant_;
    const ServoPlantNumbers of_;
    std::vector<double> damping_of_, stiffness_of_, limits_; // per mode, as in the plant; X_i
    double total_gain_, corner_ = 0, other_gain_ = 0, contact_stiffness_ = 0, contact_damping_ = 0;
    bool moves_modes_ = false, moves_elements_ = false;              // whether the numbers of any depend on p
    std::vector<double> z_;                                          // of each element
    double reference_ = 0, force_ = 0, stiffness_ = 0, damping_ = 0; // of RollingFriction::State
};

} // namespace tribode
