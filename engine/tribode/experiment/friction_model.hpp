#pragma once
#include "tribode/machine/machine_model.hpp"

#include <vector>

namespace tribode {

// What a controller or an analysis believes of the friction; the machine's own where nothing else is said.
struct FrictionModel {
    std::vector<MaxwellSlipElement> elements;
    double viscous = 0; // D_v [N s/m]

    static FrictionModel of(const MachineModel& machine) { return {machine.elements, machine.viscous}; }

    // As in a machine description.
    static void describe(auto& model, auto& fields) {
        fields.list("elements", model.elements);
        fields.number("viscous", model.viscous, "N s/m", Allowed::non_negative);
    }
};

} // namespace tribode
