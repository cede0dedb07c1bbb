#include "target.hpp"
#include "tribode/base/error.hpp"
#include "tribode/script/lookup_bindings.hpp"
#include "tribode/script/lua_function.hpp"
#include "tribode/script/lua_state.hpp"
#include "tribode/script/ready_parts.hpp"
#include "tribode/script/script_run.hpp"
#include "tribode/script/symbols.hpp"

namespace tribode::fuzz {

namespace {

// A run that the functions of systems may ask about their surroundings.
ScriptRun& surroundings() {
    static const auto run = [] {
        const auto script = scratch_folder() / "system.lua";
        write_plainly(script, "");
        ScriptRequest request;
        request.script = script;
        request.folder = scratch_folder() / "system";
        request.only_batch = true; // keeps no list of its work
        RunControl control;
        control.stop = &Patience::over();
        return std::make_unique<ScriptRun>(request, control);
    }();
    return *run;
}

constexpr std::string_view use = "local make, problem = load((...), '=a.lua')\n"
                                 "if not make then error(problem, 0) end\n"
                                 "local tb, system = require 'tribode', make()\n"
                                 "if not system then return end\n"
                                 "tb.run_system { system = system, duration_s = 0.5, output_step_s = 0.1 }\n"
                                 "tb.linearize { system = system }\n";

} // namespace

// A script with the functions of systems: tb.system, tb.run_system, tb.linearize. What it does with them is its own; a
// system that it returns, as a file of models/systems does, is run and linearized.
void run_system(std::string_view bytes) {
    ScriptRun& run = surroundings();
    Patience::begin();
    try {
        LuaState lua({std::size_t{1} << 25, 1'000'000}, {}, run.control());
        const ScriptContext script{run, lua, std::make_shared<Symbols>()};
        add_functions(script, system_functions());
        add_symbols(lua, script.symbols);
        add_lookups(lua, script.symbols);
        add_ready_parts(lua);
        lua.run_text(use, "use.lua", std::string(bytes));
    } catch (const InputError&) {
    } catch (const EndedEarly&) {
    }
}

} // namespace tribode::fuzz
