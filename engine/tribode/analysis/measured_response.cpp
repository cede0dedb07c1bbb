#include "tribode/analysis/measured_response.hpp"
#include "tribode/analysis/spectral_estimate.hpp"
#include "tribode/analysis/spectrum.hpp"
#include "tribode/base/error.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/FFT>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <numbers>
#include <optional>

namespace tribode {

namespace {

using std::numbers::pi;
using Complex = std::complex<double>;
using Spectrum = std::vector<Complex>;

constexpr double max_variance = 0.1; // of a value: above, gain and phase are known to 2 dB and 13 deg only

const char* const too_uncertain = "noise, distortion or a transient are too large: a standard deviation above 2 dB";

// Phasor of a sum over the samples. Time counts from the first one: a transient that begins there is smooth over frequency, and
// with any other origin it would turn from line to line.
Complex phasor(std::span<const double> x, double cycles_per_sample) {
    const Complex step = turned(-cycles_per_sample);
    Complex sum = 0, turn = 1;
    for (std::size_t i = 0; i < x.size(); ++i) {
        turn = i % 64 == 0 ? turned(-cycles_per_sample * static_cast<double>(i)) : turn * step;
        sum += x[i] * turn;
    }
    return sum * (2.0 / static_cast<double>(x.size()));
}

// What offset and harmonics leave.
std::vector<double> residual(std::span<const double> x, const SineFit& fit, double cycles_per_sample,
                             std::size_t first) {
    std::vector<double> rest(x.begin(), x.end());
    const Complex step = turned(cycles_per_sample);
    Complex turn = 1;
    for (std::size_t i = 0; i < x.size(); ++i) {
        turn = i % 64 == 0 ? turned(cycles_per_sample * static_cast<double>(first + i)) : turn * step;
        Complex power = turn;
        rest[i] -= fit.offset;
        for (const Complex harmonic : fit.harmonics) {
            rest[i] -= (harmonic * power).real();
            power *= turn;
        }
    }
    return rest;
}

// Transient and noise of a ratio, relative to it.
struct Precision {
    Complex transient = 0;                    // of a parabola
    double transient_variance = 0;            // of that
    double variance = MeasuredPoint::unknown; // of the noise in the ratio
    double nearest = MeasuredPoint::unknown;  // the same from the two lines on each side alone
    double bias = 0;                          // left where the transient is taken out
    bool is_rounded = false;                  // most of the rounding repeats itself with the sine
};

// What a transient of known form has at the sine, and at the lines next to it.
struct KnownTransient {
    Complex at_sine;
    Spectrum lines;
};

// Z at the lines next to a sine.
struct NearbyLines {
    std::vector<int> distance; // [lines]
    Spectrum z;
    Spectrum noise;                         // how much noise is in each, relative to the sine; empty: as much
    std::vector<KnownTransient> transients; // of known poles nearby
};

// Z over the lines next to f, by their distance d from it: a polynomial of `terms` terms and known transients, or the polynomial
// divided by 1 + a d. A transient of a lightly damped mode next to f is such a pole, and no polynomial [McKelvey 2012]. a is found
// by linear least squares on Z (1 + a d), with the denominator of the iteration before as weight.
struct LocalFit {
    Complex at_sine = 0;
    double residual = 0; // variance, per line
    double factor = 0;   // variance of at_sine relative to it
    double freedom = 0;  // real degrees of freedom of the residual
    double nearest = 0;  // as residual, of the two lines on each side

    LocalFit(const NearbyLines& nearby, Eigen::Index terms, bool pole) {
        const auto& [distance, z, noise, known] = nearby;
        const auto count = static_cast<Eigen::Index>(z.size()), transients = static_cast<Eigen::Index>(known.size());
        const Eigen::Index unknowns = terms + transients + (pole ? 1 : 0);
        Eigen::VectorXcd here = Eigen::VectorXcd::Zero(unknowns); // the columns at the sine
        here[0] = 1;
        for (Eigen::Index j = 0; j < transients; ++j) here[terms + j] = known[static_cast<std::size_t>(j)].at_sine;
        const double reach = std::max(std::abs(distance.front()), std::abs(distance.back()));
        Eigen::MatrixXcd columns(count, unknowns), inverse;
        Eigen::VectorXcd values(count), solution;
        Complex a = 0;
        for (int iteration = 0; iteration < (pole ? 6 : 1); ++iteration) {
            for (Eigen::Index i = 0; i < count; ++i) {
                const auto place = static_cast<std::size_t>(i);
                const double d = distance[place] / reach;
                const Complex weight = 1.0 / ((1.0 + a * d) * (noise.empty() ? 1.0 : noise[place]));
                for (Eigen::Index j = 0; j < terms; ++j) columns(i, j) = weight * std::pow(d, static_cast<double>(j));
                for (Eigen::Index j = 0; j < transients; ++j) {
                    columns(i, terms + j) = weight * known[static_cast<std::size_t>(j)].lines[place];
                }
                if (pole) columns(i, unknowns - 1) = -weight * d * z[place];
                values[i] = weight * z[place];
            }
            const Eigen::VectorXd scale = columns.colwise().norm().cwiseMax(1e-300);
            const Eigen::MatrixXcd scaled = columns * scale.cwiseInverse().asDiagonal();
            inverse = (scaled.adjoint() * scaled).inverse();
            solution = scale.cwiseInverse().asDiagonal() * (inverse * (scaled.adjoint() * values));
            const Eigen::VectorXcd scaled_here = here.cwiseQuotient(scale.cast<Complex>()).conjugate();
            factor = scaled_here.dot(inverse * scaled_here).real();
            if (pole) a = solution[unknowns - 1];
        }
        at_sine = (here.transpose() * solution).value();
        const Eigen::VectorXcd rest = values - columns * solution;
        residual = rest.squaredNorm() / static_cast<double>(count - unknowns);
        double lines = 0;
        for (Eigen::Index i = 0; i < count; ++i) {
            if (std::abs(distance[static_cast<std::size_t>(i)]) > 2) continue;
            nearest += std::norm(rest[i]);
            ++lines;
        }
        nearest *= static_cast<double>(count) / static_cast<double>(count - unknowns) / lines;
        freedom = 2 * static_cast<double>(count - unknowns);
        if (!std::isfinite(std::abs(at_sine)) || !std::isfinite(factor)) {
            residual = std::numeric_limits<double>::infinity();
        }
    }
};

Precision precision_of(const NearbyLines& nearby) {
    Precision found;
    const std::size_t lines = nearby.z.size();
    if (lines < 2) return found;
    const Eigen::Index terms = lines >= 6 ? 3 : 1;
    LocalFit best(nearby, terms, false);
    found.bias = std::abs(best.at_sine - (terms == 3 ? LocalFit(nearby, 1, false).at_sine : 0.0));
    if (lines >= 10 && nearby.transients.empty()) {
        const LocalFit with_pole(nearby, terms, true);
        constexpr double clearly = 3; // noise alone lowers the residual by a few percent
        if (clearly * with_pole.residual < best.residual) {
            best = with_pole;
            found.bias = std::abs(best.at_sine - LocalFit(nearby, terms - 1, true).at_sine);
        }
    }
    found.transient = best.at_sine;
    // Few lines tell the variance itself only roughly: Student's distribution is wider by this.
    const double student = best.freedom > 2 ? best.freedom / (best.freedom - 2) : 3;
    found.variance = best.residual * student;
    found.nearest = best.nearest * student;
    found.transient_variance = found.variance * best.factor;
    return found;
}

// A window of a segment, with what does not depend on the input.
class SineWindow {
  public:
    SineWindow(const MeasuredSignals& signals, const Window& window, double frequency, long periods, int harmonics)
        : window_(window),
          cycles_(frequency * signals.sample_time),
          basis_(window.count, signals.sample_time, frequency, static_cast<double>(window.first) * signals.sample_time,
                 harmonics),
          sample_time_(signals.sample_time) {
        const auto n = static_cast<double>(window.count);
        constexpr int most = 10; // lines on each side
        for (int d = -most; d <= most; ++d) {
            const double line = cycles_ * n + d;
            if (d == 0 || std::abs(d) >= periods || line < 0.5 || line > n / 2 - 0.5) continue;
            distance_.push_back(d);
        }
        output_fit_ = fit(signals.output);
        const std::vector<double> rest = rest_of(signals.output, output_fit_);
        output_lines_ = lines(rest);
        sample_noise_ = changes_by_block(rest, signals.sample_time, frequency, periods, harmonics);
        if (!signals.thrust.empty()) {
            const Complex thrust = fit(signals.thrust).fundamental();
            if (std::norm(thrust) > 0) loop_ = fit(signals.excitation).fundamental() / thrust;
        }
        step_squared_ = signals.resolution * signals.resolution;
        if (signals.resolution > 0) {
            rounding_ = rounding(signals.resolution);
            rounding_ *= std::norm(loop_);
            pattern_changes_ = pattern_changes(signals.output, rest, signals.resolution);
        }
    }

