#pragma once
#include <cstddef>

namespace tribode {

// The arithmetic of the series solvers, on columns of `height` numbers: padded to a multiple of eight, which the processor
// adds and multiplies at one time. Term n of a series is column n. The results are the same bits on all processors.
constexpr std::size_t block_size = 8;
constexpr double half_ulp = 0x1p-54; // relative

constexpr std::size_t padded(std::size_t size) { return (size + block_size - 1) / block_size * block_size; }

// product = matrix x; a multiple of four columns
void multiply_columns(const double* matrix, std::size_t height, std::size_t columns, const double* x, double* product);

// A propagated step from the derivative f. moved = Psi f, and false if a guard might cross zero meanwhile. propagator: Psi,
// below it for each group of guards the rows of their first coefficients, then those of their second ones; rest: the rows of
// bounds for their further ones; moving: of each guard -1, or 0 where it does not move; g: the guards where the step begins,
// with room for all of a group.
constexpr std::size_t guard_group = 4;
bool propagate_columns(const double* propagator, const double* rest, const double* moving, const double* g,
                       std::size_t height, std::size_t groups, const double* f, double* moved);

// sum = start + matrix x
void add_columns(const double* start, const double* matrix, std::size_t columns, std::size_t height, const double* x,
                 double* sum);

// From c_0 and c_1 = h f on c_{n+1} = h/(n+1) A c_n, until two terms in a row do not count any more. Returns the last n, or 0 where
// max_terms, an even number, do not do. least: sizes of the states below which nothing counts; limit: set to the sizes
// below which terms do not count; decay: see ExactIntegrator::fastest_decay.
int expand_columns(const double* a, const double* square, double decay, const double* least, std::size_t height,
                   const double* f, double h, int max_terms, double* terms, double* limit);

// The sum of all terms, x at the step's end, and of the sizes of those after the first.
void sum_columns(const double* terms, int order, std::size_t height, double* end, double* travel);

// sum c_n s^n, even and odd powers apart
void evaluate_columns(const double* terms, int order, std::size_t height, double s, double* x);

// Of the sensitivities s_p = dx/dp that obey s' = A s + A_p x + ..., the sums of their terms after the first over a step h,
//
//     c_{n+1} = h/(n+1) A c_n,   d_{n+1} = h/(n+1) (A d_n + A_p c_n)
//
// until two terms in a row do not count any more. The columns of c and of all d follow one another, `columns` in all, that of c
// first: room begins with those of c_1 and d_1 and has four times their size, sums receives the sums. Each A_p is a sum of
// products u v^T: those of column i are first[i] .. first[i + 1], of `left` u (height each), of `right`, a matrix with a row for
// each product (`rows`, a multiple of block_size), v. values: room for a number of each row. rate: that of a state that decays
// by itself, 0 where there is none. False where max_terms do not do.
struct PartialProducts {
    const double *left, *right;
    const std::size_t* first;
    std::size_t rows;
    double* values;
};
bool expand_sensitivities(const double* a, std::size_t states, double rate, const PartialProducts& partial,
                          std::size_t columns, std::size_t height, double h, int max_terms, double* room, double* sums);

// s_p += move s_p + psi q_p + psi_p f for `parameters` columns s_p and q_p, and matrices psi_p one after the other.
void propagate_sensitivities(const double* move, const double* psi, const double* psi_p, const double* f,
                             const double* q, std::size_t states, std::size_t height, std::size_t parameters,
                             double* s);

} // namespace tribode
