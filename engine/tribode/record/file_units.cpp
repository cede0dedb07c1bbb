#include "tribode/record/file_units.hpp"
#include "tribode/base/text.hpp"

#include <cmath>
#include <cstdlib>
#include <map>
#include <numbers>

namespace tribode {

namespace {

// Units without a prefix, and those that a prefix may stand before.
const std::map<std::string, FileUnit, std::less<>>& whole_units() {
    static const double turn = 2 * std::numbers::pi;
    static const std::map<std::string, FileUnit, std::less<>> units = {
        {"1", {""}},
        {"%", {"", 1, 100}},
        {"kg", {"kg"}},
        {"sec", {"s"}},
        {"min", {"s", 60}},
        {"h", {"s", 3600}},
        {"deg", {"rad", turn, 360}},
        {"°", {"rad", turn, 360}},
        {"rev", {"rad", turn}},
        {"rpm", {"rad/s", turn, 60}},
        {"cm", {"m", 1, 100}},
        {"inch", {"m", 254, 10000}},
        {"Nm", {"N m"}},
        {"mNm", {"N m", 1, 1000}},
        {"kNm", {"N m", 1000}},
        {"degC", {"degC"}},
        {"°C", {"degC"}},
        {"Ohm", {"ohm"}},
        {"ohm", {"ohm"}},
    };
    return units;
}

constexpr std::string_view prefixed[] = {"m", "s", "N", "V", "A", "W", "J", "Hz", "Pa", "rad", "K", "T"};

struct Prefix {
    std::string_view text;
    double factor, divisor;
};
constexpr Prefix prefixes[] = {{"", 1, 1},    {"n", 1, 1e9}, {"u", 1, 1e6}, {"µ", 1, 1e6},
                               {"μ", 1, 1e6}, {"m", 1, 1e3}, {"k", 1e3, 1}, {"M", 1e6, 1}};

std::optional<FileUnit> simple_unit(std::string_view name) {
    if (const auto it = whole_units().find(name); it != whole_units().end()) return it->second;
    for (const auto& prefix : prefixes) {
        if (!name.starts_with(prefix.text)) continue;
        const std::string_view rest = name.substr(prefix.text.size());
        for (const auto base : prefixed) {
            if (rest == base) return FileUnit{std::string(base), prefix.factor, prefix.divisor};
        }
    }
    return std::nullopt;
}

// A name and its power: "s^2", "s2", "s²".
std::optional<FileUnit> power_of_unit(std::string_view text) {
    int power = 1;
    for (const auto& [mark, value] : {std::pair{"^2", 2}, {"^3", 3}, {"²", 2}, {"³", 3}, {"2", 2}, {"3", 3}}) {
        if (!text.ends_with(mark) || text.size() == std::string_view(mark).size()) continue;
        text.remove_suffix(std::string_view(mark).size());
        power = value;
        break;
    }
    auto unit = simple_unit(text);
    if (!unit || power == 1) return unit;
    return FileUnit{unit->si + std::to_string(power), std::pow(unit->factor, power), std::pow(unit->divisor, power)};
}

// Factors with a blank, a point or an asterisk between them.
std::optional<FileUnit> product_of_units(std::string_view text) {
    FileUnit product;
    for (text = trim(text); !text.empty();) {
        std::size_t end = text.size(), next = end;
        for (const std::string_view mark : {" ", "*", "·", "."}) {
            if (const auto at = text.find(mark); at < end) {
                end = at;
                next = at + mark.size();
            }
        }
        const auto unit = power_of_unit(text.substr(0, end));
        if (!unit) return std::nullopt;
        if (!product.si.empty() && !unit->si.empty()) product.si += ' ';
        product.si += unit->si;
        product.factor *= unit->factor;
        product.divisor *= unit->divisor;
        text = trim(text.substr(next));
    }
    return product;
}

} // namespace

std::optional<FileUnit> file_unit(std::string_view text) {
    text = trim(text);
    for (const auto& [open, close] : {std::pair{"[", "]"}, {"(", ")"}}) {
        if (text.size() > 2 && text.starts_with(open) && text.ends_with(close)) {
            text = trim(text.substr(1, text.size() - 2));
        }
    }
    if (text.empty() || text.starts_with('/')) return std::nullopt;
    if (text == "-") return FileUnit{};
    const auto slash = text.find('/');
    auto above = product_of_units(text.substr(0, slash));
    if (!above || slash == std::string_view::npos) return above;
    std::string_view rest = trim(text.substr(slash + 1));
    if (rest.starts_with('(') && rest.ends_with(')')) rest = rest.substr(1, rest.size() - 2);
    const auto below = product_of_units(rest);
    if (!below || below->si.empty() || rest.find('/') != std::string_view::npos) return std::nullopt;
    const bool several = below->si.find(' ') != std::string::npos;
    return FileUnit{(above->si.empty() ? "1" : above->si) + "/" + (several ? "(" + below->si + ")" : below->si),
                    above->factor * below->divisor, above->divisor * below->factor};
}

} // namespace tribode
