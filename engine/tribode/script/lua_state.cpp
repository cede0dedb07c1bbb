#include "tribode/script/lua_state.hpp"
#include "tribode/base/error.hpp"
#include "tribode/script/sandbox.hpp"
#include "tribode/script/trampoline.hpp"
#include "tribode/script/value.hpp"

#include <cstdlib>
#include <fmt/format.h>
#include <lua.hpp>
#include <utility>

namespace tribode {

namespace {

// Lua's allocator: counts, and refuses above the limit; Lua then collects garbage and asks once more.
void* allocate(void* user, void* block, std::size_t old_size, std::size_t new_size) {
    ScriptHost& host = *static_cast<ScriptHost*>(user);
    if (!block) old_size = 0; // Lua then passes the kind of object instead
    if (new_size == 0) {
        std::free(block);
        host.limits.used->memory_bytes -= old_size;
        return nullptr;
    }
    const std::size_t others = host.limits.used->memory_bytes - old_size;
    const bool grows = new_size > old_size;
    if (grows && (new_size > host.limits.memory_bytes || others > host.limits.memory_bytes - new_size)) {
        return nullptr;
    }
    void* moved = std::realloc(block, new_size);
    if (moved) host.limits.used->memory_bytes = others + new_size;
    return moved;
}

// The arguments of the running function: one table as it is, anything else as a list.
Json read_arguments(lua_State* lua, const std::string& name) {
    const int count = lua_gettop(lua);
    if (count == 1 && lua_istable(lua, 1)) return tribode::to_json(lua, 1, name + ": options");
    Json list = Json::array();
    for (int i = 1; i <= count; ++i) list.push_back(tribode::to_json(lua, i, fmt::format("{}: argument {}", name, i)));
    return list;
}

} // namespace

LuaState::LuaState(const ScriptLimits& limits, ScriptAccess access, const RunControl& control)
    : host_(std::make_unique<ScriptHost>()) {
    host_->limits = limits;
    if (!host_->limits.used) host_->limits.used = std::make_shared<ScriptUse>();
    host_->access = std::move(access);
    host_->control = control;
    lua_.reset(lua_newstate(allocate, host_.get()));
    if (!lua_) {
        throw InputError(fmt::format("a memory limit of {} bytes is too small for any script", limits.memory_bytes));
    }
    set_host(lua_.get(), *host_);
    protected_call(lua_.get(), [](lua_State* lua) {
        open_libraries(lua);
        return 0;
    });
    watch_instructions(lua_.get());
}

LuaState::~LuaState() {
    lua_.reset();
    host_->limits.used->memory_bytes -= host_->graph_bytes;
}

void LuaState::Closer::operator()(lua_State* lua) const { lua_close(lua); }

void LuaState::add_stack_function(const std::string& name, StackFunction function) {
    protected_call(lua_.get(), [&](lua_State* lua) {
        push_module(lua);
        const auto dot = name.find('.');
        if (dot != std::string::npos) luaL_getsubtable(lua, -1, name.substr(0, dot).c_str());
        lua_pushnil(lua);
        push_function(lua, std::move(function));
        lua_setfield(lua, -2, name.c_str() + (dot == std::string::npos ? 0 : dot + 1));
        return 0;
    });
}

void LuaState::add_function(const std::string& name, Function function) {
    add_stack_function(name, [label = "tribode." + name, function = std::move(function)](lua_State* lua) {
        const Json result = function(read_arguments(lua, label));
        lua_settop(lua, 0); // the arguments may be garbage now
        push(lua, result);
        return 1;
    });
}

void LuaState::add_value(const std::string& name, const Json& value) {
    protected_call(lua_.get(), [&](lua_State* lua) {
        push_module(lua);
        push(lua, value);
        lua_setfield(lua, -2, name.c_str());
        return 0;
    });
}

void LuaState::set_up(const StackFunction& body) { protected_call(lua_.get(), body); }

Json LuaState::run(const std::string& name, const Json& argument, const std::function<void(lua_State*)>& load) {
    Json result;
    protected_call(lua_.get(), [&](lua_State* lua) {
        load(lua);
        const int arguments = argument.is_null() ? 0 : 1;
        if (arguments) push(lua, argument);
        lua_call(lua, arguments, 1);
        result = to_json(lua, -1, name + ": the returned value");
        return 0;
    });
    return result;
}

Json LuaState::run_file(const std::filesystem::path& path, const Json& argument) {
    return run(path.string(), argument, [&](lua_State* lua) {
        set_script_folder(lua, path.has_parent_path() ? path.parent_path() : ".");
        load_file(lua, path);
    });
}

Json LuaState::run_text(std::string_view text, const std::string& chunk_name, const Json& argument) {
    return run(chunk_name, argument, [&](lua_State* lua) { load_text(lua, text, chunk_name); });
}

void LuaState::enter(const StackFunction& body) {
    ScriptUse& used = *host_->limits.used;
    const std::uint64_t before = std::exchange(used.instructions, 0);
    try {
        protected_call(lua_.get(), body);
    } catch (const Error&) {
        used.instructions = before;
        throw;
    }
    used.instructions = before;
}

LuaState::Numbers LuaState::compile(std::string_view body, const std::vector<std::string>& arguments,
                                    const std::string& chunk_name) {
    int reference = LUA_NOREF;
    protected_call(lua_.get(), [&](lua_State* lua) {
        // On the first line of the body, so that lines in messages are those of the user.
        load_text(lua, fmt::format("local {} = ...; {}", fmt::join(arguments, ", "), body), chunk_name);
        reference = luaL_ref(lua, LUA_REGISTRYINDEX);
        return 0;
    });
    return [state = lua_.get(), reference, chunk_name](std::span<const double> in, std::span<double> out) {
        protected_call(state, [&](lua_State* lua) {
            lua_rawgeti(lua, LUA_REGISTRYINDEX, reference);
            for (const double number : in) lua_pushnumber(lua, number);
            lua_call(lua, static_cast<int>(in.size()), static_cast<int>(out.size()));
            for (std::size_t i = 0; i < out.size(); ++i) {
                int is_number = 0;
                out[i] = lua_tonumberx(lua, static_cast<int>(i) + 1, &is_number);
                if (is_number) continue;
                throw InputError(fmt::format("{}: must return {} number{}, returned {} as number {}", chunk_name,
                                             out.size(), out.size() == 1 ? "" : "s",
                                             luaL_typename(lua, static_cast<int>(i) + 1), i + 1));
            }
            return 0;
        });
    };
}

void LuaState::set_global(const std::string& name, double value) {
    protected_call(lua_.get(), [&](lua_State* lua) {
        lua_pushnumber(lua, value);
        lua_setglobal(lua, name.c_str());
        return 0;
    });
}

void LuaState::go_on() {
    host_->ended.reset();
    watch_instructions(lua_.get());
}

const std::string& LuaState::traceback() const { return host_->traceback; }

const ScriptAccess& LuaState::access() const { return host_->access; }

const ScriptLimits& LuaState::limits() const { return host_->limits; }

} // namespace tribode
