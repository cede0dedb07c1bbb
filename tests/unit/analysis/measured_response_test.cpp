#include "tribode/analysis/measured_response.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"

#include <cmath>
#include <functional>
#include <gtest/gtest.h>
#include <numbers>
#include <utility>

namespace tribode {
namespace {

using std::numbers::pi;
using Complex = std::complex<double>;
constexpr double ts = 5e-4;

// u and y of a single sine with noise on both that is partly the same, as in a loop.
struct Sine {
    std::vector<double> u, y;
    SineSegment segment;
};

const Complex true_response = std::polar(0.02, -2.5);

Sine noisy_sine(double frequency, std::size_t count, double noise, std::uint64_t seed) {
    Sine sine{std::vector<double>(count), std::vector<double>(count), {frequency, 15, 0, 0, count}};
    for (std::size_t k = 0; k < count; ++k) {
        const Complex turn = std::polar(1.0, 2 * pi * frequency * ts * static_cast<double>(k));
        const double e = standard_normal(seed, 0, k);
        sine.u[k] = (15.0 * turn).real() - 20 * noise * e;
        sine.y[k] = (15.0 * true_response * turn).real() + noise * e;
    }
    return sine;
}

MeasuredPoint measure(const Sine& sine, const SineOptions& options = {}) {
    const MeasuredSignals signals{ts, sine.u, sine.y, {sine.u}, 0};
    return merged(sine_observations(signals, {sine.segment}, options), options).at(0).at(0);
}

TEST(MeasuredResponse, BoundsOfASineCoverTheTruth) {
    // Gain and phase of 400 records, whose true errors are known: 95 % bounds hold for 93 to 97 % of 800 values.
    int covered = 0;
    double squares = 0, variances = 0;
    constexpr int records = 400;
    for (int seed = 0; seed < records; ++seed) {
        const auto point = measure(noisy_sine(37.3, 1800, 0.02, static_cast<std::uint64_t>(seed)));
        const Complex error = std::log(point.value / true_response);
        const double deviation = std::sqrt(point.variance / 2);
        covered += std::abs(error.real()) < 1.96 * deviation;
        covered += std::abs(error.imag()) < 1.96 * deviation;
        squares += std::norm(error) / records;
        variances += point.variance / records;
        EXPECT_TRUE(point.settled);
    }
    EXPECT_GT(covered, 0.90 * 2 * records);
    EXPECT_LT(covered, 0.98 * 2 * records);
    EXPECT_NEAR(squares / variances, 1, 0.15);
}

TEST(MeasuredResponse, TakesATransientOut) {
    Sine sine = noisy_sine(40, 1600, 1e-5, 1);
    for (std::size_t k = 0; k < sine.y.size(); ++k) {
        sine.y[k] +=
            0.5 * std::exp(-static_cast<double>(k) * ts / 0.4) * std::cos(2 * pi * 7 * ts * static_cast<double>(k));
    }
    SineOptions options;
    options.periods = 32;
    options.keep_transients = true;
    const auto kept = measure(sine, options);
    options.keep_transients = false;
    const auto removed = measure(sine, options);
    const double before = std::abs(kept.value / true_response - 1.0),
                 after = std::abs(removed.value / true_response - 1.0);
    EXPECT_GT(before, 4e-3);
    EXPECT_LT(after, before / 20);
    EXPECT_FALSE(kept.settled);
    // What is left is stated, and less than the square of the transient.
    EXPECT_LT(after, 1e-5);
    EXPECT_LT(after, 3 * std::sqrt(removed.variance) + removed.bias);
    // Without a given number of periods the window avoids most of it.
    EXPECT_LT(std::abs(measure(sine).value / true_response - 1.0), before / 20);
}

TEST(MeasuredResponse, TakesASlowTransientNextToTheSineOut) {
    // As of a mode with 0.3 % damping at 82.2 Hz, which a sine at 83 Hz has set off: a pole between the lines of the window. The
    // window may begin anywhere in the record.
    for (const std::size_t first : {0u, 777u}) {
        Sine sine = noisy_sine(83, 1600 + first, 1e-4, 1);
        sine.segment.first = first;
        sine.segment.count = 1600;
        for (std::size_t k = first; k < sine.y.size(); ++k) {
            const double t = static_cast<double>(k - first) * ts;
            sine.y[k] += 0.02 * std::exp(-t / 0.6) * std::cos(2 * pi * 82.2 * t);
        }
        const auto point = measure(sine);
        const double error = std::abs(point.value / true_response - 1.0);
        EXPECT_LT(error, 1e-3); // of 2e-2 that is left in the plain ratio
        EXPECT_LT(error, 2.5 * std::sqrt(point.variance));
    }
}

TEST(MeasuredResponse, TakesTransientsOfAKnownModeOut) {
    // A mode of 34 Hz with 6 % of damping in a loop, and a sine at 33.8 Hz, half a line beside it, after one at 30 Hz: the free
    // motion of the mode is broader than a line, and the thrust holds one of the loop.
    const Complex pole = 2 * pi * 34.0 * Complex(-0.06, std::sqrt(1 - 0.06 * 0.06)), decay = std::exp(pole * ts);
    const double gain = 2e-6, feedback = 100;
    const auto response = [=](double f) {
        const Complex z = std::polar(1.0, 2 * pi * f * ts);
        return gain * z / (z * z - 2 * decay.real() * z + std::norm(decay));
    };
    constexpr double noise = 3e-5;
    double squares_before = 0, squares = 0, variances = 0;
    constexpr int records = 40;
    for (int seed = 0; seed < records; ++seed) {
        std::vector<double> exc(3200), u(3200), y(3200);
        double motion[2] = {0, 0};
        for (std::size_t k = 0; k < y.size(); ++k) {
            const double t = static_cast<double>(k) * ts;
            exc[k] = 15 * std::sin(2 * pi * (k < 1600 ? 30.0 : 33.8) * t);
            const double next =
                2 * decay.real() * motion[0] - std::norm(decay) * motion[1] + (k > 0 ? gain * u[k - 1] : 0.0);
            motion[1] = std::exchange(motion[0], next);
            y[k] = next + noise * standard_normal(static_cast<std::uint64_t>(seed), 0, k);
            u[k] = exc[k] - feedback * y[k];
        }
        MeasuredSignals signals{ts, exc, y, {u}, 0, u};
        const SineSegment segment{33.8, 15, 0, 1600, 1600};
        const auto error = [&](const MeasuredPoint& point) { return std::norm(point.value / response(33.8) - 1.0); };
        squares_before += error(merged(sine_observations(signals, {segment}, {})).at(0).at(0)) / records;
        signals.known = {{response, {pole}}};
        const auto point = merged(sine_observations(signals, {segment}, {})).at(0).at(0);
        squares += error(point) / records;
        variances += point.variance / records;
    }
    EXPECT_LT(squares, squares_before / 3);
    EXPECT_GT(squares / variances, 0.5);
    EXPECT_LT(squares / variances, 1.2);
}

TEST(MeasuredResponse, KeepsLinesForTheNoiseWhereManyModesAreNear) {
    const Sine sine = noisy_sine(40, 1600, 1e-3, 1);
    MeasuredSignals signals{ts, sine.u, sine.y, {sine.u}, 0};
    KnownResponse known{[](double) { return true_response; }, {}};
    for (int i = 0; i < 30; ++i) known.poles.push_back({-2.0, 2 * pi * (35 + 0.3 * i)});
    signals.known = {known};
    const auto point = merged(sine_observations(signals, {sine.segment}, {})).at(0).at(0);
    EXPECT_GT(point.variance, 0);
    EXPECT_LT(std::abs(point.value / true_response - 1.0), 4 * std::sqrt(point.variance));
}

TEST(MeasuredResponse, WhereNothingMovesThereIsNoValueButAReason) {
    Sine sine = noisy_sine(40, 1600, 0, 1);
    sine.y.assign(sine.y.size(), 1e-3);
    EXPECT_EQ(merged(sine_observations({ts, sine.u, sine.y, {sine.u}, 0}, {sine.segment}, {})).size(), 0u);
    Sine other = noisy_sine(60, 1600, 0.01, 1);
    auto observations = sine_observations({ts, sine.u, sine.y, {sine.u}, 0}, {sine.segment}, {});
    const auto moving = sine_observations({ts, other.u, other.y, {other.u}, 0}, {other.segment}, {});
    observations.insert(observations.end(), moving.begin(), moving.end());
    const auto points = merged(observations).at(0);
    ASSERT_EQ(points.size(), 2u);
    EXPECT_EQ(points[0].missing, "nothing moves: the position is constant");
    EXPECT_TRUE(std::isnan(points[0].value.real()));
    EXPECT_EQ(points[1].missing, "");
    EXPECT_EQ(response_of(points).size(), 1u);
}

TEST(MeasuredResponse, RoundingThatRepeatsItselfIsInTheBounds) {
    // 20 samples a period: every period is rounded in the same way, and no line between the harmonics shows it.
    int covered = 0;
    constexpr int records = 200;
    for (int record = 0; record < records; ++record) {
        Sine sine = noisy_sine(100, 2000, 0, 1);
        const double phase = 2 * pi * uniform(5, 0, static_cast<std::uint64_t>(record));
        for (std::size_t k = 0; k < sine.y.size(); ++k) {
            const Complex turn = std::polar(1.0, 2 * pi * 100 * ts * static_cast<double>(k) + phase);
            sine.u[k] = (15.0 * turn).real();
            sine.y[k] = std::round((15.0 * true_response * turn).real() / 0.06) * 0.06;
        }
        const MeasuredSignals signals{ts, sine.u, sine.y, {sine.u}, 0.06};
        const auto point = merged(sine_observations(signals, {sine.segment}, {})).at(0).at(0);
        const Complex error = std::log(point.value / true_response);
        covered += std::abs(error.real()) < 1.96 * std::sqrt(point.variance / 2);
        covered += std::abs(error.imag()) < 1.96 * std::sqrt(point.variance / 2);
    }
    EXPECT_GT(covered, 0.90 * 2 * records);
}

TEST(MeasuredResponse, ATransientAtTheBeginningDoesNotMakeTheRoundingOfTheOtherPeriodsRandom) {
    // 52 samples a period, beside a mode that dies away in the first quarter. It moves offset and harmonics of the whole window, and
    // that is no noise. Errors and bounds by repetition, gain and phase apart.
    constexpr double step = 1, frequency = 1 / (52 * ts);
    constexpr int records = 60;
    int covered = 0;
    double squares = 0, variances = 0;
    for (int record = 0; record < records; ++record) {
        Sine sine = noisy_sine(frequency, 8000, 0, 1);
        const auto drawn = [&](std::uint64_t which) { return uniform(6, which, static_cast<std::uint64_t>(record)); };
        const double phase = 2 * pi * drawn(0), amplitude = 350 + 150 * drawn(1), other = 2 * pi * drawn(2);
        for (std::size_t k = 0; k < sine.y.size(); ++k) {
            const double t = ts * static_cast<double>(k);
            const Complex turn = std::polar(1.0, 2 * pi * frequency * t + phase);
            sine.u[k] = (amplitude / std::abs(true_response) * turn).real();
            const double mode = 300 * std::exp(-t / 0.1) * std::cos(2 * pi * 82.2 * t + other);
            const double moved = amplitude / std::abs(true_response) * (true_response * turn).real() + mode;
            sine.y[k] = std::round(moved / step) * step;
        }
        const MeasuredSignals signals{ts, sine.u, sine.y, {sine.u}, step};
        const auto point = merged(sine_observations(signals, {sine.segment}, {})).at(0).at(0);
        const Complex error = std::log(point.value / true_response);
        covered += std::abs(error.real()) < 1.96 * std::sqrt(point.variance / 2);
        covered += std::abs(error.imag()) < 1.96 * std::sqrt(point.variance / 2);
        squares += std::norm(error) / records;
        variances += point.variance / records;
    }
    EXPECT_GT(covered, 0.90 * 2 * records);
    EXPECT_LT(squares / variances, 1.3);
    EXPECT_GT(squares / variances, 0.4);
}

// y = first-order lag of u, plus a cubic part of the lag's output, with noise; odd random-phase multisine with every fourth odd line
// left out.
struct Multisine {
    static constexpr std::size_t period = 2048;
    std::vector<double> u, y;
    std::vector<Complex> response; // true, of lines

