#pragma once
#include "tribode/base/lanes.hpp"

#include <cstddef>

namespace tribode {

// The arithmetic of the series solvers, on columns of `height` numbers: padded to a multiple of eight, which the processor
// adds and multiplies at one time. Term n of a series is column n. The results are the same bits on all processors.
constexpr std::size_t block_size = lane_count;
constexpr double half_ulp = 0x1p-54; // relative

constexpr std::size_t padded(std::size_t size) { return (size + block_size - 1) / block_size * block_size; }

// product = matrix x; a multiple of four columns
void multiply_columns(const double* matrix, std::size_t height, std::size_t columns, const double* x, double* product);

// A propagated step from the derivative f. moved = Psi f, and false if a guard might cross zero meanwhile. propagator: Psi,
// below it for each group of guards the rows of their first coefficients, then those of their second ones; rest: the rows of
// bounds for their further ones; g: the guards where the step begins, above zero where a group has more rows than there are.
constexpr std::size_t guard_group = 4;
bool propagate_columns(const double* propagator, const double* rest, const double* g, std::size_t height,
                       std::size_t groups, const double* f, double* moved);

// sum = start + matrix x
void add_columns(const double* start, const double* matrix, std::size_t columns, std::size_t height, const double* x,
                 double* sum);

// How many powers of A expand_columns() uses: A, A^2 and, of matrices of one block, A^4.
constexpr std::size_t power_count(std::size_t height) { return height == block_size ? 3 : 2; }

// From c_0 and c_1 = h f on c_{n+1} = h/(n+1) A c_n, until two terms in a row do not count any more. Returns the last n, or 0 where
// max_terms, two more than a multiple of four, do not do; terms has room for two more. least: sizes of the states below which
// nothing counts; limit: set to the sizes below which terms do not count; decay: see ExactIntegrator::fastest_decay.
int expand_columns(const double* powers, double decay, const double* least, std::size_t height, const double* f,
                   double h, int max_terms, double* terms, double* limit);

// The sum of all terms, x at the step's end, and of the sizes of those after the first.
void sum_columns(const double* terms, int order, std::size_t height, double* end, double* travel);

// sum c_n s^n, even and odd powers apart
void evaluate_columns(const double* terms, int order, std::size_t height, double s, double* x);

// Sensitivities s_p = dx/dp that obey s' = A s + A_p x + ..., by up to lane_count parameters: those of a state side by side, state
// after state (height x lanes).
struct SensitivityMatrices {
    std::size_t states, height;
    std::size_t parameters; // the lanes beyond are zero
    const double* a;        // A, by columns (height x height)
    // A by its rows: those with entries in several columns, and of the others row, column and value.
    const double* full; // (full_rows x height)
    const std::size_t* full_row;
    std::size_t full_rows;
    struct Single {
        std::size_t row, column;
        double value;
    };
    const Single* single;
    std::size_t single_rows;
    // The A_p as sums of products u v^T, one of each parameter in a layer: (height x lanes) for each layer, of which
    // there is one at least.
    std::size_t layers;
    const double *left, *right; // u, v
    double rate;                // of a state that decays by itself [1/s], 0 where there is none
};

// rates = A s + q
void sensitivity_rates(const SensitivityMatrices& matrices, const double* s, const double* q, double* rates);

// The sums of the terms after the first over a step h,
//
//     c_{n+1} = h/(n+1) A c_n,   d_{n+1} = h/(n+1) (A d_n + A_p c_n)
//
// until two terms in a row do not count any more. A term consists of d (height x lanes), then c (height): room begins with d_1 and
// c_1, has four times their size and a lane for each layer; sums receives the sums. False where max_terms do not do.
bool expand_sensitivities(const SensitivityMatrices& matrices, double h, int max_terms, double* room, double* sums);

// s_p += psi rates_p + psi_p f; psi and psi_p row by row (height x height), the latter of lanes.
void propagate_sensitivities(const double* psi, const double* psi_p, const double* f, const double* rates,
                             std::size_t height, double* s);

} // namespace tribode
