#pragma once
#include "tribode/friction/dry_friction.hpp"
#include "tribode/friction/rolling_friction.hpp"
#include "tribode/hybrid/piecewise_affine.hpp"
#include "tribode/plant/backlash.hpp"
#include "tribode/plant/held_input.hpp"
#include "tribode/plant/point_force.hpp"
#include "tribode/plant/vibration_mode.hpp"

#include <array>
#include <memory>
#include <span>
#include <vector>

namespace tribode {

// A sine force on the driven point: amplitude sin(2 pi freq_hz t + phase).
struct SineForce {
    double amplitude; // [N]
    double freq_hz;   // > 0
    double phase;     // [rad]
};

// The continuous part of a servo axis, eqs. (1), (11)-(17):
//
//     y = x0 + sum q_j,  v = y'           the driven point; friction acts there
//     x0'' = k0 u_e,  q_j'' = k_j u_e - r_j,  r_j = 2 z_j w_j q_j' + w_j^2 q_j
//     u_e = Fm + disturbance + F - f      effective thrust; F: added forces, see Parameters
//     f = f_roll(y, v) + D_v v + f_dry    friction
//     Fm' = w_c (u - Fm)                  current loop, or Fm = u
//
// f_dry is set-valued at v = 0: while the axis sticks it is the force that keeps v' = 0,
//     f_dry = Fm + disturbance + F - f_roll - sum r_j / k,   k = k0 + sum k_j,
// as long as its magnitude does not exceed the static level. With no mode, u_e = 0 there.
//
// The states are x = [y, v, q_1, q_1', ..., Fm]: y and v in place of the rigid body's x0 and x0', with v' = k u_e -
// sum r_j. Limits and reversals are then zero crossings of single states, and an axis that sticks has v = 0 exactly; as sums
// over the bodies they would carry the rounding, and the integration error, of every mode. Before Fm there may be the
// other body of a backlash, [y, v] each, each sine force [F, F a quarter of its period later], and the states of forces.
class ServoPlant {
  public:
    struct Parameters {
        double rigid_gain = 0; // k0 [m/(N s^2)]
        std::vector<VibrationMode> modes;
        RollingFriction rolling;
        DryFriction dry;
        double viscous = 0;         // D_v [N s/m]
        double current_loop_hz = 0; // w_c / 2 pi [Hz]; 0: Fm = u

        // What effects add; none of it costs time where it is absent.
        struct Direction {
            double level = 0;   // added to the dry level [N]; neither level may fall below zero
            double viscous = 0; // added to D_v [N s/m]
        };
        Direction forward = {}, backward = {}; // friction that depends on the direction of motion
        double constant_force = 0;             // [N]
        double spring = 0;                     // [N/m]: the force - spring y
        std::vector<SineForce> sine_forces = {};
        std::vector<std::shared_ptr<const PointForce>> forces = {};
        std::vector<std::shared_ptr<const FrictionScale>> friction_scales = {};
        std::optional<Backlash> backlash = {}; // needs a rigid body, which it splits; the modes are the driven point's
    };

    // Discrete values of the plant.
    struct State {
        RollingFriction::State rolling;
        SlipState dry = SlipState::stick;
        ContactState contact = ContactState::open;
        HeldInput input;        // u, after its delay [N]
        double disturbance = 0; // force added to the motor's [N]
    };

    // What one sees of the plant at an instant.
    struct Outputs {
        double position; // y [m]
        double velocity; // v [m/s]
        double friction; // f [N]
        double thrust;   // Fm [N]
    };

    // Subjects of the event log: 0 the Coulomb level, 1.. the elements; kinds: SlipState.
    static constexpr int coulomb_subject = 0;

    // Of half a gap: far above the rounding of positions, far below what one sees of a contact.
    static constexpr double contact_margin = 1e-9;

    explicit ServoPlant(Parameters parameters); // gains must not all be zero

    const Parameters& parameters() const { return p_; }
    const std::vector<StateVariable>& states() const { return states_; }
    double driven_gain() const { return total_gain_; } // k: v' by the effective thrust [m/(N s^2)]
    std::size_t guard_count() const { return first_own_guard() + own_guards_; }

    // Elements relaxed, dry friction in stick where v = 0. x has states().size() entries.
    State start(double position, double velocity, std::span<double> x) const;

    void derivative(double t, std::span<const double> x, const State& s, std::span<double> dxdt) const;
    // False where a force does not know its slopes.
    bool jacobian(double t, std::span<const double> x, const State& s, std::span<double> matrix) const;
    void guards(double t, std::span<const double> x, const State& s, std::span<double> g) const;
    // Whether a jump of the input makes one of a guard: of the force that holds an axis without a lag.
    bool guards_see_input() const { return has_dry_ && corner_ == 0; }
    // As PiecewiseAffine, of which a servo system has the functions. linear_part: without any friction. w: in slip the force
    // on the driven point that is not affine, in stick what keeps it from being released; where friction is scaled, also
    // the factor less one, for the level of the release; then the rates of the forces' own states, and their guards.
    void linear_part(std::span<double> matrix) const;
    std::optional<std::string> why_not_affine() const;
    std::optional<std::string> why_not_nearly_affine() const;
    // Why runs have no derivatives, as a sentence; nothing where ServoPlantTangent knows them.
    std::optional<std::string> why_not_differentiable() const;
    // Whether the rates are affine in this state: also in stick, where forces that are not do not act, and friction laws rest.
    bool is_affine_in(const State& s) const { return !curved_ || is_stuck(s); }
    AffineForm affine_form(const State& s) const;
    void append_affine_key(const State& s, AffineKey& key) const;
    bool has_varying_input(const State& s) const { return s.input.rate != 0; }
    void rate_coefficient(int n, double t0, double h, std::span<const double> c, const State& s,
                          std::span<double> coefficient) const {
        linear_derivative(s.input.taylor(n, t0, h), c, s, coefficient);
    }
    void guard_coefficient(int n, double t0, double h, std::span<const double> c, const State& s,
                           std::span<double> coefficient) const {
        linear_guards(s.input.taylor(n, t0, h), c, s, coefficient);
    }
    std::size_t forcing_count() const;
    void forcing(double t, std::span<const double> x, const State& s, std::span<double> w) const;
    EventEffect on_crossing(GuardId guard, double t, std::span<double> x, State& s, EventLog& log) const;
    std::string guard_name(GuardId guard, const State& s) const;

