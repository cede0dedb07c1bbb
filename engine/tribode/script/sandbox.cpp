#include "tribode/script/sandbox.hpp"
#include "tribode/base/error.hpp"
#include "tribode/script/ordered_tables.hpp"
#include "tribode/script/trampoline.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fmt/format.h>
#include <lua.hpp>
#include <unistd.h>

namespace tribode {

namespace fs = std::filesystem;

namespace {

constexpr std::uint64_t coroutine_charge = 1000; // instructions

// Argument `index` of the function `name` as a text.
std::string text_argument(lua_State* lua, int index, std::string_view name) {
    if (lua_type(lua, index) != LUA_TSTRING) {
        const char* found = lua_isnoneornil(lua, index) ? "missing" : luaL_typename(lua, index);
        throw InputError(fmt::format("{}: argument {} is {}, must be a text", name, index, found));
    }
    std::size_t length = 0;
    const char* text = lua_tolstring(lua, index, &length);
    return {text, length};
}

// Throws what a failed lua_load left on the stack. [-1, +0]
[[noreturn]] void fail_to_load(lua_State* lua, const std::string& name) {
    std::string text = lua_tostring(lua, -1);
    lua_pop(lua, 1);
    if (text.starts_with("attempt to load a")) {
        text = fmt::format("{}: is compiled Lua, must be program text", name);
    }
    throw InputError(text);
}

// ---- base --------------------------------------------------------------------------------

int safe_load(lua_State* lua) {
    // A missing environment and one that is nil differ, so the number of arguments stays.
    lua_settop(lua, std::max(lua_gettop(lua), 3));
    // A name that begins with @ is that of a file, and only what was read from a file has one.
    if (lua_type(lua, 2) == LUA_TSTRING && *lua_tostring(lua, 2) == '@') {
        std::string plain = text_argument(lua, 2, "load");
        plain.front() = '=';
        lua_pushlstring(lua, plain.data(), plain.size());
        lua_replace(lua, 2);
    }
    lua_pushliteral(lua, "t");
    lua_replace(lua, 3);
    return call_replaced(lua);
}

int safe_loadfile(lua_State* lua) {
    const fs::path name = text_argument(lua, 1, "loadfile");
    host_of(lua).access.check_read(name);
    const bool has_environment = !lua_isnone(lua, 3);
    if (luaL_loadfilex(lua, name.c_str(), "t") != LUA_OK) {
        lua_pushnil(lua);
        lua_insert(lua, -2);
        return 2;
    }
    host_of(lua).loaded_files.insert(name.string());
    if (has_environment) {
        lua_pushvalue(lua, 3);
        lua_setupvalue(lua, -2, 1);
    }
    return 1;
}

int safe_dofile(lua_State* lua) {
    const fs::path name = text_argument(lua, 1, "dofile");
    host_of(lua).access.check_read(name);
    lua_settop(lua, 1);
    load_file(lua, name);
    lua_call(lua, 0, LUA_MULTRET);
    return lua_gettop(lua) - 1;
}

// Lua runs finalizers with the hook switched off: an endless one could not be stopped.
int safe_setmetatable(lua_State* lua) {
    if (!lua_istable(lua, 1)) throw InputError("setmetatable: argument 1 must be a table");
    if (!lua_istable(lua, 2) && lua_type(lua, 2) != LUA_TNIL) {
        throw InputError("setmetatable: argument 2 must be a table or nil");
    }
    lua_settop(lua, 2);
    if (luaL_getmetafield(lua, 1, "__metatable") != LUA_TNIL) {
        throw InputError("setmetatable: the metatable is protected");
    }
    if (lua_istable(lua, 2)) {
        lua_pushliteral(lua, "__gc");
        if (lua_rawget(lua, 2) != LUA_TNIL) {
            throw InputError("setmetatable: __gc is not available to scripts; use --allow-all");
        }
        lua_pop(lua, 1);
    }
    lua_setmetatable(lua, 1);
    return 1;
}

// Each coroutine begins a count of its own, so that many short ones would stay below the hook.
int counted_coroutine(lua_State* lua) {
    if (!lua_isfunction(lua, 1)) throw InputError("coroutine.create: argument 1 must be a function");
    charge_instructions(lua, coroutine_charge);
    return call_replaced(lua);
}

// Lua runs error handlers, finalizers, and the __close of a coroutine that failed with the hook switched off
// when the error came from the hook itself. After the end no code of the script may run there.
constexpr std::string_view protected_calls = R"(
    local has_ended = ...
    local type, error, xpcall = type, error, xpcall
    local create, resume, status, close = coroutine.create, coroutine.resume, coroutine.status, coroutine.close

