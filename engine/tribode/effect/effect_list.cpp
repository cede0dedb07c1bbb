#include "tribode/base/text.hpp"
#include "tribode/effect/effect.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <fmt/ranges.h>

// The kinds of effects for readers: as data and as tables of the documentation.
namespace tribode {

namespace {

using Type = EffectParameter::Type;

const char* const allowed_names[] = {"finite", "positive", "not below zero", "between 0 and 1"};

Json to_json(const EffectParameter& p) {
    static const char* const types[] = {"number", "choice", "flag", "records", "text", "texts", "constants"};
    Json json = {{"name", p.name}, {"meaning", p.meaning}, {"type", types[static_cast<std::size_t>(p.type)]}};
    if (p.type == Type::number) {
        json["unit"] = p.unit;
        json["allowed"] = allowed_names[static_cast<std::size_t>(p.allowed)];
        json["plausible"] = {p.plausible_min, p.plausible_max};
    }
    if (!p.choices.empty()) json["choices"] = p.choices;
    if (p.fallback) json["default"] = *p.fallback;
    for (const auto& field : p.fields) json["fields"].push_back(to_json(field));
    return json;
}

std::string values_of(const EffectParameter& p) {
    switch (p.type) {
    case Type::number: {
        std::string text = fmt::format("{} to {}", to_text(p.plausible_min), to_text(p.plausible_max));
        if (p.allowed != Allowed::finite) {
            text += fmt::format("; {}", allowed_names[static_cast<std::size_t>(p.allowed)]);
        }
        return text;
    }
    case Type::choice: return fmt::format("\"{}\"", fmt::join(p.choices, "\", \""));
    case Type::flag: return "true, false";
    case Type::records: return "a list of tables";
    case Type::text: return "Lua text";
    case Type::texts: return "a list of names";
    case Type::constants: return "a table of numbers";
    }
    return "";
}

std::string default_of(const EffectParameter& p) {
    if (!p.fallback) return p.type == Type::texts || p.type == Type::constants ? "none" : "";
    if (p.type == Type::flag) return *p.fallback != 0 ? "true" : "false";
    if (p.type == Type::text) return "none";
    return to_text(*p.fallback);
}

std::string neutral_of(const EffectKind& kind, const EffectParameter& p) {
    const auto it = std::find_if(kind.neutral.begin(), kind.neutral.end(),
                                 [&](const auto& neutral) { return neutral.first == p.name; });
    return it == kind.neutral.end() ? "" : to_text(it->second);
}

void append_rows(std::string& text, const EffectKind& kind, const EffectParameter& p, const std::string& path) {
    const std::string name = path + p.name;
    text += fmt::format("| `{}` | `{}`{} | {} | {} | {} | {} |\n", kind.name, name,
                        p.unit.empty() ? "" : " [" + p.unit + "]", p.meaning, values_of(p), default_of(p),
                        path.empty() ? neutral_of(kind, p) : "");
    for (const auto& field : p.fields) append_rows(text, kind, field, name + "[i].");
}

} // namespace

Json effect_list() {
    Json list = Json::array();
    for (const auto* kind : effect_kinds()) {
        Json parameters = Json::array();
        for (const auto& p : kind->parameters) parameters.push_back(to_json(p));
        list.push_back({{"name", kind->name},
                        {"summary", kind->summary},
                        {"equation", kind->equation},
                        {"parameters", parameters},
                        {"example", Json::parse(kind->example)},
                        {"affine", kind->affine},
                        {"is_friction_law", kind->is_friction_law},
                        {"drawn_against", name_of(kind->drawn_against)},
                        {"lua", kind->lua}});
    }
    return list;
}

std::string effect_tables() {
    std::string text = "| name | what it is | equation | affine | drawn against |\n|---|---|---|---|---|\n";
    for (const auto* kind : effect_kinds()) {
        text += fmt::format("| `{}` | {} | {} | {} | {} |\n", kind->name, kind->summary, kind->equation,
                            kind->affine ? "yes" : "no", name_of(kind->drawn_against));
    }
    text += "\n| effect | parameter | meaning | values | default | neutral |\n|---|---|---|---|---|---|\n";
    for (const auto* kind : effect_kinds()) {
        for (const auto& p : kind->parameters) append_rows(text, *kind, p, "");
    }
    return text;
}

} // namespace tribode
