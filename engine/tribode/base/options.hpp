#pragma once
#include "tribode/base/field_reader.hpp"

#include <concepts>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

namespace tribode {

// A struct of options says once what its fields are called, in what unit they are and what they may be:
//
//     struct MoveOptions {
//         double duration = 1;
//         static void describe(auto& options, auto& fields) {
//             fields.number("duration_s", options.duration, "s", Allowed::positive);
//         }
//     };
//
// From this it is read, read_options(options, fields), and written, options_json(options): all fields, so that two structs with
// the same JSON are the same options. A describe() calls these of its visitor:
//
//     number(key, double&, unit, Allowed)         required(key, double&, unit, Allowed): a number without a default
//     integer(key, integer&, least, most)         flag(key, bool&)
//     choice(key, text or enumeration&, names)    numbers(key, vector<double>&, unit, Allowed, most entries)
//     list(key, vector<Struct>&)                  table(key, optional<Struct>&): of structs with a describe()

// Reads; absent fields stay as they are.
class OptionReader {
  public:
    explicit OptionReader(FieldReader& fields) : fields_(fields) {}

    void number(std::string_view key, double& value, std::string_view unit, Allowed allowed) {
        value = fields_.number(key, unit, allowed, value);
    }
    void required(std::string_view key, double& value, std::string_view unit, Allowed allowed) {
        value = fields_.number(key, unit, allowed);
    }
    template <std::integral Integer>
    void integer(std::string_view key, Integer& value, long least, long most) {
        value = static_cast<Integer>(fields_.integer(key, least, most, static_cast<long>(value)));
    }
    void flag(std::string_view key, bool& value) { value = fields_.boolean(key, value); }
    void choice(std::string_view key, std::string& value, const std::vector<std::string>& names) {
        value = fields_.choice(key, names, value);
    }
    // The values of the enumeration are the places of their names.
    template <class Enum>
    requires std::is_enum_v<Enum>
    void choice(std::string_view key, Enum& value, const std::vector<std::string>& names) {
        const std::string name = fields_.choice(key, names, names.at(static_cast<std::size_t>(value)));
        std::size_t place = 0;
        while (names[place] != name) ++place;
        value = static_cast<Enum>(place);
    }
    void numbers(std::string_view key, std::vector<double>& values, std::string_view unit, Allowed allowed,
                 std::size_t most) {
        values = fields_.numbers(key, unit, allowed, std::move(values));
        if (values.size() <= most) return;
        fields_.fail(key, "has " + std::to_string(values.size()) + " entries, must have " + std::to_string(most) +
                              " at most");
    }
    template <class Struct>
    void list(std::string_view key, std::vector<Struct>& values) {
        if (!fields_.has(key)) return;
        values.clear();
        fields_.each(key, [&](FieldReader& one) {
            Struct value{};
            OptionReader reader(one);
            Struct::describe(value, reader);
            values.push_back(value);
        });
    }
    template <class Struct>
    void table(std::string_view key, std::optional<Struct>& value) {
        if (fields_.value(key).is_null()) return;
        FieldReader inside = fields_.table(key);
        OptionReader reader(inside);
        Struct::describe(value.emplace(), reader);
        inside.finish();
    }

  private:
    FieldReader& fields_;
};

class OptionWriter {
  public:
    Json json = Json::object();

    void number(std::string_view key, double value, std::string_view, Allowed) { put(key, value); }
    void required(std::string_view key, double value, std::string_view, Allowed) { put(key, value); }
    template <std::integral Integer>
    void integer(std::string_view key, Integer value, long, long) {
        put(key, value);
    }
    void flag(std::string_view key, bool value) { put(key, value); }
    void choice(std::string_view key, const std::string& value, const std::vector<std::string>&) { put(key, value); }
    template <class Enum>
    requires std::is_enum_v<Enum>
    void choice(std::string_view key, Enum value, const std::vector<std::string>& names) {
        put(key, names.at(static_cast<std::size_t>(value)));
    }
    void numbers(std::string_view key, const std::vector<double>& values, std::string_view, Allowed, std::size_t) {
        put(key, values);
    }
    template <class Struct>
    void list(std::string_view key, const std::vector<Struct>& values) {
        Json all = Json::array();
        for (const auto& value : values) all.push_back(written(value));
        put(key, all);
    }
    template <class Struct>
    void table(std::string_view key, const std::optional<Struct>& value) {
        put(key, value ? written(*value) : Json());
    }

  private:
    template <class Struct>
    static Json written(const Struct& value) {
        OptionWriter writer;
        Struct::describe(value, writer);
        return writer.json;
    }
    void put(std::string_view key, Json value) { json[std::string(key)] = std::move(value); }
};

template <class Options>
void read_options(Options& options, FieldReader& fields) {
    OptionReader reader(fields);
    Options::describe(options, reader);
}

template <class Options>
Json options_json(const Options& options) {
    OptionWriter writer;
    Options::describe(options, writer);
    return writer.json;
}

} // namespace tribode
