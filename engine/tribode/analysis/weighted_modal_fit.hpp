#pragma once
#include "tribode/analysis/measured_response.hpp"
#include "tribode/analysis/modal_fit.hpp"

#include <optional>
#include <string>
#include <vector>

namespace tribode {

struct WeightedFitOptions {
    double f_min_hz = 0; // band, both ends included
    double f_max_hz = 1e9;
    int modes = 2;
    std::optional<double> delay; // start value of a dead time that is fitted as well [s]; none: there is none
};

struct WeightedFit {
    ModalModel model;           // modes by ascending frequency
    double delay = 0;           // [s]
    ModalModel standard_errors; // infinite where the data do not say
    double delay_error = 0;
    std::vector<std::string> parameters;         // k0, k1, f1_hz, zeta1, ..., delay_s: the order of the covariance
    std::vector<std::vector<double>> covariance; // empty where the data do not determine all parameters
    double misfit = 0; // relative difference from the model that the variances do not explain, one component
    int points = 0;
    std::string message; // empty, or what is wrong with the result
    // Most points are is_rounded. Errors of rounding have large ones among them, and the few points next to a resonance decide:
    // the standard errors may then be too small.
    bool rounding = false;
};

// ModalModel exp(-j w delay) fitted to the points with a value, each weighted by its variance. The residual is ln(H/P) in
// gain and phase, as in fit_modal_model, which gives the start. A response may differ from a modal model by more than its
// noise (friction does that); so the variance of each component is that of the point plus misfit^2, and misfit is the
// smallest number with which the residuals are as large as their variances. Points further off than four of their standard
// deviations lose influence (Cauchy loss). Points without a known variance count with the median of the others.
//
// The covariance is that of the M-estimator. With a misfit of zero it rests on the measured variances; with a larger one it
// takes the differences from the model for independent from point to point, which those due to friction are not.
WeightedFit fit_weighted(const std::vector<MeasuredPoint>& points, const WeightedFitOptions& options);

// {"k0", "modes": [{"gain", "freq_hz", "zeta"}], "delay_s", "standard_errors": the same, "parameters", "covariance", ...}
Json to_json(const WeightedFit& fit);

} // namespace tribode