    SineFit fit(std::span<const double> signal) const { return basis_.fit(cut(signal)); }
    const SineFit& output_fit() const { return output_fit_; }
    const Window& window() const { return window_; }

    // known: the response to this input, null where it is not.
    Precision precision(std::span<const double> input, const SineFit& input_fit, const KnownResponse* known) const {
        const Spectrum input_lines = lines(rest_of(input, input_fit));
        NearbyLines nearby{distance_, Spectrum(distance_.size()), {}, {}};
        const auto n = static_cast<double>(window_.count);
        const Complex here = known ? known->response(cycles_ / sample_time_) : 1;
        for (std::size_t i = 0; i < distance_.size(); ++i) {
            Complex share = 1; // of the response there in that at the sine
            if (known) {
                share = known->response((cycles_ + distance_[i] / n) / sample_time_) / here;
                // The noise of the output is in Y - P U by 1 + P C, which is E/U at the sine; C changes little over the lines.
                nearby.noise.push_back((1.0 + (loop_ - 1.0) * share) / loop_);
            }
            nearby.z[i] =
                output_lines_[i] / output_fit_.fundamental() - share * input_lines[i] / input_fit.fundamental();
        }
        if (known) nearby.transients = transients_of(known->poles);
        Precision found = precision_of(nearby);
        if (rounding_ > 0) {
            // Noise besides that of rounding, in steps squared. Both changes from sample to sample and the lines next to f must show
            // it: the pattern of the rounding may have lines there of its own, and its power differs from 1/12, the more the
            // fewer phases it has; and its errors may alternate. A transient is such noise as long as it lasts, so the pattern is
            // judged block by block.
            const double power = std::norm(output_fit_.fundamental());
            const double near = found.variance * power * static_cast<double>(window_.count) / 4;
            double pattern = 0; // amplitude that is left of it
            for (const double noise : sample_noise_) {
                const double dither = std::max(
                    std::min(near / step_squared_ - pattern_power_, noise / step_squared_ - pattern_changes_), 0.0);
                pattern += std::exp(-2 * pi * pi * dither) / static_cast<double>(sample_noise_.size());
            }
            const double share = pattern * pattern;
            // A slow drift across the steps spreads the pattern over the lines next to the sine, and not further.
            found.variance = std::max(found.variance, share * found.nearest) + share * rounding_ / power;
            found.is_rounded = share > 0.5;
        }
        return found;
    }

  private:
    std::span<const double> cut(std::span<const double> signal) const {
        return signal.subspan(window_.first, window_.count);
    }

    // exp(p t) in this window. A pole far away, or so strongly damped that it is wider than the lines reach, is smooth over them. Where
    // many are near, those nearest to the sine, so that half of the lines are left to tell the noise.
    std::vector<KnownTransient> transients_of(std::vector<Complex> poles) const {
        std::vector<KnownTransient> found;
        if (distance_.size() < 10) return found;
        const double omega = 2 * pi * cycles_ / sample_time_;
        std::ranges::stable_sort(poles, {}, [&](Complex pole) { return std::abs(pole.imag() - omega); });
        constexpr std::size_t terms = 3; // of the polynomial
        const auto n = static_cast<double>(window_.count);
        const double reach = std::max(-distance_.front(), distance_.back());
        for (const Complex pole : poles) {
            const Complex decay = std::exp(pole * sample_time_);
            const double away = std::abs(pole.imag() * sample_time_ / (2 * pi) - cycles_) * n;
            const double width = -pole.real() * sample_time_ / (2 * pi) * n;
            if (away > reach || width > reach) continue;
            if (2 * (terms + found.size() + 1) > distance_.size()) break;
            // A geometric series over the samples: its numerator is the same for all lines, which are whole cycles apart.
            const auto at = [&](double cycles) { return 1.0 / (1.0 - decay * turned(-cycles)); };
            KnownTransient transient{at(cycles_), {}};
            for (const int d : distance_) transient.lines.push_back(at(cycles_ + d / n));
            found.push_back(std::move(transient));
        }
        return found;
    }

