#include "tribode/diagnosis/disagreement.hpp"
#include "tribode/diagnosis/noise_floor.hpp"
#include "unit/diagnosis/small_case.hpp"

#include <algorithm>
#include <gtest/gtest.h>

namespace tribode {
namespace {

using namespace diagnosis_cases;

constexpr double two_pi = 2 * std::numbers::pi;

// Ten rounds of a circle in position and velocity, with the force that `force` gives of time, position and velocity.
ResidualForce around(const std::function<double(double t, double x, double v)>& force) {
    ResidualForce r;
    r.sample_time = 1e-3;
    r.bandwidth = 200;
    for (int k = 0; k < 10000; ++k) {
        const double t = k * 1e-3;
        r.time.push_back(t);
        r.position.push_back(0.01 * std::sin(two_pi * t));
        r.velocity.push_back(0.01 * two_pi * std::cos(two_pi * t));
        r.force.push_back(force(t, r.position.back(), r.velocity.back()));
    }
    return r;
}

TEST(Disagreement, AMapOverMotionTellsPlaceAndDirectionApart) {
    const ForceMap map = force_over_motion(around([](double, double x, double v) { return v > 0 ? 200 * x : -1.5; }));
    const std::size_t columns = map.x_edges.size() - 1;
    ASSERT_EQ(map.values.size(), columns * (map.y_edges.size() - 1));
    EXPECT_NEAR(map.x_edges.front(), -0.01, 1e-6);
    EXPECT_NEAR(map.y_edges.back(), 0.01 * two_pi, 1e-6);
    std::size_t visited = 0;
    for (std::size_t i = 0; i < map.values.size(); ++i) {
        const std::size_t column = i % columns, row = i / columns;
        if (!std::isfinite(map.values[i])) continue;
        ++visited;
        if (map.y_edges[row] >= 0) {
            EXPECT_GE(map.values[i], 200 * map.x_edges[column] - 1e-9);
            EXPECT_LE(map.values[i], 200 * map.x_edges[column + 1] + 1e-9);
        } else if (map.y_edges[row + 1] <= 0) {
            EXPECT_NEAR(map.values[i], -1.5, 1e-9);
        }
    }
    // The cells that a circle crosses, not those within.
    EXPECT_GT(visited, 100u);
    EXPECT_LT(visited, 300u);
}

TEST(Disagreement, AMapOverTimeAndFrequencyShowsWhenAndHowFast) {
    const ForceMap map = force_over_time_and_frequency(
        around([](double t, double, double) { return t > 5 ? 3 * std::sin(two_pi * 25 * t) : 0; }));
    const std::size_t columns = map.x_edges.size() - 1, rows = map.y_edges.size() - 1;
    ASSERT_EQ(map.values.size(), columns * rows);
    const auto row = static_cast<std::size_t>(std::upper_bound(map.y_edges.begin(), map.y_edges.end(), 25.0) -
                                              map.y_edges.begin() - 1);
    for (std::size_t column = 0; column < columns; ++column) {
        const double here = map.values[row * columns + column];
        if (map.x_edges[column + 1] < 4.7) {
            EXPECT_NEAR(here, 0, 1e-3);
        } else if (map.x_edges[column] > 5.3) {
            EXPECT_NEAR(here, 3, 0.2);
        }
        EXPECT_LT(map.values[(rows - 1) * columns + column], 0.05);
        EXPECT_LT(map.values[column], 0.3); // the lowest row
    }
}

TEST(Disagreement, RepetitionsTellTheNoiseFromTheData) {
    Json axis = small_axis();
    axis["noise_rms_m"] = 3e-7;
    const MachineModel machine = MachineModel::from_description(axis, "case");
    const auto measurement = [&](double frequency) {
        return measurement_from_table(measured(axis, Json::array(), sine_record(0.01, frequency, 4), 1), machine,
                                      "case");
    };
    const auto found = repetition_of(measurement(2));
    ASSERT_TRUE(found);
    EXPECT_NEAR(found->period, 0.5, 1e-9);
    // Noise of the sensor and what the loop makes of it.
    const auto floor = noise_floor(machine, measurement(2), {});
    EXPECT_NEAR(found->rms / floor->rms, 1, 0.1);
    EXPECT_FALSE(repetition_of(measurement(0.3))) << "not two periods";
    EXPECT_FALSE(repetition_of(measurement(std::sqrt(3.0)))) << "no period of whole samples";
}

} // namespace
} // namespace tribode
