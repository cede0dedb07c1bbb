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

// Amplitude, period and phase of the first harmonic, amplitude and phase of the second. A period longer than the stroke is that of a
// ripple, not of the weight of an arm, where its half shows whole.
void with_half_the_period(std::span<const double> values, std::span<double> numbers) {
    std::ranges::copy(values.first(4), numbers.begin());
    numbers[4] = values[1] / 2;
    numbers[5] = values[4];
}

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
        // Longer periods are those of the weight of an arm (gravity). Of periods that this record does not show whole, the amplitude
        // is a guess.
        const double shortest = c.shortest_period, longest = c.longest_stroke, typical = c.typical_force();
        const auto start = [&](const Sinusoid& found, double least) -> std::vector<double> {
            return {std::clamp(found.amplitude, least * typical, c.max_force()), found.period, found.phase};
        };
        std::vector<std::vector<double>> one, two;
        for (const auto& first : sinusoids(c.position, c.force, {}, shortest, longest, 3)) {
            one.push_back(start(first, 0.05));
            Signal rest = c.force;
            for (std::size_t k = 0; k < rest.size(); ++k) {
                rest[k] -= first.amplitude * std::sin(two_pi * c.position[k] / first.period + first.phase);
            }
            for (const auto& second : sinusoids(c.position, rest, {}, shortest, longest, 1)) {
                two.push_back(one.back());
                std::ranges::copy(start(second, 0.01), std::back_inserter(two.back()));
            }
        }
        if (two.size() > 2) two.resize(2);
        const auto harmonics = [&](std::initializer_list<const char*> names) {
            std::vector<FitParameter> parameters;
            for (const std::string name : names) {
                parameters.push_back(factor(name + ".F", 1e-4 * typical, c.max_force()));
                parameters.push_back(factor(name + ".period_m", shortest, longest));
                parameters.push_back(angle(name + ".phase"));
            }
            return parameters;
        };
        EffectForm long_one{.form = "a longer period and half of it",
                            .parameters = harmonics({"harmonics[1]", "harmonics[2]"}),
                            .convert = with_half_the_period};
        long_one.parameters.erase(long_one.parameters.begin() + 4);
        long_one.parameters[1] = factor("harmonics[1].period_m", longest, 2 * longest);
        for (const double strokes : {1.02, 1.2, 1.5}) {
            const double period = strokes * longest;
            std::vector<Signal> waves;
            for (const double wave : {two_pi / period, 2 * two_pi / period}) {
                waves.push_back(map(c.position, [wave](double y) { return std::sin(wave * y); }));
                waves.push_back(map(c.position, [wave](double y) { return std::cos(wave * y); }));
            }
            const auto a = regress(waves, c.force).coefficients;
            const auto size = [&](double x, double y) {
                return std::clamp(std::hypot(x, y), 0.01 * typical, c.max_force());
            };
            long_one.starts.push_back(
                {size(a[0], a[1]), period, std::atan2(a[1], a[0]), size(a[2], a[3]), std::atan2(a[3], a[2])});
        }
        return {{.form = "one harmonic", .parameters = harmonics({"harmonics[1]"}), .starts = one},
                {.form = "two harmonics", .parameters = harmonics({"harmonics[1]", "harmonics[2]"}), .starts = two},
                std::move(long_one)};
    },
    .fit_order = 90,
    .simpler = {"gravity"}, // of a period longer than the stroke
};

} // namespace tribode::effects