    Multisine(double cubic, double noise, std::uint64_t seed, std::size_t periods = 4) : response(period / 2) {
        const double pole = 0.9;
        for (std::size_t l = 1; l < response.size(); ++l) {
            const Complex z = std::polar(1.0, 2 * pi * static_cast<double>(l) / period);
            response[l] = (1 - pole) / (1.0 - pole / z);
        }
        std::vector<double> one(period), steady(period);
        for (std::size_t l = 11; l < 300; l += 2) {
            if (l % 8 == 3) continue;
            const Complex phase = std::polar(1.0, 2 * pi * uniform(seed, 1, l));
            for (std::size_t k = 0; k < period; ++k) {
                const Complex turn = phase * std::polar(1.0, 2 * pi * static_cast<double>(l * k % period) / period);
                one[k] += 0.1 * turn.real();
                steady[k] += 0.1 * (response[l] * turn).real();
            }
        }
        for (std::size_t k = 0; k < periods * period; ++k) {
            const double x = steady[k % period];
            u.push_back(one[k % period]);
            y.push_back(x + cubic * x * x * x + noise * standard_normal(seed, 2, k));
        }
    }

    std::vector<Observation> observations() const {
        return multisine_observations({ts, u, y, {u}, 0}, period, "record");
    }

    // How many of the values the 95 % bounds cover.
    double covered() const {
        double inside = 0, values = 0;
        const auto points = merged(observations()).at(0);
        for (const auto& point : points) {
            const auto line = static_cast<std::size_t>(std::lround(point.frequency_hz * ts * period));
            const Complex error = std::log(point.value / response[line]);
            inside += std::abs(error.real()) < 1.96 * std::sqrt(point.variance / 2);
            inside += std::abs(error.imag()) < 1.96 * std::sqrt(point.variance / 2);
            values += 2;
        }
        return inside / values;
    }
};

TEST(MeasuredResponse, BoundsOfAMultisineCoverTheTruth) {
    double covered = 0;
    for (std::uint64_t seed = 0; seed < 10; ++seed) covered += Multisine(0, 0.02, seed).covered() / 10;
    EXPECT_GT(covered, 0.90);
    EXPECT_LT(covered, 0.99);
}

// An axis that moves or drifts: the ramp leaks into each period alike, so the periods do not differ by it.
TEST(MeasuredResponse, BoundsOfAMultisineOnARampCoverTheTruth) {
    for (const double slope : {1e-5, 1e-3, 0.1}) {
        double covered = 0;
        for (std::uint64_t seed = 0; seed < 10; ++seed) {
            Multisine record(0, 0.02, seed);
            for (std::size_t k = 0; k < record.y.size(); ++k) record.y[k] += slope * static_cast<double>(k);
            covered += record.covered() / 10;
        }
        EXPECT_GT(covered, 0.90) << slope;
        EXPECT_LT(covered, 0.99) << slope;
    }
    // A drift that is no line changes from period to period.
    double covered = 0;
    for (std::uint64_t seed = 0; seed < 40; ++seed) {
        Multisine record(0, 0.02, seed, 8);
        double walk = 0;
        for (std::size_t k = 0; k < record.y.size(); ++k) record.y[k] += walk += 0.02 * standard_normal(seed, 3, k);
        covered += record.covered() / 40;
    }
    EXPECT_GT(covered, 0.90);
}

TEST(MeasuredResponse, TellsOddDistortionFromNoiseAndEven) {
    const auto level = [](double cubic, double noise, bool odd) {
        const auto points = merged(Multisine(cubic, noise, 1).observations()).at(0);
        double sum = 0;
        for (const auto& point : points) {
            const double distortion = odd ? point.odd_distortion : point.even_distortion;
            sum += distortion * distortion;
        }
        return std::sqrt(sum / static_cast<double>(points.size()));
    };
    // In proportion to the cube; no even lines in it, and no noise.
    const double weak = level(0.1, 0, true), strong = level(0.2, 0, true);
    EXPECT_GT(weak, 1e-3);
    EXPECT_NEAR(strong / weak, 2, 0.2);
    EXPECT_LT(level(0.2, 0, false), 1e-9);
    EXPECT_NEAR(level(0.2, 1e-3, true) / strong, 1, 0.2);
}

TEST(MeasuredResponse, RealizationsDifferByTheStochasticDistortion) {
    std::vector<Observation> all;
    for (std::uint64_t seed = 0; seed < 6; ++seed) {
        const auto one = Multisine(0.2, 1e-3, seed).observations();
        all.insert(all.end(), one.begin(), one.end());
    }
    // From six realizations, and from the detection lines of one: the same within a factor of two.
    const auto many = merged(all).at(0), single = merged(Multisine(0.2, 1e-3, 0).observations()).at(0);
    double from_many = 0, from_one = 0;
    for (const auto& point : many) from_many += 6 * point.variance / static_cast<double>(many.size());
    for (const auto& point : single) from_one += point.variance / static_cast<double>(single.size());
    EXPECT_LT(std::abs(std::log(from_many / from_one)), std::log(2.0));
}

// Two records that hardly differ, as one whose last digits were rounded anew, do not hide the noise within each.
TEST(MeasuredResponse, RealizationsDoNotHideTheNoiseWithin) {
    Multisine record(0, 0.02, 1);
    auto all = record.observations();
    for (double& y : record.y) y = std::round(y * 1e6) / 1e6;
    const auto again = record.observations();
    const auto once = merged(all).at(0);
    all.insert(all.end(), again.begin(), again.end());
    const auto twice = merged(all).at(0);
    double before = 0, after = 0;
    for (std::size_t i = 0; i < once.size(); ++i) {
        before += once[i].variance;
        after += twice[i].variance;
    }
    EXPECT_GT(after, 0.3 * before); // half of the noise, without the bound of the distortion
}

TEST(MeasuredResponse, CrossSpectraFindTheResponseUnderNoise) {
    std::vector<double> u, y;
    double x = 0;
    for (std::uint64_t k = 0; k < 60000; ++k) {
        u.push_back(standard_normal(1, 0, k));
        y.push_back(x + 0.05 * standard_normal(1, 1, k));
        x = 0.9 * x + 0.1 * u.back();
    }
    const auto points = cross_spectra({{ts, u, y, {u}, 0}}).at(0);
    int covered = 0, values = 0;
    for (const auto& point : points) {
        if (!point.missing.empty() || point.frequency_hz < 20) continue;
        const Complex z = std::polar(1.0, 2 * pi * point.frequency_hz * ts);
        const Complex error = std::log(point.value / (0.1 / (z - 0.9)));
        covered += std::abs(error.real()) < 1.96 * std::sqrt(point.variance / 2);
        covered += std::abs(error.imag()) < 1.96 * std::sqrt(point.variance / 2);
        values += 2;
    }
    EXPECT_GT(values, 1000);
    EXPECT_GT(covered, 0.88 * values);
    EXPECT_LT(covered, 0.99 * values);
}

// How many of the values of points above `low` the 95 % bounds cover, and the mean error of the logarithm of the gain.
struct Judged {
    double covered = 0, error = 0;
    int values = 0;
};

Judged judge(const std::vector<MeasuredPoint>& points, const std::function<Complex(double)>& truth, double low,
             double high) {
    Judged judged;
    for (const auto& point : points) {
        if (!point.missing.empty() || point.frequency_hz < low || point.frequency_hz > high) continue;
        const Complex error = std::log(point.value / truth(point.frequency_hz));
        judged.covered += std::abs(error.real()) < 1.96 * std::sqrt(point.variance / 2);
        judged.covered += std::abs(error.imag()) < 1.96 * std::sqrt(point.variance / 2);
        judged.error += error.real();
        ++judged.values;
    }
    judged.covered /= 2 * judged.values;
    judged.error /= judged.values;
    return judged;
}

// A chirp is at each frequency once, in windows that agree with one another whatever they leak.
TEST(MeasuredResponse, BoundsOfAChirpCoverTheTruth) {
    const double decay = std::exp(-2 * pi * 0.02 * 40 * ts), turn = 2 * pi * 40 * ts; // a mode at 40 Hz
    const auto truth = [&](double f) {
        const Complex z = std::polar(1.0, 2 * pi * f * ts);
        return 1.0 / (z * z - 2 * decay * std::cos(turn) * z + decay * decay);
    };
    for (const double noise : {0.0, 0.5}) {
        std::vector<double> u, y;
        double now = 0, before = 0;
        constexpr std::size_t samples = 37000; // whole windows leave samples at the end
        for (std::size_t k = 0; k < samples; ++k) {
            const double t = static_cast<double>(k) * ts, duration = samples * ts;
            u.push_back(std::sin(2 * pi * (2 * t + (250 - 2) / (2 * duration) * t * t)));
            y.push_back(now + noise * standard_normal(3, 0, k));
            const double next = 2 * decay * std::cos(turn) * now - decay * decay * before + u.back();
            before = now;
            now = next;
        }
        // y[k] = now: two samples after u it is 1/(z^2 - ...) times z.
        const auto points = cross_spectra({{ts, u, y, {u}, 0}}).at(0);
        const auto late = [&](double f) { return truth(f) * std::polar(1.0, 2 * pi * f * ts); };
        EXPECT_GT(judge(points, late, 5, 200).covered, 0.93) << noise;
        const Judged end = judge(points, late, 200, 248);
        EXPECT_GT(end.values, 50);
        EXPECT_GT(end.covered, 0.93) << noise;
    }
}

// y = 2 u and noise, both white.
struct WhiteNoise {
    std::vector<double> u, y;

