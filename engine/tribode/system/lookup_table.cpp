#include "tribode/system/lookup_table.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <fmt/format.h>
#include <limits>
#include <numeric>
#include <span>
#include <sstream>

namespace tribode {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double none = std::numeric_limits<double>::quiet_NaN();

using Interpolation = LookupTable::Interpolation;
using Extrapolation = LookupTable::Extrapolation;
using Cubic = std::array<double, 4>; // by powers of the distance from its abscissa

void check_axis(const std::string& name, const char* axis, const std::vector<double>& abscissas) {
    if (abscissas.size() < 2) {
        throw InputError(fmt::format("{}: {} has {} values, must have at least 2", name, axis, abscissas.size()));
    }
    for (std::size_t i = 0; i < abscissas.size(); ++i) {
        if (!std::isfinite(abscissas[i])) {
            throw InputError(fmt::format("{}: {}[{}] = {}, must be finite", name, axis, i + 1, to_text(abscissas[i])));
        }
        if (i > 0 && !(abscissas[i] > abscissas[i - 1])) {
            throw InputError(fmt::format("{}: {}[{}] = {} stands behind {}, the values of {} must increase", name, axis,
                                         i + 1, to_text(abscissas[i]), to_text(abscissas[i - 1]), axis));
        }
    }
}

// The slopes of monotonic cubics [Fritsch 1984]: harmonic means inside, one-sided parabolas at the ends.
std::vector<double> pchip_slopes(const std::vector<double>& h, const std::vector<double>& chord) {
    const std::size_t n = h.size() + 1;
    if (n == 2) return {chord[0], chord[0]};
    std::vector<double> slopes(n);
    for (std::size_t i = 1; i + 1 < n; ++i) {
        if (!(chord[i - 1] * chord[i] > 0)) continue;
        const double a = 2 * h[i] + h[i - 1], b = h[i] + 2 * h[i - 1];
        slopes[i] = (a + b) / (a / chord[i - 1] + b / chord[i]);
    }
    const auto end = [](double h0, double h1, double chord0, double chord1) {
        const double slope = ((2 * h0 + h1) * chord0 - h0 * chord1) / (h0 + h1);
        if (!(slope * chord0 > 0)) return 0.0;
        if (chord0 * chord1 <= 0 && std::abs(slope) > 3 * std::abs(chord0)) return 3 * chord0;
        return slope;
    };
    slopes[0] = end(h[0], h[1], chord[0], chord[1]);
    slopes[n - 1] = end(h[n - 2], h[n - 3], chord[n - 2], chord[n - 3]);
    return slopes;
}

// The slopes of a spline: below[i] s[i-1] + on[i] s[i] + above[i] s[i+1] = right[i].
std::vector<double> spline_slopes(const std::vector<double>& h, const std::vector<double>& chord, bool natural) {
    const std::size_t n = h.size() + 1, last = n - 1;
    if (n == 2) return {chord[0], chord[0]};
    std::vector<double> below(n), on(n), above(n), right(n);
    for (std::size_t i = 1; i < last; ++i) {
        below[i] = h[i];
        on[i] = 2 * (h[i - 1] + h[i]);
        above[i] = h[i - 1];
        right[i] = 3 * (h[i] * chord[i - 1] + h[i - 1] * chord[i]);
    }
    if (natural) {
        on[0] = on[last] = 2;
        above[0] = below[last] = 1;
        right[0] = 3 * chord[0];
        right[last] = 3 * chord[last - 1];
    } else if (n == 3) { // a parabola
        on[0] = on[last] = above[0] = below[last] = 1;
        right[0] = 2 * chord[0];
        right[last] = 2 * chord[1];
    } else {
        const auto end = [](double h0, double h1, double chord0, double chord1) {
            const double sum = h0 + h1;
            return ((h0 + 2 * sum) * h1 * chord0 + h0 * h0 * chord1) / sum;
        };
        on[0] = h[1];
        above[0] = h[0] + h[1];
        right[0] = end(h[0], h[1], chord[0], chord[1]);
        on[last] = h[n - 3];
        below[last] = h[n - 2] + h[n - 3];
        right[last] = end(h[n - 2], h[n - 3], chord[n - 2], chord[n - 3]);
    }
    for (std::size_t i = 1; i < n; ++i) {
        const double factor = below[i] / on[i - 1];
        on[i] -= factor * above[i - 1];
        right[i] -= factor * right[i - 1];
    }
    right[last] /= on[last];
    for (std::size_t i = last; i-- > 0;) right[i] = (right[i] - above[i] * right[i + 1]) / on[i];
    return right;
}

// The pieces of one variable through the points, those beyond the ends too.
std::vector<Cubic> pieces_through(const std::vector<double>& x, const std::vector<double>& values,
                                  Interpolation interpolation, Extrapolation extrapolation) {
    const std::size_t n = x.size();
    std::vector<double> h(n - 1), chord(n - 1);
    for (std::size_t i = 0; i + 1 < n; ++i) {
        h[i] = x[i + 1] - x[i];
        chord[i] = (values[i + 1] - values[i]) / h[i];
    }
    std::vector<Cubic> pieces(n + 1, Cubic{});
    if (interpolation == Interpolation::linear) {
        for (std::size_t i = 0; i + 1 < n; ++i) pieces[i + 1] = {values[i], chord[i], 0, 0};
    } else {
        const auto slopes = interpolation == Interpolation::pchip
                                ? pchip_slopes(h, chord)
                                : spline_slopes(h, chord, interpolation == Interpolation::natural);
        for (std::size_t i = 0; i + 1 < n; ++i) {
            const double bend = slopes[i] + slopes[i + 1] - 2 * chord[i];
            pieces[i + 1] = {values[i], slopes[i], (chord[i] - slopes[i] - bend) / h[i], bend / (h[i] * h[i])};
        }
    }
    const auto& [c0, c1, c2, c3] = pieces[n - 1];
    const double step = h.back();
    const double end_slope = c1 + step * (2 * c2 + step * 3 * c3);
    switch (extrapolation) {
    case Extrapolation::refuse: pieces.front() = pieces.back() = {none, none, none, none}; break;
    case Extrapolation::hold:
        pieces.front() = {values.front(), 0, 0, 0};
        pieces.back() = {values.back(), 0, 0, 0};
        break;
    case Extrapolation::linear:
        pieces.front() = {values.front(), pieces[1][1], 0, 0};
        pieces.back() = {values.back(), end_slope, 0, 0};
        break;
    }
    return pieces;
}

} // namespace

