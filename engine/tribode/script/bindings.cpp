#include "tribode/script/bindings.hpp"
#include "tribode/base/text.hpp"
#include "tribode/script/lookup_bindings.hpp"
#include "tribode/script/lua_function.hpp"
#include "tribode/script/ready_parts.hpp"
#include "tribode/script/symbols.hpp"

namespace tribode {

void add_bindings(LuaState& lua, ScriptRun& run) {
    const ScriptContext script{run, lua, std::make_shared<Symbols>()};
    lua.add_value("version", version());
    lua.add_value("quick", run.quick());
    add_functions(script, all_functions());
    add_symbols(lua, script.symbols);
    add_lookups(lua, script.symbols);
    add_ready_parts(lua);
}

} // namespace tribode
