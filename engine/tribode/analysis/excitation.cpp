#include "tribode/analysis/excitation.hpp"
#include "tribode/analysis/spectrum.hpp"
#include "tribode/base/error.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/FFT>

#include <algorithm>
#include <bit>
#include <cmath>
#include <fmt/format.h>
#include <numbers>
#include <numeric>
#include <optional>

namespace tribode {

namespace {

using std::numbers::pi;

double rms_about(std::span<const double> x, std::size_t first, const FreeSine& sine, double sample_time) {
    double sum = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        const double t = static_cast<double>(first + i) * sample_time;
        const double rest = x[i] - sine.offset - (sine.phasor * turned(sine.frequency_hz * t)).real();
        sum += rest * rest;
    }
    return std::sqrt(sum / static_cast<double>(x.size()));
}

constexpr double min_periods = 3;        // of a window in which a sine is sought
constexpr double segment_periods = 4;    // of a segment that counts
constexpr double max_noise = 0.3;        // rms relative to the amplitude, in a sine that is recognized
constexpr double exact = 1e-3;           // of a sine without noise: what a record rounded to three digits leaves
constexpr std::size_t first_window = 32; // samples

// The sine at the beginning of x, from the shortest window that holds three of its periods.
std::optional<std::pair<FreeSine, std::size_t>> sine_at_beginning(std::span<const double> x, double sample_time) {
    constexpr std::size_t longest = 1 << 16;
    for (std::size_t length = first_window; length / 2 < x.size() && length <= longest; length *= 2) {
        const std::size_t count = std::min(length, x.size());
        const auto window = x.subspan(0, count);
        const double duration = static_cast<double>(count) * sample_time;
        const auto line = strongest_line({window.begin(), window.end()}, sample_time, 0.8 * min_periods / duration,
                                         0.5 / sample_time);
        if (!line) continue;
        // Most lines of other signals hold too little of their power, which one look at them tells.
        double power = 0;
        for (const double value : window) power += value * value / static_cast<double>(count);
        const FreeSine seen = fit_free_sine(window, sample_time, *line, 1);
        if (std::norm(seen.phasor) / 2 < 0.3 * (power - seen.offset * seen.offset)) continue;
        const FreeSine sine = fit_free_sine(window, sample_time, *line);
        const double periods = sine.frequency_hz * duration;
        const bool sampled = sine.frequency_hz > 0 && sine.frequency_hz * sample_time < 0.5;
        if (!sampled || periods < 0.9 * min_periods) continue;
        if (sine.residual_rms < max_noise * std::abs(sine.phasor)) return std::pair{sine, count};
    }
    return std::nullopt;
}

// How far the sine of the first `known` samples goes on; it is fitted again each time the stretch has doubled.
std::size_t follow(std::span<const double> x, FreeSine& sine, std::size_t known, double sample_time) {
    for (;;) {
        const double amplitude = std::abs(sine.phasor);
        const double noise = std::max(sine.residual_rms, exact * amplitude);
        const auto block = static_cast<std::size_t>(std::max(8.0, std::ceil(1 / (sine.frequency_hz * sample_time))));
        const double most = noise * (1 + 3 / std::sqrt(2.0 * static_cast<double>(block)));
        const std::size_t until = std::min(2 * known, x.size());
        std::size_t end = known;
        while (end < until) {
            const std::size_t count = std::min(block, until - end);
            if (rms_about(x.subspan(end, count), end, sine, sample_time) > most) break;
            end += count;
        }
        const bool broken = end < until;
        if (end > known) sine = fit_free_sine(x.subspan(0, end), sample_time, sine.frequency_hz);
        if (broken || end == x.size()) return end;
        known = end;
    }
}

std::vector<SineSegment> sine_segments(std::span<const double> x, double sample_time) {
    double largest = 0;
    for (const double value : x) largest = std::max(largest, std::abs(value));
    std::vector<SineSegment> segments;
    constexpr int max_failures = 30;
    int failures = 0; // in a row
    for (std::size_t at = 0; at < x.size() && failures < max_failures;) {
        if (std::abs(x[at]) <= 1e-9 * largest && at + 1 < x.size() && std::abs(x[at + 1]) <= 1e-9 * largest) {
            ++at;
            continue;
        }
        auto found = sine_at_beginning(x.subspan(at), sample_time);
        // Remains of the sine before would bend the next one: it begins where a window fits much better.
        const auto relative = [](const FreeSine& sine) { return sine.residual_rms / std::abs(sine.phasor); };
        while (found && relative(found->first) > exact) {
            const std::size_t later = at + std::max<std::size_t>(found->second / 8, 4);
            if (later + first_window > x.size()) break;
            const auto next = sine_at_beginning(x.subspan(later), sample_time);
            if (!next || relative(next->first) > 0.5 * relative(found->first)) break;
            found = next;
            at = later;
        }
        if (found) {
            const auto rest = x.subspan(at);
            auto& [sine, known] = *found;
            const std::size_t end = follow(rest, sine, known, sample_time);
            if (sine.frequency_hz * sample_time * static_cast<double>(end) >= segment_periods) {
                const double amplitude = std::abs(sine.phasor);
                segments.push_back({sine.frequency_hz, amplitude, sine.residual_rms / amplitude, at, end});
                at += end;
                failures = 0;
                continue;
            }
        }
        // Shortly behind a segment its remains are passed over, later larger steps will do.
        at += std::min<std::size_t>(8u << std::min(failures, 5), 256);
        ++failures;
    }
    // One that fits far worse than the others is a change from one sine to the next.
    std::vector<double> residuals;
    for (const auto& segment : segments) residuals.push_back(segment.residual);
    if (!residuals.empty()) {
        const auto middle = residuals.begin() + static_cast<std::ptrdiff_t>(residuals.size() / 2);
        std::nth_element(residuals.begin(), middle, residuals.end());
        const double most = std::max(20 * *middle, 0.02);
        std::erase_if(segments, [&](const SineSegment& segment) { return segment.residual > most; });
    }
    return segments;
}

bool is_chirp(const std::vector<SineSegment>& segments, double sample_time) {
    std::size_t neighbors = 0, alike = 0;
    for (std::size_t i = 1; i < segments.size(); ++i) {
        const auto &a = segments[i - 1], &b = segments[i];
        const double pause = static_cast<double>(b.first - a.first - a.count) * sample_time;
        if (pause * b.frequency_hz > 1 || b.residual > 0.02) continue;
        ++neighbors;
        // A chirp of rate c leaves 0.234 c T^2 in a stretch of T that a sine was fitted to.
        const double duration = static_cast<double>(b.count) * sample_time;
        if (std::abs(b.frequency_hz - a.frequency_hz) * duration < 20 * b.residual) ++alike;
    }
    return neighbors >= 2 && 2 * alike > neighbors;
}

bool covers_half(const std::vector<SineSegment>& segments, std::span<const double> x) {
    double largest = 0;
    for (const double value : x) largest = std::max(largest, std::abs(value));
    std::size_t covered = 0, active = 0;
    for (const auto& segment : segments) covered += segment.count;
    for (const double value : x) active += std::abs(value) > 1e-9 * largest;
    return 2 * covered > active;
}

// 1 where x repeats itself exactly after that many samples.
std::vector<double> repetition(std::span<const double> x) {
    const std::size_t n = x.size();
    const double mean = std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(n);
    std::vector<double> padded(std::bit_ceil(2 * n));
    for (std::size_t k = 0; k < n; ++k) padded[k] = x[k] - mean;
    Eigen::FFT<double> fft;
    std::vector<std::complex<double>> lines;
    fft.fwd(lines, padded);
    for (auto& line : lines) line = std::norm(line);
    std::vector<double> products;
    fft.inv(products, lines);
    std::vector<double> energy(n + 1); // of the samples before
    for (std::size_t k = 0; k < n; ++k) energy[k + 1] = energy[k] + padded[k] * padded[k];
    std::vector<double> alike(n);
    for (std::size_t lag = 0; lag < n; ++lag) {
        const double both = energy[n - lag] + energy[n] - energy[lag];
        alike[lag] = both > 0 ? 2 * products[lag] / both : 0;
    }
    return alike;
}

// By how many samples the second period is later than the first, from the phases of its strong lines.
double lateness(std::span<const double> x, std::size_t period) {
    Eigen::FFT<double> fft;
    std::vector<std::complex<double>> a, b;
    fft.fwd(a, std::vector<double>(x.begin(), x.begin() + static_cast<std::ptrdiff_t>(period)));
    fft.fwd(b, std::vector<double>(x.begin() + static_cast<std::ptrdiff_t>(period),
                                   x.begin() + static_cast<std::ptrdiff_t>(2 * period)));
    double slope = 0, weight = 0;
    for (std::size_t l = 1; l < period / 2; ++l) {
        const double omega = 2 * pi * static_cast<double>(l) / static_cast<double>(period);
        const double power = std::norm(a[l]);
        slope -= power * omega * std::arg(b[l] / a[l]);
        weight += power * omega * omega;
    }
    return weight > 0 ? slope / weight : 0;
}

std::size_t period_of(std::span<const double> x, double sample_time, const std::string& where) {
    const std::vector<double> alike = repetition(x);
    const std::size_t n = x.size();
    std::size_t start = 1; // past the first lags, where every smooth signal is like itself
    while (start < n && alike[start] > 0.2) ++start;
    // Two periods at least; only where there are none may the record be too short for them.
    std::size_t last = 0;
    double best = 0;
    for (const std::size_t most : {n / 2 + 1, n * 4 / 5}) {
        last = std::max(most, start);
        best = 0;
        for (std::size_t lag = start; lag < last; ++lag) best = std::max(best, alike[lag]);
        if (best >= 0.9) break;
    }
    if (best < 0.9) return 0;
    const double enough = best - std::max(1e-9, 0.1 * (1 - best));
    std::size_t period = start;
    while (alike[period] < enough) ++period;
    while (period + 1 < last && alike[period + 1] > alike[period]) ++period;
    if (2 * period > n) {
        if (best < 0.999) return 0;
        throw InputError(
            fmt::format("{}: the excitation repeats itself after {:.6g} s and the record is {:.6g} s long; a "
                        "multisine needs whole periods, two at least",
                        where, static_cast<double>(period) * sample_time, static_cast<double>(n) * sample_time));
    }
    const double late = lateness(x, period);
    if (alike[period] < 1 - 1e-6 && std::abs(late) > 0.02) {
        throw InputError(
            fmt::format("{}: the excitation repeats itself every {:.3f} samples; the period of a multisine "
                        "must be a whole number of samples",
                        where, static_cast<double>(period) + late));
    }
    return period;
}

} // namespace

