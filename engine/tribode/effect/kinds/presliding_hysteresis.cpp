#include "tribode/analysis/friction_identification.hpp"
#include "tribode/base/error.hpp"
#include "tribode/effect/candidate.hpp"
#include "tribode/effect/friction_law_parameters.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace tribode::effects {

namespace {

struct Bounds {
    double min_level, max_level, min_reach, max_reach;
    bool replace_coulomb;
};

// Elements of levels F and reaches X = F/K: values F, X of one after another.
void elements_of(std::span<const double> values, std::span<double> numbers) {
    for (std::size_t i = 0; 2 * i + 1 < values.size(); ++i) {
        numbers[3 * i] = values[2 * i] / values[2 * i + 1];
        numbers[3 * i + 1] = values[2 * i];
    }
}

EffectForm form_near(const std::vector<double>& start, const Bounds& bounds) {
    const std::size_t count = start.size() / 2;
    EffectForm form;
    form.form = fmt::format("{} elements{}", count, bounds.replace_coulomb ? " in place of the Coulomb level" : "");
    form.fixed = {{"replace_coulomb", bounds.replace_coulomb ? 1.0 : 0.0}};
    for (std::size_t i = 1; i <= count; ++i) {
        form.parameters.push_back(factor(fmt::format("elements[{}].F", i), bounds.min_level, bounds.max_level));
        form.parameters.push_back(factor(fmt::format("elements[{}].X", i), bounds.min_reach, bounds.max_reach));
    }
    form.convert = elements_of;
    form.starts = {start};
    // Each element in two, a factor of three apart: their loop is nearly that of the one.
    form.richer = [bounds](std::span<const double> p) {
        std::vector<std::vector<double>> starts;
        for (std::size_t i = 0; i < p.size(); i += 2) {
            std::vector<double> next(p.begin(), p.end());
            next[i] /= 2;
            next.push_back(next[i]);
            next.push_back(std::min(next[i + 1] * std::sqrt(3.0), bounds.max_reach));
            next[i + 1] = std::max(next[i + 1] / std::sqrt(3.0), bounds.min_reach);
            starts.push_back(std::move(next));
        }
        EffectForm more = form_near(starts.front(), bounds);
        more.starts = std::move(starts);
        return more;
    };
    return form;
}

} // namespace

// Maxwell-slip elements besides those the machine has.
extern const EffectKind presliding_hysteresis = {
    .name = "presliding_hysteresis",
    .summary = "Friction acts as springs before it slips, with a hysteresis loop at each reversal.",
    .order = 40,
    .equation = "Maxwell-slip elements added; replace_coulomb: Fc = 0",
    .parameters =
        {
            {.name = "elements",
             .meaning = "the elements",
             .type = EffectParameter::Type::records,
             .fields = {element_stiffness_field(),
                        element_level_field("half the swing of a full loop"),
                        {.name = "D",
                         .unit = "N s/m",
                         .meaning = "damping in stick",
                         .allowed = Allowed::non_negative,
                         .plausible_min = 0,
                         .plausible_max = 100,
                         .fallback = 0}}},
            {.name = "replace_coulomb",
             .meaning = "whether the Coulomb level goes, the elements being what it stood for",
             .type = EffectParameter::Type::flag,
             .fallback = 0},
        },
    .example = R"({"elements": [{"K": 1e5, "F": 2}, {"K": 1e4, "F": 2}]})",
    .affine = true,
    .drawn_against = DrawnAgainst::distance_since_reversal,
    .apply =
        [](const Effect& e, ServoAxis& axis) {
            auto elements = axis.plant.rolling.elements();
            for (const auto& record : e.records("elements")) elements.push_back({record[0], record[1], record[2]});
            axis.plant.rolling = RollingFriction(std::move(elements));
            if (!e.flag("replace_coulomb")) return;
            DryFriction& dry = axis.plant.dry;
            if (dry.stribeck) dry.stribeck->static_level -= dry.coulomb;
            dry.coulomb = 0;
        },
    .lua = R"lua(
for _, element in ipairs(p.elements) do table.insert(m.friction.elements, element) end
if p.replace_coulomb == true or p.replace_coulomb == 1 then
  m.friction.static, m.friction.coulomb = m.friction.static - m.friction.coulomb, 0
end
)lua",
    .forms =
        [](const Clues& c) {
            std::vector<EffectForm> forms;
            const Signal& d = c.force;
            const double coulomb = c.axis.plant.dry.coulomb;
            for (const bool replace : {false, true}) {
                if (replace && coulomb == 0) continue;
                Signal friction = map(d, [](double force) { return -force; });
                if (replace) {
                    for (std::size_t k = 0; k < d.size(); ++k) friction[k] += coulomb * c.direction[k];
                }
                for (const int count : {3, 5, 7}) {
                    FrictionFitOptions options;
                    options.elements = count;
                    options.shortest = 5e-7;
                    options.longest = std::max(std::min(c.stroke, 2e-3), 4e-6);
                    if (count < 7) options.break_points = FrictionFitOptions::BreakPoints::optimized;
                    std::vector<MaxwellSlipElement> elements;
                    try {
                        elements = fit_friction(c.position, friction, options).elements;
                    } catch (const InputError&) {
                        continue; // the residual force holds no friction at all
                    }
                    double sum = 0;
                    for (const auto& element : elements) sum += element.level;
                    if (elements.empty() || sum < 0.02 * c.typical_force()) continue;
                    std::vector<double> start;
                    for (const auto& element : elements) {
                        start.push_back(std::max(element.level, 1e-3 * sum));
                        start.push_back(element.limit());
                    }
                    forms.push_back(
                        form_near(start, {1e-4 * sum, 3 * c.max_force(), 5e-8, std::max(c.stroke, 1e-5), replace}));
                    if (static_cast<int>(elements.size()) < count) break;
                }
            }
            return forms;
        },
    .fit_order = 60,
    .simpler = {"coulomb_friction", "spring_force", "lugre_friction"},
};

} // namespace tribode::effects
