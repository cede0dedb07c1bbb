#include "tribode/analysis/modal_fit.hpp"
#include "tribode/base/error.hpp"
#include "tribode/batch/sampling.hpp"
#include "tribode/effect/effect.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/script/conversions.hpp"
#include "tribode/script/lua_function.hpp"

namespace tribode {

namespace {

Json load_machine(const ScriptContext& script, const Json& arguments) {
    if (arguments.is_array() && arguments.size() == 1 && arguments[0].is_string()) {
        return script.run.machine(arguments[0].get<std::string>(), nullptr);
    }
    if (arguments.is_object() && !arguments.empty() && !arguments.contains("file")) {
        return script.run.checked_machine(arguments, "tb.machine");
    }
    FieldReader fields(arguments, "tb.machine");
    const std::string file = fields.text("file");
    const Json& argument = fields.value("argument");
    fields.finish();
    return script.run.machine(file, argument);
}

Json plant_parameters(const Json& arguments) {
    FieldReader fields(arguments, "tb.plant_parameters");
    const MachineModel machine = machine_of(fields);
    fields.finish();
    return to_json(modal_model_of(machine));
}

Json plant_response(const Json& arguments) {
    FieldReader fields(arguments, "tb.plant_response");
    const MachineModel machine = machine_of(fields);
    FrequencyResponse response;
    response.frequency_hz = fields.numbers("frequency_hz", "Hz", Allowed::positive, {});
    fields.finish();
    const ModalModel model = modal_model_of(machine);
    for (const double f : response.frequency_hz) response.value.push_back(model.response(f));
    return to_json(response);
}

Json list_effects(const Json& arguments) {
    FieldReader(arguments, "tb.effects").finish();
    return effect_list();
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
    if (!machine.is_object()) throw InputError(name + ": machine must be a machine description, see tb.machine");
    return MachineModel::from_description(machine, name).with_fields(replaced, scaled, name).description();
}

} // namespace

const std::vector<LuaFunction>& machine_functions() {
    static const std::vector<LuaFunction> functions = {
        {"machine", load_machine,
         "`tb.machine \"FILE\"`, `tb.machine{ file =, argument = }`, `tb.machine{ mass_kg =, … }`",
         "reads and checks a machine description (`.lua` or `.json`, [fields](machine-description.md)), or checks one "
         "given as a table; implausible values cause a warning; `mass_kg` becomes `rigid_gain_per_kg`. `argument` is "
         "passed "
         "to a Lua file as `...`. A relative name is searched in the working folder, then in the folder of the "
         "run, then next to the ready `models/` and `scripts/`"},
        {"plant_parameters", plant_parameters, "`tb.plant_parameters{ machine = }`",
         "the linear dynamics, eq. (1): `{ k0, k1, f1_hz, zeta1, k2, … }`"},
        {"plant_response", plant_response, "`tb.plant_response{ machine =, frequency_hz = {…} }`",
         "response of the linear dynamics, thrust to position [m/N]"},
        {"effects", list_effects, "`tb.effects{}`",
         "the kinds of [effects](effects.md) a machine may have: a list of `{ name, summary, equation, parameters, "
         "example, affine, is_friction_law, drawn_against, lua }`; `lua` is the text by which `models/servo` adds it; "
         "a parameter has "
         "`name`, `meaning`, `type` and, if it is a number, `unit`, `allowed`, `plausible`, `default`"},
        {"with_fields", change_machine,
         "`tb.with_fields(machine, fields)`, `tb.with_fields{ machine =, fields = {…}, scale = {…} }`",
         "a changed copy, checked: `fields` maps paths such as `\"friction.elements[3].K\"` to new values, `scale` to "
         "factors; `[*]` is every entry of a list. A path that does not exist and a value that is not allowed are "
         "refused ([more](batch-analysis.md#fields-of-a-machine))"},
    };
    return functions;
}

} // namespace tribode