    // Sets the states of the sine forces to what they are at t, lest errors of integration add up. Tells whether there
    // are any.
    bool refresh_sines(double t, std::span<double> x) const;

    Outputs outputs(double t, std::span<const double> x, const State& s) const;
    static double position(std::span<const double> x) { return x[0]; }
    static double velocity(std::span<const double> x) { return x[1]; }

  private:
    friend class ServoPlantTangent; // the same equations, differentiated
    enum Guard : GuardId { forward_limit, backward_limit, reversal, release_forward, release_backward };

    // Which guards matter in the present slip states.
    struct Watched {
        bool forward = false, backward = false; // an element may reach its limit
        double towards = 0;                     // +1 or -1: a reversal may come; 0: nothing slips
        bool release = false;                   // the Coulomb level may let go
    };
    Watched watched(const State& s) const;
    GuardId first_contact_guard() const { return has_dry_ ? 5 : 3; }
    GuardId first_own_guard() const { return first_contact_guard() + (p_.backlash ? 2 : 0); } // of forces

    double thrust(double t, std::span<const double> x, const State& s) const;
    double pushing(double thrust, std::span<const double> x, const State& s, double one) const;
    double own_forces(double t, std::span<const double> x, const State& s) const; // not affine [N]
    PointForce::Slopes friction_slopes(double t, std::span<const double> x, const State& s, double level,
                                       double slope) const;
    double law_friction(double t, std::span<const double> x, const State& s) const; // of friction laws [N]
    // Calls act(force, first state, states, first guard) for each force.
    void each_force(auto act) const {
        std::size_t state = first_own_, guard = first_own_guard();
        for (std::size_t i = 0; i < p_.forces.size(); ++i) {
            act(*p_.forces[i], state, own_count_[i], guard);
            state += own_count_[i];
            guard += p_.forces[i]->guard_count();
        }
    }
    double driving(double t, std::span<const double> x, const State& s) const; // Fm + disturbance + F [N]
    double viscous(const State& s) const { return viscous_[static_cast<std::size_t>(sign(s.dry) + 1)]; }
    double dry_level(double v, const State& s) const;
    double friction_factor(double t, std::span<const double> x) const;
    double separation(std::span<const double> x, std::size_t of) const;
    double contact_force(std::span<const double> x, const State& s, double one) const;
    void contact_guards(std::span<const double> x, const State& s, double one, std::span<double> g) const;
    void contact_crossing(bool first, State& s) const;
    bool is_stuck(const State& s) const { return has_dry_ && s.dry == SlipState::stick; }
    void rates(double effective, double thrust, double input, std::span<const double> x, const State& s, double one,
               std::span<double> dxdt) const;
    void linear_derivative(double input, std::span<const double> x, const State& s, std::span<double> dxdt) const;
    double restoring(std::span<const double> x) const;                                 // sum r_j / k [N]
    double smooth_friction(double t, std::span<const double> x, const State& s) const; // f - f_dry [N]
    double holding_force(double t, std::span<const double> x, const State& s) const;   // f_dry in stick [N]
    double linear_friction(std::span<const double> x, const State& s) const;
    void linear_derivatives(const State& s, std::span<double> matrix) const;
    void linear_guards(double input, std::span<const double> x, const State& s, std::span<double> g) const;
    void guards_of(double holding, double forward_level, double backward_level, std::span<const double> x,
                   const State& s, double one, std::span<double> g) const;
    void push(double force, std::span<double> dxdt) const;
    // The axis is let go a little above the static level, so that rounding does not stop it again at once: also where
    // one direction, or both, have no level at all.
    double release_level(double towards, double t, std::span<const double> x) const;
    void stop(std::span<double> x) const;
    SlipState direction(const State& s) const;

    Parameters p_;
    std::vector<StateVariable> states_;
    std::vector<double> gain_, damping_, stiffness_; // per mode: k_j, 2 z_j w_j, w_j^2
    double total_gain_;                              // k [m/(N s^2)]
    double corner_ = 0;                              // w_c [rad/s]
    double release_margin_ = 0;                      // [N]
    bool has_dry_ = false;                           // whether the direction of motion is a slip state
    bool scaled_ = false;                            // whether friction is scaled
    bool curved_ = false;                            // whether it is not affine
    bool added_ = false;              // whether there are forces besides motor and friction, or a second body
    std::array<double, 3> viscous_{}; // D_v backward, in stick, forward [N s/m]
    std::size_t other_ = 0;           // first state of the other body
    std::size_t first_sine_ = 0, first_own_ = 0;         // states
    std::vector<std::size_t> own_count_;                 // states of each force
    std::size_t own_states_ = 0, own_guards_ = 0;        // of all forces
    std::vector<const FrictionLaw*> laws_;               // forces that are friction; none where one is not
    double other_gain_ = 0;                              // of the body that is not the driven point [1/kg]
    double contact_stiffness_ = 0, contact_damping_ = 0; // [N/m], [N s/m]
};

} // namespace tribode
