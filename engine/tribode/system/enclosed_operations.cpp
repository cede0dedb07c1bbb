#include "tribode/system/enclosed_operations.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tribode {

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();
constexpr double smallest = std::numeric_limits<double>::denorm_min();

// Rounding moves a result by half a unit in the last place; zero is exact, or has underflowed from `from_zero`.
double down(double x) { return x == 0 ? x : x - std::abs(x) * epsilon - smallest; }
double up(double x) { return x == 0 ? x : x + std::abs(x) * epsilon + smallest; }
// What is undefined, as inf - inf, has no bounds.
Interval outward(double low, double high) {
    low = down(low);
    high = up(high);
    return {std::isnan(low) ? -Interval::infinity : low, std::isnan(high) ? Interval::infinity : high};
}

// Functions of <cmath> are right to a unit in the last place.
Interval function_values(double low, double high) { return outward(down(low), up(high)); }

bool is_zero(Interval a) { return a.low == 0 && a.high == 0; }

Interval operator+(Interval a, Interval b) { return outward(a.low + b.low, a.high + b.high); }
Interval operator-(Interval a, Interval b) { return outward(a.low - b.high, a.high - b.low); }
Interval operator-(Interval a) { return {-a.high, -a.low}; }

Interval operator*(Interval a, Interval b) {
    if (is_zero(a) || is_zero(b)) return {0, 0}; // as in an equation, whatever the other is
    if (a.low == a.high && b.low == b.high) return outward(a.low * b.low, a.low * b.low);
    const auto times = [](double x, double y) { return x == 0 || y == 0 ? 0.0 : x * y; }; // 0 inf: the limit is 0
    const double p = times(a.low, b.low), q = times(a.low, b.high), r = times(a.high, b.low), s = times(a.high, b.high);
    return outward(std::min({p, q, r, s}), std::max({p, q, r, s}));
}

Interval operator/(Interval a, Interval b) {
    if (b.low <= 0 && b.high >= 0) return is_zero(a) && !is_zero(b) ? Interval{0, 0} : Interval::all();
    return a * outward(1 / b.high, 1 / b.low);
}

Interval hull(Interval a, Interval b) { return {std::min(a.low, b.low), std::max(a.high, b.high)}; }
Interval square(Interval a) {
    const double low = std::abs(a.low), high = std::abs(a.high);
    return outward(a.contains(0) ? 0 : std::min(low * low, high * high), std::max(low * low, high * high));
}

// f rises over the whole of a, with the rate of f(a) being slope(a) times that of a.
template <class Function>
Interval rising(Function f, Interval a) {
    return function_values(f(a.low), f(a.high));
}

// Whether the interval holds a number of the form first + k period.
bool holds_multiple(Interval a, double first, double period) {
    const double margin = 1e-12 * (1 + std::abs(a.low) + std::abs(a.high)); // where that is in doubt, it does
    return std::floor((a.high - first + margin) / period) >= std::ceil((a.low - first - margin) / period);
}

Interval sine(Interval a) {
    constexpr double pi = std::numbers::pi;
    if (!(a.high - a.low < 2 * pi) || std::max(std::abs(a.low), std::abs(a.high)) > 1e9) return {-1, 1};
    if (a.low == a.high) {
        const double value = std::sin(a.low);
        const Interval range = function_values(value, value);
        return {std::max(range.low, -1.0), std::min(range.high, 1.0)};
    }
    const double low = std::sin(a.low), high = std::sin(a.high);
    const Interval range = function_values(std::min(low, high), std::max(low, high));
    return {holds_multiple(a, -pi / 2, 2 * pi) ? -1 : std::max(range.low, -1.0),
            holds_multiple(a, pi / 2, 2 * pi) ? 1 : std::min(range.high, 1.0)};
}

Interval cosine(Interval a) {
    constexpr double pi = std::numbers::pi;
    if (!(a.high - a.low < 2 * pi) || std::max(std::abs(a.low), std::abs(a.high)) > 1e9) return {-1, 1};
    const double low = std::cos(a.low), high = std::cos(a.high);
    const Interval range = function_values(std::min(low, high), std::max(low, high));
    if (a.low == a.high) return {std::max(range.low, -1.0), std::min(range.high, 1.0)};
    return {holds_multiple(a, pi, 2 * pi) ? -1 : std::max(range.low, -1.0),
            holds_multiple(a, 0, 2 * pi) ? 1 : std::min(range.high, 1.0)};
}