    // Variance of the output's phasor by rounding that repeats itself with the sine, so that no line between the harmonics
    // shows it. Noise of half a step does away with it.
    double rounding(double step) {
        const auto n = static_cast<double>(window_.count);
        // As many different errors as there are different phases.
        std::size_t phases = 1;
        while (phases < window_.count) {
            const double cycles = cycles_ * static_cast<double>(phases);
            if (std::abs(cycles - std::round(cycles)) < 0.5 / n) break;
            ++phases;
        }
        pattern_power_ = (1 + std::max(0.25, 3 / std::sqrt(static_cast<double>(phases)))) / 12;
        double folded = 4 * step * step / 12 * (1 / static_cast<double>(phases) - 1 / n);
        // With an even number of them each has its opposite. About a whole or half step the errors of both are opposite as well,
        // so that only half as many differ and the fundamental has twice the variance; about a quarter of a step it has half of
        // it: in between, a parabola of the offset. The offset is known to the mean error of the phases.
        if (phases % 2 == 0) {
            const double twice = 2 * output_fit_.offset / step;
            const double unknown = 2 / std::sqrt(12.0 * static_cast<double>(phases));
            const double x = std::max(std::abs(twice - std::round(twice)) - unknown, 0.0);
            folded *= 2 - 6 * x + 6 * x * x;
        }
        // What would be left with any number of phases: the describing function of the rounding of a sine of amplitude A about
        // the offset o, 1 + sum_m 2 (-1)^m/(pi m) J1(2 pi m A) cos(2 pi m o)/A, both in steps; the mean square of
        // J1(x) is 1/(pi x). All of it is in the gain, which has half of the variance.
        const double amplitude = std::max(std::abs(output_fit_.fundamental()) / step, 0.5);
        double gain = 0;
        for (const double m : {1.0, 2.0, 3.0, 4.0}) {
            gain += 2 * std::pow(std::cos(2 * pi * m * output_fit_.offset / step), 2) / (std::pow(pi, 4) * m * m * m);
        }
        return folded + 2 * gain * step * step / amplitude;
    }

    // Variance of `rest` from sample to sample in each of up to eight blocks of the window, two periods long at least. Offset and
    // harmonics are fitted anew in each: a transient at the beginning moves those of the whole window, and the difference, which is
    // as periodic as the rounding, would be taken for noise in all blocks.
    static std::vector<double> changes_by_block(const std::vector<double>& rest, double sample_time, double frequency,
                                                long periods, int harmonics) {
        const auto unknowns = static_cast<std::size_t>(1 + 2 * harmonics);
        const std::size_t blocks = std::clamp<std::size_t>(
            std::min(static_cast<std::size_t>(periods) / 2, rest.size() / (4 * unknowns)), 1, 8);
        std::vector<double> variances;
        for (std::size_t b = 0; b < blocks; ++b) {
            const std::size_t first = b * rest.size() / blocks, end = (b + 1) * rest.size() / blocks;
            const auto block = std::span(rest).subspan(first, end - first);
            const SineFit own = SineBasis(block.size(), sample_time, frequency, 0, harmonics).fit(block);
            const std::vector<double> left = residual(block, own, frequency * sample_time, 0);
            double sum = 0;
            for (std::size_t i = 1; i < left.size(); ++i) sum += (left[i] - left[i - 1]) * (left[i] - left[i - 1]) / 2;
            variances.push_back(sum / static_cast<double>(std::max<std::size_t>(left.size() - 1, 1)));
        }
        return variances;
    }

    // Largest mean square of the change of the rounding error of the fitted signal from sample to sample, halved as the noise
    // is, in steps squared: over offsets, of which the fit knows only a part.
    double pattern_changes(std::span<const double> output, const std::vector<double>& rest, double step) const {
        constexpr int offsets = 8;
        const std::span<const double> measured = cut(output);
        double largest = 0;
        for (int i = 0; i < offsets; ++i) {
            double sum = 0, previous = 0;
            for (std::size_t k = 0; k < rest.size(); ++k) {
                const double fitted = (measured[k] - rest[k]) / step + static_cast<double>(i) / offsets;
                const double error = std::round(fitted) - fitted;
                if (k > 0) sum += (error - previous) * (error - previous) / 2;
                previous = error;
            }
            largest = std::max(largest, sum / static_cast<double>(rest.size() - 1));
        }
        return largest;
    }

    std::vector<double> rest_of(std::span<const double> signal, const SineFit& fitted) const {
        return residual(cut(signal), fitted, cycles_, window_.first);
    }

    Spectrum lines(const std::vector<double>& rest) const {
        const Complex begin = turned(-cycles_ * static_cast<double>(window_.first)); // as the fits count time
        Spectrum found;
        for (const int d : distance_) {
            found.push_back(begin * phasor(rest, cycles_ + d / static_cast<double>(window_.count)));
        }
        return found;
    }

