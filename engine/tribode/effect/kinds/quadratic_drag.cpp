#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

namespace tribode::effects {

namespace {

class QuadraticDrag final : public PointForce {
  public:
    explicit QuadraticDrag(double drag) : drag_(drag) {}
    double force(double, double, double v, std::span<const double>) const override { return -drag_ * v * std::abs(v); }
    std::optional<Slopes> slopes(double, double, double v) const override {
        return Slopes{0, -2 * drag_ * std::abs(v)};
    }
    std::optional<std::vector<double>> numbers() const override { return {{drag_}}; }
    void by_numbers(double, double, double v, std::span<double> by) const override { by[0] = -v * std::abs(v); }
    std::string reason() const override { return "the drag (quadratic_drag) is not linear in the velocity"; }

  private:
    double drag_;
};

} // namespace

extern const EffectKind quadratic_drag = {
    .name = "quadratic_drag",
    .summary = "A drag grows with the square of the velocity.",
    .order = 120,
    .equation = "- c v abs(v)",
    .parameters =
        {
            {.name = "c", .unit = "N s^2/m^2", .meaning = "drag", .plausible_min = 0.1, .plausible_max = 2000},
        },
    .example = R"({"c": 300})",
    .affine = false,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"c", 0}},
    .apply = [](const Effect& e,
                ServoAxis& axis) { axis.plant.forces.push_back(std::make_shared<const QuadraticDrag>(e.number("c"))); },
    .lua = R"lua(
m.add_force { force = function(s) return -p.c * s.v * tb.no_event(math.abs(s.v)) end }
)lua",
    .forms = [](const Clues& clues) -> std::vector<EffectForm> {
        const Signal shape = map(clues.velocity, [](double v) { return v * std::abs(v); });
        const double c = -regress({shape}, clues.force).coefficients[0];
        const double typical = clues.typical_force() / (clues.max_speed * clues.max_speed);
        return {{.parameters = {{"c", -0.2 * std::abs(c) - typical, 1e3 * typical, false, 1e-3 * typical}},
                 .starts = {{std::max(c, 0.02 * typical)}}}};
    },
    .fit_order = 120,
};

} // namespace tribode::effects
