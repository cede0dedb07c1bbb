#pragma once
#include "tribode/control/sampled_friction.hpp"
#include "tribode/machine/machine_model.hpp"

#include <algorithm>
#include <optional>
#include <vector>

namespace tribode {

// What a controller or an analysis believes of the friction; the machine's own where nothing else is said.
struct FrictionModel {
    std::vector<MaxwellSlipElement> elements;
    double viscous = 0; // D_v [N s/m]
    DryFriction dry = {};

    static FrictionModel of(const MachineModel& machine) { return {machine.elements, machine.viscous, machine.dry}; }

    // As in a machine description.
    static void describe(auto& model, auto& fields) {
        fields.list("elements", model.elements);
        fields.number("viscous", model.viscous, "N s/m", Allowed::non_negative);
        DryFriction::describe(model.dry, fields);
    }
};

// A friction model over a measured position, sample by sample. Dry friction has no force of its own at rest: it is built up over
// two steps of the encoder, as by a very stiff element.
class MeasuredFriction {
  public:
    MeasuredFriction(const FrictionModel& model, const MachineModel& machine)
        : elements_(model.elements, model.viscous, machine.sample_time),
          dry_(model.dry),
          sample_time_(machine.sample_time),
          reach_(std::max(2 * machine.encoder_resolution, 1e-7)) {}

    double step(double position) {
        double force = elements_.step(position);
        if (dry_.present()) {
            const double travel = position - previous_.value_or(position);
            previous_ = position;
            z_ = std::clamp(z_ + travel, -reach_, reach_);
            force += dry_.level(travel / sample_time_) * z_ / reach_;
        }
        return force;
    }

  private:
    SampledFriction elements_;
    DryFriction dry_;
    double sample_time_, reach_; // [s], [m]
    double z_ = 0;               // [m]
    std::optional<double> previous_;
};

} // namespace tribode
