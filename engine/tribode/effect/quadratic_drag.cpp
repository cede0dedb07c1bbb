#include "tribode/effect/kinds.hpp"

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
    std::string reason() const override { return "the drag (quadratic_drag) is not linear in the velocity"; }

  private:
    double drag_;
};

} // namespace

const EffectKind quadratic_drag = {
    .name = "quadratic_drag",
    .equation = "- c v abs(v)",
    .parameters =
        {
            {.name = "c", .unit = "N s^2/m^2", .meaning = "drag", .plausible_min = 0.1, .plausible_max = 2000},
        },
    .affine = false,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"c", 0}},
    .apply = [](const Effect& e,
                ServoAxis& axis) { axis.plant.forces.push_back(std::make_shared<const QuadraticDrag>(e.number("c"))); },
};

} // namespace tribode::effects