    Window window_;
    double cycles_; // per sample
    SineBasis basis_;
    double sample_time_;
    std::vector<int> distance_;
    SineFit output_fit_;
    Spectrum output_lines_;
    // Variance of what the harmonics leave of the output, from sample to sample, in each block of the window.
    std::vector<double> sample_noise_;
    Complex loop_ = 1;    // E/U: an error dY goes round the loop, with U = E - C Y it is dY/Y - dU/U = (dY/Y) E/U
    double rounding_ = 0; // variance of the output's phasor, without noise, as much as it is in the ratio to the input
    double step_squared_ = 0;
    double pattern_power_ = 0, pattern_changes_ = 0; // largest ones of the rounding alone, in steps squared
};

bool is_constant(std::span<const double> x) {
    return std::ranges::all_of(x, [&](double value) { return value == x.front(); });
}

// The transient stands out from the noise of its estimate.
bool stands_out(const Precision& p) { return std::norm(p.transient) > 16 * p.transient_variance; }

// Taking a transient out costs the variance of its estimate, leaving it the square of what it is: on average that of the estimate
// less its variance. The smaller one is the choice and the price.
bool is_to_be_removed(const Precision& p) { return std::norm(p.transient) > 2 * p.transient_variance; }

double price_of_transient(const Precision& p, bool removed) {
    if (removed) return p.transient_variance;
    return std::max(std::norm(p.transient) - p.transient_variance, 0.0);
}

// What is left of a transient that stands out.
double left_over(const Precision& p, bool removed) {
    if (!stands_out(p)) return 0;
    return removed ? p.bias : std::abs(p.transient);
}

std::optional<SineWindow> window_of(const MeasuredSignals& signals, const SineSegment& segment, long periods,
                                    int harmonics) {
    const double f = segment.frequency_hz;
    Window window = whole_periods(0, periods, signals.sample_time, f);
    if (window.count > segment.count) return std::nullopt;
    window.first = segment.first + segment.count - window.count;
    return std::optional<SineWindow>(std::in_place, signals, window, f, periods, harmonics);
}

// A transient that decays so slowly next to the frequency of the sine that no line shows it: the ratio goes on changing from
// third to third of the segment, by a smaller amount each time. What is left of it in each third, relative; zero where the
// thirds agree within the noise.
class SlowTransient {
  public:
    SlowTransient(const MeasuredSignals& signals, std::size_t input, const SineSegment& segment) {
        const double f = segment.frequency_hz;
        const long periods = periods_within(segment.count / 3, signals.sample_time, f);
        if (periods < 4) return;
        std::array<Complex, 3> ratio;
        std::array<double, 3> variance{};
        for (std::size_t third = 0; third < 3; ++third) {
            SineSegment part = segment;
            part.count = segment.count / 3 * (third + 1);
            const auto window = window_of(signals, part, periods, 1);
            if (!window || std::abs(window->output_fit().fundamental()) == 0) return;
            const SineFit fit = window->fit(signals.inputs[input]);
            const Precision p = window->precision(signals.inputs[input], fit, signals.known_response(input));
            ratio[third] = window->output_fit().fundamental() / fit.fundamental();
            const bool removed = is_to_be_removed(p);
            if (removed) ratio[third] *= 1.0 - p.transient;
            variance[third] = p.variance + price_of_transient(p, removed);
        }
        const double size = std::abs(ratio[2]);
        const auto change = [&](std::size_t from) {
            const double difference = std::abs(ratio[from] - ratio[from + 1]) / size;
            return difference > 4 * std::sqrt(variance[from] + variance[from + 1]) ? difference : 0.0;
        };
        const double early = change(0), late = change(1);
        // Of a geometric series; one that does not get smaller is taken for a very slow one.
        const double decay = late == 0 ? 0 : early == 0 ? 0.9 : std::min(late / early, 0.9);
        left_ = {early / (1 - decay), late / (1 - decay), late * decay / (1 - decay)};
        left_[0] = std::max(left_[0], left_[1]);
    }

    // Over the last samples of the segment, `share` of all.
    double left(double share) const {
        double sum = 0;
        for (std::size_t third = 0; third < 3; ++third) {
            const double begin = static_cast<double>(third) / 3, from = std::max(begin, 1 - share);
            sum += left_[third] * std::max(begin + 1.0 / 3 - from, 0.0);
        }
        return sum / share;
    }

