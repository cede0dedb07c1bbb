#pragma once
#include "tribode/base/about.hpp"
#include "tribode/base/field_reader.hpp"

#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

namespace tribode {

// A filter of second order behind a controller, as drives have it against resonances:
//
//     low_pass   w^2 / (s^2 + 2 zeta w s + w^2)
//     notch      (s^2 + 2 depth zeta w s + w^2) / (s^2 + 2 zeta w s + w^2)
//
// made by the bilinear transform with w = 2 pi freq_hz in its place; freq_hz must be below half the sampling rate.
struct LoopFilter {
    enum class Kind { low_pass, notch };

    Kind kind = Kind::low_pass;
    double freq_hz = 0;
    double zeta = std::numbers::sqrt2 / 2;
    double depth = 0; // gain of a notch at freq_hz

    static void describe(auto& f, auto& fields) {
        fields.choice("type", f.kind, {"low_pass", "notch"}, "of second order; the first passes low frequencies");
        fields.required("freq_hz", f.freq_hz, "Hz", Allowed::positive,
                        About("corner, or what a notch takes out; below half the sampling rate").usually(0.1, 1e6));
        fields.number("zeta", f.zeta, "", Allowed::positive,
                      About("damping ratio; the width of a notch is 2 zeta freq_hz").usually(0.01, 2));
        fields.number("depth", f.depth, "", Allowed::non_negative,
                      About("gain of a notch at freq_hz").usually(1e-6, 1));
    }

    // Of 1, z^-1, z^-2: numerator, then denominator, whose first is 1.
    std::array<double, 6> coefficients(double sample_time) const {
        const double c = 1 / std::tan(std::numbers::pi * freq_hz * sample_time);
        const double square = kind == Kind::notch ? 1 : 0, linear = kind == Kind::notch ? depth : 0;
        const double scale = 1 + 2 * zeta * c + c * c;
        return {(1 + 2 * linear * zeta * c + square * c * c) / scale,
                2 * (1 - square * c * c) / scale,
                (1 - 2 * linear * zeta * c + square * c * c) / scale,
                1,
                2 * (1 - c * c) / scale,
                (1 - 2 * zeta * c + c * c) / scale};
    }

    std::complex<double> response(double frequency_hz, double sample_time) const {
        const auto d = std::polar(1.0, -2 * std::numbers::pi * frequency_hz * sample_time); // z^-1
        const auto c = coefficients(sample_time);
        return (c[0] + c[1] * d + c[2] * d * d) / (c[3] + c[4] * d + c[5] * d * d);
    }
};

// Filters one behind another, at rest at the start.
struct LoopFilterStates {
    std::vector<std::array<double, 2>> all;

    double step(const std::vector<LoopFilter>& filters, double value, double sample_time) {
        if (all.size() < filters.size()) all.resize(filters.size());
        for (std::size_t i = 0; i < filters.size(); ++i) {
            const auto c = filters[i].coefficients(sample_time);
            const double out = c[0] * value + all[i][0];
            all[i] = {c[1] * value - c[4] * out + all[i][1], c[2] * value - c[5] * out};
            value = out;
        }
        return value;
    }
};

} // namespace tribode
