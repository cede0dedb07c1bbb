#include "tribode/base/error.hpp"
#include "tribode/effect/kinds.hpp"

namespace tribode::effects {

// The rigid body in two, with play between; see Backlash for the equations of the contact.
const EffectKind backlash = {
    .name = "backlash",
    .equation = "mass 1/k0 split, load = load_fraction of it; contact max(0, m w^2 (d - gap_m/2) + 2 contact_zeta w m "
                "d') beyond the "
                "play, w = 2 pi contact_hz, m the reduced mass",
    .parameters =
        {
            {.name = "gap_m",
             .unit = "m",
             .meaning = "the whole play; the bodies start in its middle",
             .allowed = Allowed::positive,
             .plausible_min = 1e-6,
             .plausible_max = 1e-3},
            {.name = "load_fraction",
             .meaning = "share of the mass that is the load",
             .allowed = Allowed::fraction,
             .plausible_min = 0.1,
             .plausible_max = 0.9},
            {.name = "contact_hz",
             .unit = "Hz",
             .meaning = "natural frequency of the contact",
             .allowed = Allowed::positive,
             .plausible_min = 50,
             .plausible_max = 1000},
            {.name = "contact_zeta",
             .meaning = "its damping ratio",
             .allowed = Allowed::non_negative,
             .plausible_min = 0.02,
             .plausible_max = 0.5},
            {.name = "sensor",
             .meaning = "the body whose position is measured, on which friction and position forces act",
             .type = EffectParameter::Type::choice,
             .choices = {"motor", "load"}},
        },
    .affine = true,
    .drawn_against = DrawnAgainst::distance_since_reversal,
    .neutral = {},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            if (axis.plant.backlash) throw InputError("backlash can be there only once");
            axis.plant.backlash = Backlash{e.number("gap_m"), e.number("load_fraction"), e.number("contact_hz"),
                                           e.number("contact_zeta"), e.choice("sensor") == "load"};
        },
};

} // namespace tribode::effects