  private:
    std::array<double, 3> left_{};
};

std::optional<SineWindow> best_window(const MeasuredSignals& signals, const SineSegment& segment,
                                      const SineOptions& options) {
    const long all = periods_within(segment.count, signals.sample_time, segment.frequency_hz);
    if (options.periods > 0) return window_of(signals, segment, std::min(options.periods, all), options.harmonics);
    std::vector<std::pair<double, std::optional<SineWindow>>> tried;
    const SlowTransient slow(signals, 0, segment);
    for (const double share : {1.0, 0.75, 0.5, 1.0 / 3, 0.25}) {
        const long periods = std::lround(share * static_cast<double>(all));
        if (periods < 4 && share < 1) break;
        auto window = window_of(signals, segment, periods, options.harmonics);
        if (!window) continue;
        if (is_constant(signals.output.subspan(window->window().first, window->window().count))) return window;
        const auto input = signals.inputs.front();
        const Precision p = window->precision(input, window->fit(input), signals.known_response(0));
        const double bias =
            std::hypot(left_over(p, !options.keep_transients),
                       slow.left(static_cast<double>(window->window().count) / static_cast<double>(segment.count)));
        const double price = options.keep_transients ? 0 : price_of_transient(p, is_to_be_removed(p));
        tried.push_back({p.variance + price + bias * bias, std::move(window)});
    }
    double least = std::numeric_limits<double>::infinity();
    for (const auto& [error, window] : tried) least = std::min(least, error);
    for (auto& [error, window] : tried) {
        if (error <= 1.5 * least) return std::move(window);
    }
    if (!tried.empty()) return std::move(tried.front().second); // its precision is not known
    return std::nullopt;
}

Observation observe(const MeasuredSignals& signals, const SineSegment& segment, const SineOptions& options) {
    Observation o;
    o.frequency_hz = segment.frequency_hz;
    if (segment.frequency_hz * signals.sample_time > 0.45) {
        o.missing = "above 0.45 of the sampling rate, where a sine cannot be told from its alias";
        return o;
    }
    const auto window = best_window(signals, segment, options);
    if (!window) {
        o.missing = "the segment is too short";
        return o;
    }
    o.window = window->window();
    o.duration = static_cast<double>(o.window.count) * signals.sample_time;
    if (is_constant(signals.output.subspan(o.window.first, o.window.count))) {
        o.missing = "nothing moves: the position is constant";
        return o;
    }
    o.excitation = window->fit(signals.excitation).fundamental();
    o.output_harmonics = window->output_fit().harmonics;
    o.output = o.output_harmonics.front();
    const double share = static_cast<double>(o.window.count) / static_cast<double>(segment.count);
    std::vector<std::span<const double>> cut;
    // Of output and input each has a part of the transient of their ratio; the excitation has none.
    const bool excited_by_input = std::ranges::equal(signals.excitation, signals.inputs.front());
    if (!excited_by_input && !options.keep_transients) {
        const Precision p = window->precision(signals.excitation, window->fit(signals.excitation), nullptr);
        if (is_to_be_removed(p)) o.output_transient = p.transient;
    }
    for (std::size_t i = 0; i < signals.inputs.size(); ++i) {
        const auto input = signals.inputs[i];
        cut.push_back(input.subspan(o.window.first, o.window.count));
        const SineFit fit = window->fit(input);
        o.input_harmonics.push_back(fit.harmonics);
        const Precision p = window->precision(input, fit, signals.known_response(i));
        const bool removed = !options.keep_transients && is_to_be_removed(p);
        o.inputs.push_back(removed ? fit.fundamental() / (1.0 - p.transient) : fit.fundamental());
        if (i == 0 && removed && excited_by_input) o.output_transient = p.transient;
        o.is_rounded = o.is_rounded || p.is_rounded;
        o.variance.push_back(p.variance + (options.keep_transients ? 0.0 : price_of_transient(p, removed)));
        o.transient.push_back(std::abs(p.transient));
        o.bias.push_back(
            std::hypot(left_over(p, !options.keep_transients), SlowTransient(signals, i, segment).left(share)));
    }
    try {
        o.coherence =
            coherence(cut, signals.output.subspan(o.window.first, o.window.count), signals.sample_time, o.frequency_hz);
    } catch (const InputError&) { // too few periods
        o.coherence.assign(cut.size(), MeasuredPoint::unknown);
    }
    return o;
}

// ---- multisines ----------------------------------------------------------------------------------------------------

// Lines 0 .. P/2 of each period.
std::vector<Spectrum> periods_of(std::span<const double> x, std::size_t period) {
    Eigen::FFT<double> fft;
    std::vector<Spectrum> periods;
    const std::size_t count = x.size() / period;
    const std::size_t first = x.size() - count * period;
    for (std::size_t p = 0; p < count; ++p) {
        const auto begin = x.begin() + static_cast<std::ptrdiff_t>(first + p * period);
        Spectrum lines;
        fft.fwd(lines, std::vector<double>(begin, begin + static_cast<std::ptrdiff_t>(period)));
        lines.resize(period / 2 + 1);
        for (auto& line : lines) line *= 2.0 / static_cast<double>(period);
        periods.push_back(std::move(lines));
    }
    return periods;
}

// Less the leakage of a drift. A drift that goes on, as of an axis that moves, leaks into all periods alike, so their scatter does not
// show it; the first and the last period tell its slope. What else a drift has changes from period to period, and is scatter.
Spectrum mean_of(const std::vector<Spectrum>& periods, std::size_t period, std::size_t skipped) {
    Spectrum mean(periods.front().size());
    const auto count = static_cast<double>(periods.size() - skipped);
    for (std::size_t p = skipped; p < periods.size(); ++p) {
        for (std::size_t l = 0; l < mean.size(); ++l) mean[l] += periods[p][l] / count;
    }
    if (count < 2) return mean;
    // Within a period; the line at zero is twice the mean.
    const double drift = (periods.back().front() - periods[skipped].front()).real() / 2 / (count - 1);
    const auto samples = static_cast<double>(period);
    for (std::size_t l = 1; l < mean.size(); ++l) {
        mean[l] -= 2 * drift / samples / (turned(-static_cast<double>(l) / samples) - 1.0);
    }
    return mean;
}

// Variance of the mean of output - share * input over the periods.
double variance_of_mean(const std::vector<Spectrum>& output, const std::vector<Spectrum>& input, Complex share,
                        std::size_t line, std::size_t skipped) {
    const std::size_t count = output.size() - skipped;
    if (count < 2) return MeasuredPoint::unknown;
    Complex mean = 0;
    for (std::size_t p = skipped; p < output.size(); ++p) mean += output[p][line] - share * input[p][line];
    mean /= static_cast<double>(count);
    double sum = 0;
    for (std::size_t p = skipped; p < output.size(); ++p) {
        sum += std::norm(output[p][line] - share * input[p][line] - mean);
    }
    return sum / static_cast<double>(count - 1) / static_cast<double>(count);
}

// Mean of the values next to place i, `reach` on each side; NaN are left out.
std::vector<double> smoothed(const std::vector<double>& values, std::size_t reach) {
    std::vector<double> result;
    for (std::size_t i = 0; i < values.size(); ++i) {
        double sum = 0;
        int count = 0;
        for (std::size_t k = i - std::min(i, reach); k < std::min(i + reach + 1, values.size()); ++k) {
            if (std::isfinite(values[k])) {
                sum += values[k];
                ++count;
            }
        }
        result.push_back(count > 0 ? sum / count : MeasuredPoint::unknown);
    }
    return result;
}

std::vector<std::size_t> excited_lines(const std::vector<Spectrum>& periods, std::size_t period, std::size_t skipped) {
    const Spectrum mean = mean_of(periods, period, skipped);
    double largest = 0;
    std::vector<double> noise;
    for (std::size_t l = 1; l < mean.size(); ++l) {
        largest = std::max(largest, std::abs(mean[l]));
        noise.push_back(variance_of_mean(periods, periods, 0, l, skipped));
    }
    // Few periods tell the noise of one line so roughly that among thousands some would pass.
    noise = smoothed(noise, 8);
    std::vector<std::size_t> lines;
    for (std::size_t l = 1; l < mean.size(); ++l) {
        const double own = noise[l - 1];
        const double least = std::max(1e-4 * largest, std::isfinite(own) ? 6 * std::sqrt(own) : 0.0);
        if (std::abs(mean[l]) > least) lines.push_back(l);
    }
    return lines;
}

// Response between the excited lines.
Complex between(const std::vector<std::size_t>& lines, const Spectrum& values, std::size_t line) {
    const auto above = static_cast<std::size_t>(std::lower_bound(lines.begin(), lines.end(), line) - lines.begin());
    const double share =
        static_cast<double>(line - lines[above - 1]) / static_cast<double>(lines[above] - lines[above - 1]);
    const Complex ratio = std::log(values[above] / values[above - 1]);
    return values[above - 1] * std::exp(share * ratio);
}

// Power of the distortion relative to that of the output at each excited line, from the nearest four lines that detect it.
std::vector<double> distortion(const std::vector<std::size_t>& lines, const Spectrum& output,
                               const std::map<std::size_t, std::pair<double, double>>& detected, bool odd) {
    std::vector<std::pair<std::size_t, std::pair<double, double>>> found;
    for (const auto& entry : detected) {
        if (entry.first % 2 == (odd ? 1 : 0)) found.push_back(entry);
    }
    std::vector<double> shares;
    for (std::size_t i = 0; i < lines.size(); ++i) {
        const std::size_t used = std::min<std::size_t>(4, found.size());
        if (used == 0) {
            shares.push_back(MeasuredPoint::unknown);
            continue;
        }
        const auto away = [&](const auto& entry) {
            return entry.first > lines[i] ? entry.first - lines[i] : lines[i] - entry.first;
        };
        auto nearest = found;
        std::partial_sort(nearest.begin(), nearest.begin() + static_cast<std::ptrdiff_t>(used), nearest.end(),
                          [&](const auto& a, const auto& b) { return away(a) < away(b); });
        double power = 0, noise = 0;
        for (std::size_t k = 0; k < used; ++k) {
            power += nearest[k].second.first / static_cast<double>(used);
            if (std::isfinite(nearest[k].second.second)) noise += nearest[k].second.second / static_cast<double>(used);
        }
        // What is within the scatter of the noise is no distortion; the scatter bounds it.
        const double bound = noise / std::sqrt(static_cast<double>(used));
        shares.push_back(std::max(power - noise, bound) / std::norm(output[lines[i]]));
    }
    return shares;
}

// A value that noise made larger seems the surer for it: a limit for its own variance would keep those that are too large. So where the
// variance is near the limit, the median of lines about it decides, without the nearest ones, which share its luck.
void refuse_uncertain(std::vector<MeasuredPoint>& points) {
    constexpr std::size_t nearest = 2, reach = 10;
    constexpr double certain = 0.1 * max_variance; // noise above the limit does not make a value three times as large
    std::vector<bool> refused;
    for (std::size_t i = 0; i < points.size(); ++i) {
        std::vector<double> near;
        for (std::size_t k = i - std::min(i, reach); k < std::min(i + reach + 1, points.size()); ++k) {
            if (k + nearest >= i && k <= i + nearest && points.size() > reach) continue;
            const double variance = points[k].variance;
            near.push_back(std::isfinite(variance) ? variance : std::numeric_limits<double>::infinity());
        }
        const auto middle = near.begin() + static_cast<std::ptrdiff_t>(near.size() / 2);
        std::nth_element(near.begin(), middle, near.end());
        const double own = points[i].variance;
        refused.push_back(!(own <= certain || (std::isfinite(own) && *middle <= max_variance)));
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (!refused[i]) continue;
        points[i].missing = too_uncertain;
        points[i].value = {MeasuredPoint::unknown, MeasuredPoint::unknown};
    }
}

} // namespace

double MeasuredPoint::standard_gain_db() const { return 20 / std::log(10.0) * std::sqrt(variance / 2); }
double MeasuredPoint::standard_phase_deg() const { return 180 / pi * std::sqrt(variance / 2); }

FrequencyResponse response_of(const std::vector<MeasuredPoint>& points) {
    FrequencyResponse response;
    for (const auto& point : points) {
        if (!point.missing.empty()) continue;
        response.frequency_hz.push_back(point.frequency_hz);
        response.value.push_back(point.value);
    }
    return response;
}

std::vector<Observation> sine_observations(const MeasuredSignals& signals, const std::vector<SineSegment>& segments,
                                           const SineOptions& options) {
    std::vector<Observation> observations;
    for (const auto& segment : segments) observations.push_back(observe(signals, segment, options));
    return observations;
}

std::vector<Observation> multisine_observations(const MeasuredSignals& signals, std::size_t period,
                                                const std::string& where) {
    const auto excitation = periods_of(signals.excitation, period), output = periods_of(signals.output, period);
    std::vector<std::vector<Spectrum>> inputs;
    for (const auto input : signals.inputs) inputs.push_back(periods_of(input, period));

    // How many periods at the beginning to leave out.
    std::size_t skipped = 0;
    auto lines = excited_lines(excitation, period, output.size() > 2 ? 1 : 0);
    if (lines.size() < 2) throw InputError(where + ": the excitation has fewer than two lines above its noise");
    // A binary sequence has all lines up to half the sampling rate, a tenth of its power above this limit; an excitation that lies
    // there is aliased.
    constexpr double highest = 0.45, most = 0.5;
    const Spectrum all = mean_of(excitation, period, 0);
    double power = 0, above = 0;
    for (const std::size_t l : lines) {
        power += std::norm(all[l]);
        if (static_cast<double>(l) > highest * static_cast<double>(period)) above += std::norm(all[l]);
    }
    std::erase_if(lines, [&](std::size_t l) { return static_cast<double>(l) > highest * static_cast<double>(period); });
    if (above > most * power || lines.size() < 2) {
        throw InputError(fmt::format("{}: most of the excitation lies above 0.45 of the sampling rate ({:.6g} Hz), "
                                     "where a line cannot be told from its alias",
                                     where, highest / signals.sample_time));
    }
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t tried = 0; tried + 2 <= output.size(); ++tried) {
        const Spectrum y = mean_of(output, period, tried), w = mean_of(inputs.front(), period, tried);
        double sum = 0;
        for (const std::size_t l : lines) {
            sum += variance_of_mean(output, inputs.front(), y[l] / w[l], l, tried) / std::norm(y[l]);
        }
        // The variance of few periods is itself uncertain: no period is given up for less than a third.
        if (sum < least / 1.5) {
            least = sum;
            skipped = tried;
        }
    }
    const Spectrum e = mean_of(excitation, period, skipped), y = mean_of(output, period, skipped);
    std::vector<Observation> observations(lines.size());
    const double period_s = static_cast<double>(period) * signals.sample_time;
    for (std::size_t i = 0; i < lines.size(); ++i) {
        auto& o = observations[i];
        o.frequency_hz = static_cast<double>(lines[i]) / period_s;
        o.duration = static_cast<double>(output.size() - skipped) * period_s;
        o.excitation = e[lines[i]];
        o.output = y[lines[i]];
        o.is_line = true;
        if (std::abs(o.output) == 0) o.missing = "nothing moves: the position is constant";
    }
    for (const auto& input : inputs) {
        const Spectrum w = mean_of(input, period, skipped);
        Spectrum responses;
        std::vector<double> noise;
        for (const std::size_t l : lines) {
            responses.push_back(y[l] / w[l]);
            noise.push_back(variance_of_mean(output, input, y[l] / w[l], l, skipped) / std::norm(y[l]));
        }
        noise = smoothed(noise, 3);
        std::map<std::size_t, std::pair<double, double>> detected; // line -> power and noise of the distortion
        std::size_t next = 0;
        for (std::size_t l = lines.front(); l < lines.back(); ++l) {
            if (l == lines[next]) {
                ++next;
                continue;
            }
            const Complex share = between(lines, responses, l);
            detected[l] = {std::norm(y[l] - share * w[l]), variance_of_mean(output, input, share, l, skipped)};
        }
        const auto odd = distortion(lines, y, detected, true), even = distortion(lines, y, detected, false);
        for (std::size_t i = 0; i < lines.size(); ++i) {
            auto& o = observations[i];
            o.inputs.push_back(w[lines[i]]);
            o.variance.push_back(noise[i]);
            o.transient.push_back(0);
            o.bias.push_back(0);
            o.odd.push_back(odd[i]);
            o.even.push_back(even[i]);
            // Of the periods: how much of the power repeats itself.
            const double scatter = noise[i] * static_cast<double>(output.size() - skipped);
            o.coherence.push_back(1 / (1 + scatter));
        }
    }
    return observations;
}

