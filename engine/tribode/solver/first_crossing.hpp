#pragma once
#include <cstddef>
#include <span>

namespace tribode {

constexpr std::size_t max_polynomial_terms = 31;
constexpr double no_crossing = 2;

// The first s in [0, 1] at which the polynomial sum p_n s^n crosses below zero after having been zero or above (s = 0 where
// it begins below), or no_crossing. One that falls to zero at the very end, up to rounding, crosses there. Exact up to
// rounding of the evaluation, also for an s far below 1: to rounding of s, not of the interval. At most
// max_polynomial_terms coefficients.
double first_crossing_below_zero(std::span<const double> p);

} // namespace tribode
