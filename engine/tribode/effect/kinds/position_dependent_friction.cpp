#include "tribode/base/constants.hpp"
#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

namespace tribode::effects {

namespace {

constexpr const char* not_linear =
    "the friction depends on the position (position_dependent_friction), so that its force "
    "is not linear in it";

class SineScale final : public FrictionScale {
  public:
    SineScale(double share, double wave, double phase) : share_(share), wave_(wave), phase_(phase) {}
    double factor(double, double y) const override { return std::max(0.0, 1 + share_ * std::sin(wave_ * y + phase_)); }
    double slope(double, double y) const override { return share_ * wave_ * std::cos(wave_ * y + phase_); }
    std::optional<std::vector<double>> numbers() const override { return {{share_, wave_, phase_}}; }
    void by_numbers(double, double y, std::span<double> by) const override {
        by[0] = std::sin(wave_ * y + phase_);
        by[2] = share_ * std::cos(wave_ * y + phase_);
        by[1] = y * by[2];
    }
    std::string reason() const override { return not_linear; }

  private:
    double share_, wave_, phase_;
};

class GradientScale final : public FrictionScale {
  public:
    GradientScale(double share, double length) : share_(share), length_(length) {}
    double factor(double, double y) const override {
        return std::max(0.0, 1 + share_ * std::clamp(y / length_, -1.0, 1.0));
    }
    double slope(double, double y) const override { return std::abs(y) < length_ ? share_ / length_ : 0; }
    std::optional<std::vector<double>> numbers() const override { return {{share_, length_}}; }
    void by_numbers(double, double y, std::span<double> by) const override {
        by[0] = std::clamp(y / length_, -1.0, 1.0);
        by[1] = std::abs(y) < length_ ? -share_ * y / (length_ * length_) : 0;
    }
    std::string reason() const override { return not_linear; }

  private:
    double share_, length_;
};

} // namespace

// All friction, the viscous part and the elements too, times a function of the position, which is never below zero.
extern const EffectKind position_dependent_friction = {
    .name = "position_dependent_friction",
    .summary = "Friction varies along the travel.",
    .order = 60,
    .equation = "friction times 1 + a sin(2 pi y/period_m + phase) or, mode gradient, 1 + a clip(y/period_m, -1, 1)",
    .parameters =
        {
            {.name = "mode",
             .meaning = "how the friction varies",
             .type = EffectParameter::Type::choice,
             .choices = {"sine", "gradient"}},
            {.name = "a", .meaning = "share of the friction that varies", .plausible_min = 0.02, .plausible_max = 1},
            {.name = "period_m",
             .unit = "m",
             .meaning = "period, or the length of the gradient",
             .allowed = Allowed::positive,
             .plausible_min = 1e-3,
             .plausible_max = 1},
            phase_parameter(),
        },
    .example = R"({"mode": "sine", "a": 0.5, "period_m": 0.02})",
    .affine = false,
    .drawn_against = DrawnAgainst::position,
    .neutral = {{"a", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            const double wave = two_pi / e.number("period_m");
            if (e.choice("mode") == "sine") {
                axis.plant.friction_scales.push_back(
                    std::make_shared<const SineScale>(e.number("a"), wave, e.number("phase")));
            } else {
                axis.plant.friction_scales.push_back(
                    std::make_shared<const GradientScale>(e.number("a"), e.number("period_m")));
            }
        },
    .lua = R"lua(
if p.mode == "sine" then
  m.scale_friction(function(_, y) return 1 + p.a * math.sin(2 * math.pi / p.period_m * y + p.phase) end)
else
  m.scale_friction(function(_, y) return 1 + p.a * math.max(-1, math.min(1, y / p.period_m)) end)
end
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        if (!c.has_friction() || c.stroke < 1e-6) return {};
        const Signal friction = map(c.residual.friction, [](double f) { return -f; });
        std::vector<std::vector<double>> sines, gradients;
        for (const auto& one : sinusoids(c.position, c.force, friction, c.shortest_period, 1.5 * c.stroke, 3)) {
            sines.push_back({std::clamp(one.amplitude, 0.03, 0.9), one.period, one.phase});
        }
        for (const double period : {1.2 * c.reach, 0.5 * c.reach}) {
            Signal shape(c.position.size());
            for (std::size_t k = 0; k < shape.size(); ++k) {
                shape[k] = friction[k] * std::clamp(c.position[k] / period, -1.0, 1.0);
            }
            gradients.push_back({std::clamp(regress({shape}, c.force).coefficients[0], -2.0, 2.0), period});
        }
        return {{.form = "sine",
                 .fixed = {{"mode", "sine"}},
                 .parameters = {{"a", 0, 3, false, 1e-3},
                                factor("period_m", c.shortest_period, 3 * c.stroke),
                                angle("phase")},
                 .starts = sines},
                {.form = "gradient",
                 .fixed = {{"mode", "gradient"}},
                 .parameters = {{"a", -5, 5, false, 1e-3}, factor("period_m", 0.05 * c.reach, 20 * c.reach)},
                 .starts = gradients}};
    },
    .fit_order = 70,
    .simpler = {"coulomb_friction", "viscous_friction"},
};

} // namespace tribode::effects
