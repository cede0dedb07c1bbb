#include "tribode/fmu_import/unit_description.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <cmath>
#include <fmt/format.h>
#include <map>
#include <optional>
#include <pugixml.hpp>

namespace tribode {

namespace {

using Type = UnitDescription::Type;

std::optional<Type> type_of(int version, std::string_view element) {
    static const std::map<std::string_view, Type> of_2 = {
        {"Real", Type::real}, {"Integer", Type::int32}, {"Enumeration", Type::int32}, {"Boolean", Type::boolean}};
    static const std::map<std::string_view, Type> of_3 = {
        {"Float64", Type::real}, {"Float32", Type::float32}, {"Int8", Type::int8},         {"UInt8", Type::uint8},
        {"Int16", Type::int16},  {"UInt16", Type::uint16},   {"Int32", Type::int32},       {"UInt32", Type::uint32},
        {"Int64", Type::int64},  {"UInt64", Type::uint64},   {"Enumeration", Type::int64}, {"Boolean", Type::boolean}};
    const auto& types = version == 2 ? of_2 : of_3;
    const auto found = types.find(element);
    return found == types.end() ? std::nullopt : std::optional(found->second);
}

class Reader {
  public:
    Reader(const pugi::xml_document& document, const std::string& source)
        : root_(document.child("fmiModelDescription")),
          source_(source) {}

    UnitDescription read() {
        if (!root_) fail("has no element fmiModelDescription");
        const std::string version = root_.attribute("fmiVersion").value();
        if (!version.starts_with("2.") && !version.starts_with("3.")) {
            fail(fmt::format("is of FMI {}, must be of FMI 2.0 or 3.0", version.empty() ? "(no version)" : version));
        }
        made_.version = version[0] - '0';
        made_.model_name = root_.attribute("modelName").value();
        made_.token = root_.attribute(made_.version == 2 ? "guid" : "instantiationToken").value();
        const pugi::xml_node kind = root_.child("CoSimulation");
        if (!kind) fail("is no unit for co-simulation, must be one (model exchange is not imported)");
        made_.identifier = kind.attribute("modelIdentifier").value();
        if (made_.identifier.empty() || made_.identifier.find_first_of("/\\") != std::string::npos) {
            fail(fmt::format("has modelIdentifier \"{}\", must be the name of a library", made_.identifier));
        }
        made_.varies_step = kind.attribute("canHandleVariableCommunicationStepSize").as_bool();
        made_.one_instance = kind.attribute("canBeInstantiatedOnlyOncePerProcess").as_bool();
        made_.needs_tool = kind.attribute("needsExecutionTool").as_bool();
        if (const pugi::xml_attribute step = kind.attribute("fixedInternalStepSize")) {
            made_.fixed_step = number(step, "CoSimulation");
        }
        read_units();
        for (const pugi::xml_node& variable : root_.child("ModelVariables").children()) {
            if (variable.type() == pugi::node_element) read_variable(variable);
        }
        return std::move(made_);
    }

  private:
    [[noreturn]] void fail(const std::string& what) const { throw InputError(fmt::format("{}: {}", source_, what)); }

    // pugixml itself takes a text that is no number for zero.
    double number(const pugi::xml_attribute& attribute, const std::string& where, double max_natural = 0) const {
        const auto value = parse_number(attribute.value());
        const bool natural =
            max_natural == 0 || (value && *value >= 0 && *value <= max_natural && *value == std::floor(*value));
        if (value && std::isfinite(*value) && natural) return *value;
        fail(fmt::format("{}: {} = \"{}\", must be a {}number", printable(where), attribute.name(),
                         printable(attribute.value()), max_natural == 0 ? "finite " : "natural "));
    }

    void read_units() {
        for (const pugi::xml_node& type : root_.child("TypeDefinitions").children()) {
            // FMI 2: SimpleType with the attributes in a child; FMI 3: Float64Type.
            const pugi::xml_node holder = made_.version == 2 ? type.child("Real") : type;
            if (holder.attribute("unit")) unit_of_[type.attribute("name").value()] = holder.attribute("unit").value();
        }
    }

    void read_variable(const pugi::xml_node& variable) {
        const pugi::xml_node value = made_.version == 2 ? variable.first_child() : variable;
        const std::string causality = variable.attribute("causality").value(),
                          name = variable.attribute("name").value();
        std::vector<UnitDescription::Variable>* list = nullptr;
        if (causality == "input") list = &made_.inputs;
        if (causality == "output") list = &made_.outputs;
        if (causality == "parameter") list = &made_.parameters;
        if (!list) return;
        const auto type = type_of(made_.version, value.name());
        if (!type || variable.child("Dimension")) {
            made_.left_out.push_back(name);
            return;
        }
        UnitDescription::Variable made;
        made.name = name;
        made.type = *type;
        const pugi::xml_attribute reference = variable.attribute("valueReference");
        if (name.empty() || !reference) fail(fmt::format("variable \"{}\" has no name or valueReference", name));
        made.reference = static_cast<std::uint32_t>(number(reference, "variable " + name, 0xffffffff));
        made.unit = value.attribute("unit").value();
        if (made.unit.empty()) {
            const auto declared = unit_of_.find(value.attribute("declaredType").value());
            if (declared != unit_of_.end()) made.unit = declared->second;
        }
        if (const pugi::xml_attribute start = value.attribute("start")) {
            made.has_start = true;
            const bool truth = *type == Type::boolean;
            made.start = truth ? static_cast<double>(start.as_bool()) : number(start, "variable " + name);
        }
        list->push_back(std::move(made));
    }

    pugi::xml_node root_;
    const std::string& source_;
    std::map<std::string, std::string> unit_of_; // of the declared types
    UnitDescription made_;
};

} // namespace

UnitDescription read_unit_description(std::string_view xml, const std::string& source) {
    pugi::xml_document document;
    const auto parsed = document.load_buffer(xml.data(), xml.size());
    if (!parsed) {
        throw InputError(fmt::format("{}: is no XML: {}, at byte {}", source, parsed.description(), parsed.offset));
    }
    return Reader(document, source).read();
}

} // namespace tribode
