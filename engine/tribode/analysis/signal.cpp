#include "tribode/analysis/signal.hpp"
#include "tribode/base/error.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace tribode {

namespace {

// One pair of poles of a low-pass filter of gain one, as a difference equation:
// y = b (x + 2 x1 + x2) - a1 y1 - a2 y2.
struct Section {
    double b, a1, a2;

    // s^2 + damping s + square over the rate s = (1 - 1/z)/(1 + 1/z), the bilinear transform.
    Section(double damping, double square) {
        const double scale = 1 + damping + square;
        b = square / scale;
        a1 = 2 * (square - 1) / scale;
        a2 = (1 - damping + square) / scale;
    }

    // In place, from where the filter rests at the first value.
    void run(std::vector<double>& values) const {
        double x1 = values.front(), x2 = x1, y1 = x1, y2 = x1;
        for (double& value : values) {
            const double y = b * (value + 2 * x1 + x2) - a1 * y1 - a2 * y2;
            x2 = x1;
            x1 = value;
            y2 = y1;
            y1 = y;
            value = y;
        }
    }
};

// Of a pair of poles on circle or ellipse, from the imaginary axis.
double pole_angle(int pair, int order) { return std::numbers::pi * (2 * pair + 1) / (2 * order); }

std::vector<double> forwards_and_backwards(std::span<const double> values, const std::vector<Section>& sections) {
    const std::size_t n = values.size(), margin = 6 * sections.size();
    if (n <= margin) {
        throw InputError(fmt::format("a low-pass filter of order {} needs more than {} values, there are {}",
                                     2 * sections.size(), margin, n));
    }
    std::vector<double> longer;
    longer.reserve(n + 2 * margin);
    for (std::size_t k = margin; k > 0; --k) longer.push_back(2 * values.front() - values[k]);
    longer.insert(longer.end(), values.begin(), values.end());
    for (std::size_t k = 1; k <= margin; ++k) longer.push_back(2 * values.back() - values[n - 1 - k]);
    for (int direction = 0; direction < 2; ++direction) {
        for (const auto& section : sections) section.run(longer);
        std::reverse(longer.begin(), longer.end());
    }
    const auto first = longer.begin() + static_cast<std::ptrdiff_t>(margin);
    return {first, first + static_cast<std::ptrdiff_t>(n)};
}

} // namespace

std::vector<double> zero_phase_low_pass(std::span<const double> values, double sample_time, double corner_hz,
                                        int order) {
    if (order < 2 || order > 20 || order % 2 != 0) {
        throw InputError(fmt::format("the order of a low-pass filter = {}, must be even and from 2 to 20", order));
    }
    if (!(corner_hz > 0 && corner_hz * sample_time < 0.5)) {
        throw InputError(fmt::format("the corner of a low-pass filter = {} Hz, must be below {} Hz, half the sample "
                                     "rate",
                                     corner_hz, 0.5 / sample_time));
    }
    const double w = std::tan(std::numbers::pi * corner_hz * sample_time);
    std::vector<Section> sections;
    for (int k = 0; k < order / 2; ++k) sections.emplace_back(2 * std::sin(pole_angle(k, order)) * w, w * w);
    return forwards_and_backwards(values, sections);
}

std::vector<double> decimated(std::span<const double> values, int factor) {
    if (factor < 2) throw InputError(fmt::format("the factor of a decimation = {}, must be 2 or more", factor));
    constexpr int order = 8;
    const double dip = std::pow(10, -0.05 / 20); // the gain at zero frequency: the ripple ends low there
    const double mu = std::asinh(1 / std::sqrt(1 / (dip * dip) - 1)) / order;
    const double w = std::tan(std::numbers::pi * 0.4 / factor);
    std::vector<Section> sections;
    for (int k = 0; k < order / 2; ++k) {
        const double real = w * std::sinh(mu) * std::sin(pole_angle(k, order));
        const double imaginary = w * std::cosh(mu) * std::cos(pole_angle(k, order));
        sections.emplace_back(2 * real, real * real + imaginary * imaginary);
    }
    const auto smooth = forwards_and_backwards(values, sections);
    const auto step = static_cast<std::size_t>(factor);
    std::vector<double> kept;
    for (std::size_t k = (smooth.size() - 1) % step; k < smooth.size(); k += step)
        kept.push_back(dip * dip * smooth[k]);
    return kept;
}