    _G.xpcall = function(f, handler, ...)
        if type(handler) ~= "function" then error("xpcall: argument 2 must be a function", 2) end
        local function handle(...)
            if has_ended() then return ... end
            return handler(...)
        end
        return xpcall(f, handle, ...)
    end

    local function finish(co, ok, ...)
        if ok then return ... end
        if status(co) == "dead" then close(co) end
        error((...), 0)
    end

    coroutine.wrap = function(f)
        local co = create(f)
        return function(...) return finish(co, resume(co, ...)) end
    end
)";

int has_ended(lua_State* lua) {
    lua_pushboolean(lua, host_of(lua).ended.has_value());
    return 1;
}

void replace_protected_calls(lua_State* lua) {
    if (luaL_loadbufferx(lua, protected_calls.data(), protected_calls.size(), own_chunk, "t") != LUA_OK) {
        fail_to_load(lua, own_chunk);
    }
    lua_pushcfunction(lua, has_ended);
    lua_call(lua, 1, 0);
}

// ---- files -------------------------------------------------------------------------------

// Calls the replaced function with the name of an open file in place of its first argument, and closes the file.
int call_with_open_file(lua_State* lua, int file) {
    struct Closed {
        int file;
        ~Closed() { ::close(file); }
    } const closed{file};
    lua_pushfstring(lua, "/proc/self/fd/%d", file);
    lua_replace(lua, 1);
    return call_replaced(lua);
}

bool is_mode(std::string_view mode) {
    if (mode.empty() || std::string_view("rwa").find(mode[0]) == std::string_view::npos) return false;
    mode.remove_prefix(mode.substr(1).starts_with('+') ? 2 : 1);
    return mode.find_first_not_of('b') == std::string_view::npos;
}

int safe_open(lua_State* lua) {
    const std::string name = text_argument(lua, 1, "io.open");
    const std::string mode = lua_isnoneornil(lua, 2) ? "r" : text_argument(lua, 2, "io.open");
    const ScriptAccess& access = host_of(lua).access;
    if (!is_mode(mode)) {
        access.check_write(name);
        throw InputError("bad argument #2 to 'open' (invalid mode)"); // as Lua says it
    }
    const bool reads = mode.find_first_of("wa+") == std::string::npos;
    const int file = reads ? access.open_to_read(name) : access.open_to_write(name, mode[0] != 'r');
    return file >= 0 ? call_with_open_file(lua, file) : luaL_fileresult(lua, 0, name.c_str());
}

int safe_lines(lua_State* lua) {
    const std::string name = text_argument(lua, 1, "io.lines");
    const int file = host_of(lua).access.open_to_read(name);
    if (file < 0) throw InputError(fmt::format("{}: {}", name, std::strerror(errno)));
    return call_with_open_file(lua, file);
}

// The file of a module; throws where none is found.
fs::path module_file(const ScriptHost& host, const std::string& name) {
    std::string relative = name;
    std::replace(relative.begin(), relative.end(), '.', '/');
    if (relative.starts_with('/')) throw InputError(fmt::format("the module name \"{}\" is not relative", name));
    std::vector<fs::path> folders = host.access.read_folders;
    folders.insert(folders.begin(), host.script_folder);
    std::vector<std::string> searched;
    for (const auto& folder : folders) {
        for (const auto& file : {folder / (relative + ".lua"), folder / relative / "init.lua"}) {
            std::error_code problem;
            if (fs::is_regular_file(file, problem)) {
                host.access.check_module(file, host.script_folder);
                return file;
            }
            searched.push_back(file.string());
        }
    }
    throw InputError(fmt::format("the module \"{}\" was not found; searched: {}", name, fmt::join(searched, ", ")));
}

int safe_require(lua_State* lua) {
    const std::string name = text_argument(lua, 1, "require");
    lua_settop(lua, 1);
    luaL_getsubtable(lua, LUA_REGISTRYINDEX, LUA_LOADED_TABLE);
    if (lua_getfield(lua, 2, name.c_str()) != LUA_TNIL) return 1;
    const fs::path file = module_file(host_of(lua), name);
    load_file(lua, file);
    lua_pushvalue(lua, 1);
    lua_call(lua, 1, 1);
    if (lua_isnil(lua, -1)) lua_pushboolean(lua, true);
    lua_pushvalue(lua, -1);
    lua_setfield(lua, 2, name.c_str());
    return 1;
}

// ---- libraries ---------------------------------------------------------------------------

// Field `name` of the table on top becomes `function`, with the old value for call_replaced. [-0, +0]
void replace(lua_State* lua, const char* name, LuaState::StackFunction function) {
    lua_getfield(lua, -1, name);
    push_function(lua, std::move(function));
    lua_setfield(lua, -2, name);
}

// Removes all other fields of the table on top. [-0, +0]
void keep_only(lua_State* lua, const std::vector<std::string_view>& names) {
    lua_pushnil(lua);
    while (lua_next(lua, -2)) {
        lua_pop(lua, 1);
        if (std::find(names.begin(), names.end(), lua_tostring(lua, -1)) != names.end()) continue;
        lua_pushvalue(lua, -1);
        lua_pushnil(lua);
        lua_rawset(lua, -4);
    }
}

void open_base(lua_State* lua) {
    luaL_requiref(lua, "_G", luaopen_base, 1);
    replace(lua, "load", safe_load);
    replace(lua, "loadfile", safe_loadfile);
    replace(lua, "dofile", safe_dofile);
    replace(lua, "setmetatable", safe_setmetatable);
    replace(lua, "require", safe_require);
    lua_pop(lua, 1);
}

// Nothing as often as one likes takes no memory, so that no limit ends Lua's loop over it.
int safe_rep(lua_State* lua) {
    const auto is_empty = [lua](int index) {
        return lua_type(lua, index) == LUA_TSTRING && lua_rawlen(lua, index) == 0;
    };
    int is_whole = 0;
    lua_tointegerx(lua, 2, &is_whole);
    const bool is_nothing = is_empty(1) && (lua_isnoneornil(lua, 3) || is_empty(3));
    if (!is_nothing || !is_whole) return call_replaced(lua);
    lua_pushliteral(lua, "");
    return 1;
}

void open_text_and_numbers(lua_State* lua) {
    luaL_requiref(lua, "string", luaopen_string, 1);
    lua_pushnil(lua);
    lua_setfield(lua, -2, "dump");
    replace(lua, "rep", safe_rep);
    luaL_requiref(lua, "table", luaopen_table, 1);
    luaL_requiref(lua, "math", luaopen_math, 1);
    luaL_requiref(lua, "utf8", luaopen_utf8, 1);
    lua_pop(lua, 4);
}

void open_coroutine(lua_State* lua) {
    luaL_requiref(lua, "coroutine", luaopen_coroutine, 1);
    replace(lua, "create", counted_coroutine);
    replace(lua, "close", call_replaced); // refuses after the end, as all our functions do
    lua_pop(lua, 1);
    replace_protected_calls(lua);
}

void open_system(lua_State* lua) {
    luaL_requiref(lua, "os", luaopen_os, 1);
    keep_only(lua, {"clock", "date", "difftime", "time"});
    luaL_requiref(lua, "io", luaopen_io, 1);
    keep_only(lua, {"close", "lines", "open", "stderr", "stdout", "type", "write"});
    replace(lua, "open", safe_open);
    replace(lua, "lines", safe_lines);
    // The finalizer of files is in their metatable, out of reach.
    luaL_getmetatable(lua, LUA_FILEHANDLE);
    lua_pushboolean(lua, false);
    lua_setfield(lua, -2, "__metatable");
    lua_pop(lua, 1);
    luaL_requiref(lua, "debug", luaopen_debug, 1);
    keep_only(lua, {"traceback"});
    lua_pop(lua, 3);
}

// Lua's own seed is the time; a run must be repeatable.
void seed_random_numbers(lua_State* lua) {
    lua_getglobal(lua, "math");
    lua_getfield(lua, -1, "randomseed");
    lua_pushinteger(lua, 0);
    lua_call(lua, 1, 0);
    lua_pop(lua, 1);
}

// ---- the open state: Lua's own functions, but what a script reads is noted ----------------------------------------

int call_noted(lua_State* lua) {
    lua_pushvalue(lua, lua_upvalueindex(2));
    lua_insert(lua, 1);
    if (lua_pcall(lua, lua_gettop(lua) - 1, LUA_MULTRET, 0) == LUA_OK) return lua_gettop(lua);
    // A text gets the script's line, which the function did not find; other errors are the script's own.
    if (lua_type(lua, -1) == LUA_TSTRING) throw InputError(lua_tostring(lua, -1));
    return lua_error(lua);
}

void note_text(lua_State* lua, int index) {
    if (lua_type(lua, index) == LUA_TSTRING) host_of(lua).access.check_read(lua_tostring(lua, index));
}

int noted_read(lua_State* lua) {
    note_text(lua, 1);
    return call_noted(lua);
}

int noted_open(lua_State* lua) {
    const bool only_writes = lua_type(lua, 2) == LUA_TSTRING && is_mode(lua_tostring(lua, 2)) &&
                             std::string_view(lua_tostring(lua, 2)).find_first_of("r+") == std::string_view::npos;
    if (!only_writes) note_text(lua, 1);
    return call_noted(lua);
}

// The second result is the file that the module came from, where the module was not there before.
int noted_require(lua_State* lua) {
    const int results = call_noted(lua);
    if (results == 2) note_text(lua, -1);
    return results;
}

void note_what_is_read(lua_State* lua) {
    lua_pushglobaltable(lua);
    for (const char* name : {"dofile", "loadfile"}) replace(lua, name, noted_read);
    replace(lua, "require", noted_require);
    lua_getfield(lua, -1, "io");
    for (const char* name : {"input", "lines"}) replace(lua, name, noted_read);
    replace(lua, "open", noted_open);
    lua_pop(lua, 2);
}

// The open state has Lua's own `require`. [-0, +0]
void search_first(lua_State* lua, const fs::path& folder) {
    const std::string patterns = fmt::format("{};{};", (folder / "?.lua").string(), (folder / "?/init.lua").string());
    lua_getglobal(lua, "package");
    lua_pushlstring(lua, patterns.data(), patterns.size());
    lua_getfield(lua, -2, "path");
    lua_concat(lua, 2);
    lua_setfield(lua, -2, "path");
    lua_pop(lua, 1);
}

} // namespace

