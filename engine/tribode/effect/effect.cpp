#include "tribode/effect/effect.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_path.hpp"
#include "tribode/base/text.hpp"
#include "tribode/effect/built_in_kinds.hpp"

#include <algorithm>
#include <atomic>
#include <cassert>
#include <fmt/format.h>

namespace tribode {

std::string_view name_of(DrawnAgainst axis) {
    switch (axis) {
    case DrawnAgainst::position: return "position";
    case DrawnAgainst::velocity: return "velocity";
    case DrawnAgainst::time: return "time";
    case DrawnAgainst::thrust: return "thrust";
    case DrawnAgainst::distance_since_reversal: return "distance since reversal";
    case DrawnAgainst::frequency: return "frequency";
    }
    return "";
}

EffectParameter phase_parameter(std::string name) {
    return {.name = std::move(name),
            .unit = "rad",
            .meaning = "phase",
            .plausible_min = 0,
            .plausible_max = 6.2832,
            .fallback = 0};
}

EffectParameter relaxed_position() {
    return {.name = "y0",
            .unit = "m",
            .meaning = "where it is relaxed",
            .plausible_min = 0,
            .plausible_max = 0.5,
            .fallback = 0};
}

static std::atomic<ForceCompiler> compiler = nullptr;
void set_force_compiler(ForceCompiler now) { compiler = now; }
ForceCompiler force_compiler() { return compiler; }

static void insert_in_order(std::vector<const EffectKind*>& kinds, const EffectKind& kind) {
    const auto before = [](const EffectKind* a, const EffectKind* b) { return a->order < b->order; };
    kinds.insert(std::upper_bound(kinds.begin(), kinds.end(), &kind, before), &kind);
}

static std::vector<const EffectKind*>& registered_kinds() {
    static std::vector<const EffectKind*> kinds = [] {
        std::vector<const EffectKind*> built_in;
        for (const auto* kind : built_in_kinds()) insert_in_order(built_in, *kind);
        return built_in;
    }();
    return kinds;
}

const std::vector<const EffectKind*>& effect_kinds() { return registered_kinds(); }

static std::vector<std::string> kind_names() {
    std::vector<std::string> names;
    for (const auto* kind : effect_kinds()) names.push_back(kind->name);
    return names;
}

static const EffectKind* find_kind(std::string_view name) {
    for (const auto* kind : effect_kinds()) {
        if (kind->name == name) return kind;
    }
    return nullptr;
}

const EffectKind& effect_kind(std::string_view name) {
    if (const auto* kind = find_kind(name)) return *kind;
    throw InputError(fmt::format("effect \"{}\" is not known{}", name, suggestion(name, kind_names())));
}

void register_effect(const EffectKind& kind) {
    if (kind.name.empty() || find_kind(kind.name)) {
        throw InputError(fmt::format("effect \"{}\" cannot be registered, must have a name of its own", kind.name));
    }
    insert_in_order(registered_kinds(), kind);
}

std::string EffectKind::unit_of(std::string_view path) const {
    const auto dot = path.rfind('.');
    const std::string_view last = dot == std::string_view::npos ? path : path.substr(dot + 1);
    for (const auto& parameter : parameters) {
        if (parameter.name == last) return parameter.unit;
        for (const auto& field : parameter.fields) {
            if (field.name == last) return field.unit;
        }
    }
    return "";
}

Effect::Effect(const EffectKind& kind) : kind_(&kind) {
    for (const auto& p : kind.parameters) {
        Value& value = values_.emplace_back(Value{.number = p.fallback.value_or(0)});
        if (p.type == EffectParameter::Type::text) value.texts = {""};
    }
}

Effect::Effect(const EffectKind& kind, std::vector<Value> values) : kind_(&kind), values_(std::move(values)) {
    assert(values_.size() == kind.parameters.size());
}

Effect Effect::begin(FieldReader& fields) {
    const std::string name = fields.text("name");
    const EffectKind* kind = find_kind(name);
    if (!kind) {
        fields.fail("name", fmt::format("= \"{}\" is not a known effect{}", name, suggestion(name, kind_names())));
    }
    Effect effect(*kind);
    for (std::size_t i = 0; i < kind->parameters.size(); ++i) {
        const auto& p = kind->parameters[i];
        if (p.type == EffectParameter::Type::choice && !p.fallback) effect.values_[i].number = -1; // none yet
    }
    return effect;
}

Effect Effect::read(FieldReader& fields) {
    Effect effect = begin(fields);
    read_options(effect, fields);
    return effect;
}

double Effect::place_of(const std::string& name, const std::vector<std::string>& names) {
    const auto it = std::find(names.begin(), names.end(), name);
    return it == names.end() ? -1 : static_cast<double>(it - names.begin());
}

std::vector<double> Effect::defaults_of(const std::vector<EffectParameter>& numbers) {
    std::vector<double> defaults;
    for (const auto& p : numbers) defaults.push_back(p.fallback.value_or(0));
    return defaults;
}

std::size_t Effect::index_of(std::string_view name) const {
    const auto& parameters = kind_->parameters;
    const auto it = std::find_if(parameters.begin(), parameters.end(), [&](const auto& p) { return p.name == name; });
    assert(it != parameters.end());
    return static_cast<std::size_t>(it - parameters.begin());
}

const std::string& Effect::choice(std::string_view name) const {
    const std::size_t index = index_of(name);
    return kind_->parameters[index].choices[static_cast<std::size_t>(values_[index].number)];
}

// "parameters.harmonics[1].F" -> "harmonics[1].F".
static std::string own_path(const std::string& path) { return path.substr(path.find('.') + 1); }

std::vector<double> Effect::numbers() const {
    std::vector<double> all;
    each_number(*this, [&](double number, auto&&...) { all.push_back(number); });
    return all;
}

std::vector<std::string> Effect::number_names() const {
    std::vector<std::string> all;
    each_number(*this, [&](double, const auto& path, auto&&...) { all.push_back(own_path(path())); });
    return all;
}

Effect Effect::with_numbers(const std::vector<double>& numbers) const {
    Effect other = *this;
    std::size_t next = 0;
    each_number(other, [&](double& number, auto&&...) { number = numbers.at(next++); });
    assert(next == numbers.size());
    return other;
}

void Effect::require_allowed() const {
    each_number(*this, [&](double number, const auto& path, std::string_view, Allowed allowed, const About&) {
        if (is_allowed(number, allowed)) return;
        throw InputError(
            fmt::format("{}: {} = {}, {}", kind_->name, own_path(path()), to_text(number), requirement(allowed)));
    });
}

Json Effect::to_json() const { return options_json(*this); }

} // namespace tribode
