#pragma once
#include "friction/dry_friction.hpp"
#include "friction/rolling_friction.hpp"
#include "hybrid/hybrid_system.hpp"
#include "plant/held_input.hpp"

#include <span>
#include <vector>

namespace tribode {

// A vibration mode of eq. (1): q'' + 2 zeta w q' + w^2 q = gain u_e.
struct VibrationMode {
    double gain;    // k_j [m/(N s^2)]
    double freq_hz; // w_j / 2 pi [Hz], > 0
    double zeta;    // z_j, >= 0
};

// The continuous part of a servo axis, eqs. (1), (11)-(17):
//
//     y = x0 + sum q_j,  v = y'           the driven point; friction acts there
//     x0'' = k0 u_e,  q_j'' = k_j u_e - r_j,  r_j = 2 z_j w_j q_j' + w_j^2 q_j
//     u_e = Fm + disturbance - f          effective thrust
//     f = f_roll(y, v) + D_v v + f_dry    friction
//     Fm' = w_c (u - Fm)                  current loop, or Fm = u
//
// f_dry is set-valued at v = 0: while the axis sticks it is the force that keeps v' = 0,
//     f_dry = Fm + disturbance - f_roll - sum r_j / k,   k = k0 + sum k_j,
// as long as its magnitude does not exceed the static level. With no mode, u_e = 0 there.
//
// The states are x = [y, v, q_1, q_1', ..., Fm]: y and v in place of the rigid body's x0 and x0', with v' = k u_e -
// sum r_j. Limits and reversals are then falls of single states, and an axis that sticks has v = 0 exactly; as sums
// over the bodies they would carry the rounding, and the integration error, of every mode.
class ServoPlant {
  public:
    struct Parameters {
        double rigid_gain = 0; // k0 [m/(N s^2)]
        std::vector<VibrationMode> modes;
        RollingFriction rolling;
        DryFriction dry;
        double viscous = 0;         // D_v [N s/m]
        double current_loop_hz = 0; // w_c / 2 pi [Hz]; 0: Fm = u
    };

    // Discrete values of the plant.
    struct State {
        RollingFriction::State rolling;
        SlipState dry = SlipState::stick;
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

    explicit ServoPlant(Parameters parameters); // gains must not all be zero

    const Parameters& parameters() const { return p_; }
    const std::vector<StateVariable>& states() const { return states_; }
    std::size_t guard_count() const { return p_.dry.present() ? 5 : 3; }

    // Elements relaxed, dry friction in stick where v = 0. x has states().size() entries.
    State start(double position, double velocity, std::span<double> x) const;

    void derivative(double t, std::span<const double> x, const State& s, std::span<double> dxdt) const;
    void jacobian(std::span<const double> x, const State& s, std::span<double> matrix) const;
    void guards(double t, std::span<const double> x, const State& s, std::span<double> g) const;
    // Driven point, modes and current loop without any friction.
    void linear_part(std::span<double> matrix) const;
    std::optional<std::string> why_not_affine() const;
    void affine_derivative(int n, double t0, double h, std::span<const double> c, const State& s,
                           std::span<double> coefficient) const;
    void affine_guards(int n, double t0, double h, std::span<const double> c, const State& s,
                       std::span<double> coefficient) const;
    std::optional<AffinePattern> affine_pattern(const State& s) const;
    EventEffect on_crossing(GuardId guard, double t, std::span<double> x, State& s, EventLog& log) const;
    std::string guard_name(GuardId guard, const State& s) const;

    Outputs outputs(double t, std::span<const double> x, const State& s) const;
    static double position(std::span<const double> x) { return x[0]; }
    static double velocity(std::span<const double> x) { return x[1]; }

  private:
    enum Guard : GuardId { forward_limit, backward_limit, reversal, release_forward, release_backward };

    // Which guards matter in the present slip states.
    struct Watched {
        bool forward = false, backward = false; // an element may reach its limit
        double towards = 0;                     // +1 or -1: a reversal may come; 0: nothing slips
        bool release = false;                   // the Coulomb level may let go
    };
    Watched watched(const State& s) const;

    double thrust(double t, std::span<const double> x, const State& s) const;
    double restoring(std::span<const double> x) const;                               // sum r_j / k [N]
    double smooth_friction(std::span<const double> x, const State& s) const;         // f - f_dry [N]
    double holding_force(double t, std::span<const double> x, const State& s) const; // f_dry in stick [N]
    double linear_friction(std::span<const double> x, const State& s) const;
    void motion(std::span<const double> x, double effective, std::span<double> dxdt) const;
    // The axis is let go a little above the static level, so that rounding does not stop it again at once [N].
    double release_level() const { return p_.dry.static_level * (1 + 1e-12); }
    void stop(std::span<double> x) const;
    SlipState direction(const State& s) const;

    Parameters p_;
    std::vector<StateVariable> states_;
    std::vector<double> gain_, damping_, stiffness_; // per mode: k_j, 2 z_j w_j, w_j^2
    double total_gain_;                              // k [m/(N s^2)]
    double corner_ = 0;                              // w_c [rad/s]
};

} // namespace tribode