LookupTable::LookupTable(const Points& points)
    : points_(std::make_shared<Points>(points)),
      name_(points.name),
      units_{points.x_unit, points.y_unit, points.unit},
      two_(!points.y.empty()) {
    check_axis(name_, "x", points.x);
    if (two_) check_axis(name_, "y", points.y);
    const std::size_t rows = points.x.size(), columns = two_ ? points.y.size() : 1;
    const char* value_name = two_ ? "z" : "y";
    if (points.values.size() != rows * columns) {
        throw InputError(
            fmt::format("{}: {} has {} values, must have {}", name_, value_name, points.values.size(),
                        two_ ? fmt::format("{} times {}, as x and y", rows, columns) : fmt::format("{}, as x", rows)));
    }
    for (std::size_t i = 0; i < points.values.size(); ++i) {
        if (std::isfinite(points.values[i])) continue;
        const std::string place =
            two_ ? fmt::format("z[{}][{}]", i / columns + 1, i % columns + 1) : fmt::format("y[{}]", i + 1);
        throw InputError(fmt::format("{}: {} = {}, must be finite", name_, place, to_text(points.values[i])));
    }
    if (two_ && points.interpolation == Interpolation::pchip) {
        throw InputError(fmt::format("{}: interpolation = \"pchip\" is for tables of one variable; those of two have "
                                     "\"linear\", \"spline\" and \"natural\"",
                                     name_));
    }
    const bool linear = points.interpolation == Interpolation::linear;
    one_polynomial_ = linear && points.extrapolation != Extrapolation::refuse;
    const std::size_t order = linear ? 2 : 4;
    axes_[0].knots = points.x;
    axes_[1].knots = points.y;
    for (std::size_t a = 0; a < (two_ ? 2u : 1u); ++a) {
        axes_[a].order = order;
        axes_[a].refuses = points.extrapolation == Extrapolation::refuse;
    }
    // Along y for each x; then each coefficient of these along x, as if it were a value.
    std::vector<std::vector<Cubic>> along_y(rows);
    for (std::size_t i = 0; i < rows; ++i) {
        const auto begin = points.values.begin() + static_cast<std::ptrdiff_t>(i * columns);
        const std::vector<double> row(begin, begin + static_cast<std::ptrdiff_t>(columns));
        along_y[i] = two_ ? pieces_through(points.y, row, points.interpolation, points.extrapolation)
                          : std::vector<Cubic>{{row[0], 0, 0, 0}};
    }
    const std::size_t y_order = axes_[1].order, y_pieces = along_y[0].size();
    coefficients_.assign((rows + 1) * y_pieces * order * y_order, 0);
    std::vector<double> column(rows);
    for (std::size_t j = 0; j < y_pieces; ++j) {
        for (std::size_t m = 0; m < y_order; ++m) {
            for (std::size_t i = 0; i < rows; ++i) column[i] = along_y[i][j][m];
            const auto pieces = pieces_through(points.x, column, points.interpolation, points.extrapolation);
            for (std::size_t i = 0; i < pieces.size(); ++i) {
                double* c = coefficients_.data() + (i * y_pieces + j) * order * y_order;
                for (std::size_t k = 0; k < order; ++k) c[k * y_order + m] = pieces[i][k];
            }
        }
    }
    // Where slopes jump: of a line at each abscissa where they differ, of a curve at the ends where it is held.
    for (std::size_t a = 0; a < (two_ ? 2u : 1u); ++a) {
        auto& axis = axes_[a];
        const std::size_t last = axis.knots.size() - 1;
        for (std::size_t k = 0; k <= last; ++k) {
            const bool end = k == 0 || k == last;
            if (end && axis.refuses) continue;
            if (!end && !linear) continue;
            if (end && points.extrapolation == Extrapolation::linear) continue;
            const bool straight = linear && !two_ && coefficients(k, 0)[1] == coefficients(k + 1, 0)[1];
            if (!straight) axis.kinks.push_back(k);
        }
        borders_[a] = border_of(a);
    }
}

