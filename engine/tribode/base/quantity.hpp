#pragma once
#include <string>
#include <string_view>

namespace tribode {

// A unit with an SI prefix: a value in the unit without one, times the factor, is in `unit`. The letter u stands for micro.
struct PrefixedUnit {
    double factor = 1;
    std::string unit;
};

// Whether a prefix may stand before the unit: it begins with the symbol of a unit that takes one, to the first power: m, N/m,
// rad/s^2, but not m^2 nor kg.
bool takes_prefix(std::string_view unit);

// The prefix with which `value` has one to three digits before the point, rounded to `digits` significant ones; the unit as
// it is where it takes none, or the value is zero, not finite or beyond the prefixes.
PrefixedUnit prefixed_unit(double value, std::string_view unit, int digits = 4);

// What people read, in reports and on the terminal: format_quantity(1.23e-5, "m") is "12.3 um". Files keep all digits.
std::string format_quantity(double value, std::string_view unit, int digits = 4);

} // namespace tribode
