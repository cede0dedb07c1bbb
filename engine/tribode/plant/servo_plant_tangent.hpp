#pragma once
#include "tribode/base/lanes.hpp"
#include "tribode/plant/servo_plant.hpp"

#include <span>
#include <vector>

namespace tribode {

// The numbers of a plant; or their derivatives by one parameter.
struct ServoPlantNumbers {
    ServoPlant::Parameters plant; // but for the elements, and the numbers of forces and scales
    std::vector<MaxwellSlipElement> elements;
    std::vector<std::vector<double>> forces = {}, scales = {}; // none of those that runs cannot be differentiated with

    static ServoPlantNumbers of(ServoPlant::Parameters plant);

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
        if (p.dry.stribeck) {
            act(p.dry.stribeck->static_level);
            act(p.dry.stribeck->velocity);
            act(p.dry.stribeck->exponent);
        }
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
        for (auto* own : {&numbers.forces, &numbers.scales}) {
            for (auto& all : *own) {
                for (auto& number : all) act(number);
            }
        }
        if (!p.backlash) return;
        act(p.backlash->gap);
        act(p.backlash->load_fraction);
        act(p.backlash->contact_hz);
        act(p.backlash->contact_zeta);
    }
};

// What changes in a plant's run with each of up to lane_count parameters p, side by side: the derivatives by p of its rates at
// fixed states, and of the discrete values that come from the states. dx are the sensitivities dx/dp. At an event at time t*,
// which moves with p,
//
//     dx+ = dx- + (f- - f+) dt*/dp
//
// where x does not jump. Where the force is continuous an event leaves dx as it is. The damping of elements and of a contact
// jumps in proportion to the velocity, of which dt*/dp is a fraction: there the product is finite however slow the motion is.
class ServoPlantTangent {
  public:
    // derivatives: of the plant's numbers by each p. The plant must be differentiable and outlive it.
    ServoPlantTangent(const ServoPlant& plant, std::span<const ServoPlantNumbers* const> derivatives);

    // As ServoPlant::start, whose state s is.
    void start(const Lanes& position, const Lanes& velocity, const ServoPlant::State& s, std::span<Lanes> dx);

    // df/dp at fixed x; `one` = 0: the part linear in x. dxdt has an entry for each state. Where the plant is affine.
    void rates(std::span<const double> x, const ServoPlant::State& s, double one, std::span<Lanes> dxdt) const;
    // In a state in which it is not: f in dxdt, in by_p df/dp along dx but for A dx, A being the matrix of the plant's affine form.
    // The dry level goes on smoothly beyond v = 0.
    void curved_rates(double t, std::span<const double> x, const ServoPlant::State& s, std::span<const Lanes> dx,
                      std::span<double> dxdt, std::span<Lanes> by_p) const;

    // The derivatives of the elements' stiffness and damping in stick, on which rates() with `one` = 0 depends besides the
    // plant's key.
    const Lanes& stiffness() const { return stiffness_; }
    const Lanes& damping() const { return damping_; }

    // What on_crossing of the plant did, s being the state after it and log its entries. Slips of elements and contacts that
    // close change dx; at a reversal dx is that after it.
    void after_slips(std::span<const Event> log, double t, std::span<const double> x, const ServoPlant::State& s,
                     std::span<Lanes> dx);
    void after_reversal(std::span<const Event> log, const ServoPlant::State& s, std::span<const Lanes> dx);
    // f: the rates before it.
    void after_contact(ContactState before, std::span<const double> x, std::span<const double> f,
                       const ServoPlant::State& s, std::span<Lanes> dx) const;
    // Whether the contact of a backlash has closed at this instant, and then dt*/dp.
    bool has_closed(std::span<const double> x, const ServoPlant::State& s) const;
    Lanes closing_shift(std::span<const double> x, const ServoPlant::State& s, std::span<const Lanes> dx) const;

    void refresh_sines(double t, std::span<Lanes> dx) const;

    Lanes input, disturbance; // du/dp after the delay, and of the disturbance [N by the unit of p]

  private:
    // The numbers' derivatives, and those of what the plant computes of them.
    struct Mode {
        Lanes gain, damping, stiffness; // as in the plant
    };
    struct Element {
        Lanes stiffness, level, damping, limit; // K, F, B, X = F/K
        Lanes z;                                // of its deflection
    };
    struct Sine {
        Lanes amplitude, freq_hz, phase;
    };
    struct Direction {
        Lanes level, viscous;
    };

    void set(std::size_t lane, const ServoPlantNumbers& by);
    void set_curves(std::size_t lane, const ServoPlantNumbers& by);
    void differentiate_laws(double thrust, const Lanes& thrust_by, std::span<const double> x, std::span<const Lanes> dx,
                            std::span<Lanes> by_p) const;
    Lanes restoring(std::span<const double> x) const; // of sum r_j
    // The rates by p from u_e, the effective thrust, and its derivative by p but for that of a contact.
    void spread(double effective, const Lanes& without_contact, const Lanes& restoring_by, std::span<const double> x,
                const ServoPlant::State& s, double one, std::span<Lanes> dxdt) const;
    void sum_up(const ServoPlant::State& s);
    void push(const Lanes& force, std::span<Lanes> dxdt) const;
    Lanes separation(std::span<const Lanes> dx, std::size_t of) const;
    Lanes contact_force(std::span<const double> x, const ServoPlant::State& s, double one) const;

    const ServoPlant& plant_;
    std::vector<Mode> modes_;
    std::vector<Element> elements_;
    std::vector<Sine> sines_;
    struct Stribeck {
        Lanes static_level, velocity, exponent;
    };
    Stribeck stribeck_;
    std::vector<std::vector<Lanes>> forces_, scales_; // of their numbers
    Lanes coulomb_, viscous_, constant_force_, spring_, gap_;
    Direction forward_, backward_;
    Lanes total_gain_, corner_, other_gain_, contact_stiffness_, contact_damping_;
    bool moves_modes_ = false, moves_elements_ = false; // whether the numbers of any depend on a parameter
    Lanes reference_, force_, stiffness_, damping_;     // of RollingFriction::State
    mutable std::vector<double> work_;                  // the derivatives of a force by its numbers
};

} // namespace tribode
