#include "script/sampling_bindings.hpp"
#include "base/error.hpp"
#include "base/field_reader.hpp"
#include "batch/sampling.hpp"
#include "machine/machine_model.hpp"

namespace tribode {

namespace {

constexpr long most_at_once = 10'000'000; // points in one list

// The options of tb.grid and the like are the description without its kind.
LuaState::Function design_function(const std::string& kind) {
    return [kind](const Json& arguments) {
        Json description = {{"design", kind}};
        if (arguments.is_object()) description.update(arguments);
        description["design"] = kind;
        return Design::from_description(description, "tb." + kind).description();
    };
}

Json points_of(const Json& arguments) {
    FieldReader fields(arguments, "tb.points");
    const Design design = Design::from_description(fields.value("design"), fields.name_of("design"));
    const auto count = static_cast<long>(design.count());
    const long first = fields.integer("first", 1, count, 1);
    const long wanted = fields.integer("count", 1, count - first + 1, count - first + 1);
    fields.finish();
    if (wanted > most_at_once) throw InputError("tb.points: more than 1e7 points at once; use first and count");
    Json points = Json::array();
    for (long i = first - 1; i < first - 1 + wanted; ++i) points.push_back(design.point(static_cast<std::uint64_t>(i)));
    return points;
}

// tb.with_fields(machine, fields), or one table of options.
Json change_machine(const Json& arguments) {
    const std::string name = "tb.with_fields";
    if (arguments.is_array() && !arguments.empty()) {
        if (arguments.size() != 2) throw InputError(name + ": wants a machine and a table of fields");
        return change_machine({{"machine", arguments[0]}, {"fields", arguments[1]}});
    }
    FieldReader fields(arguments, name);
    const Json& machine = fields.value("machine");
    const Json& replaced = fields.value("fields");
    const Json& scaled = fields.value("scale");
    fields.finish();
    Json changed = with_fields(machine, replaced, scaled, name);
    MachineModel::from_description(changed, name); // names and values are checked here, not at the first run
    return changed;
}

} // namespace

void add_sampling_bindings(LuaState& lua) {
    for (const char* kind :
         {"grid", "list", "monte_carlo", "latin_hypercube", "sobol", "saltelli", "one_at_a_time"}) {
        lua.add_function(kind, design_function(kind));
    }
    lua.add_function("points", points_of);
    lua.add_function("with_fields", change_machine);
}

} // namespace tribode
