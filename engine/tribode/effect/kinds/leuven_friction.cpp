#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/effect/candidate.hpp"
#include "tribode/effect/directed_law.hpp"
#include "tribode/effect/friction_law_parameters.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <memory>
#include <string>
#include <utility>

namespace tribode::effects {

namespace {

// States of each element: its deflection, and the direction in which it slips, -1, 0 or 1; then the direction of motion.
class Leuven final : public FrictionLaw {
  public:
    Leuven(std::vector<MaxwellSlipElement> elements, const DryFriction& level, double exponent, double damping,
           double viscous)
        : elements_(std::move(elements)),
          level_(level),
          exponent_(exponent),
          damping_(damping),
          viscous_(viscous) {
        for (const auto& element : elements_) stiffness_ += element.stiffness;
    }
    double friction(double v, std::span<const double> s) const override {
        return hysteresis(s) + damping_ * deflecting(v, s) + viscous_ * v;
    }
    void rates(double v, std::span<const double> s, std::span<double> dsdt) const override {
        const double rate = deflecting(v, s);
        std::ranges::fill(dsdt, 0.0);
        for (std::size_t i = 0; i < elements_.size(); ++i) dsdt[2 * i] = direction(s[2 * i + 1]) == 0 ? rate : 0;
    }
    std::size_t guard_count() const override { return elements_.size() + 1; }
    void guards(double v, std::span<const double> s, std::span<double> g) const override {
        const double rate = deflecting(v, s);
        for (std::size_t i = 0; i < elements_.size(); ++i) {
            const double z = s[2 * i], slips = direction(s[2 * i + 1]);
            g[i] = slips != 0 ? slips * rate + turning * std::abs(v)
                              : elements_[i].limit() - (rate > 0   ? z
                                                        : rate < 0 ? -z
                                                                   : 0);
        }
        g[elements_.size()] = motion::guard(v, s.back());
    }
    void on_crossing(std::size_t guard, double v, std::span<double> s) const override {
        if (guard == elements_.size()) {
            s.back() = motion::after_crossing(v, s.back());
            return;
        }
        const double rate = deflecting(v, s);
        double& slips = s[2 * guard + 1];
        slips = direction(slips) != 0 || rate == 0 ? 0 : std::copysign(1.0, rate);
    }
    double fastest_rate(double v, std::span<const double> s) const override {
        const double level = level_.level(v);
        return std::abs(v) * stiffness_ / level * exponent_ *
               std::max(1.0, std::pow(std::abs(hysteresis(s)) / level, exponent_ - 1));
    }
    std::string reason() const override { return "the friction law (leuven_friction) is not linear in its states"; }
    std::vector<StateVariable> states() const override {
        std::vector<StateVariable> states;
        for (std::size_t i = 1; i <= elements_.size(); ++i) {
            states.push_back({"deflection " + std::to_string(i) + " of leuven_friction", "m"});
            states.push_back({"direction " + std::to_string(i) + " of leuven_friction", ""});
        }
        states.push_back({"direction of leuven_friction", ""});
        return states;
    }

  private:
    // An element in slip stays there until the contact deflects back at this share of the speed: in steady motion the
    // deflection rests, and its rate is zero but for errors of integration.
    static constexpr double turning = 1e-6;

    double hysteresis(std::span<const double> s) const { // F_h [N]
        double sum = 0;
        for (std::size_t i = 0; i < elements_.size(); ++i) sum += elements_[i].stiffness * s[2 * i];
        return sum;
    }
    double deflecting(double v, std::span<const double> s) const { // z' [m/s]
        const double share = motion::way(v, s.back()) * hysteresis(s) / level_.level(v);
        return v * (1 - (exponent_ == 1 ? share : std::copysign(std::pow(std::abs(share), exponent_), share)));
    }

