#pragma once
#include "tribode/base/about.hpp"
#include "tribode/base/field_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <concepts>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

namespace tribode {

// A struct says once what its fields are called, in what unit they are and what they may be:
//
//     struct MoveOptions {
//         double duration = 1;
//         static void describe(auto& options, auto& fields) {
//             fields.number("duration_s", options.duration, "s", Allowed::positive, "of one move");
//         }
//     };
//
// Everything else visits that description: read_options(options, fields) reads, options_json(options) writes all fields, so that
// two structs with the same JSON are the same options; field_path.hpp finds single fields, field_rows.hpp makes tables for
// documentation. A describe() calls these of its visitor, each with an About as its last argument where there is more to say:
//
//     number(key, double&, unit, Allowed)         required(key, double&, unit, Allowed): a number without a default
//     integer(key, integer&, least, most)         flag(key, bool&)
//     integers(key, vector<long>&, least, most)   index(key, size_t&, most): counts from 1 for the user
//     choice(key, text or enumeration&, names)    numbers(key, vector<double>&, unit, Allowed, most entries)
//     choices(key, vector<string>&, names)        a list of some of the names
//     list(key, vector<Struct>&)                  table(key, optional<Struct>&): of structs with a describe()
//
// number(), integer() and flag() also take an optional, which stays empty where the field is absent. What fields must
// satisfy together is said by a function check(const FieldReader&) of the struct, which read_options() calls.
//
// and, for what is not options but a machine and its effects:
//
//     optional(key, double&, none, unit, Allowed)      a number, or absent: it is `none` then
//     entry(key, map<string, double>&, unit, Allowed)  a number that is in the map or absent
//     group(key, describe)                             a table whose fields are members of the struct itself: describe(fields)
//     variant(key, variant<monostate, Struct...>&, tag, names)   none, or a table whose field `tag` is the name of its kind
//     entries(key, vector<Entry>&, begin, describe, About, bool required)
//                                                      begin(FieldReader&): an entry with its defaults; describe(entry, fields)
//     fixed(key, text)                                 what begin() has read: known, written, never changed
//     text(key, string&, bool required)   texts(key, vector<string>&)   constants(key, names&, vector<double>&)

// Calls visit(table) with the alternative of a variant that is there; none: does nothing.
template <class Visit, class Variant>
void visit_present(Variant& value, Visit visit) {
    std::visit(
        [&](auto& kind) {
            if constexpr (!std::is_same_v<std::remove_cvref_t<decltype(kind)>, std::monostate>) visit(kind);
        },
        value);
}

// Calls visit(kind) with a default of each alternative of a variant but the first, which is none.
template <class Visit, class... Kinds>
void visit_kinds(const std::variant<std::monostate, Kinds...>&, Visit visit) {
    (visit(Kinds{}), ...);
}

// Describes an entry of a list by its own type.
constexpr auto describe_struct = [](auto& value, auto& fields) {
    std::remove_cvref_t<decltype(value)>::describe(value, fields);
};

// Reads; absent fields stay as they are. With `left_out`, the paths of absent fields that have a default go there.
class OptionReader {
  public:
    explicit OptionReader(FieldReader& fields, std::set<std::string>* left_out = nullptr)
        : fields_(fields),
          left_out_(left_out) {}