std::vector<std::vector<MeasuredPoint>> merged(const std::vector<Observation>& observations,
                                               const SineOptions& options) {
    std::vector<const Observation*> sorted;
    std::size_t inputs = 0;
    for (const auto& o : observations) {
        sorted.push_back(&o);
        inputs = std::max(inputs, o.inputs.size());
    }
    std::ranges::stable_sort(sorted, {}, &Observation::frequency_hz);
    std::vector<std::vector<const Observation*>> groups;
    for (const auto* o : sorted) {
        const double near = groups.empty() ? 0 : groups.back().front()->frequency_hz;
        const double apart = std::max(1e-6 * o->frequency_hz, o->duration > 0 ? 0.02 / o->duration : 0.0);
        if (groups.empty() || o->frequency_hz - near > apart) groups.emplace_back();
        groups.back().push_back(o);
    }

    std::vector<std::vector<MeasuredPoint>> responses(inputs);
    for (std::size_t i = 0; i < inputs; ++i) {
        auto& points = responses[i];
        std::vector<double> scatters; // of each point, per repetition
        for (const auto& group : groups) {
            MeasuredPoint point;
            point.frequency_hz = group.front()->frequency_hz;
            Complex cross = 0, power = 0;
            std::vector<const Observation*> used;
            for (const auto* o : group) {
                if (!o->missing.empty()) {
                    point.missing = o->missing;
                    continue;
                }
                used.push_back(o);
                cross += o->output * std::conj(o->excitation);
                power += o->inputs[i] * std::conj(o->excitation);
            }
            double scatter = MeasuredPoint::unknown;
            if (!used.empty()) {
                point.missing.clear();
                point.repetitions = used.size();
                point.value = cross / power;
                double noise = 0, difference = 0, odd = 0, even = 0, coherent = 0;
                for (const auto* o : used) {
                    const double weight = std::norm(o->inputs[i] * o->excitation) / std::norm(power);
                    noise += o->variance[i] * weight;
                    difference += std::norm((o->output / point.value - o->inputs[i]) * std::conj(o->excitation));
                    const double share = 1 / static_cast<double>(used.size());
                    coherent += share * o->coherence[i];
                    point.transient = std::max(point.transient, o->transient[i]);
                    point.bias = std::max(point.bias, o->bias[i]);
                    point.is_rounded = point.is_rounded || o->is_rounded;
                    if (o->is_line) {
                        odd += share * o->odd[i];
                        even += share * o->even[i];
                    }
                }
                point.coherence = coherent;
                point.variance = noise;
                const auto count = static_cast<double>(used.size());
                if (used.size() > 1) scatter = difference * count / (count - 1) / std::norm(power);
                if (used.front()->is_line) {
                    point.odd_distortion = std::sqrt(odd);
                    point.even_distortion = std::sqrt(even);
                    if (used.size() == 1 && std::isfinite(odd)) point.variance = noise + odd;
                } else if (used.size() > 1 && !(scatter <= 5 * noise)) {
                    point.variance = scatter;
                }
            }
            scatters.push_back(!used.empty() && used.front()->is_line ? scatter : MeasuredPoint::unknown);
            points.push_back(std::move(point));
        }
        scatters = smoothed(scatters, 4);
        for (std::size_t k = 0; k < points.size(); ++k) {
            auto& point = points[k];
            if (!point.missing.empty()) continue;
            if (point.repetitions > 1 && std::isfinite(scatters[k]) && groups[k].front()->is_line) {
                // Never below the noise within each: records that are hardly different are no proof that there is none.
                point.variance = std::max(point.variance, scatters[k]);
            }
            point.settled = point.bias <= std::max(options.tolerance, 2 * std::sqrt(point.variance));
            point.variance += point.bias * point.bias;
            if (std::abs(point.value) == 0 || point.variance > max_variance || !std::isfinite(std::abs(point.value))) {
                point.missing = too_uncertain;
                point.value = {MeasuredPoint::unknown, MeasuredPoint::unknown};
            }
        }

        // Harmonics of sines, with the response known by now.
        const FrequencyResponse response = response_of(points);
        if (response.size() < 2) continue;
        for (std::size_t k = 0; k < points.size(); ++k) {
            double odd = 0, even = 0;
            int odd_count = 0, even_count = 0, used = 0;
            if (!points[k].missing.empty()) continue;
            for (const auto* o : groups[k]) {
                if (o->is_line || !o->missing.empty() || o->input_harmonics[i].empty()) continue;
                ++used;
                for (std::size_t n = 2; n <= o->output_harmonics.size(); ++n) {
                    const double f = static_cast<double>(n) * o->frequency_hz;
                    if (f > response.frequency_hz.back() || f < response.frequency_hz.front()) continue;
                    const Complex own = response.at(f) * o->input_harmonics[i][n - 1];
                    const double power = std::norm((o->output_harmonics[n - 1] - own) / o->output);
                    (n % 2 ? odd : even) += power;
                    ++(n % 2 ? odd_count : even_count);
                }
            }
            const double noise = points[k].variance;
            const auto level = [&](double power, int count) {
                if (count == 0) return MeasuredPoint::unknown;
                return std::sqrt(std::max(power - count * noise, noise) / used);
            };
            if (used > 0) {
                points[k].odd_distortion = level(odd, odd_count);
                points[k].even_distortion = level(even, even_count);
            }
        }
    }
    return responses;
}

