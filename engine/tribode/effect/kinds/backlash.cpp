#include "tribode/base/error.hpp"
#include "tribode/effect/candidate.hpp"

namespace tribode::effects {

// The rigid body in two, with play between; see Backlash for the equations of the contact. Vibration modes are of the body
// whose position is measured: its response to a force is load or motor part of k0, and all modes, as without backlash.
extern const EffectKind backlash = {
    .name = "backlash",
    .summary = "The mass is split into two bodies with play between them.",
    .order = 140,
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
    .example = R"({"gap_m": 5e-5, "load_fraction": 0.4, "contact_hz": 200, "contact_zeta": 0.2, "sensor": "load"})",
    .affine = true,
    .drawn_against = DrawnAgainst::distance_since_reversal,
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            if (axis.plant.backlash) throw InputError("backlash can be there only once");
            axis.plant.backlash = Backlash{e.number("gap_m"), e.number("load_fraction"), e.number("contact_hz"),
                                           e.number("contact_zeta"), e.choice("sensor") == "load"};
        },
    .lua = R"lua(
m.backlash = p
)lua",
    .forms =
        [](const Clues& c) {
            std::vector<EffectForm> forms;
            if (!c.axis.plant.modes.empty() || c.axis.plant.rigid_gain == 0) return forms;
            std::vector<std::vector<double>> probes;
            for (const double gap : geometric(2e-6, 1e-3, 20)) {
                for (const double share : {0.2, 0.35, 0.5, 0.65, 0.8}) {
                    for (const double contact : {80.0, 110.0, 160.0, 240.0, 340.0, 500.0})
                        probes.push_back({gap, share, contact, 0.2});
                }
            }
            for (const char* sensor : {"motor", "load"}) {
                // Without play the load is a vibration mode of the motor. Its own position has one of negative gain.
                const auto mode = [gain = c.axis.plant.rigid_gain, is_motor = sensor == std::string_view("motor")](
                                      std::span<const double> values) -> std::vector<double> {
                    if (!is_motor) return {};
                    const double share = values[1];
                    return {gain * share / (1 - share), values[2], values[3]};
                };
                forms.push_back({.form = sensor,
                                 .fixed = {{"sensor", sensor}},
                                 // Steps of differences are small, lest a contact come or go within one.
                                 .parameters = {{"gap_m", 1e-7, 5e-3, true, 1e-4},
                                                {"load_fraction", 0.03, 0.97, false, 1e-4},
                                                {"contact_hz", 30, 2000, true, 1e-4},
                                                {"contact_zeta", 5e-3, 2, true, 1e-4}},
                                 .probes = probes,
                                 .tried = 3,
                                 .as_simpler = mode,
                                 .rugged = true});
            }
            return forms;
        },
    .fit_order = 220,
    .simpler = {"resonant_mode"}, // of a play of next to nothing
};

} // namespace tribode::effects
