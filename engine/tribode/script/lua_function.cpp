#include "tribode/script/lua_function.hpp"

namespace tribode {

void add_functions(const ScriptContext& script, const std::vector<LuaFunction>& functions) {
    for (const auto& entry : functions) {
        if (const auto* plain = std::get_if<LuaFunction::Plain>(&entry.function)) {
            script.lua.add_function(entry.name, *plain);
        } else if (const auto* in_script = std::get_if<LuaFunction::InScript>(&entry.function)) {
            script.lua.add_function(
                entry.name, [script, call = *in_script](const Json& arguments) { return call(script, arguments); });
        } else if (const auto* on_stack = std::get_if<LuaFunction::OnStack>(&entry.function)) {
            script.lua.add_stack_function(entry.name,
                                          [script, call = *on_stack](lua_State* lua) { return call(script, lua); });
        }
    }
}

std::vector<LuaFunction> all_functions() {
    std::vector<LuaFunction> all;
    for (const auto* table : {&run_functions(), &machine_functions(), &experiment_functions(), &analysis_functions(),
                              &measurement_functions(), &design_functions(), &diagnosis_functions(),
                              &record_functions(), &batch_functions(), &system_functions()}) {
        all.insert(all.end(), table->begin(), table->end());
    }
    return all;
}

} // namespace tribode
