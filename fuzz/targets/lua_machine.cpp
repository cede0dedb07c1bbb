#include "machine.hpp"
#include "target.hpp"
#include "tribode/base/error.hpp"
#include "tribode/script/lua_state.hpp"

namespace tribode::fuzz {

void run_lua_machine(std::string_view bytes) {
    RunControl control;
    control.stop = &Patience::over();
    Patience::begin();
    ScriptAccess nothing;
    nothing.read_folders = {scratch_folder()};
    try {
        LuaState lua({std::size_t{1} << 24, 1'000'000}, std::move(nothing), control);
        const Json json = lua.run_text(bytes, "a.lua");
        if (json.is_object()) run_machine(json);
    } catch (const InputError&) {
    } catch (const EndedEarly&) {
    }
}

} // namespace tribode::fuzz
