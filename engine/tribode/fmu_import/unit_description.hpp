#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// What modelDescription.xml of a functional mock-up unit for co-simulation says, FMI 2.0 or 3.0.
struct UnitDescription {
    enum class Type { real, float32, int8, uint8, int16, uint16, int32, uint32, int64, uint64, boolean };
    struct Variable {
        std::string name, unit; // the unit as it is written there; empty: none
        std::uint32_t reference = 0;
        Type type = Type::real;
        double start = 0;
        bool has_start = false;
    };

    int version = 2; // of FMI
    std::string model_name;
    std::string identifier; // of the shared library
    std::string token;      // guid, instantiationToken
    bool varies_step = false;
    double fixed_step = 0; // [s] 0: not said
    bool one_instance = false;
    bool needs_tool = false;
    std::vector<Variable> inputs, outputs, parameters;
    std::vector<std::string>
        left_out; // inputs, outputs and parameters that are no single numbers: texts, arrays, clocks
};

// Throws InputError where the text is no such description, is of a model for model exchange alone, or of FMI 1.0. `source`
// begins the messages.
UnitDescription read_unit_description(std::string_view xml, const std::string& source);

} // namespace tribode
