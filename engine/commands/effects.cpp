#include "commands/command.hpp"
#include "tribode/effect/effect.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

// A parameter and, below it, the fields of its records.
std::string line_of(const Json& parameter, std::size_t indent) {
    const auto text = [&](const char* key) {
        const auto it = parameter.find(key);
        return it == parameter.end() ? "" : it->is_string() ? it->get<std::string>() : it->dump();
    };
    std::string line = fmt::format("{:{}}{:<{}} {}", "", indent, text("name"), 24 - indent, text("meaning"));
    if (const std::string unit = text("unit"); !unit.empty()) line += fmt::format(" [{}]", unit);
    if (parameter.contains("plausible")) {
        line += fmt::format("; usually {} to {}", parameter["plausible"][0].dump(), parameter["plausible"][1].dump());
    }
    if (parameter.contains("choices")) line += "; one of " + text("choices");
    if (parameter.contains("default")) line += "; default " + text("default");
    line += '\n';
    if (parameter.contains("fields")) {
        for (const auto& field : parameter["fields"]) line += line_of(field, indent + 2);
    }
    return line;
}

struct EffectsCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        app.add_option("name", name, "an effect: its equation, parameters and an example (default: a list of all)");
        common.add_json(app);
    }

    int run(const Common& common) override {
        const Json all = effect_list();
        if (name.empty()) {
            std::string text;
            for (const auto& kind : all) {
                text += fmt::format("{:<26} {}\n", kind["name"].get<std::string>(), kind["summary"].get<std::string>());
            }
            common.print(text, all);
            return done;
        }
        effect_kind(name); // a name that is not known is refused
        for (const auto& kind : all) {
            if (kind["name"] != name) continue;
            std::string text = fmt::format("{}: {}\n\n    {}\n\n", name, kind["summary"].get<std::string>(),
                                           kind["equation"].get<std::string>());
            for (const auto& parameter : kind["parameters"]) text += line_of(parameter, 2);
            text += fmt::format("\nIn a machine: {}\n",
                                Json{{"effects", {{{"name", name}, {"parameters", kind["example"]}}}}}.dump());
            common.print(text, kind);
        }
        return done;
    }

    std::string name;
};

} // namespace

std::unique_ptr<Command> effects_command() { return std::make_unique<EffectsCommand>(); }

} // namespace tribode
