#include "tribode/base/constants.hpp"
#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>

namespace tribode::effects {

namespace {

class ForceRipple final : public PointForce {
  public:
    explicit ForceRipple(const std::vector<std::vector<double>>& harmonics) {
        for (const auto& h : harmonics) harmonics_.push_back({h[0], two_pi / h[1], h[2]});
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
    std::optional<std::vector<double>> numbers() const override {
        std::vector<double> all;
        for (const auto& h : harmonics_) all.insert(all.end(), {h.amplitude, h.wave, h.phase});
        return all;
    }
    void by_numbers(double, double y, double, std::span<double> by) const override {
        double* next = by.data();
        for (const auto& h : harmonics_) {
            const double by_phase = h.amplitude * std::cos(h.wave * y + h.phase);
            *next++ = std::sin(h.wave * y + h.phase);
            *next++ = y * by_phase;
            *next++ = by_phase;
        }
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
extern const EffectKind force_ripple = {
    .name = "force_ripple",
    .summary = "A force is periodic in position, such as cogging.",
    .order = 80,
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
                        phase_parameter()}},
        },
    .example = R"({"harmonics": [{"F": 3, "period_m": 0.012}]})",
    .affine = false,
    .drawn_against = DrawnAgainst::position,
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            axis.plant.forces.push_back(std::make_shared<const ForceRipple>(e.records("harmonics")));
        },
    .lua = R"lua(
m.add_force {
  force = function(s)
    local sum = 0
    for _, h in ipairs(p.harmonics) do sum = sum + h.F * math.sin(2 * math.pi / h.period_m * s.y + h.phase) end
    return sum
  end,
}
)lua",
    .forms = [](const Clues& c) -> std::vector<EffectForm> {
        if (c.stroke < 1e-6) return {};
        // Longer periods are those of the weight of an arm (gravity), but for a ripple of which a harmonic shows. Of periods that
        // this record does not show whole, the amplitude is a guess.
        const double shortest = c.shortest_period, longest = c.longest_stroke, longest_of_two = 2 * longest;
        const double typical = c.typical_force();
        const auto start = [&](const Sinusoid& found, double least) -> std::vector<double> {
            return {std::clamp(found.amplitude, least * typical, c.max_force()), found.period, found.phase};
        };
        std::vector<std::vector<double>> one, two;
        for (const auto& found : sinusoids(c.position, c.force, {}, shortest, longest, 3)) {
            one.push_back(start(found, 0.05));
        }
        for (const auto& first : sinusoids(c.position, c.force, {}, shortest, longest_of_two, 3)) {
            Signal rest = c.force;
            for (std::size_t k = 0; k < rest.size(); ++k) {
                rest[k] -= first.amplitude * std::sin(two_pi * c.position[k] / first.period + first.phase);
            }
            for (const auto& second : sinusoids(c.position, rest, {}, shortest, longest, 1)) {
                two.push_back(start(first, 0.05));
                std::ranges::copy(start(second, 0.01), std::back_inserter(two.back()));
            }
        }
        if (two.size() > 2) two.resize(2);
        const auto harmonic = [&](const std::string& name, double longest_period) -> std::vector<FitParameter> {
            return {factor(name + ".F", 1e-4 * typical, c.max_force()),
                    factor(name + ".period_m", shortest, longest_period), angle(name + ".phase")};
        };
        auto both = harmonic("harmonics[1]", longest_of_two);
        std::ranges::move(harmonic("harmonics[2]", longest), std::back_inserter(both));
        return {{.form = "one harmonic", .parameters = harmonic("harmonics[1]", longest), .starts = one},
                {.form = "two harmonics", .parameters = std::move(both), .starts = two}};
    },
    .fit_order = 90,
};

} // namespace tribode::effects
