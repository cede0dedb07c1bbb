#pragma once
#include "friction/slip_state.hpp"

#include <cstddef>
#include <functional>
#include <vector>

namespace tribode {

// One elasto-slide element of the paper, eqs. (11)-(14): a spring that follows the driven point until it slips.
struct MaxwellSlipElement {
    double stiffness; // K_i [N/m], > 0
    double level;     // F_i [N], > 0: half the swing of a full loop, |K_i z_i| <= F_i
    double damping;   // D_i [N s/m], >= 0: acts in stick only, and is not bounded by F_i

    double limit() const { return level / stiffness; } // X_i [m]
};

// Rolling friction: elements in parallel, eq. (15), as functions of the position y of the driven point.
//
// Between two events the force is affine in y and v, because an element in stick follows the position and one in slip
// rests at its limit:
//
//     f = force + stiffness (y - reference) + damping v
//
// State holds these three sums, so that an evaluation costs the same for any number of elements, and no element needs
// a continuous state of its own. All elements see the same velocity; those in slip all slip the same way.
class RollingFriction {
  public:
    struct State {
        std::vector<double> z;        // deflection of each element at the reference [m]
        std::vector<SlipState> slip;  // of each element
        double reference = 0;         // position at the last event [m]
        double force = 0;             // sum K_i z_i at the reference [N]
        double stiffness = 0;         // sum of K_i in stick [N/m]
        double damping = 0;           // sum of D_i in stick [N s/m]
        double forward_limit = 0;     // position at which the next element slips forward [m], or +inf
        double backward_limit = 0;    // the same backward, or -inf
        std::size_t next_forward = 0; // which element that is
        std::size_t next_backward = 0;
        SlipState direction = SlipState::stick; // of the elements in slip; stick: none slips
    };

    // Called for each element that changes, in order of index.
    using Report = std::function<void(std::size_t element, SlipState now)>;

    RollingFriction() = default;
    explicit RollingFriction(std::vector<MaxwellSlipElement> elements);

    const std::vector<MaxwellSlipElement>& elements() const { return elements_; }

    // All elements relaxed, in stick, at position y.
    State at_rest(double y) const;

    double force(const State& s, double y, double v) const {
        return s.force + s.stiffness * (y - s.reference) + s.damping * v;
    }

    // The position has come to forward_limit or backward_limit (as near as events are located): the element there,
    // and every other whose limit is not beyond, goes into slip with z exactly on its limit.
    void slip(State& s, double y, SlipState direction, const Report& report) const;

    // The velocity has come to zero: every element in slip sticks where it is.
    void stick(State& s, double y, const Report& report) const;

    // The force with all elements in slip: sum F_i [N].
    double coulomb_level() const;

  private:
    void move_reference(State& s, double y) const;
    void refresh(State& s) const;

    std::vector<MaxwellSlipElement> elements_;
    std::vector<double> limits_; // X_i [m]
};

} // namespace tribode