std::vector<std::vector<MeasuredPoint>> cross_spectra(const std::vector<MeasuredSignals>& records, std::size_t window) {
    std::size_t shortest = std::numeric_limits<std::size_t>::max();
    for (const auto& record : records) shortest = std::min(shortest, record.output.size());
    if (window == 0) window = std::min<std::size_t>(std::bit_floor(std::max<std::size_t>(shortest / 8, 1)), 8192);
    if (window < 64) {
        throw InputError(
            fmt::format("cross spectra of a record of {} samples: eight windows of 64 samples are needed at "
                        "least",
                        shortest));
    }
    if (2 * window > shortest) {
        throw InputError(
            fmt::format("cross spectra of a record of {} samples with windows of {}: the record must have two "
                        "of them, since one explains any output",
                        shortest, window));
    }
    const std::size_t lines = window / 2, inputs = records.front().inputs.size();
    std::vector<double> hann(window), slope(window); // of the window, per length of it
    for (std::size_t k = 0; k < window; ++k) {
        const Complex turn = turned(static_cast<double>(k) / static_cast<double>(window));
        hann[k] = 0.5 - 0.5 * turn.real();
        slope[k] = pi * turn.imag();
    }
    Eigen::FFT<double> fft;
    const auto spectrum = [&](std::span<const double> x, const std::vector<double>& weight) {
        // Less the straight line nearest to it.
        const double n = static_cast<double>(window);
        double mean = 0, rise = 0;
        for (std::size_t k = 0; k < window; ++k) {
            mean += x[k] / n;
            rise += x[k] * (static_cast<double>(k) - (n - 1) / 2);
        }
        rise /= n * (n * n - 1) / 12;
        std::vector<double> weighted(window);
        for (std::size_t k = 0; k < window; ++k) {
            weighted[k] = weight[k] * (x[k] - mean - rise * (static_cast<double>(k) - (n - 1) / 2));
        }
        Spectrum all;
        fft.fwd(all, weighted);
        all.resize(lines);
        return all;
    };
    // Sums of products over all windows; v: of an input under the slope of the window.
    std::vector<double> ee(lines), yy(lines);
    Spectrum ye(lines);
    std::vector<Spectrum> we(inputs, Spectrum(lines)), yw = we, ve = we;
    std::vector<std::vector<double>> ww(inputs, std::vector<double>(lines));
    double averages = 0;
    for (const auto& record : records) {
        // To the last sample, since a chirp is there but once. By steps of a quarter the squares of the windows sum up to a constant,
        // and most of what windows leak in and out of a chirp cancels.
        const std::size_t room = record.output.size() - window, step = window / 4;
        const std::size_t windows = (room + step - 1) / step + 1;
        averages += averages_of(hann, step, windows);
        for (std::size_t place = 0; place < windows; ++place) {
            const auto part = [&](std::span<const double> x, const std::vector<double>& weight) {
                return spectrum(x.subspan(place * room / (windows - 1), window), weight);
            };
            const Spectrum e = part(record.excitation, hann), y = part(record.output, hann);
            for (std::size_t l = 0; l < lines; ++l) {
                ee[l] += std::norm(e[l]);
                yy[l] += std::norm(y[l]);
                ye[l] += y[l] * std::conj(e[l]);
            }
            for (std::size_t i = 0; i < inputs; ++i) {
                const Spectrum w = part(record.inputs[i], hann), v = part(record.inputs[i], slope);
                for (std::size_t l = 0; l < lines; ++l) {
                    ww[i][l] += std::norm(w[l]);
                    we[i][l] += w[l] * std::conj(e[l]);
                    yw[i][l] += y[l] * std::conj(w[l]);
                    ve[i][l] += v[l] * std::conj(e[l]);
                }
            }
        }
    }
    const double freedom = averages - 1; // the response takes one
    // Few averages tell the variance itself only roughly: Student's distribution is wider by this.
    const double student = freedom / (freedom - 1);
    const double strongest = *std::max_element(ee.begin() + 2, ee.end());
    std::vector<std::vector<MeasuredPoint>> responses(inputs);
    for (std::size_t i = 0; i < inputs; ++i) {
        const auto response = [&](std::size_t l) { return ye[l] / we[i][l]; };
        for (std::size_t l = 2; l + 1 < lines; ++l) {
            const double cycles = static_cast<double>(l) / static_cast<double>(window);
            if (ee[l] < 1e-8 * strongest || cycles > 0.45) continue;
            MeasuredPoint point;
            point.frequency_hz = cycles / records.front().sample_time;
            point.value = response(l);
            // Power of z = Y/H - W, which the excitation does not explain.
            const double z = yy[l] / std::norm(point.value) + ww[i][l] - 2 * (yw[i][l] / point.value).real();
            const double noise = student * std::max(z, 0.0) * ee[l] / std::norm(we[i][l]) / freedom;
            const Complex turn = std::log(response(l + 1) / response(l - 1)) / 2.0; // from line to line
            const double leakage = std::norm(turn / (2 * pi) * ve[i][l] / we[i][l]);
            point.variance = noise + leakage;
            point.coherence = std::norm(yw[i][l]) / (yy[l] * ww[i][l]);
            responses[i].push_back(std::move(point));
        }
        refuse_uncertain(responses[i]);
    }
    return responses;
}

} // namespace tribode
