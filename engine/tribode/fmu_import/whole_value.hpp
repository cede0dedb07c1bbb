#pragma once
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/fmu_import/imported_unit.hpp"

#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <type_traits>

namespace tribode {

// The value of a variable that is an integer or a boolean. Throws InputError where the number is none that it can have.
template <class Integer>
Integer whole_value(const UnitFile& unit, const UnitDescription::Variable& variable, double value) {
    const bool truth = variable.type == UnitDescription::Type::boolean;
    const double least = truth ? 0 : static_cast<double>(std::numeric_limits<Integer>::min());
    // Of 64 bits the greatest is no double; the next one above it is.
    const double most = truth ? 1 : static_cast<double>(std::numeric_limits<Integer>::max());
    const bool fits = value >= least && value <= most && (sizeof(Integer) < 8 || truth || value < most);
    if (value != std::floor(value) || !fits) {
        throw InputError(
            fmt::format("{}: {} = {}, must be {}", unit.file().string(), variable.name, to_text(value),
                        truth ? "0 or 1" : fmt::format("a whole number from {} to {}", to_text(least), to_text(most))));
    }
    return static_cast<Integer>(value);
}

} // namespace tribode
