#include "tribode/analysis/signal_fit.hpp"
#include "tribode/base/constants.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/FFT>

#include <cmath>
#include <complex>
#include <limits>
#include <utility>

namespace tribode {

namespace {

Sinusoid sinusoid_of(const Signal& x, const Signal& target, const Signal& weight, double period) {
    Signal sine(x.size()), cosine(x.size());
    for (std::size_t k = 0; k < x.size(); ++k) {
        const double w = weight.empty() ? 1 : weight[k];
        sine[k] = w * std::sin(two_pi * x[k] / period);
        cosine[k] = w * std::cos(two_pi * x[k] / period);
    }
    const Regression fit = regress({std::move(sine), std::move(cosine)}, target);
    return {period, std::hypot(fit.coefficients[0], fit.coefficients[1]),
            std::atan2(fit.coefficients[1], fit.coefficients[0]), fit.explained};
}

} // namespace

Regression regress(const std::vector<Signal>& columns, const Signal& target) {
    const auto n = static_cast<Eigen::Index>(columns.size());
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
    double square = 0;
    const auto dot = [](const Signal& a, const Signal& b) {
        double sum = 0;
        for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * b[k];
        return sum;
    };
    for (Eigen::Index i = 0; i < n; ++i) {
        for (Eigen::Index j = 0; j <= i; ++j) {
            normal(i, j) = normal(j, i) =
                dot(columns[static_cast<std::size_t>(i)], columns[static_cast<std::size_t>(j)]);
        }
        right[i] = dot(columns[static_cast<std::size_t>(i)], target);
    }
    square = dot(target, target);
    // Columns that a record does not show are left out rather than blown up.
    for (Eigen::Index i = 0; i < n; ++i) normal(i, i) += 1e-9 * normal(i, i) + std::numeric_limits<double>::min();
    const Eigen::VectorXd coefficients = normal.ldlt().solve(right);
    return {{coefficients.begin(), coefficients.end()}, square > 0 ? coefficients.dot(right) / square : 0};
}

double largest(const Signal& x) {
    double most = 0;
    for (const double value : x) most = std::max(most, std::abs(value));
    return most;
}

double rms(const Signal& x) {
    double sum = 0;
    for (const double value : x) sum += value * value;
    return x.empty() ? 0 : std::sqrt(sum / static_cast<double>(x.size()));
}

std::vector<double> geometric(double from, double to, int count) {
    std::vector<double> values;
    for (int i = 0; i < count; ++i)
        values.push_back(from * std::pow(to / from, static_cast<double>(i) / std::max(count - 1, 1)));
    return values;
}

std::vector<Sinusoid> sinusoids(const Signal& x, const Signal& target, const Signal& weight, double shortest,
                                double longest, std::size_t count) {
    if (!(longest > shortest)) return {};
    const auto [low, high] = std::minmax_element(x.begin(), x.end());
    const double span = *high - *low;
    if (!(span > 0)) return {};
    std::vector<double> periods;
    for (const double period : geometric(std::max(shortest, span / 6), longest, 24)) {
        if (period <= longest) periods.push_back(period);
    }
    const double width = shortest / 6;
    const auto bins = static_cast<std::size_t>(std::min(span / width + 1, 4e6));
    if (bins > 8) {
        std::size_t length = 1;
        while (length < 4 * bins) length *= 2;
        std::vector<double> collected(length, 0.0);
        for (std::size_t k = 0; k < x.size(); ++k) {
            const auto bin = std::min(static_cast<std::size_t>((x[k] - *low) / width), length - 1);
            collected[bin] += target[k] * (weight.empty() ? 1 : weight[k]);
        }
        std::vector<std::complex<double>> line;
        Eigen::FFT<double> fft;
        fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
        fft.fwd(line, collected);
        const double total = static_cast<double>(length) * width;
        std::vector<std::pair<double, double>> peaks; // magnitude, period
        for (std::size_t i = 2; i + 1 < line.size(); ++i) {
            const double period = total / static_cast<double>(i);
            if (period < shortest || period > longest) continue;
            const double here = std::abs(line[i]);
            if (here >= std::abs(line[i - 1]) && here > std::abs(line[i + 1])) peaks.push_back({here, period});
        }
        std::sort(peaks.rbegin(), peaks.rend());
        for (std::size_t i = 0; i < std::min<std::size_t>(peaks.size(), 12); ++i) periods.push_back(peaks[i].second);
    }
    const auto strongest_first = [](std::vector<Sinusoid>& list) {
        std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.explained > b.explained; });
    };
    // Of a list in that order: neighbors on one peak, whose width in frequency is 1/span, count once.
    const auto distinct = [span](const std::vector<Sinusoid>& list, double share, std::size_t most) {
        std::vector<Sinusoid> kept;
        for (const auto& one : list) {
            const bool known = std::any_of(kept.begin(), kept.end(), [&](const Sinusoid& other) {
                return std::abs(1 / one.period - 1 / other.period) < share / span;
            });
            if (!known && kept.size() < most) kept.push_back(one);
        }
        return kept;
    };
    std::vector<Sinusoid> found;
    for (const double period : periods) found.push_back(sinusoid_of(x, target, weight, period));
    strongest_first(found);
    // The proposals lie on their peaks, if not on the tops: a few more than asked for are followed there.
    found = distinct(found, 0.25, count + 3);
    for (Sinusoid& best : found) {
        const double peak = best.period * best.period / span;
        for (double step = 0.25 * peak; step > 0.01 * peak; step /= 2) {
            for (const double next : {best.period - step, best.period + step}) {
                if (next < shortest || next > longest) continue;
                const Sinusoid other = sinusoid_of(x, target, weight, next);
                if (other.explained > best.explained) best = other;
            }
        }
    }
    strongest_first(found);
    return distinct(found, 0.5, count);
}

} // namespace tribode
