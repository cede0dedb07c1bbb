#include "tribode/experiment/friction_map.hpp"
#include "tribode/analysis/signal_fit.hpp"

#include <unsupported/Eigen/FFT>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

namespace tribode {

namespace {

using Complex = std::complex<double>;
using std::numbers::pi;

// The mean of whole periods, or all with both ends faded over a fortieth. straight: less the line between the ends, which takes no
// force where it is a position; then the fading bends nothing that is large.
std::vector<double> segment(std::span<const double> x, std::size_t period, bool straight) {
    if (period > 0) {
        const std::size_t periods = x.size() / period, first = periods > 2 ? 1 : 0;
        const std::size_t begin = x.size() - (periods - first) * period;
        std::vector<double> mean(period);
        for (std::size_t k = begin; k < x.size(); ++k) mean[(k - begin) % period] += x[k];
        for (auto& value : mean) value /= static_cast<double>(periods - first);
        return mean;
    }
    const std::size_t n = x.size(), fade = std::max<std::size_t>(n / 40, 1);
    std::vector<double> y(n);
    for (std::size_t k = 0; k < n; ++k) {
        const double line =
            straight ? x.front() + (x.back() - x.front()) * static_cast<double>(k) / static_cast<double>(n - 1) : 0;
        const std::size_t from_end = std::min(k, n - 1 - k);
        const double share =
            from_end < fade ? 0.5 - 0.5 * std::cos(pi * static_cast<double>(from_end) / static_cast<double>(fade)) : 1;
        y[k] = share * (x[k] - line);
    }
    return y;
}

std::vector<double> edges(std::span<const double> x, std::size_t cells) {
    const auto [low, high] = std::ranges::minmax(x);
    std::vector<double> list;
    for (std::size_t i = 0; i <= cells; ++i) {
        list.push_back(low + (high - low) * static_cast<double>(i) / static_cast<double>(cells));
    }
    return list;
}

std::size_t cell_of(double value, const std::vector<double>& edges) {
    const double width = edges.back() - edges.front();
    const auto cells = static_cast<double>(edges.size() - 1);
    return static_cast<std::size_t>(
        std::clamp(width > 0 ? (value - edges.front()) / width * cells : 0.0, 0.0, cells - 1));
}

// R squared of the means of the cells, less what chance gives.
double explained_share(const ForceResidual& r) {
    constexpr std::size_t cells = 8;
    const auto x = edges(r.position, cells), v = edges(r.velocity, cells);
    std::vector<double> sum(cells * cells), count(cells * cells);
    double square = 0, mean = 0;
    for (std::size_t k = 0; k < r.force.size(); ++k) {
        const std::size_t cell = cell_of(r.velocity[k], v) * cells + cell_of(r.position[k], x);
        sum[cell] += r.force[k];
        ++count[cell];
        square += r.force[k] * r.force[k];
        mean += r.force[k];
    }
    const auto n = static_cast<double>(r.force.size());
    const double all = square - mean * mean / n;
    double within = square, used = 0;
    for (std::size_t i = 0; i < sum.size(); ++i) {
        if (count[i] == 0) continue;
        within -= sum[i] * sum[i] / count[i];
        ++used;
    }
    if (!(all > 0) || n <= used) return 0;
    return std::max(0.0, 1 - within / (n - used) * (n - 1) / all);
}

} // namespace

ForceResidual force_residual(const ForceSignals& all, std::size_t period, const ModalModel& model, double limit_hz) {
    // A length whose transform is quick.
    constexpr std::size_t block = 1024;
    const std::size_t count = all.position.size();
    const std::size_t used = period > 0 || count < 4 * block ? count : count - count % block;
    const ForceSignals signals{all.position.first(used), all.driving.first(used), all.left.first(used),
                               all.sample_time};
    Eigen::FFT<double> fft;
    const auto transformed = [&](std::span<const double> x, bool straight) {
        std::vector<Complex> samples, lines;
        for (const double value : segment(x, period, straight)) samples.emplace_back(value);
        fft.fwd(lines, samples);
        return lines;
    };
    std::vector<Complex> y = transformed(signals.position, true), left = transformed(signals.left, false),
                         driving = transformed(signals.driving, false);
    const std::size_t n = y.size();
    std::vector<Complex> velocity(n), force(n), friction(n);
    force[0] = left[0];
    friction[0] = driving[0];
    for (std::size_t l = 1; 2 * l < n; ++l) {
        const double f = static_cast<double>(l) / static_cast<double>(n) / signals.sample_time;
        if (f > limit_hz) break;
        const Complex motion = y[l] / model.response(f);
        velocity[l] = y[l] * Complex(0, 2 * pi * f);
        force[l] = left[l] - motion;
        friction[l] = driving[l] - motion;
    }
    // Without the faded ends.
    const std::size_t skip = period > 0 ? 0 : n / 32;
    const auto back = [&](std::vector<Complex>& lines) {
        for (std::size_t l = 1; 2 * l < n; ++l) lines[n - l] = std::conj(lines[l]);
        std::vector<Complex> samples;
        fft.inv(samples, lines);
        std::vector<double> real;
        for (std::size_t k = skip; k < n - skip; ++k) real.push_back(samples[k].real());
        return real;
    };
    ForceResidual residual;
    residual.velocity = back(velocity);
    residual.force = back(force);
    residual.friction = back(friction);
    residual.first = skip;
    residual.friction_rms = rms(residual.friction);
    residual.rms = rms(residual.force);
    const std::vector<double> position = period > 0
                                             ? segment(signals.position, period, false)
                                             : std::vector<double>(signals.position.begin(), signals.position.end());
    residual.position.assign(position.begin() + static_cast<std::ptrdiff_t>(skip),
                             position.end() - static_cast<std::ptrdiff_t>(skip));
    residual.explained = explained_share(residual);
    return residual;
}

MeasuredLoop measured_loop(const ForceResidual& residual, const Window& window, double frequency_hz,
                           double sample_time) {
    MeasuredLoop loop{frequency_hz, {}, {}, {}};
    constexpr double least_samples = 100;
    const double period = 1 / (frequency_hz * sample_time);
    const auto count = static_cast<std::size_t>(std::ceil(period * std::ceil(least_samples / period))) + 1;
    const std::size_t end = window.first + window.count;
    if (count > window.count || end - count < residual.first || end > residual.first + residual.force.size())
        return loop;
    const std::size_t begin = end - count - residual.first;
    const auto cut = [&](const std::vector<double>& x) {
        const auto from = x.begin() + static_cast<std::ptrdiff_t>(begin);
        return std::vector<double>(from, from + static_cast<std::ptrdiff_t>(count));
    };
    loop.position = cut(residual.position);
    loop.measured = cut(residual.friction);
    const auto force = cut(residual.force);
    double mean = 0;
    for (const double y : loop.position) mean += y / static_cast<double>(count);
    for (std::size_t k = 0; k < count; ++k) {
        loop.position[k] -= mean;
        loop.modeled.push_back(loop.measured[k] - force[k]);
    }
    return loop;
}

CellMeans cell_means(std::span<const double> x, std::span<const double> y, std::span<const double> values,
                     std::size_t cells) {
    CellMeans means{edges(x, cells), edges(y, cells), std::vector<double>(cells * cells)};
    std::vector<std::size_t> count(cells * cells);
    for (std::size_t k = 0; k < values.size(); ++k) {
        const std::size_t cell = cell_of(y[k], means.y_edges) * cells + cell_of(x[k], means.x_edges);
        means.values[cell] += values[k];
        ++count[cell];
    }
    constexpr std::size_t least = 3;
    for (std::size_t i = 0; i < count.size(); ++i) {
        means.values[i] = count[i] < least ? std::numeric_limits<double>::quiet_NaN()
                                           : means.values[i] / static_cast<double>(count[i]);
    }
    return means;
}

} // namespace tribode
