#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

namespace tribode::effects {

namespace {

class CubicSpring final : public PointForce {
  public:
    CubicSpring(double stiffness, double relaxed) : stiffness_(stiffness), relaxed_(relaxed) {}
    double force(double, double y, double, std::span<const double>) const override {
        const double d = y - relaxed_;
        return -stiffness_ * d * d * d;
    }
    std::optional<Slopes> slopes(double, double y, double) const override {
        const double d = y - relaxed_;
        return Slopes{-3 * stiffness_ * d * d, 0};
    }
    std::optional<std::vector<double>> numbers() const override { return {{stiffness_, relaxed_}}; }
    void by_numbers(double, double y, double, std::span<double> by) const override {
        const double d = y - relaxed_;
        by[0] = -d * d * d;
        by[1] = 3 * stiffness_ * d * d;
    }
    std::string reason() const override { return "the cubic spring (cubic_stiffness) is not linear in the position"; }

  private:
    double stiffness_, relaxed_;
};

} // namespace

extern const EffectKind cubic_stiffness = {
    .name = "cubic_stiffness",
    .summary = "A spring pulls with the cube of its deflection.",
    .order = 110,
    .equation = "- k3 (y - y0)^3",
    .parameters =
        {
            {.name = "k3", .unit = "N/m^3", .meaning = "stiffness", .plausible_min = 1, .plausible_max = 1e8},
            relaxed_position(),
        },
    .example = R"({"k3": 1e6})",
    .affine = false,
    .drawn_against = DrawnAgainst::position,
    .neutral = {{"k3", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.forces.push_back(std::make_shared<const CubicSpring>(e.number("k3"), e.number("y0")));
        },
    .lua = R"lua(
m.add_force { force = function(s) return -p.k3 * (s.y - p.y0) ^ 3 end }
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        const double typical = c.typical_force() / std::pow(c.reach, 3);
        const auto fit_about = [&c](double y0) {
            return regress({map(c.position, [y0](double y) { return -std::pow(y - y0, 3); })}, c.force);
        };
        struct Start {
            double explained, k3, y0;
        };
        std::vector<Start> starts;
        for (int i = 0; i <= 12; ++i) {
            const double y0 = c.min_position - 0.25 * c.stroke + c.stroke * 1.5 * i / 12;
            const Regression fit = fit_about(y0);
            starts.push_back({fit.explained, fit.coefficients[0], y0});
        }
        std::sort(starts.begin(), starts.end(), [](const auto& a, const auto& b) { return a.explained > b.explained; });
        const auto noticeable = [typical](double k3) { return Clues::at_least(0.02 * typical, k3); };
        const FitParameter k3{"k3", -1e3 * typical, 1e3 * typical, false, 1e-3 * typical};
        const FitParameter y0{"y0", c.min_position - c.stroke, c.max_position + c.stroke, false, 1e-3 * c.stroke};
        return {{.form = "about zero", .parameters = {k3}, .starts = {{noticeable(fit_about(0).coefficients[0])}}},
                {.parameters = {k3, y0}, .starts = {{noticeable(starts[0].k3), starts[0].y0}}}};
    },
    .fit_order = 110,
};

} // namespace tribode::effects
