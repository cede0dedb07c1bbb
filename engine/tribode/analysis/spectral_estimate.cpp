#include "tribode/analysis/spectral_estimate.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/normal.hpp"
#include "tribode/base/text.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>
#include <span>
#include <unsupported/Eigen/FFT>

namespace tribode {

namespace {

using Complex = std::complex<double>;

// Sums of cosines of the multiples of one turn, the periodic form.
std::vector<double> window_of(const std::string& name, std::size_t length) {
    std::vector<double> terms{1};
    if (name == "hann") terms = {0.5, -0.5};
    if (name == "hamming") terms = {0.54, -0.46};
    if (name == "blackman_harris") terms = {0.35875, -0.48829, 0.14128, -0.01168};
    if (name == "flat_top") terms = {0.21557895, -0.41663158, 0.277263158, -0.083578947, 0.006947368};
    std::vector<double> window(length);
    for (std::size_t k = 0; k < length; ++k) {
        const double turn = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(length);
        for (std::size_t i = 0; i < terms.size(); ++i) window[k] += terms[i] * std::cos(static_cast<double>(i) * turn);
    }
    return window;
}

// Of chi squared with `degrees` degrees of freedom, over them [Wilson 1931]: within 1 % from 8 degrees on.
double chi_squared_ratio(double probability, double degrees) {
    const double share = 2 / (9 * degrees);
    return std::pow(std::max(0.0, 1 - share + normal_quantile(probability) * std::sqrt(share)), 3);
}

// Quantile of the multiple coherence of an output with as many inputs that have nothing to do with it: of a beta distribution with
// `inputs` and averages - inputs [Bendat 2010, chapter 9]. With a whole number of inputs the probability to exceed x is a finite sum.
double chance_coherence(double probability, std::size_t inputs, double averages) {
    const double rest = averages - static_cast<double>(inputs);
    const auto exceeded = [&](double x) {
        double sum = 0, term = 1;
        for (std::size_t j = 0; j < inputs; ++j) {
            sum += term;
            term *= x * (rest + static_cast<double>(j)) / static_cast<double>(j + 1);
        }
        return std::pow(1 - x, rest) * sum;
    };
    double low = 0, high = 1;
    for (int halving = 0; halving < 60; ++halving) {
        const double middle = 0.5 * (low + high);
        (exceeded(middle) > 1 - probability ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

// Of one window, less its mean or the straight line nearest to it.
std::vector<Complex> transform(std::span<const double> x, const std::vector<double>& window, const std::string& detrend,
                               Eigen::FFT<double>& fft) {
    const double n = static_cast<double>(window.size()), middle = (n - 1) / 2;
    double mean = 0, slope = 0;
    if (detrend != "none") {
        for (const double value : x) mean += value / n;
    }
    if (detrend == "line") {
        for (std::size_t k = 0; k < x.size(); ++k) slope += x[k] * (static_cast<double>(k) - middle);
        slope /= n * (n * n - 1) / 12;
    }
    std::vector<double> weighted(window.size());
    for (std::size_t k = 0; k < x.size(); ++k) {
        weighted[k] = window[k] * (x[k] - mean - slope * (static_cast<double>(k) - middle));
    }
    std::vector<Complex> lines;
    fft.fwd(lines, weighted);
    return lines;
}

} // namespace

double averages_of(const std::vector<double>& window, std::size_t step, std::size_t windows) {
    double square = 0;
    for (const double w : window) square += w * w;
    double sum = 1;
    for (std::size_t m = 1; m < windows && m * step < window.size(); ++m) {
        double common = 0;
        for (std::size_t k = m * step; k < window.size(); ++k) common += window[k] * window[k - m * step];
        sum += 2 * (1 - static_cast<double>(m) / static_cast<double>(windows)) * std::pow(common / square, 2);
    }
    return static_cast<double>(windows) / sum;
}

SpectralEstimate spectral_estimate(const std::vector<std::vector<double>>& inputs, const std::vector<double>& output,
                                   const SpectrumOptions& options) {
    const std::size_t samples = output.size(), count = inputs.size();
    for (std::size_t i = 0; i < count; ++i) {
        if (inputs[i].size() == samples) continue;
        throw InputError(fmt::format("a spectrum: input {} has {} samples, must have {}, as many as the output", i + 1,
                                     inputs[i].size(), samples));
    }
    if (options.overlap > 0.95) {
        throw InputError(fmt::format("a spectrum: overlap = {}, must be 0.95 at most", to_text(options.overlap)));
    }
    std::size_t length = static_cast<std::size_t>(options.window_samples);
    if (length == 0) length = std::min<std::size_t>(std::bit_floor(std::max<std::size_t>(samples / 8, 1)), 8192);
    if (length < 8 || 2 * length > samples) {
        throw InputError(fmt::format(
            "a spectrum of {} samples with windows of {}: windows must have 8 or more, and the record two of them",
            samples, length));
    }
    const auto window = window_of(options.window, length);
    const auto step = std::max<std::size_t>(
        1, length - static_cast<std::size_t>(std::floor(options.overlap * static_cast<double>(length))));
    SpectralEstimate estimate;
    estimate.windows = (samples - length) / step + 1;
    estimate.averages = averages_of(window, step, estimate.windows);
    if (estimate.averages <= static_cast<double>(count) + 1e-9) {
        throw InputError(fmt::format("a spectrum with {} inputs and {} windows: more windows than inputs are needed",
                                     count, estimate.windows));
    }

    // Sums of products over the windows: of the inputs, of output and inputs, of the output.
    const auto size = static_cast<Eigen::Index>(count);
    const std::size_t lines = (length - 1) / 2; // without zero and half the rate
    std::vector<Eigen::MatrixXcd> xx(lines, Eigen::MatrixXcd::Zero(size, size));
    std::vector<Eigen::VectorXcd> xy(lines, Eigen::VectorXcd::Zero(size));
    std::vector<double> yy(lines);
    Eigen::FFT<double> fft;
    std::vector<std::vector<Complex>> x(count);
    for (std::size_t w = 0; w < estimate.windows; ++w) {
        const auto cut = [&](const std::vector<double>& signal) {
            return transform(std::span(signal).subspan(w * step, length), window, options.detrend, fft);
        };
        const auto y = cut(output);
        for (std::size_t i = 0; i < count; ++i) x[i] = cut(inputs[i]);
        for (std::size_t l = 0; l < lines; ++l) {
            yy[l] += std::norm(y[l + 1]);
            for (std::size_t i = 0; i < count; ++i) {
                const auto row = static_cast<Eigen::Index>(i);
                xy[l](row) += y[l + 1] * std::conj(x[i][l + 1]);
                for (std::size_t j = 0; j < count; ++j) {
                    xx[l](row, static_cast<Eigen::Index>(j)) += std::conj(x[i][l + 1]) * x[j][l + 1];
                }
            }
        }
    }

    double sum = 0, square = 0;
    for (const double w : window) {
        sum += w;
        square += w * w;
    }
    const double rate = 1 / options.sample_time;
    const double density = 2 / (rate * square * static_cast<double>(estimate.windows));
    estimate.bandwidth = rate * square / (sum * sum);
    const double degrees = 2 * estimate.averages;
    estimate.power_low = 1 / chi_squared_ratio(0.975, degrees);
    estimate.power_high = 1 / std::max(chi_squared_ratio(0.025, degrees), std::numeric_limits<double>::min());
    const double more = estimate.averages - static_cast<double>(count);
    estimate.coherence_threshold =
        count > 0 ? chance_coherence(0.95, count, estimate.averages) : std::numeric_limits<double>::quiet_NaN();
    estimate.inputs.resize(count);
    for (std::size_t l = 0; l < lines; ++l) {
        const double frequency = static_cast<double>(l + 1) * rate / static_cast<double>(length);
        estimate.frequency_hz.push_back(frequency);
        estimate.power.push_back(density * yy[l]);
        if (count == 0) continue;
        // In units of each input's own size, so that the test for dependence sees shapes only.
        Eigen::VectorXd scale = xx[l].diagonal().real().cwiseSqrt();
        for (Eigen::Index i = 0; i < size; ++i) {
            if (scale(i) > 0) continue;
            throw InputError(fmt::format("a spectrum: input {} has nothing at {} Hz, so there is no response", i + 1,
                                         to_text(frequency)));
        }
        const Eigen::MatrixXcd shape = scale.cwiseInverse().asDiagonal() * xx[l] * scale.cwiseInverse().asDiagonal();
        const Eigen::LDLT<Eigen::MatrixXcd> solver(shape);
        if (solver.info() != Eigen::Success || solver.vectorD().real().minCoeff() < 1e-12) {
            throw InputError(fmt::format(
                "a spectrum: the inputs are linearly dependent at {} Hz, so their shares cannot be told apart",
                to_text(frequency)));
        }
        const Eigen::MatrixXcd inverse = solver.solve(Eigen::MatrixXcd::Identity(size, size));
        const Eigen::VectorXcd scaled = scale.cwiseInverse().asDiagonal() * xy[l];
        const Eigen::VectorXcd weights = inverse * scaled;
        // scaled^H inverse scaled is what the inputs explain.
        const double explained = scaled.dot(weights).real();
        const double coherence = yy[l] > 0 ? std::clamp(explained / yy[l], 0.0, 1.0) : 0;
        const double noise = yy[l] * (1 - coherence) * estimate.averages / more;
        estimate.coherence.push_back(coherence);
        estimate.noise.push_back(density * noise);
        for (std::size_t i = 0; i < count; ++i) {
            const auto row = static_cast<Eigen::Index>(i);
            InputSpectra& input = estimate.inputs[i];
            const double power = scale(row) * scale(row);
            const Complex h1 = weights(row) / scale(row);
            input.power.push_back(density * power);
            input.cross.push_back(density * xy[l](row));
            input.coherence.push_back(yy[l] > 0 ? std::min(1.0, std::norm(xy[l](row)) / (power * yy[l])) : 0);
            input.h1.push_back(h1);
            const double variance =
                noise * inverse(row, row).real() / (power * estimate.averages * std::max(std::norm(h1), 1e-300));
            input.standard_deviation.push_back(std::sqrt(variance / 2));
            if (count > 1) continue;
            const Complex h2 = yy[l] / std::conj(xy[l](row));
            input.h2.push_back(h2);
            input.hv.push_back(std::sqrt(std::abs(h2) / std::abs(h1)) * h1);
        }
    }
    return estimate;
}

} // namespace tribode
