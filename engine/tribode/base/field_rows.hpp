#pragma once
#include "tribode/base/options.hpp"
#include "tribode/base/text.hpp"

#include <fmt/format.h>

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
};

// Makes a row for each field, those of structs in lists, absent tables and all kinds of a variant too.
class FieldLister {
  public:
    std::vector<FieldRow> rows;

    void number(std::string_view key, double value, std::string_view unit, Allowed allowed, const About& about = {}) {
        add(key, unit, values_of(allowed), to_text(value), about);
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
    void integer(std::string_view key, auto value, long least, long most, const About& about = {}) {
        add(key, "", fmt::format("whole, {} to {}", least, most), std::to_string(value), about);
    }
    void flag(std::string_view key, bool value, const About& about = {}) {
        add(key, "", "true or false", value ? "true" : "false", about);
    }
    void flag(std::string_view key, const std::optional<bool>&, const About& about = {}) {
        add(key, "", "true or false", "none", about);
    }
    void choice(std::string_view key, const std::string& value, const std::vector<std::string>& names,
                const About& about = {}) {
        add(key, "", fmt::format("`\"{}\"`", fmt::join(names, "\"`, `\"")), fmt::format("`\"{}\"`", value), about);
    }
    template <class Enum>
    requires std::is_enum_v<Enum>
    void choice(std::string_view key, Enum value, const std::vector<std::string>& names, const About& about = {}) {
        choice(key, names.at(static_cast<std::size_t>(value)), names, about);
    }
    void numbers(std::string_view key, const auto&, std::string_view unit, Allowed allowed, std::size_t,
                 const About& about = {}) {
        add(key, unit, "list of numbers, each " + values_of(allowed), "none", about);
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

} // namespace tribode
