#include "tribode/analysis/multisine.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"

#include <unsupported/Eigen/FFT>

#include <algorithm>
#include <cmath>
#include <complex>
#include <fmt/format.h>
#include <limits>
#include <numbers>

namespace tribode {

namespace {

enum Stream : std::uint64_t { left_out, phases };

std::vector<std::size_t> lines_of(const MultisineOptions& o, std::size_t period) {
    const double step = 1 / (static_cast<double>(period) * o.sample_time);
    std::vector<std::size_t> lines;
    for (auto l = static_cast<std::size_t>(std::max(1.0, std::ceil(o.f_min_hz / step - 1e-9)));
         static_cast<double>(l) * step <= o.f_max_hz * (1 + 1e-12); ++l) {
        if (!o.odd || l % 2 == 1) lines.push_back(l);
    }
    if (o.detection < 2) return lines;
    std::vector<std::size_t> kept;
    const auto group = static_cast<std::size_t>(o.detection);
    for (std::size_t i = 0; i < lines.size(); ++i) {
        const auto chosen = static_cast<std::size_t>(uniform(o.seed, left_out, i / group) * static_cast<double>(group));
        // First and last line stay: between them the response is known.
        if (i % group != chosen || i == 0 || i + 1 == lines.size()) kept.push_back(lines[i]);
    }
    return kept;
}

} // namespace

Multisine make_multisine(const MultisineOptions& options) {
    const double samples = std::round(options.period / options.sample_time);
    if (!(samples * static_cast<double>(options.periods) <= 1e8)) {
        throw InputError("a multisine of more than 1e8 samples was asked for");
    }
    if (!(options.f_max_hz * options.sample_time <= 0.45)) {
        throw InputError(fmt::format("f_max_hz = {:.6g} Hz, must be {:.6g} Hz at most, 0.45 of the sampling rate",
                                     options.f_max_hz, 0.45 / options.sample_time));
    }
    Multisine made;
    made.period = static_cast<std::size_t>(samples);
    const auto lines = lines_of(options, made.period);
    if (lines.size() < 2) {
        throw InputError(fmt::format("between {:.6g} and {:.6g} Hz there are {} lines, must be two at least: a longer "
                                     "period_s has more",
                                     options.f_min_hz, options.f_max_hz, lines.size()));
    }
    Eigen::FFT<double> fft;
    std::vector<double> best;
    double least = std::numeric_limits<double>::infinity();
    for (std::uint64_t draw = 0; draw < 8; ++draw) {
        std::vector<std::complex<double>> spectrum(made.period);
        for (const std::size_t l : lines) {
            const double turn = uniform(derived_seed(options.seed, draw), phases, l);
            spectrum[l] = std::polar(1.0, 2 * std::numbers::pi * turn);
            spectrum[made.period - l] = std::conj(spectrum[l]);
        }
        std::vector<std::complex<double>> wave;
        fft.inv(wave, spectrum);
        std::vector<double> values;
        double largest = 0, square = 0;
        for (const auto& value : wave) {
            values.push_back(value.real());
            largest = std::max(largest, std::abs(value.real()));
            square += value.real() * value.real();
        }
        const double crest = largest / std::sqrt(square / samples);
        if (crest >= least) continue;
        least = crest;
        for (double& value : values) value *= options.amplitude / largest;
        best = std::move(values);
    }
    made.crest_factor = least;
    for (long p = 0; p < options.periods; ++p) made.values.insert(made.values.end(), best.begin(), best.end());
    for (const std::size_t l : lines) {
        made.frequency_hz.push_back(static_cast<double>(l) / (samples * options.sample_time));
    }
    return made;
}

} // namespace tribode
