#include "tribode/effect/kinds.hpp"

#include <cmath>
#include <memory>
#include <numbers>

namespace tribode::effects {

namespace {

class ForceRipple final : public PointForce {
  public:
    explicit ForceRipple(const std::vector<std::vector<double>>& harmonics) {
        for (const auto& h : harmonics) harmonics_.push_back({h[0], 2 * std::numbers::pi / h[1], h[2]});
    }
    double force(double, double y, double, std::span<const double>) const override {
        double sum = 0;
        for (const auto& h : harmonics_) sum += h.amplitude * std::sin(h.wave * y + h.phase);
        return sum;
    }
    std::optional<Slopes> slopes(double, double y, double) const override {
        Slopes sum;
        for (const auto& h : harmonics_) sum.position += h.amplitude * h.wave * std::cos(h.wave * y + h.phase);
        return sum;
    }
    std::string reason() const override { return "the force ripple (force_ripple) is not linear in the position"; }

  private:
    struct Harmonic {
        double amplitude, wave, phase;
    };
    std::vector<Harmonic> harmonics_;
};

} // namespace

// Cogging: a force that is periodic in the position, added to the motor's.
const EffectKind force_ripple = {
    .name = "force_ripple",
    .equation = "sum of F sin(2 pi y/period_m + phase) added to Fm",
    .parameters =
        {
            {.name = "harmonics",
             .meaning = "the harmonics",
             .type = EffectParameter::Type::records,
             .fields = {{.name = "F", .unit = "N", .meaning = "amplitude", .plausible_min = 0.05, .plausible_max = 50},
                        {.name = "period_m",
                         .unit = "m",
                         .meaning = "period",
                         .allowed = Allowed::positive,
                         .plausible_min = 1e-4,
                         .plausible_max = 1},
                        {.name = "phase",
                         .unit = "rad",
                         .meaning = "phase",
                         .plausible_min = 0,
                         .plausible_max = 6.2832,
                         .fallback = 0}}},
        },
    .affine = false,
    .drawn_against = DrawnAgainst::position,
    .neutral = {},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.forces.push_back(std::make_shared<const ForceRipple>(e.records("harmonics")));
        },
};

} // namespace tribode::effects