    WhiteNoise(std::size_t samples, double noise, std::uint64_t seed) {
        for (std::size_t k = 0; k < samples; ++k) {
            u.push_back(standard_normal(seed, 0, k));
            y.push_back(2 * u.back() + noise * standard_normal(seed, 1, k));
        }
    }
    std::vector<MeasuredPoint> points(std::size_t window = 0) const {
        return cross_spectra({{ts, u, y, {u}, 0}}, window).at(0);
    }
    Judged judged(std::size_t window = 0) const {
        return judge(
            points(window), [](double) { return 2.0; }, 0, 1 / ts);
    }
};

TEST(MeasuredResponse, CrossSpectraOfFewWindowsAreAsUncertainAsTheyAre) {
    EXPECT_THROW(WhiteNoise(4096, 3, 1).points(4096), InputError);
    EXPECT_THROW(WhiteNoise(4096, 3, 1).points(3000), InputError);
    for (const std::size_t window : {512u, 1024u, 2048u}) {
        double covered = 0;
        for (std::uint64_t seed = 0; seed < 10; ++seed)
            covered += WhiteNoise(4096, 0.3, seed).judged(window).covered / 10;
        EXPECT_GT(covered, 0.92) << window;
        EXPECT_LT(covered, 0.98) << window;
    }
}

// With noise near the limit, values that it made larger are not preferred.
TEST(MeasuredResponse, ValuesAreNotChosenByTheirLuck) {
    double error = 0, covered = 0, values = 0, lines = 0;
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
        const WhiteNoise record(4096, 2, seed);
        const Judged judged = record.judged();
        lines += static_cast<double>(record.points().size());
        values += judged.values;
        error += judged.error * judged.values;
        covered += judged.covered * judged.values;
    }
    EXPECT_GT(values / lines, 0.7);
    EXPECT_NEAR(error / values, 0, 0.02);
    EXPECT_GT(covered / values, 0.92);
    // Above the limit few lines have a value, and those are not too large.
    values = lines = error = 0;
    for (std::uint64_t seed = 0; seed < 40; ++seed) {
        const WhiteNoise record(4096, 3, seed);
        const Judged judged = record.judged();
        lines += static_cast<double>(record.points().size());
        values += judged.values;
        if (judged.values > 0) error += judged.error * judged.values;
    }
    EXPECT_LT(values / lines, 0.2);
    EXPECT_NEAR(error / values, 0, 0.08);
}

TEST(MeasuredResponse, NoiseIsNoExcitedLine) {
    for (const std::size_t periods : {2u, 3u}) {
        for (std::uint64_t seed = 0; seed < 10; ++seed) {
            Multisine record(0, 1e-3, seed, periods);
            for (std::size_t k = 0; k < record.u.size(); ++k) record.u[k] += 0.02 * standard_normal(seed, 5, k);
            for (const auto& o : record.observations()) {
                EXPECT_LT(o.frequency_hz * ts * Multisine::period, 300) << periods << " periods";
            }
        }
    }
}

// A binary sequence has lines up to half the sampling rate: those that cannot be told from their aliases are left out.
TEST(MeasuredResponse, LinesAboveTheLimitAreLeftOut) {
    constexpr std::size_t period = 511;
    const auto measured = [](auto&& excitation) {
        std::vector<double> u, y;
        for (std::size_t k = 0; k < 4 * period; ++k) u.push_back(excitation(k % period));
        for (const double value : u) y.push_back(0.5 * value);
        return merged(multisine_observations({ts, u, y, {u}, 0}, period, "record")).at(0);
    };
    const auto points = measured([](std::size_t k) { return uniform(1, 2, k) < 0.5 ? -1.0 : 1.0; });
    EXPECT_GT(points.size(), 200u);
    EXPECT_LE(points.back().frequency_hz, 0.45 / ts);
    EXPECT_NEAR(std::abs(points.front().value), 0.5, 1e-9);
    const auto high = [](std::size_t k) {
        const double turn = 2 * pi * static_cast<double>(k) / period;
        return std::sin(240 * turn) + std::sin(250 * turn);
    };
    EXPECT_THROW(measured(high), InputError);
}

} // namespace
} // namespace tribode
