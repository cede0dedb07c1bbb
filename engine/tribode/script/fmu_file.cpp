#include "tribode/script/fmu_file.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/kernel_sandbox.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/script/sandbox.hpp"
#include "tribode/script/script_run.hpp"
#include "tribode/script/system_reader.hpp"
#include "tribode/script/value.hpp"

#include <fmt/format.h>
#include <lua.hpp>

namespace tribode {

namespace fs = std::filesystem;

// The unit of what the script returns.
static std::string unit_of_script(ScriptRun& script, const FmuRequest& request, const FmuOptions& options) {
    std::string unit;
    script.lua().enter([&](lua_State* lua) {
        set_script_folder(lua, request.model.has_parent_path() ? request.model.parent_path() : ".");
        load_file(lua, request.model);
        lua_call(lua, 0, 1);
        if (const Equations* system = system_at(lua, -1)) {
            unit = fmu_of_system(*system, options);
        } else if (lua_istable(lua, -1)) {
            unit = fmu_of_machine(to_json(lua, -1, request.model.string() + ": the returned value"), options);
        } else {
            throw InputError(fmt::format("{}: returns a {}, must return a machine description or tb.system{{...}}",
                                         request.model.string(), luaL_typename(lua, -1)));
        }
        return 0;
    });
    return unit;
}

void export_fmu(const FmuRequest& request, const RunControl& control) {
    const fs::path kind = request.model.extension();
    if (kind != ".lua" && kind != ".json") {
        throw InputError(fmt::format("{}: a model is a .lua or a .json file", request.model.string()));
    }
    if (request.output.extension() != ".fmu") {
        throw InputError(fmt::format("{}: a functional mock-up unit is a .fmu file", request.output.string()));
    }
    FmuOptions options = request.options;
    options.name = fmu_name(request.output.stem().string());
    const fs::path folder = request.output.has_parent_path() ? request.output.parent_path() : ".";
    if (kind == ".json") {
        KernelSandbox sandbox;
        sandbox.read = {request.model};
        sandbox.allow_output(request.output);
        sandbox.enter();
        const Json description = read_json(request.model);
        if (!description.is_object()) {
            throw InputError(fmt::format("{}: must hold a table of named fields", request.model.string()));
        }
        write_file(request.output, fmu_of_machine(description, options));
        return;
    }
    ScriptRequest run;
    run.script = request.model;
    run.folder = folder; // what it writes goes beside the unit
    run.only_batch = true;
    run.confine = true;
    ScriptRun script(run, control);
    script.confine(fs::absolute(folder));
    write_file(request.output, unit_of_script(script, request, options));
}

} // namespace tribode
