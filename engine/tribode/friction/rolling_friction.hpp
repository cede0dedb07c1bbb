#pragma once
#include "tribode/base/about.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/friction/slip_state.hpp"

#include <cstddef>
#include <functional>
#include <vector>

namespace tribode {

// One elasto-slide element of the paper, eqs. (11)-(14): a spring that follows the driven point until it slips.
struct MaxwellSlipElement {
    double stiffness;   // K_i [N/m], > 0
    double level;       // F_i [N], > 0: half the swing of a full loop, |K_i z_i| <= F_i
    double damping = 0; // D_i [N s/m], >= 0: acts in stick only, and is not bounded by F_i

    static void describe(auto& e, auto& fields) {
        fields.required("K", e.stiffness, "N/m", Allowed::positive,
                        About("stiffness").usually(1, 1e12).uncertain("friction.elements"));
        fields.required(
            "F", e.level, "N", Allowed::positive,
            About("level: half the swing of a full loop").usually(1e-6, 1e5).uncertain("friction.elements"));
        fields.number("D", e.damping, "N s/m", Allowed::non_negative,
                      About("damping, in stick only").usually(1e-6, 1e6));
    }

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
// a continuous state of its own. All elements see the same velocity, so those in slip all slip the same way, and they
// let go one after another in the order of the room they had at the last reversal. That order is made once, at the
// first slip after a reversal, with the sums for each of its rungs; a slip then costs the same for any number of
// elements, and only a reversal looks at all of them.
class RollingFriction {
  public:
    // One element of the order, and the state of all when it and those before it have let go.
    struct Rung {
        double room; // travel from the reference to its limit [m]
        std::size_t element;
        double level;     // sum of F_i of those that slip [N]
        double spring;    // sum of K_i z_i of those that stick, at the reference [N]
        double stiffness; // sum of K_i in stick [N/m]
        double damping;   // sum of D_i in stick [N s/m]
    };

    struct State {
        std::vector<double> z;       // deflection [m]: in slip +-X_i, in stick that at the reference
        std::vector<SlipState> slip; // of each element
        double reference = 0;        // position at the last reversal, or the start [m]
        double force = 0;            // of all elements at the reference, those in slip at their limit [N]
        double stiffness = 0;        // sum of K_i in stick [N/m]
        double damping = 0;          // sum of D_i in stick [N s/m]
        // Position at which the next element slips [m]; infinite where none can before a reversal.
        double forward_limit = 0;
        double backward_limit = 0;
        std::size_t next_forward = 0; // which element that is
        std::size_t next_backward = 0;
        SlipState direction = SlipState::stick; // of the elements in slip; stick: none slips
        std::vector<Rung> ladder;               // the order of slips, where some slip
        std::size_t slipped = 0;                // rungs behind us
    };

    // Called for each element that changes: at a slip in the order in which they let go, else in order of index.
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
    // and every other whose limit is not beyond, goes into slip with z exactly on its limit. Some element must be in
    // stick.
    void slip(State& s, double y, SlipState direction, const Report& report) const;

    // The velocity has come to zero: every element in slip sticks where it is.
    void stick(State& s, double y, const Report& report) const;

    // The force with all elements in slip: sum F_i [N].
    double coulomb_level() const;

  private:
    void begin(State& s) const;
    void make_ladder(State& s, double towards) const;

    std::vector<MaxwellSlipElement> elements_;
    std::vector<double> limits_; // X_i [m]
};

} // namespace tribode
