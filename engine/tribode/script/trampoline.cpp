#include "tribode/script/trampoline.hpp"
#include "tribode/base/error.hpp"

#include <fmt/format.h>
#include <lua.hpp>
#include <new>

namespace tribode {

namespace {

constexpr int hook_interval = 1000; // instructions

int raise(lua_State* lua, const Failure& failure) {
    host_of(lua).last_text[static_cast<std::size_t>(failure.kind)] = failure.text;
    lua_pushlstring(lua, failure.text.data(), failure.text.size());
    return lua_error(lua);
}

// Only texts pass through a script, and it may put its own line in front of them.
Failure recognized(const ScriptHost& host, const std::string& text) {
    for (const auto kind : {Failure::Kind::output, Failure::Kind::ended_early, Failure::Kind::other}) {
        const auto& last = host.last_text[static_cast<std::size_t>(kind)];
        if (!last.empty() && text.ends_with(last)) return {kind, text};
    }
    return {Failure::Kind::input, text};
}

// Copies the text of a C++ exception, leaves the catch block, and only then raises.
int guarded(lua_State* lua, const LuaState::StackFunction& body) {
    Failure failure;
    try {
        return body(lua);
    } catch (const InputError& problem) {
        failure = {Failure::Kind::input, problem.what()};
    } catch (const OutputError& problem) {
        failure = {Failure::Kind::output, problem.what()};
    } catch (const EndedEarly& problem) {
        failure = {Failure::Kind::ended_early, problem.what()};
    } catch (const std::bad_alloc&) {
        failure = {Failure::Kind::input, "there is not enough memory for this"};
    } catch (const std::exception& problem) {
        failure = {Failure::Kind::other, problem.what()};
    }
    // What is said of a line of the script, such as that of a function in a table, begins with that line already.
    const std::string place = where(lua), file = place.substr(0, place.find(':') + 1);
    const bool has_line = !file.empty() && failure.text.starts_with(file) && failure.text.size() > file.size() &&
                          failure.text[file.size()] >= '0' && failure.text[file.size()] <= '9';
    if (!has_line) failure.text.insert(0, place);
    return raise(lua, failure);
}

int call_function(lua_State* lua) {
    charge_instructions(lua, 0);
    return guarded(lua, *static_cast<LuaState::StackFunction*>(lua_touserdata(lua, lua_upvalueindex(1))));
}

int call_body(lua_State* lua) {
    const auto& body = *static_cast<const LuaState::StackFunction*>(lua_touserdata(lua, 1));
    lua_settop(lua, 0);
    return guarded(lua, body);
}

// An error value may be anything; from here on it is a text. [-1, +1]
int handle_error(lua_State* lua) {
    if (!lua_isstring(lua, 1) && !luaL_callmeta(lua, 1, "__tostring")) {
        const std::string text =
            fmt::format("{}the script raised a {} as its error, must be a text", where(lua), luaL_typename(lua, 1));
        lua_pushlstring(lua, text.data(), text.size());
    }
    lua_tostring(lua, -1);
    luaL_traceback(lua, lua, nullptr, 1);
    host_of(lua).traceback = lua_tostring(lua, -1);
    lua_pop(lua, 1);
    return 1;
}

std::optional<Failure> end_of(const ScriptHost& host) {
    if (host.control.stop_requested()) return Failure{Failure::Kind::ended_early, "interrupted"};
    if (host.limits.used->instructions <= host.limits.instructions) return std::nullopt;
    return Failure{Failure::Kind::input,
                   fmt::format("the script ran more than {} instructions (an endless loop?); --max-instructions "
                               "raises the limit",
                               host.limits.instructions)};
}

std::string memory_problem(const ScriptHost& host) {
    return fmt::format("the script used more than its memory limit of {} MiB",
                       static_cast<double>(host.limits.memory_bytes) / (1 << 20));
}

void count_hook(lua_State* lua, lua_Debug*);

// Ends the script where there is a reason, or was one before.
void end_where(lua_State* lua, const std::optional<Failure>& reason) {
    ScriptHost& host = host_of(lua);
    if (!host.ended && reason) {
        host.ended = reason;
        host.ended->text.insert(0, where(lua));
    }
    if (!host.ended) return;
    // A script that catches the error meets it again at its next instruction.
    lua_sethook(lua, count_hook, LUA_MASKCOUNT, 1);
    raise(lua, *host.ended);
}

void count_hook(lua_State* lua, lua_Debug*) { charge_instructions(lua, hook_interval); }

} // namespace

void Failure::throw_again() const {
    switch (kind) {
    case Kind::input: throw InputError(text);
    case Kind::output: throw OutputError(text);
    case Kind::ended_early: throw EndedEarly(text);
    case Kind::other: break;
    }
    throw Error(text);
}

ScriptHost& host_of(lua_State* lua) { return **static_cast<ScriptHost**>(lua_getextraspace(lua)); }

void set_host(lua_State* lua, ScriptHost& host) { *static_cast<ScriptHost**>(lua_getextraspace(lua)) = &host; }

std::string where(lua_State* lua) {
    lua_Debug call;
    for (int level = 0; lua_getstack(lua, level, &call); ++level) {
        lua_getinfo(lua, "Sl", &call);
        if (call.currentline > 0 && std::string_view(call.source) != own_chunk)
            return fmt::format("{}:{}: ", call.short_src, call.currentline);
    }
    return {};
}

void watch_instructions(lua_State* lua) { lua_sethook(lua, count_hook, LUA_MASKCOUNT, hook_interval); }

void charge_instructions(lua_State* lua, std::uint64_t count) {
    ScriptHost& host = host_of(lua);
    host.limits.used->instructions += count;
    end_where(lua, end_of(host));
}

void charge_graph(lua_State* lua, std::size_t bytes) {
    ScriptHost& host = host_of(lua);
    std::size_t& used = host.limits.used->memory_bytes;
    used = used - host.graph_bytes + bytes;
    host.graph_bytes = bytes;
    if (used > host.limits.memory_bytes) end_where(lua, Failure{Failure::Kind::input, memory_problem(host)});
}

void push_function(lua_State* lua, LuaState::StackFunction function) {
    auto& kept = host_of(lua).functions.emplace_back(std::move(function));
    lua_pushlightuserdata(lua, &kept);
    lua_insert(lua, -2);
    lua_pushcclosure(lua, call_function, 2);
}

int call_replaced(lua_State* lua) {
    lua_pushvalue(lua, lua_upvalueindex(2));
    lua_insert(lua, 1);
    // Library functions look for the script's line one level up, where they would find none.
    const int status = lua_pcall(lua, lua_gettop(lua) - 1, LUA_MULTRET, 0);
    if (status == LUA_OK) return lua_gettop(lua);
    if (status == LUA_ERRMEM) throw InputError(memory_problem(host_of(lua)));
    const char* text = lua_tostring(lua, -1);
    throw InputError(text ? text : "a library function failed");
}

void call_with_hint(lua_State* lua, int arguments, int results, const char* part, const char* hint) {
    if (lua_pcall(lua, arguments, results, 0) == LUA_OK) return;
    if (lua_type(lua, -1) == LUA_TSTRING &&
        std::string_view(lua_tostring(lua, -1)).find(part) != std::string_view::npos) {
        lua_pushstring(lua, hint);
        lua_concat(lua, 2);
    }
    lua_error(lua);
}

void protected_call(lua_State* lua, const LuaState::StackFunction& body) {
    ScriptHost& host = host_of(lua);
    host.traceback.clear();
    const int top = lua_gettop(lua);
    // None of these three allocates: out here an error of Lua would abort the program.
    lua_pushcfunction(lua, handle_error);
    lua_pushcfunction(lua, call_body);
    lua_pushlightuserdata(lua, const_cast<LuaState::StackFunction*>(&body));
    const int status = lua_pcall(lua, 1, 0, top + 1);
    const bool has_text = status != LUA_OK && lua_type(lua, -1) == LUA_TSTRING;
    const std::string text = has_text ? lua_tostring(lua, -1) : "the script failed without a message";
    lua_settop(lua, top);
    if (host.ended) host.ended->throw_again();
    if (status == LUA_OK) return;
    if (status == LUA_ERRMEM) {
        throw InputError(memory_problem(host));
    }
    recognized(host, text).throw_again();
}

} // namespace tribode
