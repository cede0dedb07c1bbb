#include "tribode/effect/candidate.hpp"
#include "tribode/effect/directed_law.hpp"
#include "tribode/effect/friction_law_parameters.hpp"

#include <cmath>
#include <memory>

namespace tribode::effects {

namespace {

class BoucWen final : public DirectedLaw {
  public:
    BoucWen(double level, double reach, double beta, double exponent)
        : DirectedLaw("bouc_wen_friction"),
          level_(level),
          reach_(reach),
          beta_(beta),
          exponent_(exponent) {}
    double friction(double, double, double z) const override { return level_ / reach_ * z; }
    double rate(double v, double way, double z) const override {
        const double share = std::pow(std::abs(z) / reach_, exponent_);
        return v * (1 - share * (beta_ * way * std::copysign(1.0, z) + 1 - beta_));
    }
    std::optional<std::vector<double>> numbers() const override { return {{level_, reach_, beta_, exponent_}}; }
    void differentiate(double v, double way, double z, Derivatives& friction, Derivatives& rate) const override {
        friction.deflection = level_ / reach_;
        friction.numbers[0] = z / reach_;
        friction.numbers[1] = -level_ * z / (reach_ * reach_);
        const double share = std::pow(std::abs(z) / reach_, exponent_), side = way * std::copysign(1.0, z);
        const double shape = beta_ * side + 1 - beta_;
        rate.velocity = 1 - share * shape;
        rate.numbers[1] = v * shape * exponent_ * share / reach_;
        rate.numbers[2] = -v * share * (side - 1);
        if (z == 0) return;
        rate.deflection = -v * shape * exponent_ * share / z;
        rate.numbers[3] = -v * shape * share * std::log(std::abs(z) / reach_);
    }
    double fastest_rate(double v, std::span<const double>) const override { return exponent_ * std::abs(v) / reach_; }

  private:
    double level_, reach_, beta_, exponent_;
};

} // namespace

// [Bouc 1967], [Wen 1976], with A = 1 and gamma = 1 - beta, so that the level is reached.
extern const EffectKind bouc_wen_friction = {
    .name = "bouc_wen_friction",
    .summary = "Friction follows a smooth hysteresis loop, whose corner and way back can be shaped.",
    .order = 33,
    .equation = "- F z/reach, z' = v (1 - abs(z/reach)^exponent (beta sign(v z) + 1 - beta))",
    .parameters =
        {
            friction_level_parameter("F", "level"),
            {.name = "reach",
             .unit = "m",
             .meaning = "level over the stiffness at rest",
             .allowed = Allowed::positive,
             .plausible_min = 1e-7,
             .plausible_max = 1e-3},
            {.name = "beta",
             .meaning = "shape: 0.5 unloads as a spring, 1 is widest",
             .allowed = Allowed::positive,
             .plausible_min = 0.5,
             .plausible_max = 1,
             .fallback = 0.5},
            {.name = "exponent",
             .meaning = "sharpness of the corner, 1 or more",
             .allowed = Allowed::positive,
             .plausible_min = 1,
             .plausible_max = 10,
             .fallback = 1},
        },
    .example = R"({"F": 3, "reach": 3e-5, "beta": 0.6, "exponent": 2})",
    .affine = false,
    .drawn_against = DrawnAgainst::distance_since_reversal,
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.forces.push_back(std::make_shared<const BoucWen>(e.number("F"), e.number("reach"),
                                                                        e.number("beta"), e.number("exponent")));
        },
    .lua = R"lua(
m.add_force {
  states = { z = 0 },
  rates = function(s, own)
    local share = tb.no_event(math.abs(own.z)) / p.reach
    if p.exponent ~= 1 then share = share ^ p.exponent end
    return { z = s.v * (1 - share * tb.where(tb.less(s.v * own.z, 0), 1 - 2 * p.beta, 1)) }
  end,
  force = function(_, own) return -p.F / p.reach * own.z end,
}
)lua",
    .is_friction_law = true,
};

} // namespace tribode::effects
