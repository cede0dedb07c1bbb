#include "tribode/base/quantity.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

constexpr std::array symbols = {"m", "s", "N", "rad", "V", "A", "W", "J", "Pa", "Hz", "F", "H", "Wb", "ohm"};
constexpr std::array prefixes = {"f", "p", "n", "u", "m", "", "k", "M", "G"};

std::string_view first_symbol(std::string_view unit) {
    return unit.substr(0, std::min(unit.find_first_of(" /*"), unit.size()));
}

double rounded(double value, int digits) {
    return *parse_number(fmt::format("{:.{}e}", value, std::max(digits, 1) - 1));
}

} // namespace

bool takes_prefix(std::string_view unit) {
    return std::find(symbols.begin(), symbols.end(), first_symbol(unit)) != symbols.end();
}

PrefixedUnit prefixed_unit(double value, std::string_view unit, int digits) {
    PrefixedUnit result{1, std::string(unit)};
    if (value == 0 || !std::isfinite(value) || !takes_prefix(unit)) return result;
    // As it will be shown: 9.99999e-4 is 1 milli.
    int third = static_cast<int>(std::floor(std::log10(std::abs(rounded(value, digits))) / 3 + 1e-9));
    if (first_symbol(unit) == "s") third = std::min(third, 0); // nobody reads kiloseconds
    if (third < -5 || third > 3) return result;
    result.factor = std::pow(10.0, -3 * third);
    result.unit.insert(0, prefixes[static_cast<std::size_t>(third + 5)]);
    return result;
}

std::string format_quantity(double value, std::string_view unit, int digits) {
    const PrefixedUnit prefixed = prefixed_unit(value, unit, digits);
    const double shown = value * prefixed.factor;
    std::string text =
        fmt::format("{:.{}g}", std::isfinite(shown) ? rounded(shown, digits) : shown, std::max(digits, 6));
    if (!unit.empty()) text += " " + prefixed.unit;
    return text;
}

} // namespace tribode
