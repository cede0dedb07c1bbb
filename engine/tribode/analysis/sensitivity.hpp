#pragma once
#include <cstdint>
#include <span>
#include <vector>

namespace tribode {

// Which factors a result depends on. Rows whose result is not finite (a run that failed) are left out.

// The shares of the variance of a result: `first` is due to a factor alone, `total` to it alone or with others
// [Saltelli 2010]. Standard errors are those of the bootstrap over the groups.
struct SobolIndices {
    std::vector<double> first, first_error, total, total_error;
    double mean = 0, variance = 0; // of the result
    std::size_t groups = 0, dropped = 0;
};

// `values`: results of a design `saltelli` in its order, groups of factors + 2; a group in which one is missing is dropped.
// The estimators are those of [Saltelli 2010] for the first order, on results less their mean, and of [Jansen 1999] for the
// total. Independent factors are taken for granted. Throws InputError where the number of values is no multiple of
// factors + 2 or fewer than two groups are left. All indices are NaN where the result does not vary.
SobolIndices sobol_indices(std::span<const double> values, std::size_t factors, std::size_t replicates = 200,
                           std::uint64_t seed = 0);

using FactorColumns = std::vector<std::vector<double>>; // (factors x rows)

// The linear regression of the result on all factors, both in units of their standard deviations: with independent factors
// the square of a coefficient is the share of the variance that the factor explains linearly.
struct StandardizedRegression {
    std::vector<double> coefficients, standard_errors;
    double r_squared = 0; // the share that all explain together
    std::size_t rows = 0;
};

// With `ranks` the same of the ranks: for a result that rises or falls all the way, but not linearly.
// A factor that does not vary has the coefficient NaN. Throws InputError where columns differ in length or rows are no
// more than factors + 1.
StandardizedRegression standardized_regression(const FactorColumns& factors, std::span<const double> values,
                                               bool ranks = false);

// The mean of the result over the rows in which a factor is among its lowest or its highest share, whatever the others are.
struct TornadoBar {
    std::size_t factor;
    double low, high;             // means
    double low_error, high_error; // their standard errors
};

// The widest bar first. 0 < share <= 0.5; at least two rows at each end.
std::vector<TornadoBar> tornado(const FactorColumns& factors, std::span<const double> values, double share = 0.1);

} // namespace tribode