FreeSine fit_free_sine(std::span<const double> samples, double sample_time, double near_hz, int iterations) {
    const auto n = static_cast<double>(samples.size());
    const double half = 0.5 * (n - 1) * sample_time; // time counts from the middle, in halves of the window
    FreeSine sine;
    sine.frequency_hz = near_hz;
    std::complex<double> phasor = 0; // at the middle
    for (int iteration = 0; iteration < iterations; ++iteration) {
        // Unknowns: offset, real and imaginary part, and the phase that a change of frequency makes at the end.
        Eigen::Matrix4d gram = Eigen::Matrix4d::Zero();
        Eigen::Vector4d right = Eigen::Vector4d::Zero();
        const bool free = iteration > 0;
        double sum = 0;
        for (std::size_t i = 0; i < samples.size(); ++i) {
            const double t = static_cast<double>(i) * sample_time - half;
            const std::complex<double> turn = turned(sine.frequency_hz * t);
            const Eigen::Vector4d row(1, turn.real(), -turn.imag(),
                                      free ? (std::complex(0.0, 1.0) * phasor * turn).real() * (t / half) : 0.0);
            const double rest = samples[i] - (free ? sine.offset + (phasor * turn).real() : 0.0);
            gram.selfadjointView<Eigen::Lower>().rankUpdate(row);
            right += row * rest;
            sum += rest * rest;
        }
        sine.residual_rms = std::sqrt(sum / n);
        if (!free) gram(3, 3) = 1;
        const Eigen::Vector4d step = gram.selfadjointView<Eigen::Lower>().ldlt().solve(right);
        if (!step.allFinite()) break;
        sine.offset = free ? sine.offset + step[0] : step[0];
        phasor = (free ? phasor : 0.0) + std::complex(step[1], step[2]);
        if (!free) continue;
        // A step of more than a quarter of a resolution is outside of what is linear.
        const double change = std::clamp(step[3], -pi / 4, pi / 4) / (2 * pi * half);
        sine.frequency_hz += change;
        if (std::abs(change) < 1e-15 * std::abs(sine.frequency_hz)) break;
    }
    // One that was meant to be a round number is told as that.
    const double rounded = std::stod(fmt::format("{:.12g}", sine.frequency_hz));
    if (std::abs(rounded - sine.frequency_hz) < 1e-13 * rounded) sine.frequency_hz = rounded;
    sine.phasor = phasor * turned(-sine.frequency_hz * half);
    return sine;
}

Excitation recognize_excitation(std::span<const double> signal, double sample_time, const std::string& where) {
    if (signal.empty() || std::ranges::all_of(signal, [&](double value) { return value == signal.front(); })) {
        throw InputError(where + ": the excitation is constant, a frequency response needs one that changes");
    }
    Excitation excitation;
    excitation.segments = sine_segments(signal, sample_time);
    if (covers_half(excitation.segments, signal) && !is_chirp(excitation.segments, sample_time)) {
        excitation.kind = ExcitationKind::stepped_sine;
        return excitation;
    }
    excitation.segments.clear();
    excitation.period = period_of(signal, sample_time, where);
    if (excitation.period > 0) excitation.kind = ExcitationKind::multisine;
    return excitation;
}

} // namespace tribode
