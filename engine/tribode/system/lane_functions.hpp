#pragma once
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

// Functions of several numbers at once, without branches, so that a compiler makes vector instructions of them: their bits are the
// same for any length of vectors. At most three units in the last place from those of the C library, which takes over beyond the
// range in which they hold.
namespace tribode::lane_functions {

constexpr double to_integer = 0x1.8p52; // added to a number, rounds it to an integer, which stands in the last bits

// sin(x + quarters pi/2) for |x| < 1e5: pi/2 in three parts, of which the products by such integers are exact, and the polynomials
// of least error of fdlibm between -pi/4 and pi/4.
[[gnu::always_inline]] inline double sine(double x, double quarters) {
    const double turns = (x * 0x1.45f306dc9c883p-1 + to_integer) - to_integer;
    const double r = ((x - turns * 0x1.921fb544p0) - turns * 0x1.0b4611a6p-34) - turns * 0x1.3198a2e037073p-69;
    const double z = r * r, zz = z * z;
    // Pairs of terms, which do not wait for one another.
    const double odd = r + r * z *
                               (((-1.66666666666666324348e-01 + z * 8.33333333332248946124e-03) +
                                 zz * (-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06)) +
                                zz * zz * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10));
    const double half = 0.5 * z, one = 1 - half;
    const double even =
        one + (((1 - one) - half) + zz * (((4.16666666666666019037e-02 + z * -1.38888888888741095749e-03) +
                                           zz * (2.48015872894767294178e-05 + z * -2.75573143513906633035e-07)) +
                                          zz * zz * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)));
    // The quarter of the turn, from the last two bits.
    const auto quarter = std::bit_cast<std::uint64_t>(turns + quarters + to_integer);
    const double size = (quarter & 1) != 0 ? even : odd;
    return (quarter & 2) != 0 ? -size : size;
}

// e^x - 1 = 2^k (e^r - 1) + 2^k - 1, for |x| < 700: |r| < 0.35, where the power series needs thirteen terms.
struct Exponential {
    double power, rest; // 2^k and e^r - 1
};
[[gnu::always_inline]] inline Exponential exponential(double x) {
    const double shifted = x * 0x1.71547652b82fep0 + to_integer, k = shifted - to_integer;
    const double r = (x - k * 0x1.62e42feep-1) - k * 0x1.a39ef35793c76p-33;
    const double r2 = r * r, r4 = r2 * r2;
    const double low = (0.5 + r * (1.0 / 6)) + r2 * (1.0 / 24 + r * (1.0 / 120));
    const double middle = (1.0 / 720 + r * (1.0 / 5040)) + r2 * (1.0 / 40320 + r * (1.0 / 362880));
    const double high = (1.0 / 3628800 + r * (1.0 / 39916800)) + r2 * (1.0 / 479001600 + r * (1.0 / 6227020800));
    const double series = (low + r4 * middle) + r4 * r4 * high;
    return {std::bit_cast<double>((std::bit_cast<std::uint64_t>(shifted) + 1023) << 52), r + r * r * series};
}

// `beyond`: of one number, for those that are not smaller than the limit in size.
template <std::size_t lanes, class Function>
[[gnu::always_inline]] inline void replace(const double* x, double* y, double limit, const Function& beyond) {
    bool is_within = true;
    for (std::size_t l = 0; l < lanes; ++l) is_within &= std::abs(x[l]) < limit;
    if (is_within) return;
    for (std::size_t l = 0; l < lanes; ++l) {
        if (!(std::abs(x[l]) < limit)) y[l] = beyond(x[l]);
    }
}

template <std::size_t lanes>
[[gnu::always_inline]] inline void sin(const double* x, double* y) {
    for (std::size_t l = 0; l < lanes; ++l) y[l] = sine(x[l], 0);
    replace<lanes>(x, y, 1e5, [](double value) { return std::sin(value); });
}

template <std::size_t lanes>
[[gnu::always_inline]] inline void cos(const double* x, double* y) {
    for (std::size_t l = 0; l < lanes; ++l) y[l] = sine(x[l], 1);
    replace<lanes>(x, y, 1e5, [](double value) { return std::cos(value); });
}

template <std::size_t lanes>
[[gnu::always_inline]] inline void exp(const double* x, double* y) {
    for (std::size_t l = 0; l < lanes; ++l) {
        const auto [power, rest] = exponential(x[l]);
        y[l] = power + power * rest;
    }
    replace<lanes>(x, y, 700, [](double value) { return std::exp(value); });
}

// From 22 on it is one.
template <std::size_t lanes>
[[gnu::always_inline]] inline void tanh(const double* x, double* y) {
    for (std::size_t l = 0; l < lanes; ++l) {
        const double size = std::abs(x[l]), most = 22;
        const auto [power, rest] = exponential(-2 * (size > most ? most : size));
        const double less_one = power * rest + (power - 1);
        y[l] = std::copysign(less_one / (less_one + 2), x[l]);
    }
}

} // namespace tribode::lane_functions
