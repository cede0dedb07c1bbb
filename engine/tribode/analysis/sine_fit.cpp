#include "tribode/analysis/sine_fit.hpp"

#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <map>
#include <numbers>

namespace tribode {

namespace {

// exp(j 2 pi f t), by rotation from sample to sample and anew every 64 samples, which keeps the error near 64
// eps.
class Rotation {
  public:
    Rotation(double frequency_hz, double first_instant, double sample_time)
        : frequency_(frequency_hz),
          first_instant_(first_instant),
          sample_time_(sample_time),
          step_(at_cycles(frequency_hz * sample_time)) {}

    std::complex<double> at(Eigen::Index i) {
        if (i % 64 == 0)
            value_ = at_cycles(frequency_ * (first_instant_ + static_cast<double>(i) * sample_time_));
        else
            value_ *= step_;
        return value_;
    }

  private:
    // Whole turns are taken off before the multiplication by 2 pi, so that late instants lose no digits
    // there.
    static std::complex<double> at_cycles(double cycles) {
        return std::polar(1.0, 2 * std::numbers::pi * (cycles - std::floor(cycles)));
    }

    double frequency_, first_instant_, sample_time_;
    std::complex<double> step_, value_;
};

void require_sampling(double sample_time, double frequency_hz) {
    if (!(sample_time > 0) || !std::isfinite(sample_time))
        throw InputError("sine fit: sample time = " + to_text(sample_time) + " s, must be positive and finite");
    if (!(frequency_hz > 0) || !std::isfinite(frequency_hz))
        throw InputError("sine fit: frequency = " + to_text(frequency_hz) + " Hz, must be positive and finite");
}

// How many of the harmonics lie at least one resolution of the window below the Nyquist frequency.
int harmonics_below_nyquist(std::size_t samples, double sample_time, double frequency_hz, int harmonics) {
    const double count = static_cast<double>(samples);
    const double highest_hz = (0.5 - 1 / count) / sample_time;
    // The margin of 1e-9 keeps a harmonic that lies exactly on the limit, whichever way its product is
    // rounded.
    const double below = std::floor(highest_hz / frequency_hz * (1 + 1e-9));
    return static_cast<int>(std::clamp(below, 0.0, static_cast<double>(harmonics)));
}

// SineBasis::columns_: with cos and -sin the coefficients of a pair are the real and imaginary part of its phasor.
Eigen::MatrixXd regressors(Eigen::Index samples, double sample_time, double frequency_hz, double first_instant,
                           int harmonics, bool drift) {
    const Eigen::Index base = drift ? 2 : 1;
    Eigen::MatrixXd columns(samples, base + 2 * harmonics);
    columns.col(0).setOnes();
    if (drift) columns.col(1).setLinSpaced(samples, -1, 1);
    Rotation rotation(frequency_hz, first_instant, sample_time);
    for (Eigen::Index i = 0; i < samples; ++i) {
        const std::complex<double> turn = rotation.at(i);
        std::complex<double> power = turn;
        for (int n = 0; n < harmonics; ++n, power *= turn) {
            columns(i, base + 2 * n) = power.real();
            columns(i, base + 2 * n + 1) = -power.imag();
        }
    }
    return columns;
}

} // namespace

double SineFit::total_harmonic_distortion() const {
    double sum = 0;
    for (std::size_t n = 1; n < harmonics.size(); ++n) sum += std::norm(harmonics[n]);
    return std::sqrt(sum) / std::abs(fundamental());
}

SineBasis::SineBasis(std::size_t count, double sample_time, double frequency_hz, double first_instant, int harmonics,
                     Drift drift)
    : half_window_(0.5 * (static_cast<double>(count) - 1) * sample_time),
      harmonics_(static_cast<std::size_t>(harmonics)),
      drift_(drift == Drift::linear) {
    require_sampling(sample_time, frequency_hz);
    if (harmonics < 1) throw InputError("sine fit: " + std::to_string(harmonics) + " harmonics, must be at least 1");
    const int fitted = harmonics_below_nyquist(count, sample_time, frequency_hz, harmonics);
    const std::size_t unknowns = 1 + (drift_ ? 1 : 0) + 2 * static_cast<std::size_t>(fitted);
    if (count < unknowns || count < 3)
        throw InputError("sine fit at " + to_text(frequency_hz) + " Hz: " + std::to_string(count) +
                         " samples, must be at least " + std::to_string(std::max<std::size_t>(unknowns, 3)));
    if (fitted == 0)
        throw InputError("sine fit: frequency = " + to_text(frequency_hz) + " Hz, must be below " +
                         to_text((0.5 - 1 / static_cast<double>(count)) / sample_time) +
                         " Hz with this sample time and window");

    columns_ = regressors(static_cast<Eigen::Index>(count), sample_time, frequency_hz, first_instant, fitted, drift_);
    Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(columns_.cols(), columns_.cols());
    gram.selfadjointView<Eigen::Lower>().rankUpdate(columns_.transpose());
    factor_.compute(gram);
    if (factor_.info() != Eigen::Success || factor_.rcond() < 1e-10)
        throw InputError("sine fit at " + to_text(frequency_hz) + " Hz: the window covers " +
                         to_text(static_cast<double>(count) * sample_time * frequency_hz) +
                         " periods, too few for the number of unknowns; one period or more is enough");
}

Eigen::VectorXd SineBasis::coefficients(std::span<const double> samples) const {
    assert(samples.size() == static_cast<std::size_t>(columns_.rows()));
    const Eigen::Map<const Eigen::VectorXd> measured(samples.data(), columns_.rows());
    return factor_.solve(columns_.transpose() * measured);
}

std::complex<double> SineBasis::fundamental(std::span<const double> samples) const {
    const Eigen::VectorXd found = coefficients(samples);
    const Eigen::Index base = drift_ ? 2 : 1;
    return {found[base], found[base + 1]};
}

SineFit SineBasis::fit(std::span<const double> samples) const {
    const Eigen::Map<const Eigen::VectorXd> measured(samples.data(), columns_.rows());
    const Eigen::VectorXd found = coefficients(samples);

    SineFit fit;
    fit.offset = found[0];
    if (drift_) fit.drift = found[1] / half_window_;
    fit.harmonics.resize(harmonics_);
    const Eigen::Index base = drift_ ? 2 : 1;
    for (Eigen::Index n = 0; base + 2 * n < found.size(); ++n)
        fit.harmonics[static_cast<std::size_t>(n)] = {found[base + 2 * n], found[base + 2 * n + 1]};
    fit.residual_rms = (measured - columns_ * found).norm() / std::sqrt(static_cast<double>(samples.size()));
    return fit;
}

SineFit fit_sine(std::span<const double> samples, double sample_time, double frequency_hz, double first_instant,
                 int harmonics, Drift drift) {
    return SineBasis(samples.size(), sample_time, frequency_hz, first_instant, harmonics, drift).fit(samples);
}

Window whole_periods(std::size_t first, long periods, double sample_time, double frequency_hz) {
    require_sampling(sample_time, frequency_hz);
    const double count = std::round(static_cast<double>(periods) / (frequency_hz * sample_time));
    constexpr double most = 1e15; // samples
    if (!(count <= most)) {
        throw InputError("a window of " + std::to_string(periods) + " periods of " + to_text(frequency_hz) +
                         " Hz has " + to_text(count) + " samples, must have " + to_text(most) + " at most");
    }
    return {first, static_cast<std::size_t>(count)};
}

long periods_within(std::size_t samples, double sample_time, double frequency_hz) {
    require_sampling(sample_time, frequency_hz);
    // One period more than the quotient may fit, because windows end at the nearest sample.
    constexpr double most = 1e15; // far more than there are samples
    const auto whole = static_cast<long>(std::min(static_cast<double>(samples) * frequency_hz * sample_time, most));
    return whole_periods(0, whole + 1, sample_time, frequency_hz).count <= samples ? whole + 1 : whole;
}

std::vector<double> coherence(std::span<const std::span<const double>> inputs, std::span<const double> output,
                              double sample_time, double frequency_hz, int harmonics) {
    for (const auto& input : inputs) {
        if (input.size() == output.size()) continue;
        throw InputError("coherence: " + std::to_string(input.size()) + " input and " + std::to_string(output.size()) +
                         " output samples, must be the same number");
    }
    const long available = periods_within(output.size(), sample_time, frequency_hz);
    // Four samples per unknown, and a resolution that reaches from the frequency to the Nyquist frequency.
    const double to_nyquist = std::max(0.5 - frequency_hz * sample_time, 1e-3);
    const double wanted_samples = std::max(4.0 * (1 + 2 * harmonics), 1 / to_nyquist + 1);
    const long per_window = static_cast<long>(std::ceil(wanted_samples * frequency_hz * sample_time));
    const long windows = available / per_window;
    if (windows < 2)
        throw InputError("coherence at " + to_text(frequency_hz) + " Hz: the record holds " +
                         std::to_string(available) + " periods, must be at least " + std::to_string(2 * per_window));

    std::vector<std::complex<double>> cross(inputs.size());
    std::vector<double> input_power(inputs.size());
    double output_power = 0;
    // A window may begin at any time, as only the angle between two phasors counts: so few windows need a basis of their own.
    std::map<std::size_t, SineBasis> bases;
    for (long p = 0; p < windows; ++p) {
        const std::size_t begin = whole_periods(0, p * per_window, sample_time, frequency_hz).count;
        const std::size_t count = whole_periods(0, (p + 1) * per_window, sample_time, frequency_hz).count - begin;
        const SineBasis& basis = bases.try_emplace(count, count, sample_time, frequency_hz, 0, harmonics).first->second;
        const auto phasor = [&](std::span<const double> signal) {
            return basis.fundamental(signal.subspan(begin, count));
        };
        const std::complex<double> y = phasor(output);
        output_power += std::norm(y);
        for (std::size_t i = 0; i < inputs.size(); ++i) {
            const std::complex<double> u = phasor(inputs[i]);
            cross[i] += y * std::conj(u);
            input_power[i] += std::norm(u);
        }
    }
    std::vector<double> result;
    for (std::size_t i = 0; i < inputs.size(); ++i) {
        const double power = input_power[i] * output_power;
        result.push_back(power == 0 ? 0.0 : std::min(std::norm(cross[i]) / power, 1.0));
    }
    return result;
}

double coherence(std::span<const double> input, std::span<const double> output, double sample_time, double frequency_hz,
                 int harmonics) {
    return coherence({&input, 1}, output, sample_time, frequency_hz, harmonics).front();
}

bool settled(std::complex<double> previous, std::complex<double> latest, double tolerance) {
    return std::abs(latest - previous) <= tolerance * std::abs(latest);
}

} // namespace tribode
