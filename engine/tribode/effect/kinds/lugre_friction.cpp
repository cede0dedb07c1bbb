#include "tribode/effect/candidate.hpp"
#include "tribode/effect/directed_law.hpp"
#include "tribode/effect/friction_law_parameters.hpp"

#include <cmath>
#include <memory>

namespace tribode::effects {

namespace {

class LuGre final : public DirectedLaw {
  public:
    LuGre(const DryFriction& level, double stiffness, double damping, double viscous)
        : DirectedLaw("lugre_friction"),
          level_(level),
          stiffness_(stiffness),
          damping_(damping),
          viscous_(viscous) {}
    double friction(double v, double way, double z) const override {
        return stiffness_ * z + damping_ * rate(v, way, z) + viscous_ * v;
    }
    double rate(double v, double way, double z) const override {
        return v - stiffness_ * way * v / level_.level(v) * z;
    }
    double fastest_rate(double v, std::span<const double>) const override {
        return stiffness_ * std::abs(v) / level_.level(v);
    }

  private:
    DryFriction level_;
    double stiffness_, damping_, viscous_;
};

} // namespace

// [Canudas 1995].
extern const EffectKind lugre_friction = {
    .name = "lugre_friction",
    .summary = "Friction is that of bristles, which deflect and let go at a level that falls with speed.",
    .order = 32,
    .equation = "- K z - D z' - viscous v, z' = v - K abs(v) z/g(v), g = F + (Fs - F) exp(-(abs(v)/velocity)^exponent)",
    .parameters =
        {
            friction_level_parameter("F", "Coulomb level"),
            friction_level_parameter("Fs", "static level"),
            stribeck_velocity_parameter(),
            stribeck_exponent_parameter("exponent of the Stribeck curve", 2),
            friction_stiffness_parameter("stiffness of the bristles"),
            {.name = "D",
             .unit = "N s/m",
             .meaning = "damping of the bristles",
             .allowed = Allowed::non_negative,
             .plausible_min = 0.1,
             .plausible_max = 1e4,
             .fallback = 0},
            law_viscous_parameter(),
        },
    .example = R"({"F": 3, "Fs": 4, "velocity": 0.005, "K": 1e5, "D": 30})",
    .affine = false,
    .drawn_against = DrawnAgainst::distance_since_reversal,
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.forces.push_back(
                std::make_shared<const LuGre>(stribeck_level(e), e.number("K"), e.number("D"), e.number("viscous")));
        },
    .lua = R"lua(
local function deflecting(s, own)
  local speed = tb.where(tb.less(s.v, 0), -1, 1) * s.v
  local share = math.exp(-(tb.no_event(math.abs(s.v)) / p.velocity) ^ p.exponent)
  return s.v - p.K * speed * own.z / (p.F + (p.Fs - p.F) * share)
end
m.add_force {
  states = { z = 0 },
  rates = function(s, own) return { z = deflecting(s, own) } end,
  force = function(s, own) return -p.K * own.z - p.D * deflecting(s, own) - p.viscous * s.v end,
}
)lua",
    .is_friction_law = true,
};

} // namespace tribode::effects
