#include "tribode/effect/kinds.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

namespace tribode::effects {

namespace {

// 1 + share form(t/time)
template <class Form>
class TimeScale final : public FrictionScale {
  public:
    TimeScale(double share, double time, Form form) : share_(share), time_(time), form_(form) {}
    double factor(double t, double) const override { return std::max(0.0, 1 + share_ * form_(t / time_)); }
    double slope(double, double) const override { return 0; }
    std::string reason() const override {
        return "the friction varies with time (time_varying_friction), so that its coefficients do";
    }

  private:
    double share_, time_;
    Form form_;
};

} // namespace

// All friction, the viscous part and the elements too, times a function of time, which is never below zero.
const EffectKind time_varying_friction = {
    .name = "time_varying_friction",
    .equation = "friction times 1 + a (1 - exp(-t/T)) or, kind ramp, 1 + a t/T or, kind sine, 1 + a sin(2 pi t/T)",
    .parameters =
        {
            {.name = "kind",
             .meaning = "how the friction varies",
             .type = EffectParameter::Type::choice,
             .choices = {"exp", "ramp", "sine"}},
            {.name = "a", .meaning = "share of the friction that varies", .plausible_min = 0.02, .plausible_max = 1},
            {.name = "T",
             .unit = "s",
             .meaning = "time constant, time of the ramp or period",
             .allowed = Allowed::positive,
             .plausible_min = 0.1,
             .plausible_max = 1000},
        },
    .affine = false,
    .drawn_against = DrawnAgainst::time,
    .neutral = {{"a", 0}},
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            const double a = e.number("a"), time = e.number("T");
            const auto add = [&](auto form) {
                axis.plant.friction_scales.push_back(std::make_shared<const TimeScale<decltype(form)>>(a, time, form));
            };
            if (e.choice("kind") == "exp") {
                add([](double s) { return 1 - std::exp(-s); });
            } else if (e.choice("kind") == "ramp") {
                add([](double s) { return s; });
            } else {
                add([](double s) { return std::sin(2 * std::numbers::pi * s); });
            }
        },
};

} // namespace tribode::effects
