#pragma once
#include "tribode/base/options.hpp"
#include "tribode/base/text.hpp"

#include <fmt/format.h>

#include <optional>
#include <string>
#include <vector>

namespace tribode {

// One field of a describe(), as text for tables of the documentation.
struct FieldRow {
    std::string path; // "friction.elements[].K"
    std::string unit;
    std::string values;   // what is allowed: "> 0", "text", "one of ..."
    std::string fallback; // "required", "none" or the default
    About about;
    std::vector<std::string> words = {}; // where only these are allowed, or lists of them
};

// Makes a row for each field, those of structs in lists, absent tables and all kinds of a variant too.
class FieldLister {
  public:
    std::vector<FieldRow> rows;

    void number(std::string_view key, double value, std::string_view unit, Allowed allowed, const About& about = {}) {
        // A default that nobody could write stands for none.
        add(key, unit, values_of(allowed), is_allowed(value, allowed) ? to_text(value) : "none", about);
    }
    void number(std::string_view key, const std::optional<double>&, std::string_view unit, Allowed allowed,
                const About& about = {}) {
        add(key, unit, values_of(allowed), "none", about);
    }
    void required(std::string_view key, double, std::string_view unit, Allowed allowed, const About& about = {}) {
        add(key, unit, values_of(allowed), "required", about);
    }
    void optional(std::string_view key, double, double, std::string_view unit, Allowed allowed,
                  const About& about = {}) {
        add(key, unit, values_of(allowed), "none", about);
    }
    void entry(std::string_view key, const auto&, std::string_view unit, Allowed allowed, const About& about = {}) {
        add(key, unit, values_of(allowed), "none", about);
    }
    void integer(std::string_view key, std::integral auto value, long least, long most, const About& about = {}) {
        add(key, "", whole(least, most), std::to_string(value), about);
    }
    template <class Integer>
    void integer(std::string_view key, const std::optional<Integer>&, long least, long most, const About& about = {}) {
        add(key, "", whole(least, most), "none", about);
    }
    void integers(std::string_view key, const std::vector<long>& values, long least, long most,
                  const About& about = {}) {
        add(key, "", "list of numbers, each " + whole(least, most), fmt::format("{{ {} }}", fmt::join(values, ", ")),
            about);
    }
    void index(std::string_view key, std::size_t value, long most, const About& about = {}) {
        add(key, "", whole(1, most), std::to_string(value + 1), about);
    }
    void flag(std::string_view key, bool value, const About& about = {}) {
        add(key, "", "true or false", value ? "true" : "false", about);
    }
    void flag(std::string_view key, const std::optional<bool>&, const About& about = {}) {
        add(key, "", "true or false", "none", about);
    }
    void choice(std::string_view key, const std::string& value, const std::vector<std::string>& names,
                const About& about = {}) {
        std::vector<std::string> quoted;
        for (const auto& name : names) {
            quoted.push_back(fmt::format("`\"{}\"`", name));
            if (name == about.alias.means) quoted.back() += fmt::format(" (also `\"{}\"`)", about.alias.name);
        }
        add(key, "", fmt::format("{}", fmt::join(quoted, ", ")), fmt::format("`\"{}\"`", value), about);
        rows.back().words = names;
    }
    template <class Enum>
    requires std::is_enum_v<Enum>
    void choice(std::string_view key, Enum value, const std::vector<std::string>& names, const About& about = {}) {
        choice(key, names.at(static_cast<std::size_t>(value)), names, about);
    }
    void choices(std::string_view key, const std::vector<std::string>& values, const std::vector<std::string>& names,
                 const About& about = {}) {
        add(key, "", fmt::format("list of `\"{}\"`", fmt::join(names, "\"`, `\"")),
            fmt::format("{{ \"{}\" }}", fmt::join(values, "\", \"")), about);
        rows.back().words = names;
    }
    void numbers(std::string_view key, const std::vector<double>& values, std::string_view unit, Allowed allowed,
                 std::size_t, const About& about = {}) {
        std::vector<std::string> texts;
        for (const double value : values) texts.push_back(to_text(value));
        add(key, unit, "list of numbers, each " + values_of(allowed),
            texts.empty() ? "none" : fmt::format("{{ {} }}", fmt::join(texts, ", ")), about);
    }
    void fixed(std::string_view key, const std::string&, const About& about = {}) {
        add(key, "", "text", "required", about);
    }
    void text(std::string_view key, const std::string&, bool required, const About& about = {}) {
        add(key, "", "text", required ? "required" : "none", about);
    }
    void texts(std::string_view key, const auto&, const About& about = {}) {
        add(key, "", "list of texts", "none", about);
    }
    void constants(std::string_view key, const auto&, const auto&, const About& about = {}) {
        add(key, "", "table of numbers", "none", about);
    }
    template <class Struct>
    void list(std::string_view key, const std::vector<Struct>&, const About& about = {}) {
        add(key, "", "list of tables", "none", about);
        inside(std::string(key) + "[].", [&] {
            Struct fresh{};
            Struct::describe(fresh, *this);
        });
    }
    void entries(std::string_view key, const auto&, auto, auto, const About& about = {}, bool = false) {
        add(key, "", "list of tables", "none", about);
    }
    template <class Struct>
    void table(std::string_view key, const std::optional<Struct>&, const About& about = {}) {
        add(key, "", "table", "none", about);
        inside(std::string(key) + ".", [&] {
            Struct fresh{};
            Struct::describe(fresh, *this);
        });
    }
    void group(std::string_view key, auto describe, const About& about = {}) {
        add(key, "", "table", "none", about);
        inside(std::string(key) + ".", [&] { describe(*this); });
    }
    void variant(std::string_view key, const auto& value, std::string_view tag, const std::vector<std::string>& names,
                 const About& about = {}) {
        add(key, "", "table", "none", about);
        inside(std::string(key) + ".", [&] {
            choice(tag, names.front(), names, "which of the kinds below");
            std::size_t place = 0;
            visit_kinds(value, [&](auto kind) {
                const std::size_t first = rows.size();
                describe_struct(kind, *this);
                for (std::size_t i = first; i < rows.size(); ++i) rows[i].path += fmt::format(" ({})", names[place]);
                ++place;
            });
        });
    }

  private:
    static std::string values_of(Allowed allowed) {
        switch (allowed) {
        case Allowed::finite: return "any";
        case Allowed::positive: return "> 0";
        case Allowed::non_negative: return "≥ 0";
        case Allowed::fraction: return "between 0 and 1";
        }
        return "";
    }
    static std::string whole(long least, long most) {
        constexpr long practically_unlimited = 1'000'000;
        return most < practically_unlimited ? fmt::format("whole, {} to {}", least, most)
                                            : fmt::format("whole, ≥ {}", least);
    }
    void add(std::string_view key, std::string_view unit, std::string values, std::string fallback,
             const About& about) {
        rows.push_back({path_ + std::string(key), std::string(unit), std::move(values), std::move(fallback), about});
    }
    template <class Visit>
    void inside(const std::string& step, Visit visit) {
        const std::string around = path_;
        path_ += step;
        visit();
        path_ = around;
    }

    std::string path_;
};

// The rows of a struct with its defaults.
template <class Struct>
std::vector<FieldRow> field_rows(const Struct& defaults = {}) {
    FieldLister lister;
    Struct::describe(defaults, lister);
    return std::move(lister.rows);
}

} // namespace tribode
