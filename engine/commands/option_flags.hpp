#pragma once
#include "tribode/base/field_rows.hpp"
#include "tribode/base/text.hpp"

#include <CLI/CLI.hpp>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// A text of the documentation for the terminal: without the marks of Markdown.
std::string without_marks(const std::string& text);

// Flags of a command that set fields of an options struct. Limits, defaults and help are those of its describe().
class OptionFlags {
  public:
    struct Flag {
        std::string_view key; // of the field, as Lua has it
        std::string name;     // "--rtol"
        std::string fallback; // said in the help in place of the default
    };

    template <class Options>
    void add(CLI::App& app, const Options& defaults, std::vector<Flag> flags) {
        flags_ = std::move(flags);
        command_ = app.get_name();
        for (const auto& row : field_rows(defaults)) {
            if (const Flag* flag = flag_of(row.path)) add(app, *flag, row);
        }
    }

    bool given(std::string_view key) const { return given_.contains(flag_of(key)->name); }

    // Sets the fields whose flags were given. Throws InputError, which names the flag.
    template <class Options>
    void read(Options& options) const {
        FlagReader reader{*this};
        Options::describe(options, reader);
    }

  private:
    // A visitor of describe(), see base/options.hpp: reads each field under the name of its flag.
    struct FlagReader {
        const OptionFlags& flags;

        void number(std::string_view key, auto& value, auto&&... more) {
            flags.read(key, number_in, [&](auto& reader, auto& flag) { reader.number(flag, value, more...); });
        }
        void integer(std::string_view key, auto& value, auto&&... more) {
            flags.read(key, number_in, [&](auto& reader, auto& flag) { reader.integer(flag, value, more...); });
        }
        void index(std::string_view key, auto& value, auto&&... more) {
            flags.read(key, number_in, [&](auto& reader, auto& flag) { reader.index(flag, value, more...); });
        }
        void flag(std::string_view key, auto& value, auto&&... more) {
            const auto is_set = [](const std::string&) { return Json(true); };
            flags.read(key, is_set, [&](auto& reader, auto& flag) { reader.flag(flag, value, more...); });
        }
        void choice(std::string_view key, auto& value, const std::vector<std::string>& names, const About& about = {}) {
            flags.read(key, text_in, [&](auto& reader, auto& flag) { reader.choice(flag, value, names, about); });
        }
        void choices(std::string_view key, auto& values, const std::vector<std::string>& names,
                     const About& about = {}) {
            flags.read(key, list_in<text_in>,
                       [&](auto& reader, auto& flag) { reader.choices(flag, values, names, about); });
        }
        void texts(std::string_view key, auto& values, auto&&... more) {
            flags.read(key, list_in<text_in>, [&](auto& reader, auto& flag) { reader.texts(flag, values, more...); });
        }
        void integers(std::string_view key, auto& values, auto&&... more) {
            flags.read(key, list_in<number_in>,
                       [&](auto& reader, auto& flag) { reader.integers(flag, values, more...); });
        }
        void numbers(std::string_view key, auto& values, auto&&... more) {
            flags.read(key, list_in<number_in>,
                       [&](auto& reader, auto& flag) { reader.numbers(flag, values, more...); });
        }
        void table(std::string_view, auto&, const About& = {}) {}
    };

    static Json text_in(const std::string& text) { return text; }
    static Json number_in(const std::string& text) {
        const auto number = parse_number(text);
        return number ? Json(*number) : Json(text); // refused where it is read
    }
    template <Json (*entry)(const std::string&)>
    static Json list_in(const std::string& text) {
        Json list = Json::array();
        for (const auto& part : CLI::detail::split(text, ',')) list.push_back(entry(part));
        return list;
    }

    const Flag* flag_of(std::string_view key) const {
        for (const auto& flag : flags_) {
            if (flag.key == key) return &flag;
        }
        return nullptr;
    }
    void add(CLI::App& app, const Flag& flag, const FieldRow& row);
    void read(std::string_view key, auto value_in, auto read_field) const {
        const Flag* flag = flag_of(key);
        if (!flag || !given_.contains(flag->name)) return;
        const Json json{{flag->name, value_in(given_.at(flag->name))}};
        FieldReader fields(json, command_);
        OptionReader reader(fields);
        read_field(reader, flag->name);
    }

    std::vector<Flag> flags_;
    std::string command_;
    std::map<std::string, std::string> given_; // by the name of the flag
};

} // namespace tribode