    void number(std::string_view key, double& value, std::string_view unit, Allowed allowed, const About& = {}) {
        note(key);
        value = fields_.number(key, unit, allowed, value);
    }
    void required(std::string_view key, double& value, std::string_view unit, Allowed allowed, const About& = {}) {
        value = fields_.number(key, unit, allowed);
    }
    void number(std::string_view key, std::optional<double>& value, std::string_view unit, Allowed allowed,
                const About& = {}) {
        if (const auto read = fields_.optional_number(key, unit, allowed)) value = read;
    }
    void optional(std::string_view key, double& value, double none, std::string_view unit, Allowed allowed,
                  const About& = {}) {
        value = fields_.optional_number(key, unit, allowed).value_or(none);
    }
    void entry(std::string_view key, std::map<std::string, double>& values, std::string_view unit, Allowed allowed,
               const About& = {}) {
        if (const auto value = fields_.optional_number(key, unit, allowed)) values[std::string(key)] = *value;
    }
    template <std::integral Integer>
    void integer(std::string_view key, Integer& value, long least, long most, const About& = {}) {
        note(key);
        value = static_cast<Integer>(fields_.integer(key, least, most, static_cast<long>(value)));
    }
    template <std::integral Integer>
    void integer(std::string_view key, std::optional<Integer>& value, long least, long most, const About& = {}) {
        const long read = fields_.integer(key, least, most, 0);
        if (fields_.has(key)) value = static_cast<Integer>(read);
    }
    void integers(std::string_view key, std::vector<long>& values, long least, long most, const About& = {}) {
        note(key);
        values = fields_.integers(key, least, most, std::move(values));
    }
    void index(std::string_view key, std::size_t& value, long most, const About& = {}) {
        note(key);
        value = static_cast<std::size_t>(fields_.integer(key, 1, most, static_cast<long>(value) + 1) - 1);
    }
    void flag(std::string_view key, bool& value, const About& = {}) {
        note(key);
        value = fields_.boolean(key, value);
    }
    void flag(std::string_view key, std::optional<bool>& value, const About& = {}) {
        const bool read = fields_.boolean(key, false);
        if (fields_.has(key)) value = read;
    }
    void choice(std::string_view key, std::string& value, const std::vector<std::string>& names,
                const About& about = {}) {
        note(key);
        if (value.empty() && !fields_.has(key)) {
            fields_.fail(key, fmt::format("is missing, must be one of {}", fmt::join(names, ", ")));
        }
        value = fields_.choice(key, names, value, about.alias);
    }
    // The values of the enumeration are the places of their names.
    template <class Enum>
    requires std::is_enum_v<Enum>
    void choice(std::string_view key, Enum& value, const std::vector<std::string>& names, const About& about = {}) {
        std::string name = names.at(static_cast<std::size_t>(value));
        choice(key, name, names, about);
        std::size_t place = 0;
        while (names[place] != name) ++place;
        value = static_cast<Enum>(place);
    }
    void choices(std::string_view key, std::vector<std::string>& values, const std::vector<std::string>& names,
                 const About& = {}) {
        note(key);
        values = fields_.texts(key, std::move(values));
        if (values.empty()) fields_.fail(key, fmt::format("is empty, must have one of {} or more", name_list(names)));
        for (const auto& value : values) {
            if (std::find(names.begin(), names.end(), value) != names.end()) continue;
            fields_.fail(key, fmt::format("has \"{}\", must have some of {}", value, name_list(names)));
        }
    }
    void numbers(std::string_view key, std::vector<double>& values, std::string_view unit, Allowed allowed,
                 std::size_t most, const About& = {}) {
        note(key);
        values = fields_.numbers(key, unit, allowed, std::move(values));
        if (values.size() <= most) return;
        fields_.fail(key, "has " + std::to_string(values.size()) + " entries, must have " + std::to_string(most) +
                              " at most");
    }
    void fixed(std::string_view, const std::string&, const About& = {}) {}
    void text(std::string_view key, std::string& value, bool required, const About& = {}) {
        if (!required) note(key);
        value = required ? fields_.text(key) : fields_.text(key, value);
    }
    void texts(std::string_view key, std::vector<std::string>& values, const About& = {}) {
        note(key);
        values = fields_.texts(key, std::move(values));
    }
    void constants(std::string_view key, std::vector<std::string>& names, std::vector<double>& values,
                   const About& = {}) {
        note(key);
        const Json& table = fields_.value(key);
        FieldReader inside(table, fields_.name_of(key));
        if (!table.is_object()) return;
        names.clear();
        values.clear();
        for (const auto& [name, number] : table.items()) {
            names.push_back(name);
            values.push_back(inside.number(name, "", Allowed::finite));
        }
    }
    template <class Struct>
    void list(std::string_view key, std::vector<Struct>& values, const About& = {}) {
        entries(
            key, values, [](FieldReader&) { return Struct{}; }, describe_struct);
    }
    template <class Entry, class Begin, class Describe>
    void entries(std::string_view key, std::vector<Entry>& values, Begin begin, Describe describe, const About& = {},
                 bool required = false) {
        note(key);
        if (fields_.has(key)) values.clear();
        fields_.each(key, [&](FieldReader& one) {
            Entry value = begin(one);
            OptionReader reader(one, left_out_);
            describe(value, reader);
            values.push_back(std::move(value));
        });
        if (required && values.empty()) {
            fields_.fail(key, "is missing or empty, must be a list of one table or more");
        }
    }
    // One entry of a list, as a table of this name.
    template <class Entry, class Begin, class Describe>
    void single_entry(std::string_view key, Entry& value, Begin begin, Describe describe) {
        FieldReader inside = fields_.table(key, true);
        Entry read = begin(inside);
        inside_of(inside, [&](OptionReader& reader) { describe(read, reader); });
        value = std::move(read);
    }
    template <class Struct>
    void table(std::string_view key, std::optional<Struct>& value, const About& = {}) {
        if (fields_.value(key).is_null()) return;
        FieldReader inside = fields_.table(key);
        inside_of(inside, [&](OptionReader& reader) { Struct::describe(value.emplace(), reader); });
    }
    template <class Describe>
    void group(std::string_view key, Describe describe, const About& = {}) {
        note(key);
        FieldReader inside = fields_.table(key);
        inside_of(inside, describe);
    }
    template <class... Kinds>
    void variant(std::string_view key, std::variant<std::monostate, Kinds...>& value, std::string_view tag,
                 const std::vector<std::string>& names, const About& = {}) {
        FieldReader inside = fields_.table(key);
        if (!fields_.has(key)) return;
        inside_of(inside, [&](OptionReader& reader) {
            std::string name = names.front();
            reader.choice(tag, name, names);
            std::size_t place = 0;
            visit_kinds(value, [&]<class Kind>(Kind kind) {
                if (names[place++] != name) return;
                Kind::describe(kind, reader);
                value = std::move(kind);
            });
        });
    }

