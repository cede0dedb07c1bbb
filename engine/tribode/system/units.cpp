#include "tribode/system/units.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <fmt/format.h>
#include <vector>

namespace tribode {

namespace {

using Powers = std::map<std::string, double>;

void multiply(Powers& product, const Powers& factor, double power) {
    for (const auto& [name, exponent] : factor) {
        if ((product[name] += power * exponent) == 0) product.erase(name);
    }
}

const std::map<std::string, Powers, std::less<>>& si_units() {
    static const Powers ohm = {{"kg", 1}, {"m", 2}, {"s", -3}, {"A", -2}};
    static const std::map<std::string, Powers, std::less<>> units = {
        {"1", {}},
        {"rad", {}},
        {"degC", {{"K", 1}}},
        {"\u00b0C", {{"K", 1}}},
        {"Hz", {{"s", -1}}},
        {"N", {{"kg", 1}, {"m", 1}, {"s", -2}}},
        {"Pa", {{"kg", 1}, {"m", -1}, {"s", -2}}},
        {"J", {{"kg", 1}, {"m", 2}, {"s", -2}}},
        {"W", {{"kg", 1}, {"m", 2}, {"s", -3}}},
        {"C", {{"A", 1}, {"s", 1}}},
        {"V", {{"kg", 1}, {"m", 2}, {"s", -3}, {"A", -1}}},
        {"ohm", ohm},
        {"Ohm", ohm},
        {"\u03a9", ohm}, // the Greek letter
        {"\u2126", ohm}, // the sign of the unit
        {"S", {{"kg", -1}, {"m", -2}, {"s", 3}, {"A", 2}}},
        {"F", {{"kg", -1}, {"m", -2}, {"s", 4}, {"A", 2}}},
        {"Wb", {{"kg", 1}, {"m", 2}, {"s", -2}, {"A", -1}}},
        {"T", {{"kg", 1}, {"s", -2}, {"A", -1}}},
        {"H", {{"kg", 1}, {"m", 2}, {"s", -2}, {"A", -2}}},
    };
    return units;
}

class UnitReader {
  public:
    explicit UnitReader(std::string_view text) : rest_(text) {}

    Dimension read() {
        Powers product;
        if (trim(rest_).empty() || !read_product(product) || !rest_.empty()) return std::nullopt;
        return product;
    }

  private:
    bool take(std::string_view mark) {
        if (!rest_.starts_with(mark)) return false;
        rest_.remove_prefix(mark.size());
        return true;
    }

    void skip_blanks() { rest_ = rest_.substr(std::min(rest_.find_first_not_of(' '), rest_.size())); }

    // Up to the end or a closing bracket.
    bool read_product(Powers& product) {
        double power = 1;
        for (;;) {
            skip_blanks();
            Powers factor;
            if (!read_factor(factor)) return false;
            multiply(product, factor, power);
            skip_blanks();
            if (rest_.empty() || rest_.front() == ')') return true;
            power = take("/") ? -1 : 1;
            if (power > 0 && !take("*")) take("·");
        }
    }

    bool read_factor(Powers& factor) {
        Powers base;
        if (take("(")) {
            if (!read_product(base) || !take(")")) return false;
        } else if (take("1")) {
            base = {};
        } else if (!read_name(base)) {
            return false;
        }
        double power = 1;
        if (!read_power(power)) return false;
        multiply(factor, base, power);
        return true;
    }

    bool read_name(Powers& base) {
        const auto part_of_name = [](unsigned char c) { return std::isalpha(c) || c >= 0x80 || c == '%' || c == '_'; };
        std::size_t size = 0;
        while (size < rest_.size() && part_of_name(static_cast<unsigned char>(rest_[size])) &&
               !rest_.substr(size).starts_with("·")) {
            ++size;
        }
        if (size == 0) return false;
        const std::string_view name = rest_.substr(0, size);
        rest_.remove_prefix(size);
        const auto known = si_units().find(name);
        base = known == si_units().end() ? Powers{{std::string(name), 1}} : known->second;
        return true;
    }

    // "2", "^2", "^-1"; none is 1.
    bool read_power(double& power) {
        const bool written = take("^");
        const double sign = written && take("-") ? -1 : 1;
        std::size_t size = 0;
        while (size < rest_.size() && std::isdigit(static_cast<unsigned char>(rest_[size]))) ++size;
        if (size == 0) return !written;
        power = sign * parse_number(rest_.substr(0, size)).value_or(1);
        rest_.remove_prefix(size);
        return true;
    }

