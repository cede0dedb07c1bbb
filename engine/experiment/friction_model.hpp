#pragma once
#include "base/field_reader.hpp"
#include "machine/machine_model.hpp"

#include <optional>
#include <vector>

namespace tribode {

// What a controller or an analysis believes of the friction; the machine's own where nothing else is said.
struct FrictionModel {
    std::vector<MaxwellSlipElement> elements;
    double viscous = 0; // D_v [N s/m]

    static FrictionModel of(const MachineModel& machine) { return {machine.elements, machine.viscous}; }

    // Field `friction_model`: {elements=, viscous=} as in a machine description; absent: nothing.
    static std::optional<FrictionModel> read(FieldReader& fields);
};

} // namespace tribode
