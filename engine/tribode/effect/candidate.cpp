#include "tribode/effect/candidate.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <stdexcept>

namespace tribode {

FitParameter factor(std::string name, double low, double high) { return {std::move(name), low, high, true, 1e-3}; }
FitParameter angle(std::string name) { return {std::move(name), -1e3, 1e3, false, 1e-3}; }

static std::logic_error unknown(const EffectKind& kind, const std::string& name) {
    return std::logic_error(
        fmt::format("effect {}: a form names {}, which is none of its parameters", kind.name, name));
}

// The effect with as many records as the parameters of the form name, and with what the form fixes but numbers.
static Effect shape_of(const EffectKind& kind, const EffectForm& form) {
    std::vector<Effect::Value> values = Effect(kind).values();
    for (std::size_t i = 0; i < values.size(); ++i) {
        const EffectParameter& p = kind.parameters[i];
        std::size_t records = 0;
        for (const auto& fitted : form.parameters) {
            if (p.type != EffectParameter::Type::records || !fitted.name.starts_with(p.name + "[")) continue;
            records = std::max<std::size_t>(records, std::stoul(fitted.name.substr(p.name.size() + 1)));
        }
        std::vector<double> defaults;
        for (const auto& field : p.fields) defaults.push_back(field.fallback.value_or(0));
        values[i].records.assign(records, defaults);
        for (const auto& [name, value] : form.fixed) {
            if (name != p.name) continue;
            if (const auto* choice = std::get_if<std::string>(&value)) {
                const auto it = std::find(p.choices.begin(), p.choices.end(), *choice);
                if (it == p.choices.end()) throw unknown(kind, name + " = " + *choice);
                values[i].number = static_cast<double>(it - p.choices.begin());
            } else {
                values[i].number = std::get<double>(value);
            }
        }
    }
    return Effect(kind, std::move(values));
}

Candidate::Candidate(const EffectKind& kind, EffectForm described)
    : EffectForm(std::move(described)),
      shape_(shape_of(kind, *this)),
      numbers_(shape_.numbers()) {
    for (const auto& [name, value] : fixed) {
        const auto has_name = [&name = name](const EffectParameter& p) { return p.name == name; };
        if (std::none_of(kind.parameters.begin(), kind.parameters.end(), has_name)) throw unknown(kind, name);
    }
    if (convert) return;
    const auto names = shape_.number_names();
    for (const auto& parameter : parameters) {
        const auto it = std::find(names.begin(), names.end(), parameter.name);
        if (it == names.end()) throw unknown(kind, parameter.name);
        places_.push_back(static_cast<std::size_t>(it - names.begin()));
    }
}

std::vector<double> Candidate::numbers_at(std::span<const double> values) const {
    std::vector<double> numbers = numbers_;
    if (convert) {
        convert(values, numbers);
    } else {
        for (std::size_t i = 0; i < values.size(); ++i) numbers[places_[i]] = values[i];
    }
    return numbers;
}

Effect Candidate::at(std::span<const double> values) const {
    Effect effect = shape_.with_numbers(numbers_at(values));
    effect.require_allowed();
    return effect;
}

std::shared_ptr<const Candidate> Candidate::richer_near(std::span<const double> values) const {
    return richer ? std::make_shared<const Candidate>(kind(), richer(values)) : nullptr;
}

std::vector<Candidate> candidates(const Clues& clues, const std::function<bool(const EffectKind&)>& wanted) {
    std::vector<const EffectKind*> kinds;
    for (const auto* kind : effect_kinds()) {
        if (kind->forms && wanted(*kind)) kinds.push_back(kind);
    }
    std::stable_sort(kinds.begin(), kinds.end(),
                     [](const auto* a, const auto* b) { return a->fit_order < b->fit_order; });
    std::vector<Candidate> list;
    for (const auto* kind : kinds) {
        for (auto& form : kind->forms(clues)) {
            for (auto* points : {&form.starts, &form.probes}) {
                for (auto& point : *points) {
                    for (std::size_t i = 0; i < point.size(); ++i) {
                        const auto& p = form.parameters[i];
                        const double room = p.logarithmic ? 0 : 1e-6 * (p.high - p.low);
                        point[i] = std::clamp(point[i], p.low + room, p.high - room);
                    }
                }
            }
            if (!form.starts.empty() || !form.probes.empty()) list.emplace_back(*kind, std::move(form));
        }
    }
    return list;
}

} // namespace tribode
