#include "base/error.hpp"
#include "script/lua_state.hpp"
#include "script/script_run.hpp"
#include "script/system_bindings.hpp"
#include "target.hpp"

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

} // namespace

// A script with the functions of systems: tb.system, tb.run_system, tb.linearize. What it does with them is its own.
void run_system(std::string_view bytes) {
    ScriptRun& run = surroundings();
    Patience::begin();
    try {
        LuaState lua({std::size_t{1} << 25, 1'000'000}, {}, run.control());
        add_system_bindings(lua, run);
        lua.run_text(bytes, "a.lua");
    } catch (const InputError&) {
    } catch (const EndedEarly&) {
    }
}

} // namespace tribode::fuzz
