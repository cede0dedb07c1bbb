#pragma once
#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace tribode {

// What a model leaves of one output, in samples that follow each other, and how these errors fall as its p parameters grow.
struct OutputErrors {
    Eigen::VectorXd errors;        // n, in any unit
    Eigen::MatrixXd slopes;        // n x p, that unit over those of the parameters
    std::vector<std::size_t> rows; // of each record, one behind the other
};

// Errors of one output as white noise of this variance and a motion with `ratio` times that, whose correlation after a time t is e^-x,
// or (1 + x) e^-x where it is smooth (Matérn's of order 1/2 or 3/2), x = t / T: what a random force does to a machine.
struct ErrorModel {
    bool is_smooth = false;
    double lasts = 1; // T [samples]
    double ratio = 0;
    double variance = 1;

    // Of each row of signals, a column for each sample, what does not follow from the samples before, with variance one for
    // errors of this kind. rows: samples of each record.
    Eigen::MatrixXd whitened(const Eigen::MatrixXd& signals, const std::vector<std::size_t>& rows) const;
};

// Of parameters, to first order.
struct GeneralizedFit {
    Eigen::VectorXd step;           // p, to those of generalized least squares
    Eigen::MatrixXd covariance;     // p x p, of these; zero for a parameter that the errors do not depend on
    std::vector<ErrorModel> models; // the likeliest for each output
};

// How large and how lasting a motion in the errors is cannot be read from what a fit leaves, since the fit has followed it; the
// likelihood of what no parameter can follow tells it [Harville 1974]. Step and covariance are those over all sizes and T, weighed by
// that. At least one output; a step of zero where there are no errors.
GeneralizedFit generalized_fit(const std::vector<OutputErrors>& outputs);

} // namespace tribode
