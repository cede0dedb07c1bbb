#include "tribode/analysis/excitation.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode {
namespace {

using std::numbers::pi;
constexpr double ts = 5e-4;

struct Step {
    double frequency_hz, amplitude, phase, duration;
};

std::vector<double> stepped(const std::vector<Step>& steps, double noise = 0) {
    std::vector<double> x;
    for (const auto& step : steps) {
        const auto count = std::lround(step.duration / ts);
        for (long k = 0; k < count; ++k) {
            const double turn = 2 * pi * step.frequency_hz * static_cast<double>(k) * ts + step.phase;
            x.push_back(step.amplitude * std::sin(turn) + noise * standard_normal(7, 0, x.size()));
        }
    }
    return x;
}

// In any order, with jumps of the phase, near neighbors, another amplitude and a pause.
const std::vector<Step> plan = {{190, 15, 0.3, 0.4}, {10.476190476190476, 15, 0, 1.2},
                                {47, 3, 2, 0.5},     {47.5, 3, 1, 0.7},
                                {1, 0, 0, 0.2},      {700, 15, 0, 0.3},
                                {3, 15, 1, 2}};

TEST(Excitation, FindsSingleSinesInAnyOrder) {
    const auto x = stepped(plan);
    const auto found = recognize_excitation(x, ts, "record");
    ASSERT_EQ(found.kind, ExcitationKind::stepped_sine);
    ASSERT_EQ(found.segments.size(), 6u);
    std::size_t next = 0, first = 0;
    for (const auto& step : plan) {
        const auto count = static_cast<std::size_t>(std::lround(step.duration / ts));
        if (step.amplitude > 0) {
            const auto& segment = found.segments[next++];
            EXPECT_NEAR(segment.frequency_hz, step.frequency_hz, 1e-10 * step.frequency_hz);
            EXPECT_NEAR(segment.amplitude, step.amplitude, 1e-9);
            // All but a few periods at the beginning and one at the end.
            const double period = 1 / (step.frequency_hz * ts);
            EXPECT_NEAR(static_cast<double>(segment.first), static_cast<double>(first), 3 * period + 32);
            EXPECT_NEAR(static_cast<double>(segment.first + segment.count), static_cast<double>(first + count),
                        period + 8);
        }
        first += count;
    }
}

TEST(Excitation, FollowsASineToTheLastSample) {
    const auto x = stepped({{33, 15, 0, 1.0}});
    const auto found = recognize_excitation(x, ts, "record");
    ASSERT_EQ(found.segments.size(), 1u);
    EXPECT_EQ(found.segments[0].first, 0u);
    EXPECT_EQ(found.segments[0].count, x.size());
    EXPECT_EQ(found.segments[0].frequency_hz, 33);
}

TEST(Excitation, FindsThemUnderNoise) {
    const auto found = recognize_excitation(stepped(plan, 0.15), ts, "record");
    ASSERT_EQ(found.kind, ExcitationKind::stepped_sine);
    for (const auto& step : plan) {
        if (step.amplitude == 0) continue;
        EXPECT_TRUE(std::ranges::any_of(found.segments, [&](const SineSegment& segment) {
            return std::abs(segment.frequency_hz - step.frequency_hz) < 0.02 / step.duration;
        })) << step.frequency_hz;
    }
}

TEST(Excitation, AChirpAndNoiseAreBroadband) {
    std::vector<double> chirp, noise;
    for (int k = 0; k < 20000; ++k) {
        const double t = k * ts;
        chirp.push_back(std::sin(2 * pi * (5 * t + 195.0 / 20 * t * t)));
        noise.push_back(standard_normal(3, 0, static_cast<std::uint64_t>(k)));
    }
    EXPECT_EQ(recognize_excitation(chirp, ts, "record").kind, ExcitationKind::broadband);
    EXPECT_EQ(recognize_excitation(noise, ts, "record").kind, ExcitationKind::broadband);
}

std::vector<double> multisine(double period, std::size_t samples) {
    std::vector<double> x;
    for (std::size_t k = 0; k < samples; ++k) {
        double sum = 0;
        for (int line = 5; line < 200; line += 2) {
            sum += std::cos(2 * pi * line * static_cast<double>(k) / period + line * line * 0.7);
        }
        x.push_back(sum);
    }
    return x;
}

TEST(Excitation, FindsThePeriodOfAMultisine) {
    for (const std::size_t samples : {4000u, 5333u, 12000u}) {
        const auto found = recognize_excitation(multisine(2000, samples), ts, "record");
        EXPECT_EQ(found.kind, ExcitationKind::multisine);
        EXPECT_EQ(found.period, 2000u);
    }
}

std::string refusal(const std::vector<double>& x) {
    try {
        recognize_excitation(x, ts, "record");
    } catch (const InputError& problem) {
        return problem.what();
    }
    return "";
}

TEST(Excitation, RefusesWhatHasNoWholePeriodsOrNothing) {
    EXPECT_NE(refusal(multisine(2000, 3200)).find("needs whole periods, two at least"), std::string::npos);
    EXPECT_NE(refusal(multisine(2000.3, 12000)).find("a whole number of samples"), std::string::npos);
    EXPECT_NE(refusal(std::vector<double>(1000, 2.0)).find("is constant"), std::string::npos);
}

} // namespace
} // namespace tribode
