#include "lua_system.hpp"
#include "tribode/base/error.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/script/sandbox.hpp"
#include "tribode/script/script_run.hpp"
#include "tribode/script/system_reader.hpp"
#include "tribode/script/value.hpp"

#include <cstdlib>
#include <fmt/format.h>
#include <lua.hpp>

namespace tribode::python {

namespace {

namespace fs = std::filesystem;

class TemporaryFolder {
  public:
    TemporaryFolder() {
        std::string name = (fs::temp_directory_path() / "tribode-XXXXXX").string();
        if (!::mkdtemp(name.data())) throw OutputError(fmt::format("{}: the folder cannot be made", name));
        path_ = name;
    }
    ~TemporaryFolder() {
        std::error_code ignored;
        fs::remove_all(path_, ignored);
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;

    const fs::path& path() const { return path_; }

  private:
    fs::path path_;
};

// Calls the function of the module with the options and the system; `use` finds its result on top of the stack.
void with_result(const LuaSystem& system, const std::string& function, const Json& options, const RunControl& control,
                 const std::function<void(lua_State*)>& use) {
    if (options.contains("system")) throw InputError(fmt::format("tb.{}: system is this one, give no other", function));
    const TemporaryFolder folder;
    ScriptRequest request;
    request.script = folder.path() / "system.lua";
    write_file(request.script, system.text);
    request.folder = folder.path();
    request.read_folders = system.read_folders;
    request.compile = system.compile;
    request.only_batch = true; // nothing is written of the work done
    ScriptRun run(request, control);
    run.lua().enter([&](lua_State* lua) {
        if (!system.folder.empty()) set_script_folder(lua, system.folder);
        load_text(lua, system.text, system.name);
        lua_call(lua, 0, 1);
        if (!system_at(lua, -1)) {
            throw InputError(fmt::format("{}: must return a system (see tb.system), returned {}", system.name,
                                         lua_isnil(lua, -1) ? "nothing" : fmt::format("a {}", luaL_typename(lua, -1))));
        }
        push_module(lua);
        lua_getfield(lua, -1, function.c_str());
        push(lua, options);
        lua_pushvalue(lua, -4);
        lua_setfield(lua, -2, "system");
        lua_call(lua, 1, 1);
        use(lua);
        return 0;
    });
}

std::string text_field(lua_State* lua, const char* name) {
    lua_getfield(lua, -1, name);
    std::string text = lua_tostring(lua, -1);
    lua_pop(lua, 1);
    return text;
}

// The list of columns on top of the stack. [-1, +0]
Table take_columns(lua_State* lua) {
    Table table;
    const auto count = static_cast<lua_Integer>(lua_rawlen(lua, -1));
    for (lua_Integer i = 1; i <= count; ++i) {
        lua_rawgeti(lua, -1, i);
        std::string name = text_field(lua, "name"), unit = text_field(lua, "unit");
        lua_getfield(lua, -1, "values");
        std::vector<double> values(lua_rawlen(lua, -1));
        for (std::size_t k = 0; k < values.size(); ++k) {
            lua_rawgeti(lua, -1, static_cast<lua_Integer>(k) + 1);
            values[k] = lua_tonumber(lua, -1);
            lua_pop(lua, 1);
        }
        table.add(std::move(name), std::move(unit), std::move(values));
        lua_pop(lua, 2);
    }
    lua_pop(lua, 1);
    return table;
}

} // namespace

LuaSystemRun run(const LuaSystem& system, const Json& options, const RunControl& control) {
    LuaSystemRun result;
    with_result(system, "run_system", options, control, [&](lua_State* lua) {
        lua_getfield(lua, -1, "columns");
        result.table = take_columns(lua);
        for (const char* list : {"columns", "values", "t"}) { // the same once more
            lua_pushnil(lua);
            lua_setfield(lua, -2, list);
        }
        result.info = to_json(lua, -1, "the result");
    });
    return result;
}

Json call(const LuaSystem& system, const std::string& function, const Json& options, const RunControl& control) {
    Json result;
    with_result(system, function, options, control, [&](lua_State* lua) { result = to_json(lua, -1, "the result"); });
    return result;
}

} // namespace tribode::python
