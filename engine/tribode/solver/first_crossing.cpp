#include "tribode/solver/first_crossing.hpp"

#include <array>
#include <cmath>
#include <limits>

namespace tribode {

namespace {

constexpr double none = no_crossing;
constexpr int bisected = 8; // rounds of which one is a bisection

// Of p_n in the first and second derivative at 1.
struct Factors {
    double of_slope, of_curvature;
};
constexpr auto factors = [] {
    std::array<Factors, max_polynomial_terms> values{};
    for (std::size_t n = 1; n < values.size(); ++n) {
        values[n] = {static_cast<double>(n), static_cast<double>(n * (n - 1))};
    }
    return values;
}();

using Bernstein = std::array<double, max_polynomial_terms>;

// b_i = sum_{k <= i} C(i,k)/C(N,k) p_k: the polynomial on [0, 1] lies within the range of the b_i.
Bernstein bernstein(std::span<const double> p) {
    Bernstein b{};
    const std::size_t degree = p.size() - 1;
    // p_k/C(N,k), then the sums with C(i,k) as repeated additions.
    double binomial = 1;
    b[0] = p[0];
    for (std::size_t k = 1; k <= degree; ++k) {
        binomial *= static_cast<double>(degree - k + 1) / static_cast<double>(k);
        b[k] = p[k] / binomial;
    }
    for (std::size_t round = 1; round <= degree; ++round) {
        for (std::size_t i = degree; i >= round; --i) b[i] += b[i - 1];
    }
    return b;
}

struct Derivatives {
    double value, first, second;
};

// Even and odd powers apart, p(s) = e(s^2) + s o(s^2), so that one half does not wait for the other.
Derivatives derivatives(std::span<const double> p, double s) {
    const double square = s * s;
    struct Half {
        double value = 0, first = 0, second = 0; // the second derivative by s^2 is twice that

        void append(double square, double coefficient) {
            second = second * square + first;
            first = first * square + value;
            value = value * square + coefficient;
        }
    };
    Half even, odd;
    std::size_t n = p.size();
    if (n % 2 == 1) even.value = p[--n];
    while (n > 0) {
        odd.append(square, p[--n]);
        even.append(square, p[--n]);
    }
    return {even.value + s * odd.value, 2 * s * (even.first + s * odd.first) + odd.value,
            2 * even.first + 6 * s * odd.first + 8 * square * (even.second + s * odd.second)};
}

// One root in [low, high], the polynomial positive before and negative after it.
double close_in(std::span<const double> p, double low, double high) {
    // Where the first three terms have it, falling.
    const double half = 0.5 * p[1], square = p.size() > 2 ? half * half - p[2] * p[0] : 0;
    double guess = low;
    if (square > 0) guess = half > 0 ? -(half + std::sqrt(square)) / p[2] : p[0] / (std::sqrt(square) - half);
    double s = guess > low && guess < high ? guess : 0.5 * (low + high);
    for (int round = 0; round < 100; ++round) {
        const auto [value, first, second] = derivatives(p, s);
        (value >= 0 ? low : high) = s;
        // Halley's method.
        const double next = s - 2 * value * first / (2 * first * first - value * second);
        // Where it does not fall, as at its top, the step leads nowhere; and a step may lead to where another one began.
        const bool is_inside = first < 0 && next >= low && next <= high;
        if (!is_inside || round % bisected == bisected - 1) {
            const double middle = 0.5 * (low + high);
            if (middle == low || middle == high) return middle;
            s = middle;
            continue;
        }
        // It takes the error, relative to s, to the third power: after a step this short it is below rounding.
        if (std::abs(next - s) < 1e-7 * next) return next;
        s = next;
    }
    return s;
}

// The first crossing in [low, high], at whose beginning the polynomial is zero or above; b: its Bernstein coefficients there.
double search(std::span<const double> p, const Bernstein& b, double low, double high) {
    const std::size_t degree = p.size() - 1;
    int changes = 0; // of sign, zeros passed over: as many as roots inside, or more by an even number (Descartes)
    double sign = 0; // of the last coefficient that is not zero
    for (std::size_t i = 0; i <= degree; ++i) {
        if (b[i] == 0) continue;
        if (sign * b[i] < 0) ++changes;
        sign = b[i] > 0 ? 1 : -1;
    }
    if (changes == 0) return sign < 0 ? low : none;
    if (changes == 1) return sign < 0 ? close_in(p, low, high) : low;
    // Two roots nearer than rounding can tell apart: the polynomial touches zero. Near the beginning they may be apart by
    // far less than rounding of the whole interval.
    if (high - low < 0x1p-50 * high || high < 0x1p-200) return none;
    // de Casteljau: the coefficients on the two halves.
    Bernstein left{}, right = b;
    for (std::size_t round = 0; round <= degree; ++round) {
        left[round] = right[0];
        for (std::size_t i = 0; i + round < degree; ++i) right[i] = 0.5 * (right[i] + right[i + 1]);
    }
    const double middle = 0.5 * (low + high);
    const double first = search(p, left, low, middle);
    return first != none ? first : search(p, right, middle, high);
}

// What a polynomial and its first two derivatives are in [0, 1].
struct Sizes {
    double end = 0;    // its value at 1
    double others = 0; // its terms but the first differ from zero by at most these together,
    double rest = 0, slope_rest = 0, curvature_rest = 0; // and from what its first terms have by these
};

double first_crossing_before_end(std::span<const double> p, const Sizes& sizes) {
    constexpr double margin = 1 + 1e-12; // for rounding of these sums
    // On the way to its value at the end it neither rises nor falls in between.
    const bool monotonous = p.size() > 1 && std::abs(p[1]) > sizes.slope_rest * margin;
    if (monotonous) {
        if (p[1] > 0) return none;
        return p[0] == 0 ? 0 : sizes.end < 0 ? close_in(p, 0, 1) : none;
    }
    // Bent one way all along, from above zero (or rising from it) it comes to an end below zero by one crossing; to one above zero
    // by none where it is bent downwards, where it never falls, or where its lowest point is high enough.
    const bool begins_above = p.size() > 2 && (p[0] > 0 || p[1] > 0);
    if (begins_above && 2 * std::abs(p[2]) > sizes.curvature_rest * margin) {
        if (sizes.end < 0) return close_in(p, 0, 1);
        if (p[2] < 0 || p[1] >= 0) return none;
        const double at = -p[1] / (2 * p[2]);
        const double lowest = at < 1 ? p[0] + 0.5 * p[1] * at : p[0] + p[1] + p[2];
        if (lowest - sizes.rest > 1e-12 * sizes.others) return none;
    }
    return search(p, bernstein(p), 0, 1);
}

// Whether it falls at the end, and by more than one that touches zero there up to rounding.
bool falls_at_end(std::span<const double> p, double size) {
    double slope = 0;
    for (std::size_t n = 1; n < p.size(); ++n) slope += factors[n].of_slope * p[n];
    return slope < -1e-7 * size;
}

} // namespace

double first_crossing_below_zero(std::span<const double> p) {
    Sizes sizes{.end = p[0]};
    for (std::size_t n = 1; n < p.size(); ++n) {
        const double size = std::abs(p[n]);
        sizes.end += p[n];
        sizes.others += size;
        if (n > 1) sizes.slope_rest += factors[n].of_slope * size;
        if (n < 3) continue;
        sizes.rest += size;
        sizes.curvature_rest += factors[n].of_curvature * size;
    }
    constexpr double rounding = 4 * std::numeric_limits<double>::epsilon();
    if (p[0] > (1 + rounding) * sizes.others) return none;
    if (p[0] < 0) return 0;
    const double first = first_crossing_before_end(p, sizes);
    if (first != none || sizes.end > rounding * sizes.others) return first;
    return falls_at_end(p, sizes.others) ? 1 : none;
}

} // namespace tribode
