#include "tribode/fmu/model_description.hpp"
#include "tribode/base/text.hpp"
#include "tribode/system/units.hpp"

#include <cmath>
#include <fmt/format.h>
#include <set>

namespace tribode {

namespace {

using fmu::Variable;
using Kind = Variable::Kind;

std::string escaped(std::string_view text) {
    std::string out;
    for (const char c : text) {
        switch (c) {
        case '&': out += "&amp;"; break;
        case '<': out += "&lt;"; break;
        case '>': out += "&gt;"; break;
        case '"': out += "&quot;"; break;
        default: out += c;
        }
    }
    return out;
}

std::string attribute(const char* name, std::string_view value) {
    return value.empty() ? "" : fmt::format(" {}=\"{}\"", name, escaped(value));
}

// In powers of the base units of SI; empty where it is none of SI, and the importing program then knows its name only.
std::string base_unit(const std::string& unit) {
    const Dimension dimension = dimension_of(unit);
    if (!dimension) return "";
    std::string text;
    for (const auto& [name, power] : *dimension) {
        static const std::set<std::string> known = {"kg", "m", "s", "A", "K", "mol", "cd"};
        if (!known.contains(name) || power != std::round(power)) return "";
        text += fmt::format(" {}=\"{}\"", name, static_cast<int>(power));
    }
    constexpr double ice_point = 273.15; // [K]
    if (unit == "degC") text += fmt::format(" offset=\"{}\"", ice_point);
    return fmt::format("<BaseUnit{}/>", text);
}

std::string unit_definitions(const fmu::Model& model) {
    std::set<std::string> units;
    for (const auto& variable : model.variables()) {
        if (!variable.unit.empty()) units.insert(variable.unit);
    }
    if (units.empty()) return "";
    std::string text = "  <UnitDefinitions>\n";
    for (const auto& unit : units) {
        const std::string base = base_unit(unit);
        text += fmt::format("    <Unit name=\"{}\"{}\n", escaped(unit), base.empty() ? "/>" : ">" + base + "</Unit>");
    }
    return text + "  </UnitDefinitions>\n";
}

struct Attributes {
    const char *causality, *variability;
    const char* initial = ""; // empty: none
    bool start = false;
};

Attributes attributes_of(const Variable& variable) {
    switch (variable.kind) {
    case Kind::time: return {"independent", "continuous"};
    case Kind::parameter: return {"parameter", "fixed", "exact", true};
    case Kind::input: return {"input", variable.is_sampled ? "discrete" : "continuous", "", true};
    case Kind::output: return {"output", variable.is_sampled ? "discrete" : "continuous", "calculated"};
    case Kind::discrete: return {"local", "discrete", "exact", true};
    case Kind::state:
        if (variable.has_start) return {"local", "continuous", "exact", true};
        break;
    default: break;
    }
    return {"local", "continuous", "calculated"};
}

// Of FMI 2 references count from 1, by the place in the list; here value references are these places, from 0.
class Structure {
  public:
    Structure(const fmu::Model& model, FmiVersion version) : model_(model), fmi2_(version == FmiVersion::fmi2) {}

    std::string text() const { return "  <ModelStructure>\n" + (fmi2_ ? fmi2() : fmi3()) + "  </ModelStructure>\n"; }

  private:
    std::string unknown(const char* element, std::size_t reference, bool with_dependences = true) const {
        const auto& variable = model_.variables()[reference];
        std::string list;
        for (const std::size_t known : variable.depends_on) {
            list += fmt::format("{}{}", list.empty() ? "" : " ", known + (fmi2_ ? 1 : 0));
        }
        return fmt::format("<{} {}=\"{}\"{}/>\n", element, fmi2_ ? "index" : "valueReference",
                           reference + (fmi2_ ? 1 : 0),
                           with_dependences ? fmt::format(" dependencies=\"{}\"", list) : "");
    }

    std::string all(const char* element, std::initializer_list<Kind> kinds, const char* indent,
                    bool with_dependences = true) const {
        std::string text;
        for (std::size_t i = 0; i < model_.variables().size(); ++i) {
            for (const Kind kind : kinds) {
                if (model_.variables()[i].kind == kind) text += indent + unknown(element, i, with_dependences);
            }
        }
        return text;
    }

