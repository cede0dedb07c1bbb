#pragma once
#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace tribode {

// rms of the errors; infinite where there are none: nothing was simulated.
// Errors below this share of an output's deviation say nothing: those of the solvers are up to about as large.
constexpr double solvers_errors = 1e-6;

double rms_of_errors(const std::vector<double>& errors);

// Standard deviation of the white noise in a signal: robustly from differences of the fourth order, in which what moves
// slowly does not show. Of a signal that moves from sample to sample it is too large. Values that are not finite are passed over.
double white_noise(const std::vector<double>& values);

// Standard deviation of what rounding or holding does to a signal of steps, whose fourth differences are mostly nothing, in the
// unit of the values; zero for a signal that is not one. From the smaller jumps between values that repeat, so rather too
// small; where these are few, as of an axis that mostly rests, from the even grid that all values are on. `errors`: what a model
// leaves of it; where they hold as well the model has the steps itself, and it is zero.
double rounding_noise(const std::vector<double>& values, const std::vector<double>& errors = {});

// Samples after which errors have forgotten what they were: the sum of their correlations, both ways.
double correlation_length(const std::vector<double>& errors);

// Whether the errors cannot be told from white noise, in which nothing is left to find: the sum of their squared correlations
// over the first lags is no larger than by chance [Ljung 1978].
bool is_white(const std::vector<double>& errors);

// Whether that is so, or they are no larger than those of the solvers. Relative to the outputs' deviations.
bool is_nothing_left(const std::vector<double>& errors);

// The probability, by resampling blocks longer than the correlation, that the second errors are smaller in mean square than
// the first ones. Both of the same samples.
double probability_of_gain(const std::vector<double>& first, const std::vector<double>& second);

// Errors of one output at samples that follow each other.
struct Stretch {
    std::size_t output, samples;
};

// Of the errors that a model was fitted to, and of those that it predicts.
struct Stretches {
    std::vector<Stretch> fitted, predicted;
};

// Twice the logarithm of the likelihood ratio of the second errors to the first ones. Those of each output are the sum of what follows
// from the errors before and of white noise. What a random force does to a motion follows in most part from what it has done
// before, so that explaining it by chance gains little. How errors follow is chosen by the Bayesian information criterion [Schwarz
// 1978], and its price is counted. `stretches`: of the errors, one behind the other.
double likelihood_gain(const std::vector<double>& first, const std::vector<double>& second,
                       const std::vector<Stretch>& stretches);

// Covariance of parameters fitted by least squares to errors that may be correlated, in a way that nobody has modeled: with
// the normal matrix N of the slopes J of the errors e, N^-1 B N^-1, where B sums the correlations of the scores J e by
// Bartlett's window over a tenth of each record. As B is estimated from few independent parts, it is enlarged so that a bound of
// 90 % covers 90 % [Kiefer 2005, table 1]. scores: a row for each sample, one record after another, and behind them those of errors
// that are independent; rows: of each record.
Eigen::MatrixXd covariance_of_correlated_errors(const Eigen::MatrixXd& inverse_of_normal, const Eigen::MatrixXd& scores,
                                                const std::vector<std::size_t>& rows);

// What least squares leaves of each tenth of a record where all the rest is fitted, to first order: errors with their slopes
// by the parameters, a row for each sample, one record after another, and behind them those of errors that stay; rows: of
// each record. What the rest does not show stays as it was fitted.
Eigen::VectorXd errors_of_left_out_parts(const Eigen::MatrixXd& slopes, const Eigen::VectorXd& errors,
                                         const std::vector<std::size_t>& rows);

// By how many of its standard deviations the sum of squares of the second errors is smaller than that of the first ones. The
// deviation is that of second errors which are correlated within the tenths of each record, as they are. Errors behind the
// records have none.
double gain_in_deviations(const Eigen::VectorXd& first, const Eigen::VectorXd& second,
                          const std::vector<std::size_t>& rows);

} // namespace tribode