// a^n for a whole number n.
Interval whole_power(Interval a, double n) {
    if (n == 0) return {1, 1};
    if (n < 0) return Interval{1, 1} / whole_power(a, -n);
    const double low = std::pow(a.low, n), high = std::pow(a.high, n);
    if (std::fmod(n, 2) != 0 || a.low >= 0) return function_values(low, high);
    if (a.high <= 0) return function_values(high, low);
    return {0, up(up(std::max(low, high)))};
}

Enclosure power(const Enclosure& a, const Enclosure& b) {
    if (b.value.low == b.value.high && is_zero(b.rate)) {
        const double n = b.value.low;
        if (std::floor(n) == n && std::abs(n) < 0x1p53) {
            const Interval value = whole_power(a.value, n);
            if (is_zero(a.rate)) return {value, {0, 0}};
            return {value, n == 0 ? Interval{0, 0} : Interval::point(n) * whole_power(a.value, n - 1) * a.rate};
        }
        if (!(a.value.low >= 0)) return Enclosure::unknown();
        const auto to_power = [](Interval base, double exponent) {
            const double low = std::pow(base.low, exponent), high = std::pow(base.high, exponent);
            return function_values(std::min(low, high), std::max(low, high));
        };
        const Interval value = to_power(a.value, n);
        if (is_zero(a.rate)) return {value, {0, 0}};
        return {value, Interval::point(n) * to_power(a.value, n - 1) * a.rate};
    }
    if (!(a.value.low > 0)) return Enclosure::unknown();
    const Interval logarithm = rising([](double x) { return std::log(x); }, a.value);
    const Interval value = rising([](double x) { return std::exp(x); }, b.value * logarithm);
    return {value, value * (b.rate * logarithm + b.value * (a.rate / a.value))};
}

Enclosure arc_tangent(const Enclosure& y, const Enclosure& x) {
    const Interval distance = square(x.value) + square(y.value);
    const bool cut = x.value.low <= 0 && y.value.contains(0); // the angle jumps by a turn, or there is none
    if (cut) return {{-std::numbers::pi, std::numbers::pi}, Interval::all()};
    // The angle of a rectangle away from the cut is largest and smallest at corners.
    double low = Interval::infinity, high = -Interval::infinity;
    for (const double corner_y : {y.value.low, y.value.high}) {
        for (const double corner_x : {x.value.low, x.value.high}) {
            const double angle = std::atan2(corner_y, corner_x);
            low = std::min(low, angle);
            high = std::max(high, angle);
        }
    }
    return {function_values(low, high), (x.value * y.rate - y.value * x.rate) / distance};
}

constexpr Interval undecided = {0, 1};

// A condition: 1, 0 or undecided; where it is, it may jump.
Enclosure condition(bool holds, bool fails) {
    if (holds) return Enclosure::constant(1);
    if (fails) return Enclosure::constant(0);
    return {undecided, Interval::all()};
}

bool is_true(const Enclosure& a) { return a.value.low > 0 || a.value.high < 0; }
bool is_false(const Enclosure& a) { return is_zero(a.value); }

} // namespace

Enclosure sum(const Enclosure& a, const Enclosure& b) { return {a.value + b.value, a.rate + b.rate}; }

Enclosure product(double factor, const Enclosure& a, const Enclosure& b) {
    const Interval k = Interval::point(factor);
    return {k * (a.value * b.value), k * (a.rate * b.value + a.value * b.rate)};
}