    std::string fmi2() const {
        const auto list = [&](const char* name, std::initializer_list<Kind> kinds, bool with_dependences = true) {
            const std::string inside = all("Unknown", kinds, "      ", with_dependences);
            return inside.empty() ? "" : fmt::format("    <{}>\n{}    </{}>\n", name, inside, name);
        };
        // At the start they may depend on anything.
        return list("Outputs", {Kind::output}) + list("Derivatives", {Kind::rate}) +
               list("InitialUnknowns", {Kind::output, Kind::rate}, false);
    }

    std::string fmi3() const {
        return all("Output", {Kind::output}, "    ") + all("ContinuousStateDerivative", {Kind::rate}, "    ") +
               all("InitialUnknown", {Kind::output, Kind::rate}, "    ", false) +
               all("EventIndicator", {Kind::event_indicator}, "    ", false);
    }

    const fmu::Model& model_;
    const bool fmi2_;
};

std::string variables_text(const fmu::Model& model, FmiVersion version) {
    std::string text = "  <ModelVariables>\n";
    for (std::size_t i = 0; i < model.variables().size(); ++i) {
        const Variable& variable = model.variables()[i];
        const Attributes has = attributes_of(variable);
        const std::string common = attribute("name", variable.name) + fmt::format(" valueReference=\"{}\"", i) +
                                   attribute("description", variable.description) +
                                   attribute("causality", has.causality) + attribute("variability", has.variability) +
                                   attribute("initial", has.initial);
        const std::string start = has.start ? attribute("start", to_text(variable.start)) : "";
        const bool is_rate = variable.kind == Kind::rate;
        if (version == FmiVersion::fmi2) {
            const auto derivative = is_rate ? fmt::format(" derivative=\"{}\"", variable.rate_of + 1) : "";
            text += fmt::format("    <ScalarVariable{}><Real{}{}{}/></ScalarVariable>\n", common,
                                attribute("unit", variable.unit), start, derivative);
        } else {
            const auto derivative = is_rate ? fmt::format(" derivative=\"{}\"", variable.rate_of) : "";
            text +=
                fmt::format("    <Float64{}{}{}{}/>\n", common, attribute("unit", variable.unit), start, derivative);
        }
    }
    return text + "  </ModelVariables>\n";
}

} // namespace

std::string model_description(const fmu::Model& model, FmiVersion version) {
    const bool fmi2 = version == FmiVersion::fmi2;
    std::string text = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription";
    text += attribute("fmiVersion", fmi2 ? "2.0" : "3.0") + attribute("modelName", model.name()) +
            attribute(fmi2 ? "guid" : "instantiationToken", model.token()) +
            attribute("generationTool", "Tribode " + tribode::version());
    if (fmi2) {
        text += " variableNamingConvention=\"flat\"";
        if (model.is_model_exchange()) {
            text += fmt::format(" numberOfEventIndicators=\"{}\"", model.count(Kind::event_indicator));
        }
    }
    text += ">\n";
    const std::string state = fmi2 ? "canGetAndSetFMUstate" : "canGetAndSetFMUState";
    text += fmt::format("  <{} modelIdentifier=\"{}\" {}=\"true\"{}/>\n",
                        model.is_model_exchange() ? "ModelExchange" : "CoSimulation", model.name(), state,
                        model.is_model_exchange() ? "" : " canHandleVariableCommunicationStepSize=\"true\"");
    text += unit_definitions(model);
    text += "  <LogCategories>\n    <Category name=\"logStatusError\" description=\"why a function has returned an "
            "error\"/>\n  </LogCategories>\n";
    text += fmt::format("  <DefaultExperiment startTime=\"0\" tolerance=\"{}\"{}/>\n", to_text(model.tolerance()),
                        model.step() > 0 ? attribute("stepSize", to_text(model.step())) : "");
    text += variables_text(model, version) + Structure(model, version).text();
    return text + "</fmiModelDescription>\n";
}

} // namespace tribode
