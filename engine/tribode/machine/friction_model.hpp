#pragma once
#include "tribode/control/sampled_friction.hpp"
#include "tribode/machine/machine_model.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// What a controller or an analysis believes of the friction; the machine's own where nothing else is said.
struct FrictionModel {
    std::vector<MaxwellSlipElement> elements;
    double viscous = 0; // D_v [N s/m]
    DryFriction dry = {};
    std::vector<Effect> laws = {}; // friction laws with states, EffectKind::is_friction_law

    static FrictionModel of(const MachineModel& machine) {
        FrictionModel model{machine.elements, machine.viscous, machine.dry, machine.effects};
        std::erase_if(model.laws, [](const Effect& effect) { return !effect.kind().is_friction_law; });
        return model;
    }

    // As in a machine description, but for the laws.
    static void describe(auto& model, auto& fields) {
        fields.list("elements", model.elements);
        fields.number("viscous", model.viscous, "N s/m", Allowed::non_negative);
        DryFriction::describe(model.dry, fields);
    }
};

// The names of the laws whose friction grows with the load.
std::vector<std::string> load_dependent(const std::vector<Effect>& laws);

// Friction laws with states over positions at equal times, between which the velocity is constant. The first position sets the
// reference, where all are relaxed.
class SampledLaws {
  public:
    SampledLaws(const std::vector<Effect>& laws, double sample_time);

    bool empty() const { return laws_.empty(); }
    // load: magnitude of the motor force there [N].
    void step(double position, double load);
    // Of the laws that grow with the load, under one of 1 N.
    double force_per_load(double velocity) const;
    // The force at the last position, if the velocity is this one there [N].
    double force(double velocity) const;
    // The mean velocity of the last step [m/s].
    double velocity() const { return velocity_; }

  private:
    struct Law {
        std::shared_ptr<const FrictionLaw> law;
        std::vector<double> state;
    };
    void advance(Law& one, double duration) const;

    std::vector<Law> laws_;
    double sample_time_, load_ = 0, velocity_ = 0;
    std::optional<double> previous_;
};

// A friction model over a measured position, sample by sample. Dry friction has no force of its own at rest: it is built up over
// two steps of the encoder, as by a very stiff element.
class MeasuredFriction {
  public:
    MeasuredFriction(const FrictionModel& model, const MachineModel& machine)
        : elements_(model.elements, model.viscous, machine.sample_time),
          dry_(model.dry),
          viscous_(model.viscous),
          laws_(model.laws, machine.sample_time),
          sample_time_(machine.sample_time),
          reach_(std::max(2 * machine.encoder_resolution, 1e-7)) {}

    // thrust: of the motor at the instant of the position, for laws that see the load [N].
    double step(double position, double thrust) {
        double force = elements_.step(position);
        late_velocity_ = (position - previous_.value_or(position)) / sample_time_;
        if (dry_.present()) {
            const double travel = position - previous_.value_or(position);
            z_ = std::clamp(z_ + travel, -reach_, reach_);
            force += dry_.level(travel / sample_time_) * z_ / reach_;
        }
        previous_ = position;
        if (laws_.empty()) return force;
        laws_.step(position, std::abs(thrust));
        return force + laws_.force(laws_.velocity());
    }

    // What the last force changes by with the velocity at the sample, in place of that from the last two positions, which is half
    // a sample late.
    double velocity_correction(double velocity) const {
        const double viscous = viscous_ * (velocity - late_velocity_);
        return laws_.empty() ? viscous : viscous + laws_.force(velocity) - laws_.force(laws_.velocity());
    }

  private:
    SampledFriction elements_;
    DryFriction dry_;
    double viscous_; // [N s/m]
    SampledLaws laws_;
    double sample_time_, reach_; // [s], [m]
    double z_ = 0;               // [m]
    double late_velocity_ = 0;   // [m/s]
    std::optional<double> previous_;
};

} // namespace tribode