// ---- evaluation --------------------------------------------------------------------------------------------------

std::size_t LookupTable::Axis::piece_at(double u) const {
    const auto place = static_cast<std::size_t>(std::upper_bound(knots.begin(), knots.end(), u) - knots.begin());
    // Where there is nothing beyond, the end belongs to what lies before it.
    return refuses && place == knots.size() && u == knots.back() ? place - 1 : place;
}

std::size_t LookupTable::Axis::stretch_at(double u) const {
    return static_cast<std::size_t>(
        std::upper_bound(kinks.begin(), kinks.end(), u, [&](double v, std::size_t k) { return v < knots[k]; }) -
        kinks.begin());
}

std::size_t LookupTable::Axis::piece(double u, bool odd) const {
    if (kinks.empty()) return piece_at(u);
    const std::size_t stretch = stretch_at(u);
    if ((stretch % 2 != 0) == odd) return piece_at(u);
    // The neighbor goes on as far as here: the one whose end is nearer.
    const double before = stretch > 0 ? u - knots[kinks[stretch - 1]] : infinity;
    const double behind = stretch < kinks.size() ? knots[kinks[stretch]] - u : infinity;
    return before <= behind ? kinks[stretch - 1] : kinks[stretch] + 1;
}

int LookupTable::side_of(double x, double y) const {
    const auto odd = [](const Axis& axis, double u) { return static_cast<int>(axis.stretch_at(u) % 2); };
    return odd(axes_[0], x) + (two_ ? 2 * odd(axes_[1], y) : 0);
}

double LookupTable::value(double x, double y, int side) const {
    const std::size_t i = axes_[0].piece(x, (side & 1) != 0);
    const double s = x - axes_[0].origin(i);
    if (!two_) {
        const double* c = coefficients_.data() + i * axes_[0].order;
        double sum = 0;
        for (std::size_t k = axes_[0].order; k-- > 0;) sum = c[k] + s * sum;
        return sum;
    }
    const std::size_t j = axes_[1].piece(y, (side & 2) != 0);
    const double t = y - axes_[1].origin(j);
    const double* c = coefficients(i, j);
    double sum = 0;
    for (std::size_t k = axes_[0].order; k-- > 0;) {
        double inner = 0;
        for (std::size_t m = axes_[1].order; m-- > 0;) inner = c[k * axes_[1].order + m] + t * inner;
        sum = inner + s * sum;
    }
    return sum;
}

std::shared_ptr<const LookupTable> LookupTable::slope(int variable) const {
    auto made = std::make_shared<LookupTable>(*this);
    const auto a = static_cast<std::size_t>(variable);
    const std::size_t x_order = axes_[0].order, y_order = axes_[1].order;
    if (axes_[a].order == 1) return nullptr;
    made->derivation_ = fmt::format("{}slope {} ", derivation_, variable);
    made->name_ = name_ + "'";
    made->units_[2].clear();
    --made->axes_[a].order;
    made->coefficients_.clear();
    bool any = false;
    for (std::size_t piece = 0; piece < coefficients_.size(); piece += x_order * y_order) {
        for (std::size_t k = a == 0 ? 1 : 0; k < x_order; ++k) {
            for (std::size_t m = a == 1 ? 1 : 0; m < y_order; ++m) {
                const double power = static_cast<double>(a == 0 ? k : m);
                made->coefficients_.push_back(power * coefficients_[piece + k * y_order + m]);
                any = any || (made->coefficients_.back() != 0 && !std::isnan(made->coefficients_.back()));
            }
        }
    }
    return any ? made : nullptr;
}

