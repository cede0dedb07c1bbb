#include "tribode/base/constants.hpp"
#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

namespace tribode::effects {

namespace {

class Gravity final : public PointForce {
  public:
    Gravity(double force, double turn, double phase) : force_(force), wave_(two_pi / turn), phase_(phase) {}
    double force(double, double y, double, std::span<const double>) const override {
        return -force_ * std::sin(wave_ * y + phase_);
    }
    std::optional<Slopes> slopes(double, double y, double) const override {
        return Slopes{-force_ * wave_ * std::cos(wave_ * y + phase_), 0};
    }
    std::optional<std::vector<double>> numbers() const override { return {{force_, wave_, phase_}}; }
    void by_numbers(double, double y, double, std::span<double> by) const override {
        by[0] = -std::sin(wave_ * y + phase_);
        by[2] = -force_ * std::cos(wave_ * y + phase_);
        by[1] = y * by[2];
    }
    std::string reason() const override { return "the weight of an arm (gravity) is not linear in the position"; }

  private:
    double force_, wave_, phase_;
};

// From here on a stroke may be an angle in rad, over which the weight of an arm is no spring.
constexpr double min_angle = 0.5;
// Turns of more than so many strokes cannot be told from a spring.
constexpr double max_strokes = 6;

} // namespace

// The weight of a lever, in whose turn the axis moves by turn_m. A weight that pulls the same everywhere is constant_force.
extern const EffectKind gravity = {
    .name = "gravity",
    .summary = "An arm that turns with the axis has weight, or a force is periodic over more than the stroke.",
    .order = 85,
    .equation = "- F sin(2 pi y/turn_m + phase)",
    .parameters =
        {
            {.name = "F",
             .unit = "N",
             .meaning = "the largest force, where the arm is level",
             .plausible_min = 0.05,
             .plausible_max = 100},
            {.name = "turn_m",
             .unit = "m",
             .meaning = "travel for a turn of the arm; of a machine in rad 2 pi",
             .allowed = Allowed::positive,
             .plausible_min = 0.01,
             .plausible_max = 10,
             .fallback = two_pi},
            phase_parameter(),
        },
    .example = R"({"F": 5, "turn_m": 0.4, "phase": 0.3})",
    .affine = false,
    .drawn_against = DrawnAgainst::position,
    .neutral = {{"F", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.forces.push_back(
                std::make_shared<const Gravity>(e.number("F"), e.number("turn_m"), e.number("phase")));
        },
    .lua = R"lua(
m.add_force { force = function(s) return -p.F * math.sin(2 * math.pi / p.turn_m * s.y + p.phase) end }
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        if (c.stroke < 1e-6) return {};
        const double typical = c.typical_force();
        const FitParameter force = factor("F", 1e-4 * typical, 10 * c.max_force());
        struct Start {
            double explained;
            std::vector<double> values;
        };
        const auto start_at = [&](double turn) {
            const Regression fit = regress({map(c.position, [&](double y) { return -std::sin(two_pi * y / turn); }),
                                            map(c.position, [&](double y) { return -std::cos(two_pi * y / turn); })},
                                           c.force);
            const double a = fit.coefficients[0], b = fit.coefficients[1];
            return Start{fit.explained, {std::max(std::hypot(a, b), 0.05 * typical), turn, std::atan2(b, a)}};
        };
        std::vector<EffectForm> forms;
        if (c.stroke > min_angle) {
            const Start rad = start_at(two_pi);
            forms.push_back({.form = "in rad",
                             .fixed = {{"turn_m", two_pi}},
                             .parameters = {force, angle("phase")},
                             .starts = {{rad.values[0], rad.values[2]}}});
        }
        // Shorter turns, which a record shows whole, are those of a ripple.
        std::vector<Start> starts;
        for (const double strokes : {1.05, 1.5, 2.2, 3.3, 5.0}) starts.push_back(start_at(strokes * c.longest_stroke));
        std::ranges::sort(starts, std::greater{}, &Start::explained);
        forms.push_back(
            {.form = "any turn",
             .parameters = {force, factor("turn_m", c.longest_stroke, max_strokes * c.longest_stroke), angle("phase")},
             .starts = {starts[0].values, starts[1].values}});
        return forms;
    },
    .fit_order = 95,
    .simpler = {"spring_force", "constant_force"},
};

} // namespace tribode::effects
