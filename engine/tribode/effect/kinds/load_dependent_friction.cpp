#include "tribode/effect/candidate.hpp"
#include "tribode/effect/directed_law.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

namespace tribode::effects {

namespace {

class LoadDependent final : public DirectedLaw {
  public:
    LoadDependent(double share, double reach) : DirectedLaw("load_dependent_friction"), share_(share), reach_(reach) {}
    double friction(double, double, double z) const override { return share_ / reach_ * z; }
    double rate(double v, double way, double z) const override { return v - way * v * z / reach_; }
    std::optional<std::vector<double>> numbers() const override { return {{share_, reach_}}; }
    void differentiate(double v, double way, double z, Derivatives& friction, Derivatives& rate) const override {
        friction.deflection = share_ / reach_;
        friction.numbers[0] = z / reach_;
        friction.numbers[1] = -share_ * z / (reach_ * reach_);
        rate.velocity = 1 - way * z / reach_;
        rate.deflection = -way * v / reach_;
        rate.numbers[1] = way * v * z / (reach_ * reach_);
    }
    bool per_load() const override { return true; }
    bool is_nearly_affine() const override { return true; }
    double fastest_rate(double v, std::span<const double>) const override { return std::abs(v) / reach_; }
    std::string reason() const override { return "the friction (load_dependent_friction) grows with the load"; }

  private:
    double share_, reach_;
};

} // namespace

// As in gears and screws, whose teeth are pressed together by the force that they transmit.
extern const EffectKind load_dependent_friction = {
    .name = "load_dependent_friction",
    .summary = "Friction grows with the force that the motor transmits, as in gears and screws.",
    .order = 35,
    .equation = "- share abs(Fm) z/reach, z' = v - abs(v) z/reach",
    .parameters =
        {
            {.name = "share",
             .meaning = "friction by load",
             .allowed = Allowed::non_negative,
             .plausible_min = 0.005,
             .plausible_max = 0.5},
            {.name = "reach",
             .unit = "m",
             .meaning = "distance over which it builds up after a reversal",
             .allowed = Allowed::positive,
             .plausible_min = 1e-7,
             .plausible_max = 1e-3},
        },
    .example = R"({"share": 0.1, "reach": 2e-5})",
    .affine = false,
    .drawn_against = DrawnAgainst::thrust,
    .neutral = {{"share", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.forces.push_back(std::make_shared<const LoadDependent>(e.number("share"), e.number("reach")));
        },
    .lua = R"lua(
m.add_force {
  states = { z = 0 },
  sees_thrust = true,
  rates = function(s, own) return { z = s.v - tb.where(tb.less(s.v, 0), -1, 1) * s.v * own.z / p.reach } end,
  force = function(s, own) return -p.share * tb.no_event(math.abs(s.thrust)) * own.z / p.reach end,
}
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        Signal shape(c.force.size());
        for (std::size_t k = 0; k < shape.size(); ++k) shape[k] = -c.direction[k] * std::abs(c.residual.thrust[k]);
        const double share = std::clamp(regress({shape}, c.force).coefficients[0], 0.01, 0.8);
        // Shorter than what the axis moves in a sample, it is at once.
        const double shortest = std::max(1e-7, 0.3 * c.max_speed * c.sample_time);
        const auto reach_of = [&](double strokes) { return std::max(strokes * c.stroke, 2 * shortest); };
        return {{.parameters = {factor("share", 1e-4, 2), factor("reach", shortest, std::max(c.stroke, 10 * shortest))},
                 .starts = {{share, reach_of(0.003)}, {share, reach_of(0.03)}}}};
    },
    .fit_order = 55,
    .is_friction_law = true,
};

} // namespace tribode::effects
