#include "tribode/effect/effect.hpp"
#include "tribode/base/error.hpp"
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

static double read_number(FieldReader& fields, const EffectParameter& p) {
    if (p.fallback) return fields.number(p.name, p.unit, p.allowed, *p.fallback);
    return fields.number(p.name, p.unit, p.allowed);
}

static Effect::Value read_value(FieldReader& fields, const EffectParameter& p) {
    switch (p.type) {
    case EffectParameter::Type::number: return {.number = read_number(fields, p)};
    case EffectParameter::Type::flag:
        return {.number = fields.boolean(p.name, p.fallback.value_or(0) != 0) ? 1.0 : 0.0};
    case EffectParameter::Type::choice: {
        const auto fallback = p.fallback ? p.choices[static_cast<std::size_t>(*p.fallback)] : std::string();
        if (!p.fallback && !fields.has(p.name)) {
            fields.fail(p.name, fmt::format("is missing, must be one of {}", fmt::join(p.choices, ", ")));
        }
        const std::string name = fields.choice(p.name, p.choices, fallback);
        return {.number = static_cast<double>(std::find(p.choices.begin(), p.choices.end(), name) - p.choices.begin())};
    }
    case EffectParameter::Type::text: return {.texts = {p.fallback ? fields.text(p.name, "") : fields.text(p.name)}};
    case EffectParameter::Type::texts: return {.texts = fields.texts(p.name, {})};
    case EffectParameter::Type::constants: {
        Effect::Value value;
        const Json& table = fields.value(p.name);
        FieldReader numbers(table, fields.name_of(p.name));
        if (table.is_object()) {
            for (const auto& [name, number] : table.items()) {
                value.texts.push_back(name);
                value.constants.push_back(numbers.number(name, "", Allowed::finite));
            }
        }
        return value;
    }
    case EffectParameter::Type::records: break;
    }
    Effect::Value value;
    fields.each(p.name, [&](FieldReader& record) {
        auto& numbers = value.records.emplace_back();
        for (const auto& field : p.fields) numbers.push_back(read_number(record, field));
    });
    if (value.records.empty()) fields.fail(p.name, "is missing or empty, must be a list of one table or more");
    return value;
}

Effect Effect::read(FieldReader& fields) {
    const std::string name = fields.text("name");
    const EffectKind* kind = find_kind(name);
    if (!kind) {
        fields.fail("name", fmt::format("= \"{}\" is not a known effect{}", name, suggestion(name, kind_names())));
    }
    FieldReader parameters = fields.table("parameters");
    std::vector<Value> values;
    for (const auto& parameter : kind->parameters) values.push_back(read_value(parameters, parameter));
    parameters.finish();
    return Effect(*kind, std::move(values));
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

// Calls visit(number, its parameter, its name) for each number of each value, in order.
template <class Values, class Visit>
static void visit_numbers(const EffectKind& kind, Values& values, Visit visit) {
    for (std::size_t i = 0; i < values.size(); ++i) {
        const EffectParameter& p = kind.parameters[i];
        if (p.type == EffectParameter::Type::number) visit(values[i].number, p, [&] { return p.name; });
        for (std::size_t r = 0; r < values[i].records.size(); ++r) {
            for (std::size_t f = 0; f < p.fields.size(); ++f) {
                visit(values[i].records[r][f], p.fields[f],
                      [&] { return fmt::format("{}[{}].{}", p.name, r + 1, p.fields[f].name); });
            }
        }
        for (std::size_t c = 0; c < values[i].constants.size(); ++c) {
            visit(values[i].constants[c], p, [&] { return fmt::format("{}.{}", p.name, values[i].texts[c]); });
        }
    }
}

std::vector<double> Effect::numbers() const {
    std::vector<double> all;
    visit_numbers(*kind_, values_, [&](double number, const auto&, const auto&) { all.push_back(number); });
    return all;
}

std::vector<std::string> Effect::number_names() const {
    std::vector<std::string> all;
    visit_numbers(*kind_, values_, [&](double, const auto&, const auto& name) { all.push_back(name()); });
    return all;
}

Effect Effect::with_numbers(const std::vector<double>& numbers) const {
    Effect other = *this;
    std::size_t next = 0;
    visit_numbers(*kind_, other.values_,
                  [&](double& number, const auto&, const auto&) { number = numbers.at(next++); });
    assert(next == numbers.size());
    return other;
}

void Effect::require_allowed() const {
    visit_numbers(*kind_, values_, [&](double number, const EffectParameter& p, const auto& name) {
        if (is_allowed(number, p.allowed)) return;
        throw InputError(fmt::format("{}: {} = {}, {}", kind_->name, name(), to_text(number), requirement(p.allowed)));
    });
}

Json Effect::to_json() const {
    Json parameters = Json::object();
    for (std::size_t i = 0; i < values_.size(); ++i) {
        const auto& p = kind_->parameters[i];
        Json& field = parameters[p.name];
        switch (p.type) {
        case EffectParameter::Type::number: field = values_[i].number; break;
        case EffectParameter::Type::flag: field = values_[i].number != 0; break;
        case EffectParameter::Type::choice: field = p.choices[static_cast<std::size_t>(values_[i].number)]; break;
        case EffectParameter::Type::text: field = values_[i].texts.front(); break;
        case EffectParameter::Type::texts: field = values_[i].texts; break;
        case EffectParameter::Type::constants:
            field = Json::object();
            for (std::size_t j = 0; j < values_[i].texts.size(); ++j) {
                field[values_[i].texts[j]] = values_[i].constants[j];
            }
            break;
        case EffectParameter::Type::records:
            field = Json::array();
            for (const auto& record : values_[i].records) {
                Json entry = Json::object();
                for (std::size_t j = 0; j < record.size(); ++j) entry[p.fields[j].name] = record[j];
                field.push_back(std::move(entry));
            }
        }
    }
    return {{"name", kind_->name}, {"parameters", parameters}};
}

} // namespace tribode
