#include "tribode/base/constants.hpp"
#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

namespace tribode::effects {

namespace {

// 1 + share form(t/time); form.slope is its derivative.
template <class Form>
class TimeScale final : public FrictionScale {
  public:
    TimeScale(double share, double time, Form form) : share_(share), time_(time), form_(form) {}
    double factor(double t, double) const override { return std::max(0.0, 1 + share_ * form_(t / time_)); }
    double slope(double, double) const override { return 0; }
    std::optional<std::vector<double>> numbers() const override { return {{share_, time_}}; }
    void by_numbers(double t, double, std::span<double> by) const override {
        by[0] = form_(t / time_);
        by[1] = -share_ * form_.slope(t / time_) * t / (time_ * time_);
    }
    std::string reason() const override {
        return "the friction varies with time (time_varying_friction), so that its coefficients do";
    }

  private:
    double share_, time_;
    Form form_;
};

struct Saturating {
    double operator()(double s) const { return 1 - std::exp(-s); }
    double slope(double s) const { return std::exp(-s); }
};

struct Ramp {
    double operator()(double s) const { return s; }
    double slope(double) const { return 1; }
};

struct Sine {
    double operator()(double s) const { return std::sin(two_pi * s); }
    double slope(double s) const { return two_pi * std::cos(two_pi * s); }
};

} // namespace

// All friction, the viscous part and the elements too, times a function of time, which is never below zero.
extern const EffectKind time_varying_friction = {
    .name = "time_varying_friction",
    .summary = "Friction changes with time, such as on a cold start.",
    .order = 70,
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
    .example = R"({"kind": "exp", "a": 0.8, "T": 1})",
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
                add(Saturating{});
            } else if (e.choice("kind") == "ramp") {
                add(Ramp{});
            } else {
                add(Sine{});
            }
        },
    .lua = R"lua(
local forms = {
  exp = function(x) return 1 - math.exp(-x) end,
  ramp = function(x) return x end,
  sine = function(x) return math.sin(2 * math.pi * x) end,
}
m.scale_friction(function(t) return 1 + p.a * forms[p.kind](t / p.T) end)
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        if (!c.has_friction()) return {};
        const Signal& t = c.residual.time;
        const Signal friction = map(c.residual.friction, [](double f) { return -f; });
        const auto size_of = [&](const auto& shape) {
            Signal column(t.size());
            for (std::size_t k = 0; k < t.size(); ++k) column[k] = friction[k] * shape(t[k]);
            return regress({column}, c.force);
        };
        using Points = std::vector<std::pair<double, std::vector<double>>>; // share explained, start
        const auto best_two = [](Points points) -> std::vector<std::vector<double>> {
            std::sort(points.rbegin(), points.rend());
            return {points[0].second, points[1].second};
        };
        Points exponentials, sines;
        for (const double T : geometric(0.05 * c.duration, 2 * c.duration, 6)) {
            const Regression fit = size_of([T](double at) { return 1 - std::exp(-at / T); });
            exponentials.push_back({fit.explained, {std::clamp(fit.coefficients[0], -0.9, 3.0), T}});
        }
        constexpr double ramp = 10; // [s]: of a ramp only a/T shows
        const double slope = size_of([](double at) { return at / ramp; }).coefficients[0];
        // Between two of these periods the phase at the end of the record differs by a quarter of a turn. The residual force is also that of
        // other friction: simulations tell more of the best.
        constexpr int quarters = 40, simulated = 12;
        for (int n = 2; n <= quarters; ++n) {
            const double T = 4 * c.duration / n;
            const Regression fit = size_of([T](double at) { return std::sin(two_pi * at / T); });
            sines.push_back({fit.explained, {std::clamp(fit.coefficients[0], -0.9, 0.9), T}});
        }
        std::sort(sines.rbegin(), sines.rend());
        std::vector<std::vector<double>> waves;
        for (int i = 0; i < simulated; ++i) {
            for (const double a : {-0.3, 0.3}) waves.push_back({a, sines[static_cast<std::size_t>(i)].second[1]});
        }
        return {{.form = "exp",
                 .fixed = {{"kind", "exp"}},
                 .parameters = {{"a", -0.98, 10, false, 1e-3}, factor("T", 0.01 * c.duration, 10 * c.duration)},
                 .starts = best_two(exponentials)},
                {.form = "ramp",
                 .fixed = {{"kind", "ramp"}, {"T", ramp}},
                 .parameters = {{"a", -0.98 * ramp / c.duration, 100, false, 1e-3}},
                 .starts = {{slope}}},
                {.form = "sine",
                 .fixed = {{"kind", "sine"}},
                 .parameters = {{"a", -0.99, 0.99, false, 1e-3}, factor("T", 0.02 * c.duration, 4 * c.duration)},
                 .starts = best_two(sines),
                 .probes = waves,
                 .size = 0,
                 .tried = 3}};
    },
    .fit_order = 80,
    .simpler = {"coulomb_friction", "viscous_friction"},
};

} // namespace tribode::effects