std::vector<double> central_differences(std::span<const double> values, double sample_time) {
    const std::size_t n = values.size();
    if (n < 2) throw InputError("differences need two values or more");
    std::vector<double> rates(n);
    for (std::size_t k = 0; k < n; ++k) {
        const std::size_t before = k > 0 ? k - 1 : 0, after = std::min(k + 1, n - 1);
        rates[k] = (values[after] - values[before]) / (static_cast<double>(after - before) * sample_time);
    }
    return rates;
}

std::size_t clipped_samples(std::span<const double> x, double step) {
    if (x.empty()) return 0;
    const auto [low, high] = std::ranges::minmax(x);
    std::size_t stands = 0, samples = 0;
    for (std::size_t first = 0, k = 1; k <= x.size(); ++k) {
        if (k < x.size() && x[k] == x[first]) continue;
        const std::size_t count = k - first;
        if (count >= 4 && first >= 3 && (x[first] == low || x[first] == high)) {
            const double slope = x[first - 1] - x[first - 2];
            const double bend = slope - (x[first - 2] - x[first - 3]);
            const double ratio = std::abs(slope / bend);
            const bool outward = slope * (x[first] == high ? 1 : -1) > 6 * step;
            if (outward && ratio > 1.5 && ratio < 1e4) {
                ++stands;
                samples += count;
            }
        }
        first = k;
    }
    return stands < 3 ? 0 : samples;
}

LinearFit linear_fit(const std::vector<std::vector<double>>& columns, std::span<const double> values) {
    const auto rows = static_cast<Eigen::Index>(values.size()), count = static_cast<Eigen::Index>(columns.size());
    if (count == 0 || rows <= count) {
        throw InputError(
            fmt::format("a linear fit of {} columns needs at least one and more values than columns, there "
                        "are {}",
                        count, rows));
    }
    Eigen::MatrixXd matrix(rows, count);
    Eigen::VectorXd scale(count);
    for (Eigen::Index j = 0; j < count; ++j) {
        const auto& column = columns[static_cast<std::size_t>(j)];
        if (column.size() != values.size()) {
            throw InputError(
                fmt::format("column {} of a linear fit has {} values, must have {}", j + 1, column.size(), rows));
        }
        matrix.col(j) = Eigen::Map<const Eigen::VectorXd>(column.data(), rows);
        scale[j] = matrix.col(j).norm();
        if (scale[j] > 0) matrix.col(j) /= scale[j];
    }
    const Eigen::Map<const Eigen::VectorXd> wanted(values.data(), rows);
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(rows, count);
    qr.setThreshold(1e-12); // of columns of length one: above what rounding leaves of a column that is a sum of others
    qr.compute(matrix);
    if (qr.rank() < count) throw InputError("the columns of a linear fit depend on one another");
    const Eigen::VectorXd solution = qr.solve(wanted);
    const Eigen::VectorXd residual = wanted - matrix * solution;
    const Eigen::MatrixXd covariance =
        (matrix.transpose() * matrix).inverse() * residual.squaredNorm() / static_cast<double>(rows - count);
    LinearFit fit;
    for (Eigen::Index j = 0; j < count; ++j) {
        fit.coefficients.push_back(solution[j] / scale[j]);
        fit.standard_errors.push_back(std::sqrt(covariance(j, j)) / scale[j]);
    }
    fit.residual.assign(residual.begin(), residual.end());
    fit.relative_error = wanted.norm() > 0 ? residual.norm() / wanted.norm() : 0;
    return fit;
}

} // namespace tribode
