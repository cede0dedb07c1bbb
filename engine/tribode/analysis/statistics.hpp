#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace tribode {

// Statistics of the results of independent runs. A value that is not finite is the result of a run that failed: it is left
// out, and counted as missing.

// A quantile with an interval that covers the true one with the wanted confidence, whatever the distribution: two order
// statistics, their places by the normal approximation of the binomial distribution. NaN where the sample is too short for
// an end.
struct Quantile {
    double probability, value, low, high;
};

struct Summary {
    std::size_t count = 0, missing = 0;
    double mean = 0, standard_deviation = 0; // the latter with count - 1
    double standard_error = 0;               // of the mean
    double mean_low = 0, mean_high = 0;      // Student's interval for the mean
    double least = 0, greatest = 0;
    std::vector<Quantile> quantiles;
};

// All numbers are NaN where there is no value, and those that need two where there is one.
// Quantiles are linear between order statistics: that of p lies at place 1 + (count - 1) p.
Summary summarize(std::span<const double> values, std::span<const double> probabilities, double confidence = 0.95);

// The quantile of sorted values, not empty.
double sorted_quantile(std::span<const double> sorted, double probability);

// The value at the place of the quantile or next below it; 0 of none.
double lower_quantile(std::vector<double> values, double probability);

// The quantile of Student's distribution with a whole number of degrees of freedom >= 1; 0 < p < 1. From 1000 degrees on by
// an expansion [Abramowitz 1964, 26.7.5].
double student_quantile(double p, std::size_t degrees);

struct Histogram {
    std::vector<double> edges; // one more than counts, even
    std::vector<std::size_t> counts;
    std::size_t missing = 0; // not finite
};

// bins = 0: as many as the rule of Freedman and Diaconis gives, 1 to 200.
Histogram histogram(std::span<const double> values, std::size_t bins = 0);

// The places of the `count` greatest (or least) finite values, the worst first; equal ones in their order.
std::vector<std::size_t> worst_cases(std::span<const double> values, std::size_t count, bool greatest = true);

} // namespace tribode
