#include "tribode/effect/candidate.hpp"
#include "tribode/effect/directed_law.hpp"
#include "tribode/effect/friction_law_parameters.hpp"

#include <cmath>
#include <memory>

namespace tribode::effects {

namespace {

class Dahl final : public DirectedLaw {
  public:
    Dahl(double level, double stiffness, double exponent)
        : DirectedLaw("dahl_friction"),
          level_(level),
          stiffness_(stiffness),
          exponent_(exponent) {}
    double friction(double, double, double z) const override { return stiffness_ * z; }
    double rate(double v, double way, double z) const override {
        const double left = 1 - stiffness_ * z * way / level_; // of the level; 2 right after a reversal in slip
        return v * (exponent_ == 1 ? left : std::copysign(std::pow(std::abs(left), exponent_), left));
    }
    std::string reason() const override {
        if (exponent_ >= 1) return DirectedLaw::reason();
        return "the friction law (dahl_friction) has no finite slope at its level (its exponent is below one)";
    }
    std::optional<std::vector<double>> numbers() const override {
        if (exponent_ < 1) return std::nullopt;
        return {{level_, stiffness_, exponent_}};
    }
    void differentiate(double v, double way, double z, Derivatives& friction, Derivatives& rate) const override {
        friction.deflection = stiffness_;
        friction.numbers[1] = z;
        const double left = 1 - stiffness_ * z * way / level_;
        const double power = std::copysign(std::pow(std::abs(left), exponent_), left);
        const double by_left = v * exponent_ * std::pow(std::abs(left), exponent_ - 1);
        rate.velocity = power;
        rate.deflection = -by_left * stiffness_ * way / level_;
        rate.numbers[0] = by_left * stiffness_ * z * way / (level_ * level_);
        rate.numbers[1] = -by_left * z * way / level_;
        rate.numbers[2] = left == 0 ? 0 : v * power * std::log(std::abs(left));
    }
    double fastest_rate(double v, std::span<const double>) const override {
        return exponent_ * std::pow(2, exponent_ - 1) * stiffness_ * std::abs(v) / level_;
    }

  private:
    double level_, stiffness_, exponent_;
};

} // namespace

// [Dahl 1968].
extern const EffectKind dahl_friction = {
    .name = "dahl_friction",
    .summary = "Friction follows the motion as a spring that yields, more and more toward its level.",
    .order = 31,
    .equation = "- K z, z' = v left abs(left)^(exponent - 1), left = 1 - K z sign(v)/F",
    .parameters =
        {
            friction_level_parameter("F", "level"),
            friction_stiffness_parameter("stiffness at the start of a motion"),
            {.name = "exponent",
             .meaning = "exponent",
             .allowed = Allowed::positive,
             .plausible_min = 0.5,
             .plausible_max = 2,
             .fallback = 1},
        },
    .example = R"({"F": 3, "K": 1e5})",
    .affine = false,
    .drawn_against = DrawnAgainst::distance_since_reversal,
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.forces.push_back(
                std::make_shared<const Dahl>(e.number("F"), e.number("K"), e.number("exponent")));
        },
    .lua = R"lua(
m.add_force {
  states = { z = 0 },
  rates = function(s, own)
    local left = 1 - p.K / p.F * own.z * tb.where(tb.less(s.v, 0), -1, 1)
    if p.exponent == 1 then return { z = s.v * left } end
    return { z = s.v * left * tb.no_event(math.abs(left)) ^ (p.exponent - 1) }
  end,
  force = function(_, own) return -p.K * own.z end,
}
)lua",
    .is_friction_law = true,
};

} // namespace tribode::effects