std::shared_ptr<const LookupTable> LookupTable::border_of(std::size_t variable) const {
    const auto& axis = axes_[variable];
    if (axis.kinks.empty()) return nullptr;
    std::shared_ptr<LookupTable> made(new LookupTable);
    made->points_ = points_;
    made->derivation_ = fmt::format("{}border {} ", derivation_, variable);
    made->name_ = "breakpoints of " + name_;
    made->one_polynomial_ = true;
    made->units_[0] = units_[variable];
    auto& own = made->axes_[0];
    own.order = 3;
    for (const std::size_t k : axis.kinks) own.knots.push_back(axis.knots[k]);
    // Up and down in parabolas whose slopes at the kinks are 1 and -1 in turn.
    made->coefficients_ = {0, 1, 0};
    for (std::size_t k = 0; k < own.knots.size(); ++k) {
        const double sign = k % 2 == 0 ? 1 : -1;
        const bool last = k + 1 == own.knots.size();
        const double bend = last ? 0 : -sign / (own.knots[k + 1] - own.knots[k]);
        made->coefficients_.insert(made->coefficients_.end(), {0, sign, bend});
    }
    return made;
}

LookupTable::Range LookupTable::domain(int variable) const {
    const auto& axis = axes_[static_cast<std::size_t>(variable)];
    if (!axis.refuses) return {-infinity, infinity};
    return {axis.knots.front(), axis.knots.back()};
}

std::size_t LookupTable::hash() const {
    std::uint64_t hash = two_;
    const auto add = [&](double value) {
        hash = (hash ^ std::bit_cast<std::uint64_t>(value)) * 0x9E3779B97F4A7C15ull;
        hash ^= hash >> 29;
    };
    for (const auto& axis : axes_) {
        for (const double knot : axis.knots) add(knot);
        add(static_cast<double>(axis.order));
        add(axis.refuses);
    }
    for (const double c : coefficients_) add(std::isnan(c) ? 0 : c);
    return hash;
}

std::shared_ptr<const LookupTable> LookupTable::derived(std::shared_ptr<const LookupTable> from,
                                                        const std::string& derivation) {
    std::istringstream words(derivation);
    int variable = 0;
    for (std::string step; from && words >> step >> variable;) {
        if (variable < 0 || variable >= from->variables()) return nullptr;
        from = step == "slope" ? from->slope(variable) : from->border(variable);
    }
    return from;
}

// ---- ranges ------------------------------------------------------------------------------------------------------

namespace {

// A polynomial's coefficients by powers of s turned into those of Bernstein form on [low, high], `stride` apart.
void to_bernstein(double* c, std::size_t order, std::size_t stride, double low, double high) {
    const auto at = [&](std::size_t k) -> double& { return c[k * stride]; };
    // By powers of s - low, then of (s - low)/(high - low).
    for (std::size_t round = 0; round + 1 < order; ++round) {
        for (std::size_t k = order - 1; k-- > round;) at(k) += low * at(k + 1);
    }
    double power = 1;
    for (std::size_t k = 1; k < order; ++k) at(k) *= power *= high - low;
    const std::size_t degree = order - 1;
    double binomial = 1;
    for (std::size_t k = 1; k <= degree; ++k) {
        binomial *= static_cast<double>(degree - k + 1) / static_cast<double>(k);
        at(k) /= binomial;
    }
    for (std::size_t round = 1; round <= degree; ++round) {
        for (std::size_t k = degree; k >= round; --k) at(k) += at(k - 1);
    }
}

// The exact extremes of a polynomial of degree 3 at most.
LookupTable::Range extremes(const double* c, std::size_t order, double low, double high) {
    const auto at = [&](double s) {
        double sum = 0;
        for (std::size_t k = order; k-- > 0;) sum = c[k] + s * sum;
        return sum;
    };
    LookupTable::Range found{infinity, -infinity};
    const auto look = [&](double s) {
        const double value = at(std::clamp(s, low, high));
        if (std::isnan(value)) found = {-infinity, infinity};
        found.low = std::min(found.low, value);
        found.high = std::max(found.high, value);
    };
    look(low);
    look(high);
    const double c1 = order > 1 ? c[1] : 0, c2 = order > 2 ? c[2] : 0, c3 = order > 3 ? c[3] : 0;
    // c1 + 2 c2 s + 3 c3 s^2 = 0, by the formula that does not cancel.
    const double root = c2 * c2 - 3 * c3 * c1;
    if (root < 0) return found;
    const double q = -(c2 + std::copysign(std::sqrt(root), c2));
    if (c3 != 0) look(q / (3 * c3));
    if (q != 0) look(c1 / q);
    return found;
}

} // namespace

