#pragma once
#include "tribode/base/json.hpp"
#include "tribode/system/equations.hpp"

#include <string>

namespace tribode {

enum class FmiVersion { fmi2, fmi3 };

struct FmuOptions {
    FmiVersion version = FmiVersion::fmi2;
    bool model_exchange = false; // else co-simulation
    std::string solver = "auto"; // of co-simulation
    std::string name;            // of the model and its file: letters, digits and _, no digit first
};

// A functional mock-up unit: the bytes of its archive. It is the same for the same model and version of the program.
// Throws InputError where the model cannot be one, with the reason.
std::string fmu_of_machine(const Json& description, const FmuOptions& options);
std::string fmu_of_system(const Equations& equations, const FmuOptions& options);

// A text as the name of a model: "my axis-2" -> "my_axis_2".
std::string fmu_name(const std::string& text);

} // namespace tribode
