#include "tribode/base/random.hpp"
#include "tribode/diagnosis/record_defects.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <memory>

namespace tribode {
namespace {

// A motion with noise of 0.01 at even instants.
struct Motion {
    std::vector<double> t, y;

    Motion() {
        for (std::size_t k = 0; k < 600; ++k) {
            t.push_back(0.02 * static_cast<double>(k));
            y.push_back(std::sin(2 * t[k]) + 0.01 * standard_normal(3, 1, k));
        }
    }
};

TEST(RecordDefects, SamplesThatStandApartAlone) {
    Motion m;
    EXPECT_TRUE(isolated_samples(m.t, m.y).empty());
    m.y[100] += 1;
    m.y[300] -= 5;
    m.y[301] -= 5; // not alone
    m.y[500] = 0;
    EXPECT_EQ(isolated_samples(m.t, m.y), (std::vector<std::size_t>{100, 500}));
}

// Events of a motion are none, whether there is noise or not: kinks, jumps and short pulses, and steps of an encoder.
TEST(RecordDefects, WhatAMotionDoesStays) {
    for (const double noise : {0.0, 1.0}) {
        Motion m;
        for (std::size_t k = 0; k < 600; ++k) {
            const double s = m.t[k];
            m.y[k] = noise * (m.y[k] - std::sin(2 * s)) + std::sin(2 * s) + 20 * std::abs(s - 4.01) +
                     10 * std::max(s - 7, 0.0) * (s - 7) + (s > 9.001 ? 3 : 0) + (k == 520 || k == 521 ? 2 : 0);
        }
        EXPECT_TRUE(isolated_samples(m.t, m.y).empty());
        for (double& y : m.y) y = 0.25 * std::round(y / 0.25);
        EXPECT_TRUE(isolated_samples(m.t, m.y).empty());
    }
}

TEST(RecordDefects, ManyOfThemBelongToTheSignal) {
    Motion m;
    for (std::size_t k = 10; k < 590; k += 50) m.y[k] += 2;
    EXPECT_TRUE(isolated_samples(m.t, m.y).empty());
}

// x' = u - x.
struct Lag {
    SystemModel model;
    SystemRecord record{.source = "a.csv"};

    Lag() {
        auto& e = model.equations;
        e.graph = std::make_shared<Expressions>();
        const Motion m;
        const Term x = e.graph->variable("x"), u = e.graph->variable("u");
        e.states.push_back({.name = "x", .symbol = x, .rate = e.graph->make(Op::subtract, u, x)});
        e.inputs.push_back({.name = "u", .symbol = u});
        e.outputs.push_back({"x_measured", "", x});
        model.measured = {0};
        model.starts = {0};
        record.t = m.t;
        record.inputs = {m.y};
        record.outputs = {m.y};
    }
};

TEST(RecordDefects, ReplacedByTheirNeighboursUnlessAnInputDoesSo) {
    Lag lag;
    const double before = lag.record.outputs[0][100];
    lag.record.outputs[0][100] += 1;
    lag.record.outputs[0][200] += 1;
    lag.record.inputs[0][199] += 1;
    std::vector<std::string> remarks;
    const auto parts = without_defects(lag.record, lag.model, remarks);
    ASSERT_EQ(parts.size(), 1u);
    EXPECT_NEAR(parts[0].outputs[0][100], before, 0.05);
    EXPECT_EQ(parts[0].outputs[0][200], lag.record.outputs[0][200]);
    EXPECT_EQ(parts[0].inputs, lag.record.inputs);
    ASSERT_EQ(remarks.size(), 1u);
    EXPECT_EQ(remarks[0],
              "a.csv: one sample of x stands apart from its neighbours alone, as errors of a sensor do, at t = 2 s; "
              "what runs through the neighbours takes its place.");
}

TEST(RecordDefects, BehindAGapARecordBegins) {
    Lag lag;
    for (std::size_t k = 200; k < 600; ++k) lag.record.t[k] += 1.5;
    std::vector<std::string> remarks;
    const auto parts = without_defects(lag.record, lag.model, remarks);
    ASSERT_EQ(parts.size(), 2u);
    EXPECT_EQ(parts[0].size(), 200u);
    EXPECT_EQ(parts[1].t.front(), lag.record.t[200]);
    EXPECT_EQ(parts[1].source, "a.csv from t = 5.5 s");
    ASSERT_EQ(remarks.size(), 1u);
    EXPECT_NE(remarks[0].find("nothing was recorded for 1.52 s from t = 3.98 s on"), std::string::npos) << remarks[0];
    // What would begin there is not free.
    remarks.clear();
    lag.model.starts.clear();
    EXPECT_EQ(without_defects(lag.record, lag.model, remarks).size(), 1u);
    ASSERT_EQ(remarks.size(), 1u);
    EXPECT_NE(remarks[0].find("x.start is not free"), std::string::npos) << remarks[0];
    // Without inputs nothing is unknown, and rows that come as they come have no gaps.
    remarks.clear();
    lag.model.starts = {0};
    auto free_motion = lag.record;
    free_motion.inputs = {{}};
    EXPECT_EQ(without_defects(free_motion, lag.model, remarks).size(), 1u);
    for (std::size_t k = 0; k < 600; ++k) lag.record.t[k] = 0.02 * static_cast<double>(k + 9 * (k / 4));
    EXPECT_EQ(without_defects(lag.record, lag.model, remarks).size(), 1u);
    EXPECT_TRUE(remarks.empty());
}

// A clock that jitters by less than half a period: each value of an input acts from the instant that is nearest to its own, none a
// period late.
TEST(RecordDefects, JitterDelaysNoInput) {
    Lag lag;
    auto even = lag.record;
    for (std::size_t k = 1; k < 600; ++k) lag.record.t[k] += 0.004 * std::sin(7 * static_cast<double>(k));
    const auto held = input_of(lag.record, 0, Interpolation::hold), exact = input_of(even, 0, Interpolation::hold);
    EXPECT_NEAR(held.period, 0.02, 2e-5);
    for (std::size_t k = 0; k < 599; ++k) EXPECT_EQ(held.pieces[k][0], exact.pieces[k][0]) << k;
}

} // namespace
} // namespace tribode
