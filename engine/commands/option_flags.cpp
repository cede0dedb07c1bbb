#include "commands/option_flags.hpp"
#include "commands/command.hpp"

#include <fmt/format.h>
#include <regex>

namespace tribode {

std::string without_marks(const std::string& text) {
    static const std::regex link(R"(\[([^\]]*)\]\([^)]*\))"), marks("`|\"");
    return std::regex_replace(std::regex_replace(text, link, "$1"), marks, "");
}

void OptionFlags::add(CLI::App& app, const Flag& flag, const FieldRow& row) {
    const auto set = [this, name = flag.name](const std::string& text) { given_[name] = text; };
    const std::string meaning = without_marks(fmt::format("{}: {}", row.path, row.about.meaning));
    if (row.values == "true or false") {
        app.add_flag_callback(
            flag.name, [set] { set(""); }, meaning);
        return;
    }
    const std::string unit = row.unit.empty() ? "" : fmt::format(" [{}]", row.unit);
    const std::string fallback = flag.fallback.empty() ? row.fallback : flag.fallback;
    app.add_option_function<std::string>(
           flag.name, set, without_marks(fmt::format("{}{}; {} (default {})", meaning, unit, row.values, fallback)))
        ->type_name(!row.words.empty()                             ? choice_of(row.words)
                    : row.values.find("text") != std::string::npos ? "TEXT"
                                                                   : "NUMBER");
}

} // namespace tribode
