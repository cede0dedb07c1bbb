#include "tribode/effect/candidate.hpp"
#include "tribode/effect/directed_law.hpp"
#include "tribode/effect/friction_law_parameters.hpp"

#include <algorithm>
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
    bool is_nearly_affine() const override { return true; }
    std::string reason() const override {
        if (level_.stribeck->exponent >= 1) return DirectedLaw::reason();
        return "the friction law (lugre_friction) has no finite slope at rest (its exponent is below one)";
    }
    std::optional<std::vector<double>> numbers() const override {
        const Stribeck& s = *level_.stribeck;
        if (s.exponent < 1) return std::nullopt;
        return {{level_.coulomb, s.static_level, s.velocity, s.exponent, stiffness_, damping_, viscous_}};
    }
    void differentiate(double v, double way, double z, Derivatives& friction, Derivatives& rate) const override {
        const auto by = level_.above_coulomb_by(way * v);
        const double level = level_.coulomb + level_.above_coulomb(way * v);
        const double by_level = stiffness_ * way * v * z / (level * level);
        rate.velocity = 1 - stiffness_ * way * z / level + by_level * by.speed * way;
        rate.deflection = -stiffness_ * way * v / level;
        rate.numbers[0] = by_level * (1 - by.static_level);
        rate.numbers[1] = by_level * by.static_level;
        rate.numbers[2] = by_level * by.velocity;
        rate.numbers[3] = by_level * by.exponent;
        rate.numbers[4] = -way * v * z / level;
        friction.velocity = damping_ * rate.velocity + viscous_;
        friction.deflection = stiffness_ + damping_ * rate.deflection;
        for (std::size_t i = 0; i < 5; ++i) friction.numbers[i] = damping_ * rate.numbers[i];
        friction.numbers[4] += z;
        friction.numbers[5] = this->rate(v, way, z);
        friction.numbers[6] = v;
    }

  private:
    DryFriction level_;
    double stiffness_, damping_, viscous_;
};

// Level F, reach F/K, time D/K, and where the level falls with speed the static one in units of F and the velocity.
void bristles_of(std::span<const double> values, std::span<double> numbers) {
    const bool falls = values.size() == 5;
    const double F = values[0], K = F / values[1];
    numbers[0] = F;
    numbers[1] = falls ? F * values[3] : F;
    numbers[2] = falls ? values[4] : 0.01;
    numbers[4] = K;
    numbers[5] = K * values[2];
}

constexpr double slowest_bristle = 0.05, fastest_bristle = 1e-6; // D/K [s]

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
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const double typical = c.typical_force(), shortest = 1e-7, longest = std::max(c.stroke, 1e-5);
        const double level = std::max(-regress({c.direction}, c.force).coefficients[0], 0.1 * typical);
        std::vector<std::vector<double>> probes;
        for (const double reach : geometric(1e-6, std::min(longest, 1e-3), 7)) {
            for (const double time : {3e-5, 1e-3}) probes.push_back({level, reach, time});
        }
        EffectForm constant{.form = "constant level",
                            .parameters = {factor("F", 1e-3 * typical, c.max_force()),
                                           factor("reach", shortest, longest),
                                           factor("time", fastest_bristle, slowest_bristle)},
                            .convert = bristles_of,
                            .probes = probes};
        constant.richer = [constant, fastest = c.max_speed](std::span<const double> p) {
            EffectForm falling = constant;
            falling.form = "falling level";
            falling.parameters.push_back(factor("Fs/F", 1, 10));
            falling.parameters.push_back(factor("velocity", 1e-4 * fastest, fastest));
            falling.probes.clear();
            for (const double share : {0.03, 0.1, 0.3}) {
                falling.starts.push_back({p[0] / 1.1, p[1] / 1.1, p[2], 1.2, share * fastest});
            }
            falling.richer = nullptr;
            return falling;
        };
        return {constant};
    },
    .fit_order = 65,
    .only_in_place = true,
    .is_friction_law = true,
};

} // namespace tribode::effects
