#pragma once
#include "tribode/base/json.hpp"
#include "tribode/base/run_control.hpp"
#include "tribode/record/table.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace tribode::python {

// A system of equations in Lua: a program that returns tb.system {...}. It is read afresh for each use, so that several
// threads may use one system at a time.
struct LuaSystem {
    std::string text;
    std::string name;                                // in messages: the file, or what stands for it
    std::filesystem::path folder;                    // searched by `require`; empty: none
    std::vector<std::filesystem::path> read_folders; // which the program may read besides
    bool compile = false;                            // the equations, by the system's C compiler
};

struct LuaSystemRun {
    Table table; // t and all variables
    Json info;   // whatever else tb.run_system returns
};

// tb.run_system with these options. Throws what it throws.
LuaSystemRun run(const LuaSystem& system, const Json& options, const RunControl& control);

// Another function of the module with the system as its option `system`: "linearize".
Json call(const LuaSystem& system, const std::string& function, const Json& options, const RunControl& control);

} // namespace tribode::python
