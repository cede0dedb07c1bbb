// The golden files are what the exact servo gives today: neither may drift away from the other.
#include "problems/golden_runs.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <gtest/gtest.h>
#include <sstream>

namespace tribode::problems {
namespace {

std::vector<std::vector<std::string>> read_cells(const std::string& file) {
    std::ifstream stream(TRIBODE_SOURCE_DIR "/tests/golden/" + file);
    EXPECT_TRUE(stream) << file;
    std::vector<std::vector<std::string>> rows;
    for (std::string line, cell; std::getline(stream, line);) {
        rows.emplace_back();
        for (std::istringstream cells(line); std::getline(cells, cell, ',');) rows.back().push_back(cell);
    }
    return rows;
}

// Where the significand of long double has 64 bits the files come out to the byte. 1e-12 of the largest value
// leaves room for 53 bits, and is far below what any change of the equations would do.
void expect_same_trace(const GoldenRun& run) {
    const auto rows = read_cells(run.name + ".csv");
    ASSERT_EQ(rows.size(), run.columns.front().second.size() + 1);
    for (std::size_t c = 0; c < run.columns.size(); ++c) {
        const auto& [name, values] = run.columns[c];
        EXPECT_EQ(rows[0].at(c), name);
        double largest = 0.0;
        for (double value : values) largest = std::max(largest, std::abs(value));
        ASSERT_GT(largest, 0.0) << name;
        for (std::size_t k = 0; k < values.size(); ++k)
            EXPECT_NEAR(std::stod(rows[k + 1].at(c)), values[k], 1e-12 * largest) << name << ", row " << k;
    }
}

// An event where v falls slowly depends on v/a: times may be off by 1e-13 s where long double is double.
void expect_same_events(const GoldenRun& run) {
    const auto rows = read_cells(run.name + "_events.csv");
    ASSERT_EQ(rows.size(), run.events.size() + 1);
    for (std::size_t i = 0; i < run.events.size(); ++i) {
        const auto& event = run.events[i];
        EXPECT_NEAR(std::stod(rows[i + 1].at(0)), event.t, 1e-13);
        EXPECT_EQ(rows[i + 1].at(1), std::to_string(event.element));
        EXPECT_EQ(rows[i + 1].at(2), to_string(event.kind));
    }
}

TEST(GoldenRuns, the_exact_servo_gives_the_golden_files) {
    for (const auto& run : golden_runs()) {
        SCOPED_TRACE(run.name);
        expect_same_trace(run);
        expect_same_events(run);
    }
}

// 40-digit arithmetic by another program counted the same changes; the counts are those of
// tests/golden/README.md.
TEST(GoldenRuns, the_event_files_have_the_counts_of_the_40_digit_program) {
    const auto count = [](const std::string& file, bool sticks) {
        const auto rows = read_cells(file);
        return std::count_if(rows.begin() + 1, rows.end(),
                             [&](const auto& row) { return (row.at(2) == "stick") == sticks; });
    };
    EXPECT_EQ(count("g1_events.csv", false), 173);
    EXPECT_EQ(count("g1_events.csv", true), 156);
    EXPECT_EQ(count("g2_events.csv", false), 540);
    EXPECT_EQ(count("g2_events.csv", true), 524);
}

} // namespace
} // namespace tribode::problems
