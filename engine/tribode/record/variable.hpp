#pragma once
#include <string>
#include <vector>

namespace tribode {

// One named entry of a data file, whether or not it can become a column of a table.
struct Variable {
    std::string name;
    std::string unit;           // "" for none or unknown
    std::vector<double> values; // empty where there is a refusal
    std::string refusal;        // why it cannot be a column, e.g. "is a struct"; empty where it can
};

} // namespace tribode
