#include "tribode/analysis/spectral_estimate.hpp"
#include "tribode/base/error.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>

namespace tribode {
namespace {

constexpr double ts = 1e-3; // [s]

std::vector<double> white(std::size_t samples, double rms, unsigned seed) {
    std::mt19937 generator(seed);
    std::normal_distribution<double> normal(0, rms);
    std::vector<double> x(samples);
    for (auto& value : x) value = normal(generator);
    return x;
}

// y = b x + a y before it: the response b/(1 - a/z).
std::vector<double> filtered(const std::vector<double>& x, double b, double a) {
    std::vector<double> y(x.size());
    for (std::size_t k = 0; k < x.size(); ++k) y[k] = b * x[k] + (k > 0 ? a * y[k - 1] : 0);
    return y;
}

std::complex<double> response(double b, double a, double frequency_hz) {
    return b / (1.0 - a * std::polar(1.0, -2 * std::numbers::pi * frequency_hz * ts));
}

TEST(SpectralEstimate, PowerOfWhiteNoiseIsItsVarianceOverHalfTheRate) {
    for (const char* window : {"hann", "hamming", "blackman_harris", "flat_top", "rectangular"}) {
        SpectrumOptions options{.sample_time = ts, .window = window, .window_samples = 256};
        const auto estimate = spectral_estimate({}, white(100000, 3, 1), options);
        double mean = 0;
        for (std::size_t l = 4; l < estimate.power.size(); ++l) mean += estimate.power[l];
        mean /= static_cast<double>(estimate.power.size() - 4);
        EXPECT_NEAR(mean / (9.0 / 500), 1, 0.02) << window;
        // The bounds hold at about 95 % of the lines.
        double inside = 0;
        for (std::size_t l = 4; l < estimate.power.size(); ++l) {
            inside += estimate.power[l] * estimate.power_low < 9.0 / 500 &&
                      estimate.power[l] * estimate.power_high > 9.0 / 500;
        }
        inside /= static_cast<double>(estimate.power.size() - 4);
        EXPECT_GT(inside, 0.88) << window;
        EXPECT_LT(estimate.power_high - estimate.power_low, 0.6) << window;
    }
}

TEST(SpectralEstimate, ASineHasItsMeanSquareInItsLine) {
    std::vector<double> x(8192);
    for (std::size_t k = 0; k < x.size(); ++k) {
        x[k] = 7 + 2 * std::sin(2 * std::numbers::pi * 125 * ts * static_cast<double>(k));
    }
    for (const char* window : {"hann", "flat_top", "blackman_harris", "rectangular"}) {
        SpectrumOptions options{.sample_time = ts, .window = window, .window_samples = 1024, .detrend = "mean"};
        const auto estimate = spectral_estimate({}, x, options);
        EXPECT_DOUBLE_EQ(estimate.frequency_hz[127], 125);
        EXPECT_NEAR(estimate.power[127] * estimate.bandwidth, 2, 2e-5) << window;
    }
}

// The known response, and standard errors that are what repetition says.
TEST(SpectralEstimate, ResponseAndItsErrorsAreTrue) {
    const SpectrumOptions options{.sample_time = ts, .window_samples = 512};
    double square = 0, below = 0, count = 0;
    for (unsigned seed = 1; seed <= 40; ++seed) {
        const auto x = white(20000, 1, seed), noise = white(20000, 1, 1000 + seed);
        auto y = filtered(x, 0.3, 0.7);
        for (std::size_t k = 0; k < y.size(); ++k) y[k] += noise[k];
        const auto estimate = spectral_estimate({x}, y, options);
        const auto& input = estimate.inputs.front();
        for (std::size_t l = 4; l < 200; l += 4, ++count) {
            const auto truth = response(0.3, 0.7, estimate.frequency_hz[l]);
            const double z = std::log(std::abs(input.h1[l] / truth)) / input.standard_deviation[l];
            square += z * z;
            below += std::abs(z) < 1.96;
        }
        // Noise in the output only: h1 is right, h2 too large by 1/coherence, hv between them.
        EXPECT_NEAR(std::abs(input.h1[20] / input.h2[20]), estimate.coherence[20], 1e-12);
        EXPECT_NEAR(std::norm(input.hv[20] / input.h1[20]), 1 / estimate.coherence[20], 1e-9);
    }
    EXPECT_NEAR(std::sqrt(square / count), 1, 0.06);
    EXPECT_NEAR(below / count, 0.95, 0.015);
}

TEST(SpectralEstimate, CoherenceByChanceIsBelowTheThreshold) {
    const SpectrumOptions options{.sample_time = ts, .window_samples = 128};
    for (const std::size_t count : {1u, 3u, 6u}) {
        double below = 0, lines = 0;
        for (std::uint64_t set = 0; set < 8; ++set) {
            std::vector<std::vector<double>> inputs;
            for (std::uint64_t i = 0; i < count; ++i) inputs.push_back(white(10000, 1, 100 * set + i));
            const auto estimate = spectral_estimate(inputs, white(10000, 1, 100 * set + 99), options);
            for (const double c : estimate.coherence) below += c < estimate.coherence_threshold;
            lines += static_cast<double>(estimate.coherence.size());
        }
        EXPECT_NEAR(below / lines, 0.95, 0.02) << count << " inputs";
    }
}

// Two correlated inputs: each alone explains a part, both all but the noise, and the shares come apart.
TEST(SpectralEstimate, SeveralInputsComeApart) {
    const std::size_t samples = 60000;
    const auto a = white(samples, 1, 7), own = white(samples, 1, 8), noise = white(samples, 0.1, 9);
    std::vector<double> b(samples), y(samples);
    const auto by_a = filtered(a, 0.5, 0.5);
    for (std::size_t k = 0; k < samples; ++k) b[k] = 0.7 * a[k] + own[k];
    const auto by_b = filtered(b, 1, -0.3);
    for (std::size_t k = 0; k < samples; ++k) y[k] = by_a[k] + by_b[k] + noise[k];
    const auto estimate = spectral_estimate({a, b}, y, {.sample_time = ts, .window_samples = 512});
    for (const std::size_t l : {20u, 100u, 200u}) {
        const double f = estimate.frequency_hz[l];
        EXPECT_NEAR(std::abs(estimate.inputs[0].h1[l] / response(0.5, 0.5, f) - 1.0), 0,
                    4 * estimate.inputs[0].standard_deviation[l]);
        EXPECT_NEAR(std::abs(estimate.inputs[1].h1[l] / response(1, -0.3, f) - 1.0), 0,
                    4 * estimate.inputs[1].standard_deviation[l]);
        EXPECT_LT(estimate.inputs[0].standard_deviation[l], 0.03);
        EXPECT_GT(estimate.coherence[l], 0.97);
        EXPECT_LT(estimate.inputs[0].coherence[l], 0.85);
        EXPECT_LT(estimate.inputs[1].coherence[l], 0.97);
        EXPECT_NEAR(estimate.noise[l] / (0.01 / 500), 1, 0.5);
    }
    EXPECT_TRUE(estimate.inputs[0].h2.empty());
}

std::string refusal(const std::vector<std::vector<double>>& inputs, const std::vector<double>& output,
                    const SpectrumOptions& options) {
    try {
        spectral_estimate(inputs, output, options);
    } catch (const InputError& error) {
        return error.what();
    }
    return "";
}

TEST(SpectralEstimate, RefusesWhatHasNoAnswer) {
    const auto x = white(1000, 1, 1), y = white(1000, 1, 2);
    SpectrumOptions options{.sample_time = ts, .window_samples = 100};
    EXPECT_NE(refusal({white(10, 1, 1)}, y, options).find("input 1 has 10 samples, must have 1000"), std::string::npos);
    EXPECT_NE(refusal({x, x}, y, options).find("the inputs are linearly dependent"), std::string::npos);
    EXPECT_NE(refusal({std::vector<double>(1000)}, y, options).find("input 1 has nothing at"), std::string::npos);
    options.window_samples = 501;
    EXPECT_NE(refusal({x}, y, options).find("the record two of them"), std::string::npos);
    options = {.sample_time = ts, .window_samples = 500, .overlap = 0};
    EXPECT_NE(refusal({x, y}, y, options).find("more windows than inputs"), std::string::npos);
    options.overlap = 0.99;
    EXPECT_NE(refusal({x}, y, options).find("must be 0.95 at most"), std::string::npos);
}

} // namespace
} // namespace tribode