  private:
    void note(std::string_view key) {
        if (left_out_ && !fields_.has(key)) left_out_->insert(fields_.path_of(key));
    }
    template <class Describe>
    void inside_of(FieldReader& inside, Describe describe) {
        OptionReader reader(inside, left_out_);
        describe(reader);
        inside.finish();
    }

    FieldReader& fields_;
    std::set<std::string>* left_out_;
};

// Writes all fields; where there are none, null. With `left_out` as a reader filled it, only those which are there: not
// the fields of these paths that still have their default, which is what `defaults` holds of them, and no null.
class OptionWriter {
  public:
    Json json = Json::object();

    OptionWriter() = default;
    OptionWriter(const std::set<std::string>& left_out, Json defaults, std::string path = "")
        : left_out_(&left_out),
          defaults_(std::move(defaults)),
          path_(std::move(path)) {}

    void number(std::string_view key, double value, std::string_view, Allowed, const About& = {}) { put(key, value); }
    void required(std::string_view key, double value, std::string_view, Allowed, const About& = {}) { put(key, value); }
    void number(std::string_view key, const std::optional<double>& value, std::string_view, Allowed,
                const About& = {}) {
        put(key, value ? Json(*value) : Json());
    }
    void optional(std::string_view key, double value, double none, std::string_view, Allowed, const About& = {}) {
        put(key, value == none ? Json() : Json(value));
    }
    void entry(std::string_view key, const std::map<std::string, double>& values, std::string_view, Allowed,
               const About& = {}) {
        const auto value = values.find(std::string(key));
        put(key, value == values.end() ? Json() : Json(value->second));
    }
    template <std::integral Integer>
    void integer(std::string_view key, Integer value, long, long, const About& = {}) {
        put(key, value);
    }
    template <std::integral Integer>
    void integer(std::string_view key, const std::optional<Integer>& value, long, long, const About& = {}) {
        put(key, value ? Json(*value) : Json());
    }
    void integers(std::string_view key, const std::vector<long>& values, long, long, const About& = {}) {
        put(key, values);
    }
    void index(std::string_view key, std::size_t value, long, const About& = {}) { put(key, value + 1); }
    void flag(std::string_view key, bool value, const About& = {}) { put(key, value); }
    void flag(std::string_view key, const std::optional<bool>& value, const About& = {}) {
        put(key, value ? Json(*value) : Json());
    }
    void choice(std::string_view key, const std::string& value, const std::vector<std::string>&, const About& = {}) {
        put(key, value);
    }
    template <class Enum>
    requires std::is_enum_v<Enum>
    void choice(std::string_view key, Enum value, const std::vector<std::string>& names, const About& = {}) {
        put(key, names.at(static_cast<std::size_t>(value)));
    }
    void choices(std::string_view key, const std::vector<std::string>& values, const std::vector<std::string>&,
                 const About& = {}) {
        put(key, values);
    }
    void numbers(std::string_view key, const std::vector<double>& values, std::string_view, Allowed, std::size_t,
                 const About& = {}) {
        put(key, values);
    }
    void fixed(std::string_view key, const std::string& value, const About& = {}) { put(key, value); }
    void text(std::string_view key, const std::string& value, bool, const About& = {}) { put(key, value); }
    void texts(std::string_view key, const std::vector<std::string>& values, const About& = {}) { put(key, values); }
    void constants(std::string_view key, const std::vector<std::string>& names, const std::vector<double>& values,
                   const About& = {}) {
        Json table = Json::object();
        for (std::size_t i = 0; i < names.size(); ++i) table[names[i]] = values[i];
        put(key, table);
    }
    template <class Struct>
    void list(std::string_view key, const std::vector<Struct>& values, const About& = {}) {
        entries(
            key, values, [](FieldReader&) { return Struct{}; }, describe_struct);
    }
    template <class Entry, class Begin, class Describe>
    void entries(std::string_view key, const std::vector<Entry>& values, Begin begin, Describe describe,
                 const About& = {}, bool = false) {
        Json all = Json::array();
        for (const auto& value : values) {
            const std::string name = std::string(key) + "[" + std::to_string(all.size() + 1) + "]";
            all.push_back(written_entry(name, value, begin, describe));
        }
        put(key, all);
    }
    template <class Entry, class Begin, class Describe>
    void single_entry(std::string_view key, const Entry& value, Begin begin, Describe describe) {
        put(key, written_entry(std::string(key), value, begin, describe));
    }
    template <class Struct>
    void table(std::string_view key, const std::optional<Struct>& value, const About& = {}) {
        if (!value) return put(key, Json());
        put(key, written_entry(
                     std::string(key), *value, [](FieldReader&) { return Struct{}; }, describe_struct));
    }
    template <class Describe>
    void group(std::string_view key, Describe describe, const About& = {}) {
        OptionWriter inside = writer_inside(
            std::string(key), defaults_.is_object() && defaults_.contains(key) ? defaults_[std::string(key)] : Json());
        describe(inside);
        if (inside.json.empty() && is_left_out(key)) return;
        json[std::string(key)] = std::move(inside.json);
    }
    template <class... Kinds>
    void variant(std::string_view key, const std::variant<std::monostate, Kinds...>& value, std::string_view tag,
                 const std::vector<std::string>& names, const About& = {}) {
        if (value.index() == 0) return put(key, Json());
        visit_present(value, [&]<class Kind>(const Kind& kind) {
            const auto describe = [&](auto& one, auto& fields) {
                fields.choice(tag, names[value.index() - 1], names);
                Kind::describe(one, fields);
            };
            OptionWriter defaults;
            if (left_out_) {
                defaults.choice(tag, names.front(), names);
                Kind fresh{};
                Kind::describe(fresh, defaults);
            }
            OptionWriter inside = writer_inside(std::string(key), std::move(defaults.json));
            describe(kind, inside);
            json[std::string(key)] = std::move(inside.json);
        });
    }

