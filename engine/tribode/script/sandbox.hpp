#pragma once
#include <filesystem>
#include <string>

struct lua_State;

namespace tribode {

// The libraries as the class comment of LuaState says, and the empty module `tribode`. [-0, +0]
void open_libraries(lua_State* lua);

// Pushes the table of the module `tribode`. [-0, +1]
void push_module(lua_State* lua);

// Pushes a file, or a text, as a function; program text only. Throws InputError. [-0, +1]
void load_file(lua_State* lua, const std::filesystem::path& path);
void load_text(lua_State* lua, std::string_view text, const std::string& chunk_name);

// Makes the folder the first that `require` searches.
void set_script_folder(lua_State* lua, const std::filesystem::path& folder);

} // namespace tribode
