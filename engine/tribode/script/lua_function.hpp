#pragma once
#include "tribode/base/field_rows.hpp"
#include "tribode/script/lua_state.hpp"
#include "tribode/script/script_run.hpp"

#include <functional>
#include <memory>
#include <string>
#include <variant>
#include <vector>

namespace tribode {

struct Symbols;

// What functions of a script work with.
struct ScriptContext {
    ScriptRun& run;
    LuaState& lua;
    std::shared_ptr<Symbols> symbols; // of the equations that the script writes

    const ScriptAccess& access() const { return lua.access(); }
};

// A field of the module `tribode`, with its text in docs/lua-reference.md. Each file of bindings has a table of these; the
// functions convert between plain tables and the engine's types and hold no physics and no defaults.
struct LuaFunction {
    // Their arguments: the table of options, or a list of plain arguments; the result is what the script gets.
    using Plain = std::function<Json(const Json& arguments)>;
    using InScript = Json (*)(const ScriptContext& script, const Json& arguments);
    using OnStack = int (*)(const ScriptContext& script, lua_State* lua); // a lua_CFunction

    std::string name;
    std::variant<std::monostate, Plain, InScript, OnStack> function; // none: registered where its value comes from
    std::string usage, documentation;                                // Markdown, the columns of the reference
    std::vector<FieldRow> (*options)() = nullptr; // of its table of options, where that has a table in the reference
};

// What is read besides an options struct, and the fields of the struct.
template <class Options>
std::vector<FieldRow> option_rows(std::vector<FieldRow> rows) {
    for (auto& row : field_rows<Options>()) rows.push_back(std::move(row));
    return rows;
}

// Puts the functions of a table into the state.
void add_functions(const ScriptContext& script, const std::vector<LuaFunction>& functions);

// The tables, by subject.
const std::vector<LuaFunction>& run_functions();
const std::vector<LuaFunction>& machine_functions();
const std::vector<LuaFunction>& experiment_functions();
const std::vector<LuaFunction>& analysis_functions();
const std::vector<LuaFunction>& measurement_functions();
const std::vector<LuaFunction>& design_functions();
const std::vector<LuaFunction>& diagnosis_functions();
const std::vector<LuaFunction>& record_functions();
const std::vector<LuaFunction>& batch_functions();
const std::vector<LuaFunction>& system_functions();

// All of them.
std::vector<LuaFunction> all_functions();

} // namespace tribode
