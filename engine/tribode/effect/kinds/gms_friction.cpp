#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/effect/candidate.hpp"
#include "tribode/effect/directed_law.hpp"
#include "tribode/effect/friction_law_parameters.hpp"

#include <cmath>
#include <fmt/format.h>
#include <memory>
#include <string>
#include <utility>

namespace tribode::effects {

namespace {

struct Element {
    double stiffness, share; // [N/m], of the level
};

// States of each element: its deflection, and the direction in which it slips, -1, 0 or 1.
class GeneralizedMaxwellSlip final : public FrictionLaw {
  public:
    GeneralizedMaxwellSlip(std::vector<Element> elements, const DryFriction& level, double attraction, double viscous)
        : elements_(std::move(elements)),
          level_(level),
          attraction_(attraction),
          viscous_(viscous) {}
    double friction(double v, std::span<const double> s) const override {
        double sum = viscous_ * v;
        for (std::size_t i = 0; i < elements_.size(); ++i) sum += elements_[i].stiffness * s[2 * i];
        return sum;
    }
    void rates(double v, std::span<const double> s, std::span<double> dsdt) const override {
        const double level = level_.level(v);
        for (std::size_t i = 0; i < elements_.size(); ++i) {
            const auto [stiffness, share] = elements_[i];
            const double z = s[2 * i], slips = direction(s[2 * i + 1]);
            dsdt[2 * i] = slips == 0 ? v : attraction_ / stiffness * (slips * share - stiffness * z / level);
            dsdt[2 * i + 1] = 0;
        }
    }
    std::size_t guard_count() const override { return elements_.size(); }
    void guards(double v, std::span<const double> s, std::span<double> g) const override {
        const double level = level_.level(v);
        for (std::size_t i = 0; i < elements_.size(); ++i) {
            const auto [stiffness, share] = elements_[i];
            const double z = s[2 * i], slips = direction(s[2 * i + 1]);
            g[i] = slips != 0 ? slips * v : share * level - (v == 0 ? 0 : std::copysign(stiffness, v)) * z;
        }
    }
    void on_crossing(std::size_t guard, double v, std::span<double> s) const override {
        double& slips = s[2 * guard + 1];
        slips = direction(slips) != 0 || v == 0 ? 0 : std::copysign(1.0, v);
    }
    double fastest_rate(double v, std::span<const double>) const override { return attraction_ / level_.level(v); }
    std::string reason() const override { return "the friction law (gms_friction) is not linear in its states"; }
    std::vector<StateVariable> states() const override {
        std::vector<StateVariable> states;
        for (std::size_t i = 1; i <= elements_.size(); ++i) {
            states.push_back({"deflection " + std::to_string(i) + " of gms_friction", "m"});
            states.push_back({"direction " + std::to_string(i) + " of gms_friction", ""});
        }
        return states;
    }

  private:
    std::vector<Element> elements_;
    DryFriction level_;
    double attraction_, viscous_;
};

} // namespace

// [Al-Bender 2005], [Lampaert 2003]. With a level that does not depend on the velocity it is that of Maxwell-slip elements.
extern const EffectKind gms_friction = {
    .name = "gms_friction",
    .summary = "Maxwell-slip elements share a level that falls with speed, and follow it late.",
    .order = 34,
    .equation =
        "- sum K z - viscous v; stick: z' = v until abs(K z) = share g(v); slip, until v = 0: K z' = attraction "
        "(share sign(v) - K z/g(v)); g = F + (Fs - F) exp(-(abs(v)/velocity)^exponent)",
    .parameters =
        {
            {.name = "elements",
             .meaning = "the elements",
             .type = EffectParameter::Type::records,
             .fields = {element_stiffness_field(),
                        {.name = "share",
                         .meaning = "share of the level; the sum of all is 1",
                         .allowed = Allowed::positive,
                         .plausible_min = 0.01,
                         .plausible_max = 1}}},
            friction_level_parameter("F", "Coulomb level"),
            friction_level_parameter("Fs", "static level"),
            stribeck_velocity_parameter(),
            stribeck_exponent_parameter("exponent of the Stribeck curve", 2),
            {.name = "attraction",
             .unit = "N/s",
             .meaning = "how fast slipping elements follow the level: g/attraction is the time of their lag",
             .allowed = Allowed::positive,
             .plausible_min = 1,
             .plausible_max = 1e5},
            law_viscous_parameter(),
        },
    .example = R"({"elements": [{"K": 1e5, "share": 0.6}, {"K": 1e4, "share": 0.4}], "F": 3, "Fs": 4,
        "velocity": 0.005, "attraction": 300})",
    .affine = false,
    .drawn_against = DrawnAgainst::distance_since_reversal,
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            std::vector<Element> elements;
            double sum = 0;
            for (const auto& record : e.records("elements")) {
                elements.push_back({record[0], record[1]});
                sum += record[1];
            }
            constexpr double rounding = 1e-6; // of shares that are written with a few digits
            if (std::abs(sum - 1) > rounding) {
                throw InputError(fmt::format("gms_friction: the shares of the elements sum up to {}, must sum up to 1",
                                             to_text(sum)));
            }
            axis.plant.forces.push_back(std::make_shared<const GeneralizedMaxwellSlip>(
                std::move(elements), stribeck_level(e), e.number("attraction"), e.number("viscous")));
        },
    .lua = R"lua(
local function level(s)
  return p.F + (p.Fs - p.F) * math.exp(-(tb.no_event(math.abs(s.v)) / p.velocity) ^ p.exponent)
end
local force = {
  states = {}, discrete = {}, when = {},
  rates = function(s, own)
    local rates = {}
    for i, e in ipairs(p.elements) do
      local z, slips = own["z" .. i], own["slips" .. i]
      local slipping = p.attraction / e.K * (slips * e.share - e.K * z / level(s))
      rates["z" .. i] = tb.where(tb.less(slips * slips, 0.5), s.v, slipping)
    end
    return rates
  end,
  force = function(s, own)
    local sum = -p.viscous * s.v
    for i, e in ipairs(p.elements) do sum = sum - e.K * own["z" .. i] end
    return sum
  end,
}
for i, e in ipairs(p.elements) do
  local z, slips = "z" .. i, "slips" .. i
  force.states[z], force.discrete[slips] = 0, 0
  for _, side in ipairs { 1, -1 } do
    -- Sticks and goes that way: no further than its share of the level.
    table.insert(force.when, {
      name = "element " .. i .. " slips",
      condition = function(s, own)
        local sticks = tb.less(own[slips] * own[slips], 0.5)
        local goes = tb.greater(side * s.v, 0)
        return tb.all(sticks, goes, tb.greater(side * e.K * own[z], e.share * level(s)))
      end,
      set = function() return { [slips] = side } end,
    })
    table.insert(force.when, {
      name = "element " .. i .. " sticks",
      condition = function(s, own) return tb.all(tb.greater(side * own[slips], 0.5), tb.less(side * s.v, 0)) end,
      set = function() return { [slips] = 0 } end,
    })
  end
end
m.add_force(force)
)lua",
    .is_friction_law = true,
};

} // namespace tribode::effects
