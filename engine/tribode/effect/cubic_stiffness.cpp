#include "tribode/effect/kinds.hpp"

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
    std::string reason() const override { return "the cubic spring (cubic_stiffness) is not linear in the position"; }

  private:
    double stiffness_, relaxed_;
};

} // namespace

const EffectKind cubic_stiffness = {
    .name = "cubic_stiffness",
    .equation = "- k3 (y - y0)^3",
    .parameters =
        {
            {.name = "k3", .unit = "N/m^3", .meaning = "stiffness", .plausible_min = 1, .plausible_max = 1e8},
            {.name = "y0",
             .unit = "m",
             .meaning = "where it is relaxed",
             .plausible_min = 0,
             .plausible_max = 0.5,
             .fallback = 0},
        },
    .affine = false,
    .drawn_against = DrawnAgainst::position,
    .neutral = {{"k3", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.forces.push_back(std::make_shared<const CubicSpring>(e.number("k3"), e.number("y0")));
        },
};

} // namespace tribode::effects
