#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <memory>
#include <utility>

namespace tribode::effects {

namespace {

class PowerDrag final : public PointForce {
  public:
    PowerDrag(double drag, double exponent) : drag_(drag), exponent_(exponent) {}
    double force(double, double, double v, std::span<const double>) const override {
        return -drag_ * std::copysign(std::pow(std::abs(v), exponent_), v);
    }
    std::optional<Slopes> slopes(double, double, double v) const override {
        return Slopes{0, -drag_ * exponent_ * std::pow(std::abs(v), exponent_ - 1)};
    }
    std::optional<std::vector<double>> numbers() const override { return {{drag_, exponent_}}; }
    void by_numbers(double, double, double v, std::span<double> by) const override {
        by[0] = -std::copysign(std::pow(std::abs(v), exponent_), v);
        by[1] = v == 0 ? 0 : drag_ * by[0] * std::log(std::abs(v));
    }
    std::string reason() const override { return "the drag (power_drag) is not linear in the velocity"; }

  private:
    double drag_, exponent_;
};

} // namespace

// The curve of a fan or a pump against its duct. With the exponent 2 it is quadratic_drag, with 1 viscous_friction.
extern const EffectKind power_drag = {
    .name = "power_drag",
    .summary = "A drag grows with a power of the velocity, as that of fans and pumps.",
    .order = 115,
    .equation = "- c abs(v)^exponent sign(v)",
    .parameters =
        {
            {.name = "c", .unit = "N", .meaning = "drag at 1 m/s", .plausible_min = 0.1, .plausible_max = 1e4},
            {.name = "exponent",
             .meaning = "exponent, 1 or more",
             .allowed = Allowed::positive,
             .plausible_min = 1,
             .plausible_max = 4},
        },
    .example = R"({"c": 200, "exponent": 1.7})",
    .affine = false,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"c", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            const double exponent = e.number("exponent");
            if (exponent < 1) {
                throw InputError(fmt::format("power_drag: exponent = {}, must be 1 or more", to_text(exponent)));
            }
            axis.plant.forces.push_back(std::make_shared<const PowerDrag>(e.number("c"), exponent));
        },
    .lua = R"lua(
m.add_force {
  force = function(s)
    return -p.c * tb.no_event(tb.where(tb.less(s.v, 0), -1, 1) * math.abs(s.v) ^ p.exponent)
  end,
}
)lua",
    .forms = [](const Clues& clues) -> std::vector<EffectForm> {
        struct Start {
            double explained;
            std::vector<double> values;
        };
        const double typical = clues.typical_force();
        std::vector<Start> starts;
        for (const double exponent : {1.3, 1.6, 2.4, 3.0}) {
            const Signal shape =
                map(clues.velocity, [&](double v) { return -std::copysign(std::pow(std::abs(v), exponent), v); });
            const Regression fit = regress({shape}, clues.force);
            const double at_1 = typical / std::pow(clues.max_speed, exponent);
            starts.push_back({fit.explained, {std::max(fit.coefficients[0], 0.05 * at_1), exponent}});
        }
        std::ranges::sort(starts, std::greater{}, &Start::explained);
        // Between viscous friction and a drag that no fluid has; the bounds of c hold at either.
        const double slowest = std::min(clues.max_speed, 1.0), fastest = std::max(clues.max_speed, 1.0);
        return {
            {.parameters = {factor("c", 1e-3 * typical / std::pow(fastest, 4), 1e3 * typical / std::pow(slowest, 4)),
                            {"exponent", 1.1, 4, false, 1e-3}},
             .starts = {starts[0].values, starts[1].values}}};
    },
    .fit_order = 122,
    .simpler = {"quadratic_drag", "viscous_friction"},
};

} // namespace tribode::effects
