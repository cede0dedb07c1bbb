#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// What a unit that a data file gives means in SI: value * factor / divisor. Two numbers, because a division by 1000 gives the
// double nearest to the decimal that was meant, a product with 0.001 does not.
struct FileUnit {
    std::string si; // "m/s", "" for a plain number
    double factor = 1, divisor = 1;

    double to_si(double value) const { return value * factor / divisor; }
    void convert(std::vector<double>& values) const {
        if (factor == 1 && divisor == 1) return;
        for (double& value : values) value = to_si(value);
    }
};

// "mm", "[ms]", "(µm/s^2)", "Nm", "rpm", "-". Nothing where a part of it is not known: the caller asks for a factor.
std::optional<FileUnit> file_unit(std::string_view text);

} // namespace tribode