Enclosure apply(Op op, const Enclosure& a, const Enclosure& b, const Enclosure& c) {
    const auto in_domain = [&](double low, double high) { return a.value.low >= low && a.value.high <= high; };
    // The chain rule; a constant stays one where the slope is infinite.
    const auto chained = [&](Interval value, auto slope) {
        return Enclosure{value, is_zero(a.rate) ? Interval{0, 0} : slope() * a.rate};
    };
    switch (op) {
    case Op::add: return sum(a, b);
    case Op::subtract: return {a.value - b.value, a.rate - b.rate};
    case Op::multiply: return product(1, a, b);
    case Op::divide: {
        const Interval quotient = a.value / b.value;
        if (is_zero(b.rate)) return {quotient, a.rate / b.value};
        return {quotient, (a.rate - quotient * b.rate) / b.value};
    }
    case Op::negate: return {-a.value, -a.rate};
    case Op::power: return power(a, b);
    case Op::sin: return chained(sine(a.value), [&] { return cosine(a.value); });
    case Op::cos: return chained(cosine(a.value), [&] { return -sine(a.value); });
    case Op::tan: {
        if (!(a.value.high - a.value.low < 3) || holds_multiple(a.value, std::numbers::pi / 2, std::numbers::pi)) {
            return Enclosure::unknown();
        }
        const Interval value = rising([](double x) { return std::tan(x); }, a.value);
        return chained(value, [&] { return Interval{1, 1} + square(value); });
    }
    case Op::asin:
    case Op::acos: {
        if (!in_domain(-1, 1)) return Enclosure::unknown();
        const Interval slope_squared = Interval{1, 1} - square(a.value);
        const auto slope = [&] {
            return Interval{1, 1} / rising([](double x) { return std::sqrt(std::max(x, 0.0)); }, slope_squared);
        };
        if (op == Op::asin) return chained(rising([](double x) { return std::asin(x); }, a.value), slope);
        return chained(function_values(std::acos(a.value.high), std::acos(a.value.low)), [&] { return -slope(); });
    }
    case Op::atan:
        return chained(rising([](double x) { return std::atan(x); }, a.value), [&] {
            return Interval{1, 1} / (Interval{1, 1} + square(a.value));
        });
    case Op::atan2: return arc_tangent(a, b);
    case Op::tanh: {
        const Interval value = rising([](double x) { return std::tanh(x); }, a.value);
        const auto slope = [&] {
            const Interval s = Interval{1, 1} - square(value);
            return Interval{std::max(s.low, 0.0), std::min(s.high, 1.0)};
        };
        return chained(value, slope);
    }
    case Op::exp: {
        const Interval value = rising([](double x) { return std::exp(x); }, a.value);
        return chained({std::max(value.low, 0.0), value.high}, [&] { return value; });
    }
    case Op::log:
        if (!(a.value.low > 0)) return Enclosure::unknown();
        return chained(rising([](double x) { return std::log(x); }, a.value), [&] { return Interval{1, 1} / a.value; });
    case Op::sqrt: {
        if (!(a.value.low >= 0)) return Enclosure::unknown();
        const Interval value = rising([](double x) { return std::sqrt(x); }, a.value);
        return chained({std::max(value.low, 0.0), value.high}, [&] {
            return Interval{std::max(down(0.5 / value.high), 0.0),
                            value.low > 0 ? up(0.5 / value.low) : Interval::infinity};
        });
    }
    case Op::floor: {
        const Interval value = {std::floor(a.value.low), std::floor(a.value.high)};
        return {value, value.low == value.high ? Interval{0, 0} : Interval::all()};
    }
    case Op::less: return condition(a.value.high < b.value.low, a.value.low >= b.value.high);
    case Op::less_equal: return condition(a.value.high <= b.value.low, a.value.low > b.value.high);
    case Op::equal:
        return condition(a.value.low == a.value.high && b.value.low == b.value.high && a.value.low == b.value.low,
                         a.value.high < b.value.low || b.value.high < a.value.low);
    case Op::all: return condition(is_true(a) && is_true(b), is_false(a) || is_false(b));
    case Op::any: return condition(is_true(a) || is_true(b), is_false(a) && is_false(b));
    case Op::logical_not: return condition(is_false(a), is_true(a));
    case Op::select:
        if (is_true(a)) return b;
        if (is_false(a)) return c;
        return {hull(b.value, c.value), Interval::all()};
    case Op::constant:
    case Op::variable:
    case Op::lookup: // look_up() has its table
    case Op::delay:
    case Op::rate:
    case Op::before:
    case Op::no_event: break;
    }
    return a;
}

Enclosure look_up(const LookupTable& table, const TableSlopes& slopes, const Enclosure& x, const Enclosure& y,
                  const Enclosure& side) {
    // On which side of a kink it is, is held between events; elsewhere it is not known.
    if (side.value.low != side.value.high) return Enclosure::unknown();
    const int sides = static_cast<int>(side.value.low);
    const auto within = [&](const LookupTable& of) {
        const auto range = of.range({x.value.low, x.value.high}, {y.value.low, y.value.high}, sides);
        return function_values(range.low, range.high);
    };
    Enclosure result{within(table), {0, 0}};
    const auto add = [&](const auto& slope, Interval rate) {
        if (slope && !is_zero(rate)) result.rate = result.rate + within(*slope) * rate;
    };
    add(slopes[0], x.rate);
    add(slopes[1], y.rate);
    return result;
}

} // namespace tribode
