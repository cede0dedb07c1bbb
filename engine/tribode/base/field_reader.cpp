#include "tribode/base/field_reader.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

bool is_allowed(double x, Allowed allowed) {
    if (!std::isfinite(x)) return false;
    switch (allowed) {
    case Allowed::finite: return true;
    case Allowed::positive: return x > 0;
    case Allowed::non_negative: return x >= 0;
    case Allowed::fraction: return x > 0 && x < 1;
    }
    return false;
}

const char* requirement(Allowed allowed) {
    switch (allowed) {
    case Allowed::finite: return "must be finite";
    case Allowed::positive: return "must be positive and finite";
    case Allowed::non_negative: return "must be zero or positive and finite";
    case Allowed::fraction: return "must lie between 0 and 1";
    }
    return "";
}

namespace {

const std::vector<std::string> notes = {"comment", "units", "conventions", "records", "equations"};

std::string refusal(double x, std::string_view unit, Allowed allowed) {
    return fmt::format("= {}{}{}, {}", to_text(x), unit.empty() ? "" : " ", unit, requirement(allowed));
}

// A value as it is shown in a message: short, never a whole table.
std::string shown(const Json& value) {
    if (value.is_object()) return "a table";
    if (value.is_array()) return "a list";
    if (value.is_number_float()) return to_text(value.get<double>());
    return value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

// Also an empty list: Lua writes both as {}.
bool is_empty_table(const Json& value) { return (value.is_array() || value.is_object()) && value.empty(); }

} // namespace

std::string name_list(const std::vector<std::string>& names, Alias alias) {
    std::string text;
    for (const auto& name : names) {
        text += (text.empty() ? "" : ", ") + name;
        if (name == alias.means) text += fmt::format(" (also {})", alias.name);
    }
    return text;
}

FieldReader::FieldReader(const Json& fields, std::string where, std::string path)
    : fields_(&fields),
      where_(std::move(where)),
      path_(std::move(path)) {
    if (fields.is_null() || fields.is_object() || is_empty_table(fields)) return;
    throw InputError(fmt::format("{}{}{} is {}, must be a table of named fields", where_, path_.empty() ? "" : ": ",
                                 path_, shown(fields)));
}

std::string FieldReader::path_of(std::string_view key) const {
    return fmt::format("{}{}{}", path_, path_.empty() || key.empty() ? "" : ".", key);
}

std::string FieldReader::name_of(std::string_view key) const { return fmt::format("{}: {}", where_, path_of(key)); }

void FieldReader::fail(std::string_view key, std::string_view problem) const {
    throw InputError(fmt::format("{} {}", name_of(key), problem));
}

const Json* FieldReader::find(std::string_view key) {
    known_.emplace_back(key);
    if (!fields_->is_object()) return nullptr;
    const auto it = fields_->find(key);
    return it == fields_->end() || it->is_null() ? nullptr : &*it;
}

bool FieldReader::is_note(std::string_view key) { return std::find(notes.begin(), notes.end(), key) != notes.end(); }

bool FieldReader::has(std::string_view key) const {
    if (!fields_->is_object()) return false;
    const auto it = fields_->find(key);
    return it != fields_->end() && !it->is_null();
}

std::optional<double> FieldReader::optional_number(std::string_view key, std::string_view unit, Allowed allowed) {
    const Json* value = find(key);
    if (!value) return std::nullopt;
    if (!value->is_number()) fail(key, fmt::format("= {}, must be a number", shown(*value)));
    const double x = value->get<double>();
    if (!is_allowed(x, allowed)) fail(key, refusal(x, unit, allowed));
    return x;
}

double FieldReader::number(std::string_view key, std::string_view unit, Allowed allowed) {
    if (const auto x = optional_number(key, unit, allowed)) return *x;
    fail(key, fmt::format("is missing{}", unit.empty() ? "" : fmt::format(" (a number in {})", unit)));
}

double FieldReader::number(std::string_view key, std::string_view unit, Allowed allowed, double fallback) {
    return optional_number(key, unit, allowed).value_or(fallback);
}

long FieldReader::integer(std::string_view key, long least, long most, long fallback) {
    const Json* value = find(key);
    if (!value) return fallback;
    if (value->is_number()) {
        const double x = value->get<double>();
        if (x == std::floor(x) && x >= static_cast<double>(least) && x <= static_cast<double>(most)) {
            return static_cast<long>(x);
        }
    }
    fail(key, fmt::format("= {}, must be a whole number from {} to {}", shown(*value), least, most));
}

std::vector<long> FieldReader::integers(std::string_view key, long least, long most, std::vector<long> fallback) {
    const std::vector<double> defaults(fallback.begin(), fallback.end());
    std::vector<long> list;
    for (const double x : numbers(key, "", Allowed::finite, defaults)) {
        if (x != std::floor(x) || x < static_cast<double>(least) || x > static_cast<double>(most)) {
            fail(fmt::format("{}[{}]", key, list.size() + 1),
                 fmt::format("= {}, must be a whole number from {} to {}", to_text(x), least, most));
        }
        list.push_back(static_cast<long>(x));
    }
    return list;
}

bool FieldReader::boolean(std::string_view key, bool fallback) {
    const Json* value = find(key);
    if (!value) return fallback;
    if (!value->is_boolean()) fail(key, fmt::format("= {}, must be true or false", shown(*value)));
    return value->get<bool>();
}

std::string FieldReader::text(std::string_view key) {
    const Json* value = find(key);
    if (!value) fail(key, "is missing (a text)");
    if (!value->is_string()) fail(key, fmt::format("= {}, must be a text", shown(*value)));
    return value->get<std::string>();
}

std::string FieldReader::text(std::string_view key, std::string_view fallback) {
    return has(key) ? text(key) : (known_.emplace_back(key), std::string(fallback));
}

std::string FieldReader::choice(std::string_view key, const std::vector<std::string>& names, std::string_view fallback,
                                Alias alias) {
    std::string name = text(key, fallback);
    if (!alias.name.empty() && name == alias.name) return std::string(alias.means);
    if (std::find(names.begin(), names.end(), name) == names.end()) {
        fail(key, fmt::format("= \"{}\", must be one of {}", name, name_list(names, alias)));
    }
    return name;
}

std::vector<double> FieldReader::numbers(std::string_view key, std::string_view unit, Allowed allowed,
                                         std::vector<double> fallback) {
    const Json* value = find(key);
    if (!value) return fallback;
    if (is_empty_table(*value)) return {};
    if (!value->is_array()) fail(key, fmt::format("= {}, must be a list of numbers", shown(*value)));
    std::vector<double> list;
    for (const auto& entry : *value) {
        const std::string name = fmt::format("{}[{}]", key, list.size() + 1);
        if (!entry.is_number()) fail(name, fmt::format("= {}, must be a number", shown(entry)));
        const double x = entry.get<double>();
        if (!is_allowed(x, allowed)) fail(name, refusal(x, unit, allowed));
        list.push_back(x);
    }
    return list;
}

std::vector<std::string> FieldReader::texts(std::string_view key, std::vector<std::string> fallback) {
    const Json* value = find(key);
    if (!value) return fallback;
    if (is_empty_table(*value)) return {};
    if (!value->is_array()) fail(key, fmt::format("= {}, must be a list of texts", shown(*value)));
    std::vector<std::string> list;
    for (const auto& entry : *value) {
        if (!entry.is_string()) {
            fail(fmt::format("{}[{}]", key, list.size() + 1), fmt::format("= {}, must be a text", shown(entry)));
        }
        list.push_back(entry.get<std::string>());
    }
    return list;
}

FieldReader FieldReader::table(std::string_view key, bool required) {
    static const Json none;
    const Json* value = find(key);
    if (!value && required) fail(key, "is missing (a table)");
    return FieldReader(value ? *value : none, where_, path_of(key));
}

void FieldReader::each(std::string_view key, const std::function<void(FieldReader&)>& read) {
    const Json* value = find(key);
    if (!value || is_empty_table(*value)) return;
    if (!value->is_array()) fail(key, fmt::format("= {}, must be a list of tables", shown(*value)));
    std::size_t index = 0;
    for (const auto& entry : *value) {
        FieldReader reader(entry, where_, fmt::format("{}[{}]", path_of(key), ++index));
        read(reader);
        reader.finish();
    }
}

const Json& FieldReader::value(std::string_view key) {
    static const Json none;
    const Json* value = find(key);
    return value ? *value : none;
}

void FieldReader::finish() const {
    if (!fields_->is_object()) return;
    for (const auto& [key, value] : fields_->items()) {
        if (std::find(known_.begin(), known_.end(), key) != known_.end()) continue;
        if (is_note(key)) continue;
        fail(key, "is not a known field" + suggestion(key, known_));
    }
}

} // namespace tribode