constexpr double far = 1e100; // stands for infinity, and its powers are finite

// The pieces in an interval, each with the part of it that lies there.
std::vector<LookupTable::Stretch> LookupTable::stretches(const Axis& axis, const Range& range, bool odd) {
    const double low = std::clamp(range.low, -far, far), high = std::clamp(range.high, -far, far);
    std::vector<double> cuts = {low, high};
    const auto cut = [&](double u) {
        if (u > low && u < high) cuts.push_back(u);
    };
    const auto first = std::lower_bound(axis.knots.begin(), axis.knots.end(), low);
    for (auto knot = first; knot != axis.knots.end() && *knot < high; ++knot) cut(*knot);
    for (std::size_t k = 0; k + 1 < axis.kinks.size(); ++k) {
        cut(std::midpoint(axis.knots[axis.kinks[k]], axis.knots[axis.kinks[k + 1]]));
    }
    std::sort(cuts.begin(), cuts.end());
    std::vector<Stretch> list;
    for (std::size_t i = 0; i + 1 < cuts.size(); ++i) {
        if (i > 0 && cuts[i] == cuts[i + 1]) continue;
        list.push_back({axis.piece(std::midpoint(cuts[i], cuts[i + 1]), odd), cuts[i], cuts[i + 1]});
    }
    // At a cut the neighbor's value counts too, where it is another one.
    for (const double end : {low, high}) list.push_back({axis.piece(end, odd), end, end});
    return list;
}

LookupTable::Range LookupTable::range(const Range& x, const Range& y, int side) const {
    const auto is_none = [](const Range& r) { return std::isnan(r.low) || std::isnan(r.high); };
    if (is_none(x) || (two_ && is_none(y))) return {-infinity, infinity};
    Range found{infinity, -infinity};
    const auto add = [&](double low, double high) {
        found.low = std::min(found.low, low);
        found.high = std::max(found.high, high);
    };
    std::vector<double> c(axes_[0].order * axes_[1].order);
    const auto along_x = stretches(axes_[0], x, (side & 1) != 0);
    const auto along_y = two_ ? stretches(axes_[1], y, (side & 2) != 0) : std::vector<Stretch>{{0, 0, 0}};
    double size = 0; // of what was added up
    for (const auto& p : along_x) {
        const double x0 = axes_[0].origin(p.piece);
        for (const auto& q : along_y) {
            std::copy_n(coefficients(p.piece, q.piece), c.size(), c.begin());
            if (std::isnan(c[0])) return {-infinity, infinity};
            const double reach = std::max(std::abs(p.low - x0), std::abs(p.high - x0));
            const double y0 = axes_[1].origin(q.piece);
            const double y_reach = std::max(std::abs(q.low - y0), std::abs(q.high - y0));
            double most = 0, power = 1;
            for (std::size_t k = 0; k < axes_[0].order; ++k, power *= reach) {
                double y_power = power;
                for (std::size_t m = 0; m < axes_[1].order; ++m, y_power *= y_reach) {
                    if (c[k * axes_[1].order + m] != 0) most += std::abs(c[k * axes_[1].order + m]) * y_power;
                }
            }
            size = std::max(size, most);
            if (!two_) {
                const Range part = extremes(c.data(), c.size(), p.low - x0, p.high - x0);
                add(part.low, part.high);
                continue;
            }
            for (std::size_t m = 0; m < axes_[1].order; ++m) {
                to_bernstein(c.data() + m, axes_[0].order, axes_[1].order, p.low - x0, p.high - x0);
            }
            for (std::size_t k = 0; k < axes_[0].order; ++k) {
                to_bernstein(c.data() + k * axes_[1].order, axes_[1].order, 1, q.low - y0, q.high - y0);
            }
            const auto [low, high] = std::minmax_element(c.begin(), c.end());
            add(*low, *high);
        }
    }
    // Rounding, of the values too that value() gives.
    const double slack = 0x1p-48 * size;
    if (!(size < far)) return {-infinity, infinity};
    return {found.low - slack, found.high + slack};
}

} // namespace tribode
