#include "tribode/script/system_file.hpp"
#include "tribode/base/error.hpp"
#include "tribode/script/sandbox.hpp"
#include "tribode/script/system_reader.hpp"

#include <fmt/format.h>
#include <lua.hpp>
#include <optional>

namespace tribode {

Equations system_of_file(ScriptRun& run) {
    const std::filesystem::path& path = run.request().script;
    const std::string file = path.string();
    std::optional<Equations> found;
    std::string other;
    run.lua().enter([&](lua_State* lua) {
        set_script_folder(lua, path.has_parent_path() ? path.parent_path() : ".");
        load_file(lua, path);
        lua_call(lua, 0, 1);
        if (const Equations* system = system_at(lua, -1)) found = *system;
        other = luaL_typename(lua, -1);
        return 0;
    });
    if (!found) throw InputError(fmt::format("{}: returns a {}, must return a system (see tb.system)", file, other));
    return *std::move(found);
}

} // namespace tribode
