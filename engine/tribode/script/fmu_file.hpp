#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/fmu/fmu_export.hpp"

#include <filesystem>

namespace tribode {

struct FmuRequest {
    std::filesystem::path model;  // a machine description, .json or .lua, or a Lua file that returns tb.system{...}
    std::filesystem::path output; // NAME.fmu
    FmuOptions options;           // without the name, which is that of the output
};

// Writes the model as a functional mock-up unit. The process is confined to the files of the request, for good. A Lua file runs as a
// script does. Throws InputError where the file holds no model, or one that cannot be a unit.
void export_fmu(const FmuRequest& request, const RunControl& control);

} // namespace tribode