  private:
    bool is_left_out(std::string_view key) const { return left_out_ && left_out_->contains(path_ + std::string(key)); }
    OptionWriter writer_inside(const std::string& key, Json defaults) const {
        return left_out_ ? OptionWriter(*left_out_, std::move(defaults), path_ + key + ".") : OptionWriter();
    }
    template <class Entry, class Begin, class Describe>
    Json written_entry(const std::string& name, const Entry& value, Begin begin, Describe describe) const {
        OptionWriter all;
        describe(value, all);
        if (!left_out_) return std::move(all.json);
        FieldReader fields(all.json, "");
        const Entry fresh = begin(fields);
        OptionWriter defaults;
        describe(fresh, defaults);
        OptionWriter inside = writer_inside(name, std::move(defaults.json));
        describe(value, inside);
        return std::move(inside.json);
    }
    void put(std::string_view key, Json value) {
        if (left_out_ && value.is_null()) return;
        if (is_left_out(key) && defaults_.contains(key) && defaults_[std::string(key)] == value) return;
        json[std::string(key)] = std::move(value);
    }

    const std::set<std::string>* left_out_ = nullptr;
    Json defaults_;
    std::string path_;
};

template <class Options>
void read_options(Options& options, FieldReader& fields) {
    OptionReader reader(fields);
    Options::describe(options, reader);
    if constexpr (requires { options.check(fields); }) options.check(fields);
}

template <class Options>
Json options_json(const Options& options) {
    OptionWriter writer;
    Options::describe(options, writer);
    return writer.json;
}

} // namespace tribode