void open_libraries(lua_State* lua) {
    const ScriptAccess& access = host_of(lua).access;
    if (access.allow_all) {
        luaL_openlibs(lua);
        note_what_is_read(lua);
        for (auto folder = access.read_folders.rbegin(); folder != access.read_folders.rend(); ++folder) {
            search_first(lua, *folder);
        }
    } else {
        open_base(lua);
        open_text_and_numbers(lua);
        open_coroutine(lua);
        open_system(lua);
    }
    seed_random_numbers(lua);
    order_tables(lua);
    luaL_getsubtable(lua, LUA_REGISTRYINDEX, LUA_LOADED_TABLE);
    lua_newtable(lua);
    lua_setfield(lua, -2, "tribode");
    lua_pop(lua, 1);
}

void push_module(lua_State* lua) {
    luaL_getsubtable(lua, LUA_REGISTRYINDEX, LUA_LOADED_TABLE);
    lua_getfield(lua, -1, "tribode");
    lua_remove(lua, -2);
}

void load_file(lua_State* lua, const fs::path& path) {
    if (luaL_loadfilex(lua, path.c_str(), "t") != LUA_OK) fail_to_load(lua, path.string());
    host_of(lua).loaded_files.insert(path.string());
}

void load_text(lua_State* lua, std::string_view text, const std::string& chunk_name) {
    const std::string name = fmt::format("={}", chunk_name); // no file, see safe_load
    if (luaL_loadbufferx(lua, text.data(), text.size(), name.c_str(), "t") != LUA_OK) fail_to_load(lua, chunk_name);
}

void set_script_folder(lua_State* lua, const fs::path& folder) {
    ScriptHost& host = host_of(lua);
    if (host.access.allow_all && folder != host.script_folder) search_first(lua, folder);
    host.script_folder = folder;
}

} // namespace tribode