    std::string_view rest_;
};

} // namespace

Dimension dimension_of(std::string_view unit) { return UnitReader(unit).read(); }

bool is_si(const Dimension& dimension) {
    return !dimension || std::ranges::all_of(*dimension, [](const auto& factor) {
        return std::ranges::count(std::array{"kg", "m", "s", "A", "K"}, factor.first) > 0;
    });
}

std::string to_text(const Dimension& dimension) {
    if (!dimension) return "any unit";
    std::string above, below;
    for (const auto& [name, power] : *dimension) {
        std::string& side = power > 0 ? above : below;
        if (!side.empty()) side += ' ';
        side += name;
        if (std::abs(power) != 1) side += to_text(std::abs(power));
    }
    if (below.empty()) return above.empty() ? "1" : above;
    const std::string_view numerator = above.empty() ? std::string_view("1") : above;
    return below.find(' ') == std::string::npos ? fmt::format("{}/{}", numerator, below)
                                                : fmt::format("{}/({})", numerator, below);
}

std::string to_readable_text(const Dimension& dimension) {
    if (!dimension || !dimension->contains("kg")) return to_text(dimension);
    const auto factors = [](const Powers& powers) {
        double sum = 0;
        for (const auto& [name, power] : powers) sum += std::abs(power);
        return sum;
    };
    // Masses and times together are forces or more to whom they are shown.
    Powers best = *dimension;
    double fewest = factors(best) + (best.contains("s") ? 2 : 0);
    for (const char* unit : {"N", "V", "ohm", "Pa", "W"}) {
        for (const double power : {1, -1, 2, -2, 3, -3}) {
            Powers rest = *dimension;
            multiply(rest, si_units().at(unit), -power);
            rest[unit] = power;
            const double count = factors(rest) + (rest.contains("kg") ? 2 : 0);
            if (count >= fewest) continue;
            fewest = count;
            best = rest;
        }
    }
    return to_text(best);
}

bool fit(const Dimension& a, const Dimension& b) { return !a || !b || *a == *b; }

Dimension Units::of(Term term) {
    for (const Term part : graph_.reachable(std::span(&term, 1))) {
        if (!known_.contains(part)) known_[part] = combined(part);
    }
    return known_[term];
}

std::string Units::advice(Term term) const {
    for (const Term part : graph_.reachable(std::span(&term, 1))) {
        const auto& node = graph_[part];
        if (node.op != Op::multiply && node.op != Op::divide) continue;
        for (const Term operand : {node.a, node.b}) {
            if (graph_[operand].op != Op::constant) continue;
            return fmt::format("; the number {} is a plain factor, a parameter can have a unit", graph_.text(operand));
        }
    }
    return "";
}

Dimension Units::combined(Term term) const {
    const auto& node = graph_[term];
    const auto at = [&](Term operand) { return known_.at(operand); };
    const auto equal = [&](Term a, Term b, const char* what) {
        if (!fit(at(a), at(b))) {
            throw InputError(fmt::format("{} {} {} and {}{}", graph_.text(term), what, to_text(at(a)), to_text(at(b)),
                                         advice(term)));
        }
        return at(a) ? at(a) : at(b);
    };
    const auto plain = [&](Term operand) {
        if (!fit(at(operand), Powers{})) {
            throw InputError(fmt::format("{} needs a plain number, but {} is in {}{}", graph_.text(term),
                                         graph_.text(operand), to_text(at(operand)), advice(operand)));
        }
    };
    const auto to_power = [&](Term base, double power) {
        Dimension result = at(base);
        if (result) {
            Powers powers;
            multiply(powers, *result, power);
            result = powers;
        }
        return result;
    };
    switch (node.op) {
    case Op::constant:
    case Op::variable: return std::nullopt;
    case Op::add: return equal(node.a, node.b, "adds");
    case Op::subtract: return equal(node.a, node.b, "subtracts between");
    case Op::less:
    case Op::less_equal:
    case Op::equal: return equal(node.a, node.b, "compares"), std::nullopt;
    case Op::select: return equal(node.b, node.c, "chooses between");
    case Op::atan2: return equal(node.a, node.b, "compares") ? Dimension(Powers{}) : std::nullopt;
    case Op::multiply:
    case Op::divide: {
        const auto factor = [&](Term operand) {
            return graph_[operand].op == Op::constant ? Dimension(Powers{}) : at(operand);
        };
        const Dimension a = factor(node.a), b = factor(node.b);
        if (!a || !b) return std::nullopt;
        Powers product = *a;
        multiply(product, *b, node.op == Op::multiply ? 1 : -1);
        return product;
    }
    case Op::power:
        if (graph_[node.b].op == Op::constant) return to_power(node.a, graph_[node.b].value);
        plain(node.a);
        plain(node.b);
        return at(node.a);
    case Op::sqrt: return to_power(node.a, 0.5);
    case Op::sin:
    case Op::cos:
    case Op::tan:
    case Op::asin:
    case Op::acos:
    case Op::atan:
    case Op::tanh:
    case Op::exp:
    case Op::log: plain(node.a); return at(node.a);
    case Op::lookup: {
        const auto& table = *graph_.table_of(term);
        for (int variable = 0; variable < table.variables(); ++variable) {
            const Term operand = variable == 0 ? node.a : node.b;
            const Dimension wanted = dimension_of(table.unit(variable));
            if (fit(at(operand), wanted)) continue;
            throw InputError(fmt::format("{} needs {}, but {} is in {}{}", graph_.text(term), to_text(wanted),
                                         graph_.text(operand), to_text(at(operand)), advice(operand)));
        }
        return dimension_of(table.unit(2));
    }
    case Op::delay:
        if (!fit(at(node.b), dimension_of("s"))) {
            throw InputError(fmt::format("{} needs a time, but {} is in {}", graph_.text(term), graph_.text(node.b),
                                         to_text(at(node.b))));
        }
        return at(node.a);
    case Op::rate: {
        const Dimension a = at(node.a);
        if (!a) return std::nullopt;
        Powers rate = *a;
        multiply(rate, *dimension_of("s"), -1);
        return rate;
    }
    case Op::negate:
    case Op::floor:
    case Op::before:
    case Op::no_event: return at(node.a);
    case Op::all:
    case Op::any:
    case Op::logical_not: break;
    }
    return std::nullopt;
}

} // namespace tribode
