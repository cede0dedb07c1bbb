#pragma once
#include "tribode/analysis/frequency_response.hpp"
#include "tribode/analysis/modal_model.hpp"
#include "tribode/base/json.hpp"
#include "tribode/base/options.hpp"

#include <string>

namespace tribode {

struct ModalFitOptions {
    double f_min_hz = 20; // band, both ends included
    double f_max_hz = 200;
    int modes = 2; // zero or more
    // Scale a of the Cauchy loss a^2 ln(1 + r^2/a^2), r = abs(ln(H/P)): beyond it a point loses influence; 0.3 is
    // 35 % or 17 deg. 0: from the data, three times the standard deviation read from the median, which suits
    // responses that differ from a modal model by noise; friction bends whole stretches of a response, and a scale
    // read from the good ones would cut those off. Infinity: least squares.
    double robust_scale = 0.3;

    static void describe(auto& o, auto& fields) {
        fields.number("f_min_hz", o.f_min_hz, "Hz", Allowed::positive, "lower end of the band");
        fields.number("f_max_hz", o.f_max_hz, "Hz", Allowed::positive, "upper end of the band");
        fields.integer("modes", o.modes, 0, 20, "number of vibration modes");
        fields.number("robust_scale", o.robust_scale, "", Allowed::non_negative,
                      "size of a relative error from which a frequency loses influence; 0: from the data");
    }
};

struct ModalFitResult {
    ModalModel model;           // modes by ascending frequency, all parameters positive
    ModalModel standard_errors; // of the same parameters, same units; infinite where the data do not say
    double residual_rms = 0;    // of abs(ln(H/P)) over the band, without robust weights: 0.01 is 1 % or 0.6 deg
    double robust_scale = 0;    // the one used in the end
    int iterations = 0;         // of all searches together
    bool converged = false;
    std::string message; // empty, or what is wrong with the result and what to do
};

// Fits ModalModel to the response in the band. The residual at a frequency is the complex logarithm of the
// ratio, ln(H/P): error of the gain in neper and of the phase in rad, wrapped; so a resonance counts as much
// as the flat parts, and a relative error anywhere counts the same. The parameters are fitted as logarithms:
// a gain, a frequency or a damping cannot become negative.
//
// The start is found from the data alone. The model begins as a free mass whose gain is the median of abs(H)
// w^2 over the highest frequencies; modes are then added one at a time. For each, all frequencies of the band
// (at most 150 of them) are tried with several dampings and shares of the total gain, the three best, and
// each mode already there split in two, are refined with all parameters free, and the one of least cost
// stays. Frequencies keep within a factor of two of the band, dampings between 1e-6 and 5, gains between 1e-6
// and 1e3 of the total; the standard error of a parameter at such a bound is infinite. Last, the scale of the
// robust loss is read from the residuals and the fit repeated until the scale no longer changes.
//
// Standard errors: covariance of the M-estimator [Huber 1981, section 7.6], (J^T J)^-1 times the mean square
// of the influence over the square of its mean slope; with plain least squares the usual residual variance.
// They hold for errors that are independent from point to point, of the same relative size everywhere. A
// systematic difference (friction at low frequencies) is no such error: then they say how sharp the minimum
// is, not how far the truth is.
//
// The result depends on the data and options alone. Throws InputError on options out of range, on values in
// the band that are zero or not finite, and on fewer points in the band than parameters.
ModalFitResult fit_modal_model(const FrequencyResponse& response, const ModalFitOptions& options = {});

// {"k0", "k1", "f1_hz", "zeta1", "k2", ...} in SI.
Json to_json(const ModalModel& model);

// The model in such a table; fields that are no parameters are passed over, so a fit's result will do.
// Throws InputError, which begins with `where`, where k0 is missing or a mode is not complete.
ModalModel modal_model_from_json(const Json& json, const std::string& where);

// The same keys for the model, then "standard_errors" with the same keys (null where infinite),
// "residual_rms", "converged", "message".
Json to_json(const ModalFitResult& result);

} // namespace tribode