    std::vector<MaxwellSlipElement> elements_;
    DryFriction level_;
    double exponent_, damping_, viscous_;
    double stiffness_ = 0; // of all [N/m]
};

} // namespace

// [Swevers 2000] in the form of [Lampaert 2002]: the hysteresis with non-local memory is that of Maxwell-slip elements, which
// the deflection z of the contact drives in place of the position.
extern const EffectKind leuven_friction = {
    .name = "leuven_friction",
    .summary =
        "The contact deflects with the hysteresis of Maxwell-slip elements, and lets go at a level that falls with "
        "speed.",
    .order = 36,
    .equation = "- Fh - D z' - viscous v, z' = v (1 - share abs(share)^(transition - 1)), share = Fh sign(v)/g, Fh: "
                "Maxwell-slip elements driven by z; g = F + (Fs - F) exp(-(abs(v)/velocity)^exponent)",
    .parameters =
        {
            {.name = "elements",
             .meaning = "elements of the hysteresis; their levels sum up to Fs or more",
             .type = EffectParameter::Type::records,
             .fields = {element_stiffness_field(), element_level_field("level")}},
            friction_level_parameter("F", "Coulomb level"),
            friction_level_parameter("Fs", "static level"),
            stribeck_velocity_parameter(),
            stribeck_exponent_parameter("exponent of the Stribeck curve", 2),
            {.name = "transition",
             .meaning = "exponent of the transition to sliding, 1 or more; the higher, the later the contact lets go",
             .allowed = Allowed::positive,
             .plausible_min = 1,
             .plausible_max = 10,
             .fallback = 1},
            {.name = "D",
             .unit = "N s/m",
             .meaning = "damping of the contact",
             .allowed = Allowed::non_negative,
             .plausible_min = 0.1,
             .plausible_max = 1e4,
             .fallback = 0},
            law_viscous_parameter(),
        },
    .example = R"({"elements": [{"K": 1e5, "F": 2}, {"K": 3e4, "F": 3}], "F": 3, "Fs": 4, "velocity": 0.005,
        "transition": 2, "D": 30})",
    .affine = false,
    .drawn_against = DrawnAgainst::distance_since_reversal,
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            std::vector<MaxwellSlipElement> elements;
            double sum = 0;
            for (const auto& record : e.records("elements")) {
                elements.push_back({record[0], record[1], 0});
                sum += record[1];
            }
            constexpr double rounding = 1e-9;
            if (sum < e.number("Fs") * (1 - rounding)) {
                throw InputError(
                    fmt::format("leuven_friction: the levels of the elements sum up to {} N, must reach Fs = {} N",
                                to_text(sum), to_text(e.number("Fs"))));
            }
            if (e.number("transition") < 1) {
                throw InputError(fmt::format("leuven_friction: transition = {}, must be 1 or more",
                                             to_text(e.number("transition"))));
            }
            axis.plant.forces.push_back(std::make_shared<const Leuven>(
                std::move(elements), stribeck_level(e), e.number("transition"), e.number("D"), e.number("viscous")));
        },
    .lua = R"lua(
local turning = 1e-6
local function hysteresis(own)
  local sum = 0
  for i, e in ipairs(p.elements) do sum = sum + e.K * own["z" .. i] end
  return sum
end
local function way(s) return tb.where(tb.less(s.v, 0), -1, 1) end
local function deflecting(s, own)
  local level = p.F + (p.Fs - p.F) * math.exp(-(tb.no_event(math.abs(s.v)) / p.velocity) ^ p.exponent)
  local share = way(s) * hysteresis(own) / level
  if p.transition ~= 1 then share = share * tb.no_event(math.abs(share)) ^ (p.transition - 1) end
  return s.v * (1 - share)
end
local force = {
  states = {}, discrete = {}, when = {},
  rates = function(s, own)
    local rates, rate = {}, deflecting(s, own)
    for i in ipairs(p.elements) do
      local slips = own["slips" .. i]
      rates["z" .. i] = tb.where(tb.less(slips * slips, 0.5), rate, 0)
    end
    return rates
  end,
  force = function(s, own) return -hysteresis(own) - p.D * deflecting(s, own) - p.viscous * s.v end,
}
for i, e in ipairs(p.elements) do
  local z, slips = "z" .. i, "slips" .. i
  force.states[z], force.discrete[slips] = 0, 0
  for _, side in ipairs { 1, -1 } do
    table.insert(force.when, {
      name = "element " .. i .. " slips",
      condition = function(s, own)
        local sticks, goes = tb.less(own[slips] * own[slips], 0.5), tb.greater(side * deflecting(s, own), 0)
        return tb.all(sticks, goes, tb.greater(side * own[z], e.F / e.K))
      end,
      set = function() return { [slips] = side } end,
    })
    table.insert(force.when, {
      name = "element " .. i .. " sticks",
      condition = function(s, own)
        local turns = tb.less(side * deflecting(s, own) + turning * way(s) * s.v, 0)
        return tb.all(tb.greater(side * own[slips], 0.5), turns)
      end,
      set = function() return { [slips] = 0 } end,
    })
  end
end
m.add_force(force)
)lua",
    .is_friction_law = true,
};

} // namespace tribode::effects
