#include "tribode/base/random.hpp"
#include "tribode/diagnosis/lane_fit.hpp"
#include "tribode/diagnosis/segments.hpp"
#include "tribode/diagnosis/system_comparison.hpp"
#include "tribode/diagnosis/system_fit.hpp"
#include "tribode/diagnosis/system_next_experiment.hpp"
#include "tribode/diagnosis/system_screening.hpp"
#include "tribode/diagnosis/system_search.hpp"
#include "tribode/diagnosis/thinned_records.hpp"
#include "tribode/script/system_file.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cmath>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <map>
#include <string>

namespace tribode {
namespace {

// A system of which all outputs are measured and all parameters and start values may move.
SystemModel model_of(const TemporaryFolder& folder, const std::string& text) {
    ScriptRequest request;
    request.script = folder.write("system.lua", "local tb = require \"tribode\"\nreturn tb.system {" + text + "}");
    request.folder = folder / "out";
    ScriptRun run(request, {});
    SystemModel model{.equations = system_of_file(run)};
    for (std::size_t o = 0; o < model.equations.outputs.size(); ++o) model.measured.push_back(o);
    for (std::size_t p = 0; p < model.equations.parameters.size(); ++p) {
        model.parameters.push_back({.place = p, .scale = std::abs(model.equations.parameters[p].value)});
    }
    for (std::size_t i = 0; i < model.equations.states.size(); ++i) model.starts.push_back(i);
    return model;
}

SystemRecord record_of(std::size_t samples, double step, const std::vector<double (*)(double)>& inputs) {
    SystemRecord record{.source = "a record"};
    for (std::size_t k = 0; k < samples; ++k) record.t.push_back(static_cast<double>(k) * step);
    for (const auto input : inputs) {
        record.inputs.emplace_back();
        for (const double t : record.t) record.inputs.back().push_back(input(t));
    }
    return record;
}

const auto never = [] { return false; };
const RunControl by_itself;

// Of a script with many systems each has the terms of all, until it gets a graph of its own: the same equations, and no more.
TEST(Equations, AGraphOfItsOwnHasWhatTheyNeedAlone) {
    const TemporaryFolder folder;
    const Equations all = model_of(folder, R"(
        inputs = { u = 0 }, states = { x = 0, v = 1 }, discrete = { n = 0 }, parameters = { k = 4, many = (function()
            for i = 1, 200 do tb.system { states = { x = i }, der = function(s) return { x = math.sin(i * s.x) - i } end } end
            return 1 end)() },
        parts = { f = tb.parts.coulomb { velocity = "v", level = 0.2, static = 0.3 } },
        der = function(s)
            local spring = tb.table1 { x = { 0, 1, 3 }, y = { 0, 2, 3 } }
            return { x = s.v, v = s.u - spring(s.x) - s.k * s.x + s.n - s.f.force - 0.1 * s.t }
        end,
        when = { { name = "far", crossing = function(s) return s.x - 2 end, set = function(s) return { v = -s.v } end } },
        sample = { { name = "count", period_s = 0.1, set = function(s) return { n = s.n + s.many } end } },
        outputs = function(s) return { y = tb.where(tb.less(s.x, s.k), s.x, s.v) } end)")
                              .equations;
    const Equations own = all.with_own_graph();
    EXPECT_GT(all.graph->size(), 800u);
    EXPECT_LT(own.graph->size(), 200u);
    EXPECT_EQ(own.fingerprint(), all.fingerprint());
    for (std::size_t i = 0; i < all.states.size(); ++i) {
        EXPECT_EQ(own.graph->text(own.states[i].rate), all.graph->text(all.states[i].rate));
        EXPECT_EQ(own.value_at_start(own.states[i].rate, std::vector{own.contacts[0].force}),
                  all.value_at_start(all.states[i].rate, std::vector{all.contacts[0].force}));
    }
    EXPECT_EQ(own.graph->name(own.contacts[0].force), "f.force");
}

// A force of a seal: the pressure is 1e5 Pa, the velocity 0.01 m/s. A column of 1e-7 of another must move as well.
TEST(SystemFit, ValuesOfAnyUnitMove) {
    const TemporaryFolder folder;
    const SystemModel model = model_of(folder, R"(
        parameters = { area = 4e-4, D = 1 }, inputs = { p = 0, v = 0 }, states = {}, der = function() return {} end,
        outputs = function(s) return { F = s.area * s.p + s.D * s.v } end)");
    auto record = record_of(
        300, 0.01, {[](double t) { return 3e5 + 1e5 * std::sin(t); }, [](double t) { return 0.01 * std::cos(5 * t); }});
    record.outputs.emplace_back();
    for (std::size_t k = 0; k < record.size(); ++k) {
        record.outputs[0].push_back(5.2e-4 * record.inputs[0][k] + 500 * record.inputs[1][k]);
    }
    const std::vector<SystemRecord> records = {record};
    const SystemFit fit(records, {50}, Interpolation::linear, {record.size()});
    const auto result = fit.fit(model, model.values(1), 20, never);
    ASSERT_EQ(result.values.size(), 2u);
    for (std::size_t i = 0; i < 2; ++i) {
        const bool is_area = model.equations.parameters[model.parameters[i].place].name == "area";
        EXPECT_NEAR(result.values[i], is_area ? 5.2e-4 : 500, is_area ? 1e-10 : 1e-3);
    }
}

// Rows of a system without states count at their own instants, however uneven.
TEST(SystemFit, RowsWithoutStatesAreTakenAsTheyAre) {
    const TemporaryFolder folder;
    const SystemModel model = model_of(folder, R"(
        parameters = { c = 2 }, inputs = { u = 0 }, states = {}, der = function() return {} end,
        outputs = function(s) return { y = s.c * s.u * s.u + s.t } end)");
    auto record = record_of(50, 0.1, {[](double t) { return std::sin(40 * t); }});
    for (std::size_t k = 20; k < 50; ++k) record.t[k] += 0.37;
    const std::vector<SystemRecord> records = {record};
    const auto trace =
        SystemFit(records, {1}, Interpolation::linear, {50}).simulate(model, model.values(1), 0, record.size());
    ASSERT_TRUE(trace);
    for (std::size_t k = 0; k < 50; ++k) {
        const double u = record.inputs[0][k];
        EXPECT_NEAR(trace->outputs[0][k], 2 * u * u + record.t[k], 1e-14) << k;
    }
}

// Times in a file are decimal numbers, of which the differences are off by rounding. A command that changes at an instant of the
// controller is the one that it sees there.
TEST(SystemFit, AClockSeesTheInputOfItsInstant) {
    const TemporaryFolder folder;
    const SystemModel model = model_of(folder, R"(
        inputs = { u = 0 }, states = { x = 0 }, discrete = { F = 0 },
        sample = { { period_s = 0.004, set = function(s) return { F = s.u } end } },
        der = function(s) return { x = (s.F - s.x) / 0.02 } end, outputs = function(s) return { y = s.x, held = s.F } end)");
    for (const double rounding : {0.0, 1e-8}) {
        SystemRecord record = record_of(400, 0.002, {[](double t) { return std::floor(t / 0.02 + 1e-9); }});
        for (std::size_t k = 0; k < record.size(); ++k) {
            record.t[k] = std::stod(fmt::format("{:.9g}", record.t[k])) + rounding * static_cast<double>(k % 3);
        }
        const std::vector<SystemRecord> records = {record};
        const SystemFit fit(records, {1, 1}, Interpolation::hold, {400});
        const auto trace = fit.simulate(model, model.values(1), 0, 400);
        ASSERT_TRUE(trace);
        double x = 0, held = 0;
        for (std::size_t k = 0; k < 400; ++k) {
            if (k % 2 == 0) held = record.inputs[0][k];
            ASSERT_EQ(trace->outputs[0][k], held) << k; // in the order of their names
            ASSERT_NEAR(trace->outputs[1][k], x, 1e-4) << k;
            x = held + (x - held) * std::exp(-0.1);
        }
    }
}

// A part of a record keeps its instants: inputs and what depends on the time itself are those of the whole.
TEST(SystemFit, APartOfARecordGoesOnAsTheWhole) {
    const TemporaryFolder folder;
    const SystemModel model = model_of(folder, R"(
        parameters = { a = 2 }, inputs = { u = 0 }, states = { x = 1 },
        der = function(s) return { x = s.u - s.a * s.x + math.sin(s.t) } end,
        outputs = function(s) return { y = s.x } end)");
    const auto record = record_of(200, 0.05, {[](double t) { return std::cos(2 * t); }});
    for (const auto between : {Interpolation::hold, Interpolation::linear}) {
        const std::vector<SystemRecord> whole = {record}, part = {record.part(70, 60)};
        ASSERT_EQ(part[0].size(), 60u);
        EXPECT_EQ(part[0].t.front(), record.t[70]);
        const auto all = SystemFit(whole, {1}, between, {200}).simulate(model, model.values(1), 0, 200);
        ASSERT_TRUE(all);
        const auto some = SystemFit(part, {1}, between, {60}).simulate(model, {2, all->states[0][70]}, 0, 60);
        ASSERT_TRUE(some);
        for (std::size_t k = 0; k < 60; ++k) EXPECT_NEAR(some->outputs[0][k], all->outputs[0][70 + k], 1e-6) << k;
    }
}

// x' = u - a x, y = x: a record of a = 2 with errors that are known.
struct NoisyLag {
    TemporaryFolder folder;
    SystemModel model = model_of(folder, R"(
        parameters = { a = 2 }, inputs = { u = 0 }, states = { x = 0 }, der = function(s) return { x = s.u - s.a * s.x } end,
        outputs = function(s) return { y = s.x } end)");
    std::vector<SystemRecord> records = {
        record_of(500, 0.05, {[](double t) { return std::sin(2 * t) + std::cos(0.7 * t); }})};

    NoisyLag() {
        const auto trace = SystemFit(records, {1}, Interpolation::hold, {500}).simulate(model, model.values(1), 0, 500);
        records[0].outputs = trace->outputs;
        for (std::size_t k = 0; k < 500; ++k) records[0].outputs[0][k] += 0.01 * standard_normal(1, 0, k);
    }
};

// The errors of a fit are those of a solver that controls its error. From errors in steps of one length they differ by more than the
// small moves of a difference quotient change.
TEST(SystemFit, StandardErrorsDoNotDependOnTheSolverOfTheErrors) {
    const NoisyLag lag;
    const SystemFit fit(lag.records, {1}, Interpolation::hold, {500});
    const auto result = fit.fit(lag.model, lag.model.values(1), 20, never);
    ASSERT_FALSE(result.errors.empty());
    const auto deviation = fit.standard_errors(lag.model, result.values, result.errors);
    // Errors that are off by far more than another solver's, and far less than the noise.
    auto others = result.errors;
    for (std::size_t k = 0; k < others.size(); ++k) others[k] += 1e-5 * std::cos(0.1 * static_cast<double>(k));
    const auto same = fit.standard_errors(lag.model, result.values, others);
    for (std::size_t i = 0; i < deviation.size(); ++i) EXPECT_NEAR(same[i], deviation[i], 0.01 * deviation[i]);
    EXPECT_NEAR(result.values[0], 2, 4 * deviation[0]);
    EXPECT_LT(deviation[0], 0.05);
}

// A force of a second's correlation beside the noise, and an input of which a part is slow and a part fast.
TEST(SystemFit, GeneralizedLeastSquaresComeNearerWhereARandomForceActs) {
    double squares = 0, of_least = 0, in_deviations = 0;
    constexpr std::uint64_t trials = 12;
    for (std::uint64_t seed = 1; seed <= trials; ++seed) {
        NoisyLag lag;
        std::vector<SystemRecord> forced = {
            record_of(500, 0.05, {[](double t) { return std::sin(4 * t) + std::cos(0.1 * t); }})};
        const SystemFit simulator(forced, {1}, Interpolation::hold, {500});
        const auto clean = simulator.simulate(lag.model, lag.model.values(1), 0, 500)->outputs;
        double force = 0;
        for (std::size_t k = 0; k < 500; ++k) {
            force = 0.95 * force + 0.05 * standard_normal(seed, 1, k);
            forced[0].inputs[0][k] += force;
        }
        forced[0].outputs = simulator.simulate(lag.model, lag.model.values(1), 0, 500)->outputs;
        for (std::size_t k = 0; k < 500; ++k) {
            const double t = 0.05 * static_cast<double>(k);
            forced[0].inputs[0][k] = std::sin(4 * t) + std::cos(0.1 * t); // the force was not measured
            forced[0].outputs[0][k] += 0.05 * standard_normal(seed, 0, k);
        }
        const SystemFit fit(forced, {1}, Interpolation::hold, {500});
        const auto least = fit.fit(lag.model, lag.model.values(1), 20, never);
        const auto general = fit.generalized(lag.model, least, never);
        const double deviation = fit.standard_errors(lag.model, general.values, general.errors)[0];
        squares += std::pow(general.values[0] - 2, 2);
        of_least += std::pow(least.values[0] - 2, 2);
        in_deviations += std::pow((general.values[0] - 2) / deviation, 2) / trials;
        EXPECT_GE(general.sum, least.sum);
        // About values that are not the best of this kind the bounds are wider.
        EXPECT_GE(fit.standard_errors(lag.model, least.values, least.errors)[0], 0.9 * deviation);
        // Of what is far more than noise a random force is no explanation.
        auto missing = forced;
        for (std::size_t k = 0; k < 500; ++k) missing[0].outputs[0][k] += 5 * clean[0][k] * clean[0][k];
        const SystemFit poor(missing, {1}, Interpolation::hold, {500});
        const auto far = poor.fit(lag.model, lag.model.values(1), 20, never);
        EXPECT_EQ(poor.generalized(lag.model, far, never).values, far.values);
    }
    EXPECT_LT(squares, 0.7 * of_least);
    EXPECT_LT(in_deviations, 2.5);
    EXPECT_GT(in_deviations, 0.2);
}

// Ten times as fast as a step of the fourth order follows: in steps of that length the motion runs away.
TEST(SystemFit, SlopesAreThoseOfASolverWhereStepsOfTheGivenLengthRunAway) {
    const TemporaryFolder folder;
    const auto model = model_of(folder, R"(inputs = { u = 1 }, states = { x = 0 }, parameters = { a = 300 },
        der = function(s) return { x = s.a * (s.u - s.x) } end,
        outputs = function(s) return { y = s.x + s.x ^ 3 / s.a } end)");
    SystemRecord record = record_of(400, 0.1, {[](double t) { return std::sin(t); }});
    record.outputs = {std::vector<double>(400, 0.5)};
    const std::vector<SystemRecord> records = {record};
    SystemFit fit(records, {1}, Interpolation::hold, {400});
    const auto values = model.values(1);
    const auto errors = fit.errors(model, values);
    ASSERT_EQ(errors.size(), 400u);
    const auto slopes = fit.jacobian(model, values, errors);
    fit.begin_search(1);
    const auto in_long_steps = fit.jacobian(model, values, errors);
    ASSERT_EQ(in_long_steps.rows(), 400);
    EXPECT_GT(slopes.norm(), 1e-4);
    EXPECT_LT((in_long_steps - slopes).norm(), 1e-3 * slopes.norm());
}

// What was not measured counts nowhere: a fit to the rest is that of a record in which it is anything.
TEST(SystemFit, WhatWasNotMeasuredCountsNowhere) {
    NoisyLag lag;
    auto& y = lag.records[0].outputs[0];
    for (std::size_t k = 150; k < 225; ++k) y[k] = std::nan("");
    EXPECT_EQ(lag.records[0].measured(500), 425u);
    EXPECT_EQ(lag.records[0].measured(200), 150u);
    const SystemFit fit(lag.records, {1}, Interpolation::hold, {500});
    const auto result = fit.fit(lag.model, lag.model.values(1), 20, never);
    ASSERT_EQ(result.errors.size(), 425u);
    const auto slopes = fit.jacobian(lag.model, result.values, result.errors);
    ASSERT_EQ(slopes.rows(), 425);
    EXPECT_NEAR(result.values[0], 2, 4 * fit.standard_errors(lag.model, result.values, result.errors)[0]);
    // The minimum: errors are orthogonal to the slopes.
    const Eigen::Map<const Eigen::VectorXd> e(result.errors.data(), 425);
    EXPECT_LT((slopes.transpose() * e).norm(), 1e-3 * slopes.norm() * e.norm());
    // Segments hold all that was measured, and nothing else counts in them.
    const auto segments = segmented(lag.model, result.values, fit, never);
    ASSERT_TRUE(segments);
    EXPECT_EQ(segments->errors.size(), 425u);
}

// Over the whole record the model ends in another hollow of the force; within each segment it stays near.
TEST(Segments, AModelThatLacksAForceStaysNearTheMeasurement) {
    const TemporaryFolder folder;
    const std::string text = R"(
        parameters = { g = 2, h = %s }, inputs = { u = 0 }, states = { x = 0, v = 0 },
        der = function(s) return { x = s.v, v = s.g * s.u - 0.4 * s.v - s.h * math.sin(5 * s.x) } end,
        outputs = function(s) return { y = s.x } end)";
    const auto with = [&](const char* h) {
        std::string one = text;
        return model_of(folder, one.replace(one.find("%s"), 2, h));
    };
    auto record = record_of(400, 0.05, {[](double t) { return std::sin(1.3 * t) + 0.6 * std::sin(3.1 * t + 1); }});
    std::vector<SystemRecord> records = {record};
    const std::vector<std::size_t> used = {record.size()};
    const auto truth = with("0.8");
    const auto trace = SystemFit(records, {1}, Interpolation::hold, used).simulate(truth, truth.values(1), 0, 400);
    ASSERT_TRUE(trace);
    records[0].outputs = trace->outputs;
    auto model = with("0");
    model.parameters.clear();
    const SystemFit fit(records, {1}, Interpolation::hold, used);
    const auto errors = fit.errors(model, model.values(1));
    const auto segments = segmented(model, model.values(1), fit, never);
    ASSERT_TRUE(segments);
    EXPECT_GT(segments->records.size(), 4u);
    EXPECT_EQ(segments->first_of, std::vector<std::size_t>{0});
    std::size_t samples = 0;
    for (const auto& one : segments->records) samples += one.size();
    EXPECT_EQ(samples, record.size());
    EXPECT_LT(SystemFit::sum_of_squares(segments->errors), 1e-2 * SystemFit::sum_of_squares(errors));
    // The first segment begins as the record does.
    const auto whole = segments->whole(model, segments->values);
    ASSERT_EQ(whole.size(), 2u);
    for (std::size_t i = 0; i < 2; ++i) EXPECT_EQ(whole[i], segments->values[i]);
}

// Seventy swings: the error over all of them has a local minimum for each turn by which the phase is off at the end.
TEST(SystemFit, AnOscillationIsFoundFromFarOffByGrowingParts) {
    const TemporaryFolder folder;
    SystemModel model = model_of(folder, R"(
        parameters = { w2 = 64 }, states = { x = 1, v = 0 },
        der = function(s) return { x = s.v, v = -s.w2 * math.sin(s.x) - 0.05 * s.v } end,
        outputs = function(s) return { y = s.x } end)");
    model.starts.clear();
    std::vector<SystemRecord> records = {record_of(2000, 0.03, {})};
    const std::vector<std::size_t> whole = {2000};
    const auto trace = SystemFit(records, {1}, Interpolation::hold, whole).simulate(model, {64}, 0, records[0].size());
    ASSERT_TRUE(trace);
    records[0].outputs = trace->outputs;
    const SystemFit fit(records, {0.5}, Interpolation::hold, whole);
    const auto direct = fit.fit(model, {42}, 40, never);
    const auto growing = fit.fit_growing(model, {42}, 40, never);
    EXPECT_GT(direct.sum, 100); // otherwise there is nothing to show
    EXPECT_LT(growing.sum, 1e-4);
    EXPECT_NEAR(growing.values[0], 64, 1e-4);
}

// The same pendulum has many minima. Once one is known, a fit that leads there again gives up, as does one that leads to a worse one.
TEST(SystemFit, AFitGivesUpWhereAnotherOneEnded) {
    const TemporaryFolder folder;
    SystemModel model = model_of(folder, R"(
        parameters = { w2 = 64, size = 1 }, states = { x = 1, v = 0 },
        der = function(s) return { x = s.v, v = -s.w2 * math.sin(s.x) - 0.05 * s.v } end,
        outputs = function(s) return { y = s.size * s.x } end)");
    model.starts.clear();
    std::vector<SystemRecord> records = {record_of(2000, 0.03, {})};
    const std::vector<std::size_t> whole = {2000};
    const bool is_size_first = model.equations.parameters[0].name == "size";
    const auto values = [&](double w2, double size) {
        return is_size_first ? std::vector<double>{size, w2} : std::vector<double>{w2, size};
    };
    const auto trace =
        SystemFit(records, {1}, Interpolation::hold, whole).simulate(model, values(64, 1), 0, records[0].size());
    ASSERT_TRUE(trace);
    records[0].outputs = trace->outputs;
    SystemFit fit(records, {0.5}, Interpolation::hold, whole);
    fit.begin_search();
    const auto local = fit.fit(model, values(42, 1), 40, never);
    const auto same = fit.fit(model, values(42.01, 1.2), 40, never);
    ASSERT_GT(local.sum, 100);
    ASSERT_NEAR(same.sum, local.sum, 1e-3 * local.sum);
    const FoundMinimum found{local.values, local.sum, local.errors.size(), local.curvature};
    EXPECT_TRUE(found.is_near(local.values));
    EXPECT_FALSE(found.is_near(values(64, 1)));
    fit.look_elsewhere(found);
    EXPECT_TRUE(fit.fit(model, values(42.01, 1.2), 40, never).gave_up);
    const auto best = fit.fit_growing(model, values(42, 1), 40, never);
    EXPECT_FALSE(best.gave_up);
    EXPECT_LT(best.sum, 1e-3);
    const FoundMinimum right{best.values, best.sum, best.errors.size(), best.curvature};
    fit.look_elsewhere(right);
    EXPECT_TRUE(fit.fit(model, values(42, 1), 40, never).gave_up);
}

// Of two tanks the level of the lower one is measured. A loss of the upper one, its outflow and its inflow nearly make up for one
// another, so the errors are least along a valley, which is bent: from what fits best without a loss, straight steps leave
// half of them after 12 iterations, and need 40.
TEST(SystemFit, AFitFollowsABentValley) {
    const TemporaryFolder folder;
    SystemModel model = model_of(folder, R"(
        parameters = { inflow = 0.05, outflow = 0.05, lower = 0.05, loss = 0 }, inputs = { u = 0 },
        states = { h1 = 4, h2 = 4 },
        der = function(s)
            local flow = s.outflow * math.sqrt(math.max(s.h1, 0.01))
            return { h1 = s.inflow * (s.u + 2) - flow - s.loss * s.h1,
                     h2 = flow - s.lower * math.sqrt(math.max(s.h2, 0.01)) }
        end,
        outputs = function(s) return { y = s.h2 } end)");
    std::vector<SystemRecord> records = {
        record_of(400, 2, {[](double t) { return 1.2 * std::sin(0.021 * t) + 0.8 * std::sin(0.057 * t); }})};
    const std::vector<std::size_t> whole = {400};
    const auto name_of = [&](std::size_t i) { return model.equations.parameters[model.parameters[i].place].name; };
    const std::map<std::string, double> true_value = {
        {"inflow", 0.062}, {"outflow", 0.041}, {"lower", 0.045}, {"loss", 0.013}};
    std::vector<double> truth;
    std::size_t loss = 0;
    for (std::size_t i = 0; i < model.parameters.size(); ++i) {
        truth.push_back(true_value.at(name_of(i)));
        if (name_of(i) == "loss") loss = i;
    }
    truth.insert(truth.end(), {5, 3.5});
    const auto trace = SystemFit(records, {1}, Interpolation::hold, whole).simulate(model, truth, 0, 400);
    ASSERT_TRUE(trace);
    records[0].outputs = trace->outputs;
    const SystemFit fit(records, {1}, Interpolation::hold, whole);
    SystemModel without = model;
    without.parameters.erase(without.parameters.begin() + static_cast<std::ptrdiff_t>(loss));
    auto start = fit.fit(without, without.values(1), 50, never).values;
    start.insert(start.begin() + static_cast<std::ptrdiff_t>(loss), 0.0);
    const auto result = fit.fit(model, start, 12, never);
    EXPECT_LT(result.sum, 1e-4);
    for (std::size_t i = 0; i < model.parameters.size(); ++i)
        EXPECT_NEAR(result.values[i], truth[i], 1e-3) << name_of(i);
}

TEST(SystemFit, AnInputThatActsLateIsSimulatedLate) {
    const TemporaryFolder folder;
    const auto model = [&](const std::string& u) {
        return model_of(folder, R"(parameters = { T = 0.3 }, inputs = { u = 0 }, states = { x = 0 },
            der = function(s) return { x = )" +
                                    u + R"( - s.x } end, outputs = function(s) return { y = s.x } end)");
    };
    const SystemModel late = model("tb.delay(s.u, s.T)"), prompt = model("s.u");
    const std::vector<SystemRecord> records = {
        record_of(100, 0.1, {[](double t) { return t < 1 ? 0.0 : std::sin(3 * t); }})};
    const SystemFit fit(records, {1}, Interpolation::hold, {100});
    const auto a = fit.simulate(late, late.values(1), 0, 100);
    const auto b = fit.simulate(prompt, prompt.values(1), 0, 100);
    ASSERT_TRUE(a && b);
    double moved = 0;
    for (std::size_t k = 3; k < 100; ++k) {
        EXPECT_NEAR(a->outputs[0][k], b->outputs[0][k - 3], 1e-6);
        moved = std::max(moved, std::abs(a->outputs[0][k] - b->outputs[0][k]));
    }
    EXPECT_GT(moved, 0.1);
}

// Fixed steps against the solver that controls its error, which shares nothing with them: a kink, a lookup of the time, inputs that
// hold or move between samples, one that is delayed by a parameter, instants that are uneven, two records.
TEST(LaneFit, AgreesWithTheSolversThatControlTheirError) {
    const TemporaryFolder folder;
    const SystemModel model = model_of(folder, R"(
        parameters = { a = 3, T = 0.123, c = 0.4 }, inputs = { u = 0, w = 0.3 }, states = { x = 0.5, v = 0 },
        der = function(s)
          return { x = s.v, v = tb.delay(s.u, s.T) * s.w - s.a * s.x - s.c * s.v * math.abs(s.v) + math.sin(s.t) }
        end,
        outputs = function(s) return { y = s.x + s.u, z = math.max(s.v, 0.1) } end)");
    const auto u = [](double t) { return std::sin(2.3 * t) + 0.4 * std::cos(9 * t); };
    const auto even = record_of(200, 0.05, {u});
    auto uneven = record_of(150, 0.05, {u});
    for (std::size_t k = 1; k < uneven.size(); ++k) uneven.t[k] += 0.02 * std::sin(static_cast<double>(k));
    std::vector<SystemRecord> records = {even, uneven};
    for (auto& record : records) {
        record.inputs.emplace_back(); // w has its own value
        record.outputs.assign(2, {});
        for (std::size_t k = 0; k < record.size(); ++k) {
            record.outputs[0].push_back(u(record.t[k]));
            record.outputs[1].push_back(0.2);
        }
    }
    // Without noise the steps are as short as 1e-3 of the errors asks for.
    for (const auto between : {Interpolation::hold, Interpolation::linear, Interpolation::band_limited}) {
        const SystemFit fit(records, {1, 1}, between, {200, 150});
        const auto values = model.values(2);
        auto lanes = LaneFit::of(fit, model, values);
        ASSERT_TRUE(lanes);
        std::vector<std::vector<double>> sets(5, values);
        for (std::size_t l = 0; l < sets.size(); ++l) {
            for (double& value : sets[l]) value += 0.03 * static_cast<double>(l);
        }
        const auto errors = lanes->errors(sets);
        for (std::size_t l = 0; l < sets.size(); ++l) {
            std::size_t row = 0;
            for (std::size_t r = 0; r < 2; ++r) {
                const auto trace = fit.simulate(model, sets[l], r, records[r].size());
                ASSERT_TRUE(trace);
                for (std::size_t o = 0; o < 2; ++o) {
                    for (std::size_t k = 0; k < records[r].size(); ++k, ++row) {
                        EXPECT_NEAR(errors[l][row], records[r].outputs[o][k] - trace->outputs[o][k], 2e-4)
                            << "set " << l << " record " << r << " output " << o << " sample " << k;
                    }
                }
            }
            ASSERT_EQ(row, errors[l].size());
            // The same bits one by one.
            EXPECT_EQ(errors[l], lanes->errors({sets[l]})[0]);
        }
        // Derivatives by the variational equations need no differences.
        const SystemFit first(records, {1, 1}, between, {200, 0});
        const auto some = LaneFit::of(first, model, values);
        ASSERT_TRUE(some);
        const auto by_lanes = some->jacobian(values, some->errors({values})[0]);
        double largest = 0;
        for (Eigen::Index i = 0; i < 5; ++i) {
            std::vector<double> there = values, back = values;
            there[static_cast<std::size_t>(i)] += 1e-3;
            back[static_cast<std::size_t>(i)] -= 1e-3;
            const auto a = first.simulate(model, there, 0, 200), b = first.simulate(model, back, 0, 200);
            ASSERT_TRUE(a && b);
            for (std::size_t k = 0; k < 200; ++k) {
                const double slope = (a->outputs[0][k] - b->outputs[0][k]) / 2e-3;
                largest = std::max(largest, std::abs(slope));
                EXPECT_NEAR(by_lanes(static_cast<Eigen::Index>(k), i), slope, 3e-3) << i << " " << k;
            }
        }
        EXPECT_GT(largest, 0.5);
    }
}

// The steps are halved until the error of a stiff state does not count.
TEST(LaneFit, StepsAreAsShortAsTheEquationsNeed) {
    const TemporaryFolder folder;
    const auto with = [&](const char* rate) {
        std::string text = R"(parameters = { r = %s }, inputs = { u = 0 }, states = { x = 0 },
            der = function(s) return { x = s.r * (s.u - s.x) } end, outputs = function(s) return { y = s.x } end)";
        return model_of(folder, text.replace(text.find("%s"), 2, rate));
    };
    std::vector<SystemRecord> records = {record_of(100, 0.1, {[](double t) { return std::sin(t); }})};
    records[0].outputs = {records[0].inputs[0]};
    const SystemFit fit(records, {1}, Interpolation::hold, {100});
    const auto exact = [](double rate) { // held inputs, in closed form
        std::vector<double> x = {0};
        for (std::size_t k = 0; k + 1 < 100; ++k) {
            const double u = std::sin(0.1 * static_cast<double>(k));
            x.push_back(u + (x.back() - u) * std::exp(-0.1 * rate));
        }
        return x;
    };
    for (const auto& [text, rate] : {std::pair("2", 2.0), std::pair("60", 60.0)}) {
        const SystemModel model = with(text);
        const auto lanes = LaneFit::of(fit, model, model.values(1));
        ASSERT_TRUE(lanes) << rate;
        const auto errors = lanes->errors({model.values(1)})[0];
        const auto x = exact(rate);
        for (std::size_t k = 0; k < 100; ++k) {
            EXPECT_NEAR(errors[k], records[0].outputs[0][k] - x[k], 2e-4) << rate << " " << k;
        }
    }
    const SystemModel stiff = with("1e5");
    EXPECT_FALSE(LaneFit::of(fit, stiff, stiff.values(1)));
    EXPECT_FALSE(fit.errors(stiff, stiff.values(1)).empty()); // solvers for stiff equations take it
}

std::vector<std::vector<double>> outputs_of(const FixedSteps& steps, const FixedSteps::Course& course,
                                            const std::vector<std::vector<double>>& sets, std::size_t substeps) {
    std::vector<FixedSteps::Simulation> simulations;
    for (const auto& values : sets) simulations.push_back({&course, &values});
    return steps.outputs(simulations, substeps);
}

// An input that jumps from its own value to the first of the record, late: the jump is within a step, and steps of fourth order
// end there.
TEST(LaneFit, StepsEndWhereALateInputBegins) {
    const TemporaryFolder folder;
    const SystemModel model =
        model_of(folder, R"(parameters = { T = 0.13 }, inputs = { u = 0 }, states = { x = 0, v = 0 },
        der = function(s)
          local late = tb.where(tb.less(s.t - s.T, 0), 0, tb.delay(s.u, s.T))
          return { x = s.v, v = 20 * (late - s.x) - s.v }
        end, outputs = function(s) return { y = s.x } end)");
    std::vector<SystemRecord> records = {record_of(100, 0.1, {[](double t) { return std::cos(t); }})};
    records[0].outputs = {std::vector<double>(100, 0)};
    for (const auto between : {Interpolation::hold, Interpolation::linear}) {
        const SystemFit fit(records, {1}, between, {100});
        const auto trace = fit.simulate(model, model.values(1), 0, 100);
        ASSERT_TRUE(trace);
        const auto steps = FixedSteps::of(model);
        ASSERT_TRUE(steps);
        const std::vector<std::vector<double>> sets = {model.values(1)};
        double off[2] = {};
        for (const std::size_t n : {std::size_t{1}, std::size_t{4}}) {
            const auto x = outputs_of(*steps, steps->course(records[0], 100, between), sets, n)[0];
            for (std::size_t k = 0; k < 100; ++k) {
                off[n / 4] = std::max(off[n / 4], std::abs(x[k] - trace->outputs[0][k]));
            }
        }
        EXPECT_LT(off[0], 2e-3);
        EXPECT_LT(off[1], off[0] / 100); // 256 by the order
    }
}

// Of every fourth sample only, in one step each: what a lag of 2 s makes of held samples at random, in closed form. Inputs with their
// mean alone would be off by 0.02. An output takes the input of its instant.
TEST(LaneFit, InputsOfFewerSamplesKeepTheirFirstMoment) {
    const TemporaryFolder folder;
    const SystemModel model = model_of(folder, R"(parameters = { r = 0.5 }, inputs = { u = 0 }, states = { x = 0 },
        der = function(s) return { x = s.r * (s.u - s.x) } end,
        outputs = function(s) return { a = s.x, b = s.u } end)");
    constexpr std::size_t samples = 400;
    SystemRecord record = record_of(samples, 0.1, {[](double) { return 0.0; }});
    for (std::size_t k = 0; k < samples; ++k) record.inputs[0][k] = standard_normal(7, 0, k);
    std::vector<double> exact = {0};
    for (const double u : record.inputs[0]) exact.push_back(u + (exact.back() - u) * std::exp(-0.05));
    const auto steps = FixedSteps::of(model);
    ASSERT_TRUE(steps);
    const auto course = steps->course(record, samples, Interpolation::hold, 4);
    ASSERT_EQ(course.samples, samples / 4);
    const auto y = outputs_of(*steps, course, {model.values(1)}, 1)[0];
    for (std::size_t k = 0; k < course.samples; ++k) {
        EXPECT_NEAR(y[k], exact[4 * k], 4e-4) << k;
        EXPECT_EQ(y[course.samples + k], record.inputs[0][4 * k]) << k;
    }
    // Lines stay as they are, and delays count in samples of the record.
    const SystemModel late = model_of(folder, R"(parameters = { T = 0.5 }, inputs = { u = 0 }, states = { x = 0 },
        der = function(s) return { x = tb.delay(s.u, s.T) } end, outputs = function(s) return { y = s.x } end)");
    for (std::size_t k = 0; k < samples; ++k) record.inputs[0][k] = record.t[k];
    const auto late_steps = FixedSteps::of(late);
    ASSERT_TRUE(late_steps);
    const auto late_course = late_steps->course(record, samples, Interpolation::linear, 4);
    const auto x = outputs_of(*late_steps, late_course, {late.values(1)}, 1)[0];
    for (std::size_t k = 0; k < late_course.samples; ++k) {
        EXPECT_NEAR(x[k], 0.5 * std::pow(std::max(0.0, record.t[4 * k] - 0.5), 2), 1e-9) << k;
    }
}

// Records that began at other times and are not as long go side by side, each with its own inputs, delays and time: to rounding as
// alone. One with uneven instants goes alone.
TEST(LaneFit, RecordsOfOneKindGoSideBySide) {
    const TemporaryFolder folder;
    const SystemModel model = model_of(folder, R"(
        parameters = { T = 0.123 }, inputs = { u = 0 }, states = { x = 0.3, v = 0 },
        parts = { f = tb.parts.coulomb { velocity = "v", level = 0.3 } },
        der = function(s)
          return { x = s.v, v = tb.delay(s.u, s.T) + math.sin(s.t) - 0.4 * s.x - 0.2 * s.v - s.f.force }
        end,
        outputs = function(s) return { y = s.x + s.u } end)");
    std::vector<SystemRecord> records;
    const auto u = [](double t) { return std::sin(2.3 * t) + 0.4 * std::cos(9 * t); };
    for (std::size_t r = 0; r < 11; ++r) {
        auto& record = records.emplace_back(record_of(200 + r % 3, 0.05, {}));
        for (double& t : record.t) t += 1.7 * static_cast<double>(r);
        if (r == 5) record.t[50] += 0.01;
        record.inputs.emplace_back();
        for (const double t : record.t) record.inputs[0].push_back(u(t));
        record.outputs.assign(model.measured.size(), std::vector<double>(record.size(), 0));
    }
    std::vector<std::size_t> used;
    for (const auto& record : records) used.push_back(record.size());
    const std::vector<double> scale(model.measured.size(), 1);
    const SystemFit fit(records, scale, Interpolation::hold, used);
    const auto values = model.values(records.size());
    const auto lanes = LaneFit::of(fit, model, values, 2);
    ASSERT_TRUE(lanes);
    const auto errors = lanes->errors({values})[0];
    std::size_t row = 0;
    for (std::size_t r = 0; r < records.size(); ++r) {
        const std::vector<SystemRecord> one = {records[r]};
        const SystemFit alone(one, scale, Interpolation::hold, {used[r]});
        const auto own_lanes = LaneFit::of(alone, model, model.values(1), 2);
        ASSERT_TRUE(own_lanes);
        const auto own = own_lanes->errors({model.values(1)})[0];
        for (const double e : own) {
            ASSERT_LT(row, errors.size());
            EXPECT_NEAR(errors[row++], e, 1e-9) << "record " << r;
        }
    }
    EXPECT_EQ(row, errors.size());
    const auto steps = FixedSteps::of(model);
    ASSERT_TRUE(steps);
    std::vector<FixedSteps::Course> courses;
    for (const auto& record : records) {
        courses.push_back(steps->course(record, record.size(), Interpolation::hold));
    }
    EXPECT_TRUE(courses[2].begins_as(courses[0])); // the longest
    EXPECT_FALSE(courses[0].begins_as(courses[2]));
    EXPECT_FALSE(courses[2].begins_as(courses[5]));
}

// Steps that another candidate needed become as long as these values allow.
TEST(LaneFit, StepsAreAsLongAsTheValuesAllow) {
    const TemporaryFolder folder;
    const SystemModel model = model_of(folder, R"(parameters = { r = 2 }, inputs = { u = 0 }, states = { x = 0 },
        der = function(s) return { x = s.r * (s.u - s.x) } end, outputs = function(s) return { y = s.x } end)");
    std::vector<SystemRecord> records = {record_of(4000, 0.01, {[](double t) { return std::sin(t); }})};
    records[0].outputs = {records[0].inputs[0]};
    SystemFit fit(records, {1}, Interpolation::linear, {4000});
    fit.begin_search();
    for (const auto& [rate, substeps] : {std::pair(2.0, 1u), std::pair(600.0, 4u)}) {
        auto lanes = LaneFit::of(fit, model, {rate, 0}, 32);
        ASSERT_TRUE(lanes);
        EXPECT_EQ(lanes->substeps(), 32u);
        lanes->lengthen({rate, 0});
        EXPECT_EQ(lanes->substeps(), substeps) << rate;
        // Over fewer samples only where one step of a sample is enough.
        const auto all = lanes->errors({{rate, 0}})[0];
        EXPECT_EQ(lanes->thin_out({rate, 0}), substeps == 1);
        const auto some = lanes->errors({{rate, 0}})[0];
        EXPECT_EQ(some.size(), substeps == 1 ? 500u : 4000u);
        for (std::size_t k = 0; k < some.size(); ++k) {
            EXPECT_NEAR(some[k], all[k * (all.size() / some.size())], 0.01 * rms_of_errors(all));
        }
    }
}

// Dry friction sticks and slips within steps: of a mass on a spring that is pushed, which rests at the turns of each push, and of one
// whose force jumps at samples and lets go only above the level of its slip. The order is that of smooth steps.
TEST(LaneFit, DryFrictionSticksAndSlipsWithinSteps) {
    const TemporaryFolder folder;
    const std::vector<SystemRecord> records = {
        record_of(200, 0.1, {[](double t) { return 1.5 * std::sin(0.7 * t) + 0.6 * std::sin(1.9 * t); }})};
    for (const auto& [friction, between] :
         {std::pair{"level = 1", Interpolation::linear}, {"level = 1, static = 1.4", Interpolation::hold}}) {
        const SystemModel model = model_of(folder, fmt::format(R"(
            inputs = {{ u = 0 }}, states = {{ x = 0.3, v = 0 }},
            parts = {{ f = tb.parts.coulomb {{ velocity = "v", {} }} }},
            der = function(s) return {{ x = s.v, v = s.u - 0.4 * s.x - 0.2 * s.v - s.f.force }} end,
            outputs = function(s) return {{ y = s.x, f = s.f.force }} end)",
                                                               friction));
        const SystemFit fit(records, std::vector<double>(model.measured.size(), 1), between, {200});
        const auto trace = fit.simulate(model, model.values(1), 0, 200);
        ASSERT_TRUE(trace);
        const auto steps = FixedSteps::of(model);
        ASSERT_TRUE(steps);
        const std::vector<std::vector<double>> sets(5, model.values(1));
        std::size_t held = 0; // samples at rest
        for (const double v : trace->states[0]) held += v == 0;
        EXPECT_GT(held, 30u);
        for (const auto& [n, off] : {std::pair{1u, 1e-6}, {4u, 1e-7}}) {
            const auto all = outputs_of(*steps, steps->course(records[0], 200, between), sets, n)[0];
            for (std::size_t k = 0; k < 200; ++k) {
                EXPECT_NEAR(all[k], trace->outputs[0][k], off) << k;
                EXPECT_NEAR(all[200 + k], trace->outputs[1][k], 10 * off) << k; // its force
            }
        }
    }
}

// Derivatives are differences of runs: a turn must be found to rounding, wherever in a step it lies, so that what moves a little ends
// a little off.
TEST(LaneFit, TurnsAreFoundToRounding) {
    const TemporaryFolder folder;
    const SystemModel model = model_of(folder, R"(
        parameters = { level = 0.1 }, states = { x = 10, v = 0 },
        parts = { f = tb.parts.coulomb { velocity = "v", level = "level" } },
        der = function(s) return { x = s.v, v = -9 * s.x - s.f.force } end,
        outputs = function(s) return { y = s.x } end)");
    ASSERT_EQ(model.measured.size(), 2u); // the position and the force
    const std::size_t samples = 3000;
    const SystemRecord record = record_of(samples, 0.02, {});
    const auto steps = FixedSteps::of(model);
    ASSERT_TRUE(steps);
    std::vector<std::vector<double>> sets(8, model.values(1));
    for (std::size_t l = 1; l < sets.size(); ++l) sets[l][0] += std::pow(10, -13.0 + static_cast<double>(l));
    const auto all = outputs_of(*steps, steps->course(record, samples, Interpolation::hold), sets, 1);
    for (std::size_t l = 1; l < sets.size(); ++l) {
        const double moved = sets[l][0] - sets[0][0];
        double most = 0;
        for (std::size_t k = samples; k < 2 * samples; ++k) {
            most = std::max(most, std::abs(all[l][k] - all[0][k]));
        }
        EXPECT_LT(most, 20 * moved + 1e-11) << moved; // 57 turns, each off by 2/9 of it
    }
}

// Whether friction can hold a velocity depends on the values that are asked for, not on those that the model has.
TEST(LaneFit, FrictionHoldsWithTheValuesThatAreAskedFor) {
    const TemporaryFolder folder;
    SystemModel model = model_of(folder, R"(
        parameters = { ratio = -0.5 }, inputs = { u = 0 }, states = { x = 0.3, v = 0 },
        parts = { f = tb.parts.coulomb { velocity = "v", level = 1 } },
        der = function(s) return { x = s.v, v = (1 + s.ratio) * (s.u - s.f.force) - 0.4 * s.x } end,
        outputs = function(s) return { y = s.x } end)");
    ASSERT_EQ(model.parameters.size(), 1u);
    model.equations.parameters[0].value = -1;
    std::vector<SystemRecord> records = {record_of(50, 0.1, {[](double t) { return 1.5 * std::sin(t); }})};
    records[0].outputs.assign(model.measured.size(), std::vector<double>(50, 0));
    const SystemFit fit(records, std::vector<double>(model.measured.size(), 1), Interpolation::linear, {50});
    auto values = model.values(1);
    EXPECT_FALSE(LaneFit::of(fit, model, values));
    values[0] = -0.2;
    EXPECT_TRUE(LaneFit::of(fit, model, values));
}

// What has events stays with the solvers that locate them.
TEST(LaneFit, EventsAreNoFixedSteps) {
    const TemporaryFolder folder;
    const SystemModel ball = model_of(folder, R"(
        states = { h = 1, v = 0 }, der = function(s) return { h = s.v, v = -9.81 } end,
        when = { { crossing = function(s) return s.h end, set = function(s) return { v = -0.8 * s.v } end } },
        outputs = function(s) return { y = s.h } end)");
    EXPECT_FALSE(FixedSteps::of(ball));
}

// From these values a step leads to a negative time constant, and on to where nothing is to be found.
TEST(SystemSearch, ValuesKeepTheirSignsWhereThatSuitsTheRecords) {
    const TemporaryFolder folder;
    const char* const equations = R"(inputs = { u = 0 }, states = { w = 0 },
        der = function(s) return { w = (s.k * s.u - s.w) / s.tau } end, outputs = function(s) return { y = s.w } end)";
    const auto motor = [&](double k, double tau) {
        SystemModel made = model_of(folder, fmt::format("parameters = {{ k = {}, tau = {} }}, {}", k, tau, equations));
        for (auto& one : made.parameters) { // as in system_model_of()
            one.high = 1e4 * made.equations.parameters[one.place].value;
            one.low = -one.high;
        }
        return made;
    };
    const SystemModel true_one = motor(2, 0.5);
    std::vector<SystemRecord> records = {record_of(600, 0.02, {[](double t) {
                                                       return std::sin(0.8 * t + 1) + std::sin(2.3 * t + 2) +
                                                              std::sin(5.1 * t) + std::sin(10.7 * t + 4);
                                                   }})};
    const SystemFit whole(records, {1}, Interpolation::hold, {600});
    records[0].outputs = whole.simulate(true_one, true_one.values(1), 0, 600)->outputs;
    for (std::size_t k = 0; k < 600; ++k) records[0].outputs[0][k] += 0.02 * standard_normal(1, 0, k);
    for (const auto& [k, tau] : {std::pair{0.2, 2.0}, {0.1, 50.0}, {0.02, 5.0}, {0.02, 50.0}}) {
        const SystemModel given = motor(k, tau);
        SystemSearch search(given, records, {2}, never, by_itself);
        const auto values = search.begin().values;
        EXPECT_NEAR(values[0], 2, 0.02) << k << " " << tau;
        EXPECT_NEAR(values[1], 0.5, 0.01) << k << " " << tau;
    }
}

// Of two values of which only the product shows, both may turn around together.
TEST(SystemSearch, SignsThatTurnedForNothingTurnBack) {
    const TemporaryFolder folder;
    SystemModel model = model_of(folder, R"(
        parameters = { R = 900, C = 1.2e-6 }, inputs = { u = 0 }, states = { v = 0 },
        der = function(s) return { v = (s.u - s.v) / (s.R * s.C) } end, outputs = function(s) return { y = s.v } end)");
    model.starts.clear();
    std::vector<SystemRecord> records = {
        record_of(500, 1e-4, {[](double t) { return std::sin(900 * t) + std::sin(2300 * t); }})};
    records[0].outputs =
        SystemFit(records, {1}, Interpolation::hold, {500}).simulate(model, {1e-6, 800}, 0, 500)->outputs;
    for (std::size_t k = 0; k < 500; ++k) records[0].outputs[0][k] += 0.01 * standard_normal(1, 0, k);
    SystemSearch search(model, records, {1}, never, by_itself);
    SystemCandidate turned{.model = model, .values = {-1e-6, -800}};
    ASSERT_TRUE(search.fit(turned));
    EXPECT_LT(turned.values[0], 0);
    const auto back = search.with_given_signs(turned);
    EXPECT_GT(back.values[0], 0);
    EXPECT_GT(back.values[1], 0);
    EXPECT_NEAR(back.values[0] * back.values[1], 8e-4, 1e-5);
    EXPECT_NEAR(back.score(), turned.score(), 1e-3 * turned.score());
    // Where the records ask for another sign than that which was given, it stays.
    for (double& y : records[0].outputs[0]) y = -y;
    SystemModel gain = model_of(folder, R"(
        parameters = { k = 1 }, inputs = { u = 0 }, states = { v = 0 },
        der = function(s) return { v = (s.k * s.u - s.v) / 8e-4 } end, outputs = function(s) return { y = s.v } end)");
    gain.starts.clear();
    SystemSearch other(gain, records, {1}, never, by_itself);
    const auto reversed = other.with_given_signs(other.begin());
    EXPECT_NEAR(reversed.values[0], -1, 0.01);
}

// A power law behind a dead zone, with an exponent of one, is that dead zone.
TEST(SystemSearch, ATermOfFewerValuesReplacesARicherOneThatDoesNoMore) {
    const TemporaryFolder folder;
    const auto lag_of = [&](const std::string& u) {
        SystemModel made = model_of(
            folder,
            fmt::format("parameters = {{ k = 2, tau = 0.5, width = 0.6 }}, inputs = {{ u = 0 }}, states = {{ v = 0 }}, "
                        "der = function(s) return {{ v = (s.k * ({}) - s.v) / s.tau }} end, "
                        "outputs = function(s) return {{ y = s.v }} end",
                        u));
        made.starts.clear();
        made.parameters.pop_back();
        return made;
    };
    const SystemModel model = lag_of("s.u"), truth = lag_of("s.u - math.min(math.max(s.u, -s.width), s.width)");
    std::vector<SystemRecord> records = {
        record_of(600, 0.02, {[](double t) { return std::sin(2 * t) + std::sin(5.3 * t); }})};
    records[0].outputs = SystemFit(records, {1}, Interpolation::hold, {600}).simulate(truth, {2, 0.5}, 0, 600)->outputs;
    for (std::size_t k = 0; k < 600; ++k) records[0].outputs[0][k] += 2e-3 * standard_normal(1, 0, k);
    SystemSearch search(model, records, {1}, never, by_itself);
    const SystemFit fit = search.fit_of_all();
    const auto values = model.values(1);
    const std::vector<SystemTrace> traces = {*fit.simulate(model, values, 0, 600)};
    const auto terms =
        system_terms(model, 1, fit, variables_of(model, 1, fit, traces), fit.errors(model, values), false);
    const auto term = std::ranges::find_if(
        terms, [](const SystemTerm& one) { return one.form() == "power_law in input u by width"; });
    ASSERT_NE(term, terms.end());
    SystemCandidate richer{.model = extended(model, *term, {0.6, 1}),
                           .values = more_values(model, values, {0.6, 1}),
                           .terms = {*term},
                           .texts = {""}};
    ASSERT_TRUE(search.fit(richer));
    ASSERT_TRUE(richer.is_noise);
    const auto simpler = search.simplified(richer);
    ASSERT_TRUE(simpler);
    ASSERT_EQ(simpler->terms.size(), 1u);
    EXPECT_EQ(simpler->terms[0].name, "dead_zone");
    EXPECT_NEAR(simpler->values[2], 0.6, 0.02);
    EXPECT_FALSE(search.simplified(*simpler));
}

// Without what it lacks, this motor is nearer the record with lines between samples, half a sample ahead; but a staircase is held.
TEST(SystemSearch, AStaircaseIsHeld) {
    const TemporaryFolder folder;
    const auto motor = [&](const std::string& drag) {
        SystemModel made =
            model_of(folder, "parameters = { k = 2, d = 1 }, inputs = { u = 0 }, states = { x = 0, v = 0 }, "
                             "der = function(s) return { x = s.v, v = s.k * s.u - s.d * s.v - (" +
                                 drag + ") } end, outputs = function(s) return { y = s.x } end");
        made.starts.clear();
        return made;
    };
    const SystemModel model = motor("0"), truth = motor("2 * tb.tanh(s.v / 0.1)");
    std::vector<SystemRecord> records = {
        record_of(600, 0.05, {[](double t) { return 3 * std::sin(std::floor(t / 0.5 + 1e-9) * 2.3); }})};
    const auto measure = [&] {
        records[0].outputs =
            SystemFit(records, {1}, Interpolation::hold, {600}).simulate(truth, {2, 1}, 0, 600)->outputs;
        for (std::size_t k = 0; k < 600; ++k) records[0].outputs[0][k] += 1e-3 * standard_normal(1, 0, k);
    };
    measure();
    SystemSearch search(model, records, {1}, never, by_itself);
    search.begin();
    EXPECT_EQ(search.interpolation(), Interpolation::hold);
    // What moves all the time may be anything.
    for (double& u : records[0].inputs[0])
        u += 1e-3 * standard_normal(2, 0, static_cast<std::uint64_t>(&u - records[0].inputs[0].data()));
    measure();
    SystemSearch other(model, records, {1}, never, by_itself);
    other.begin();
    EXPECT_NE(other.interpolation(), Interpolation::hold);
}

// The output holds its place until the input, whose motion is imposed, has moved by the width to either side.
TEST(SystemSearch, APlayIsFoundWithoutStates) {
    const TemporaryFolder folder;
    SystemModel model = model_of(folder, "parameters = { a = 2, b = 0.1 }, inputs = { u = 0, u_rate = 0 }, "
                                         "outputs = function(s) return { y = s.a * s.u + s.b } end");
    model.starts.clear();
    std::vector<SystemRecord> records = {
        record_of(800, 0.04,
                  {[](double t) { return std::sin(3 * t) + 0.4 * std::sin(7.1 * t); },
                   [](double t) { return 3 * std::cos(3 * t) + 2.84 * std::cos(7.1 * t); }})};
    double held = 0;
    records[0].outputs.assign(1, {});
    for (std::size_t k = 0; k < 800; ++k) {
        const double u = records[0].inputs[0][k];
        held = std::clamp(held, u - 0.15, u + 0.15);
        records[0].outputs[0].push_back(1.7 * held + 0.2 + 0.01 * standard_normal(1, 0, k));
    }
    SystemSearch search(model, records, {1}, never, by_itself);
    const auto found = search.next(search.begin());
    const auto play = std::ranges::find_if(found, [](const SystemCandidate& one) {
        return one.terms.size() == 1 && one.terms[0].kind() == "play in input u";
    });
    ASSERT_NE(play, found.end());
    EXPECT_NEAR(play->values[2], 0.15, 0.002);
    EXPECT_LT(rms_of_errors(play->fitted), 0.0115);
}

// Stops of springs, hit at other instants in each step, ask for steps shorter than the noise needs; they are not stiff.
TEST(SystemSearch, ATermWithAKinkIsFitted) {
    const TemporaryFolder folder;
    SystemModel model = model_of(folder, R"(
        parameters = { w2 = 400, d = 0.2, stop = 4000 }, states = { x = 0.04, v = 0 },
        der = function(s) return { x = s.v, v = -s.w2 * s.x - s.d * s.v - s.stop * math.max(s.x - 0.02, 0) } end,
        outputs = function(s) return { y = s.x } end)");
    std::vector<SystemRecord> records = {record_of(1000, 0.008, {})};
    records[0].outputs =
        SystemFit(records, {1}, Interpolation::hold, {1000}).simulate(model, model.values(1), 0, 1000)->outputs;
    for (std::size_t k = 0; k < 1000; ++k) records[0].outputs[0][k] += 1e-4 * standard_normal(1, 0, k);
    SystemFit fit(records, {0.024}, Interpolation::hold, {1000});
    fit.begin_search(32);
    fit.keep_to_fixed_steps();
    const auto result = fit.fit(model, {0.201, 3990, 400.2, 0, 0.04}, 20, never);
    ASSERT_FALSE(result.errors.empty());
    EXPECT_NEAR(result.values[1], 4000, 30);
}

// Terms are screened side by side, in one model; each has the effect that it has alone.
TEST(Screening, TermsSideBySideAreScreenedAsAlone) {
    const TemporaryFolder folder;
    SystemModel model = model_of(folder, R"(
        parameters = { k = 40, c = 0.8 }, inputs = { u = 0 }, states = { x = 0, v = 0 },
        der = function(s) return { x = s.v, v = 30 * s.u - s.k * s.x - s.c * s.v } end,
        outputs = function(s) return { y = s.x } end)");
    std::vector<SystemRecord> records = {
        record_of(600, 0.02, {[](double t) { return std::sin(1.3 * t) + 0.6 * std::sin(4.1 * t); }})};
    const SystemModel true_one = model_of(folder, R"(
        parameters = { k = 40, c = 0.8 }, inputs = { u = 0 }, states = { x = 0, v = 0 },
        der = function(s)
          return { x = s.v, v = 30 * s.u - s.k * s.x - s.c * s.v - 6 * s.x ^ 3 - 0.5 * tb.tanh(s.v / 0.05) }
        end,
        outputs = function(s) return { y = s.x } end)");
    const SystemFit whole(records, {1}, Interpolation::linear, {600});
    records[0].outputs = whole.simulate(true_one, true_one.values(1), 0, 600)->outputs;
    SystemFit fit(records, {1}, Interpolation::linear, {600});
    fit.begin_search(1);
    const auto values = model.values(1);
    const auto errors = fit.errors(model, values);
    const std::vector<SystemTrace> traces = {*fit.simulate(model, values, 0, 600)};
    const auto terms = system_terms(model, 2, fit, variables_of(model, 2, fit, traces), errors, true);
    ASSERT_GT(terms.size(), 60u);
    const RunControl control;
    std::map<std::size_t, double> explained;
    for (const auto& one : screened_singles(model, values, errors, terms, fit, control, never)) {
        explained[one.terms[0]] = one.explained;
    }
    EXPECT_GT(explained.size(), 20u);
    for (std::size_t i = 0; i < terms.size(); ++i) {
        const auto alone = screened_singles(model, values, errors, {terms[i]}, fit, control, never);
        ASSERT_EQ(alone.size(), explained.contains(i) ? 1u : 0u) << terms[i].kind();
        for (const auto& one : alone) EXPECT_NEAR(one.explained, explained[i], 1e-6) << terms[i].kind();
    }
}

// y = c u with white noise of deviation s: c is known to s / sqrt(sum u^2), and a prediction is off by that times the input.
TEST(SystemComparison, NoiseInFittedValuesIsOffInPredictionsByClosedForm) {
    const TemporaryFolder folder;
    const SystemModel model = model_of(folder, R"(
        parameters = { c = 2 }, inputs = { u = 0 }, states = {}, der = function() return {} end,
        outputs = function(s) return { y = s.c * s.u } end)");
    const auto with_outputs = [](SystemRecord record) {
        record.outputs.emplace_back();
        for (const double u : record.inputs[0]) record.outputs[0].push_back(2 * u);
        return record;
    };
    const auto fitted = with_outputs(record_of(80, 0.1, {[](double t) { return std::sin(t); }}));
    const auto predicted = with_outputs(record_of(50, 0.1, {[](double t) { return 3 + t; }}));
    const std::vector<SystemRecord> records = {fitted};
    const double scale = 5, noise = 0.02; // noise: relative to the scale
    const SystemFit fit(records, {scale}, Interpolation::linear, {80});
    const auto covariance = fit.covariance(model, {2}, fit.errors(model, {2}), noise);
    double squares = 0, later = 0;
    for (const double u : fitted.inputs[0]) squares += u * u;
    for (const double u : predicted.inputs[0]) later += u * u;
    EXPECT_NEAR(covariance(0, 0), std::pow(noise * scale, 2) / squares, 1e-9);
    const double expected = noise * scale * std::sqrt(later / 50 / squares);
    EXPECT_NEAR(prediction_uncertainty(model, {2}, predicted, 0, {scale}, Interpolation::linear, covariance, noise),
                expected, 1e-6 * expected);
}

// Of two models that leave noise alone the richer one wins if it gains more than its parameters cost and more than the best of
// so many terms does by chance: n ln(ratio of squares) > parameters ln n + 2 terms ln(library).
TEST(SystemCandidate, ARicherModelOfNoiseMustGainMoreThanChance) {
    const std::size_t n = 400, library = 100;
    const auto candidate = [&](double gain, std::size_t terms) {
        SystemCandidate one{.model = {}};
        one.library = library;
        one.is_noise = true;
        const double e = std::sqrt(std::exp(-gain / static_cast<double>(n)));
        one.fitted.assign(300, e);
        one.predicted.assign(100, -e);
        for (std::size_t i = 0; i < terms; ++i) {
            one.terms.push_back({.name = "linear", .equation = "der(x)", .of = "x", .parameters = {{.name = "a"}}});
        }
        return one;
    };
    const double price = std::log(400.0) + 2 * std::log(100.0);
    const auto plain = candidate(0, 1);
    EXPECT_GT(candidate(0.98 * price, 2).score(), plain.score());
    EXPECT_LT(candidate(1.02 * price, 2).score(), plain.score());
}

// The best of M frequencies in N independent errors gains more than 2 ln(M/0.05) of N ln(ratio of squares) once in twenty times.
TEST(SystemCandidate, AWaveMustExplainMoreThanTheBestOfManyFrequencies) {
    const std::size_t n = 400, frequencies = 100;
    const auto candidate = [&](double gain, std::size_t looked_at) {
        SystemCandidate one{.model = {}};
        const double e = std::sqrt(std::exp(-gain / static_cast<double>(n)));
        for (std::size_t k = 0; k < n; ++k) one.fitted.push_back(k % 2 == 0 ? e : -e);
        one.terms.push_back({.name = "periodic_in_time", .equation = "der(x)", .of = "t", .parameters = {}});
        one.terms.back().looked_at = looked_at;
        return one;
    };
    const double price = 2 * std::log(100.0 / 0.05);
    const auto plain = candidate(0, 1);
    EXPECT_TRUE(candidate(0.98 * price, frequencies).is_chance_beside(plain));
    EXPECT_FALSE(candidate(1.02 * price, frequencies).is_chance_beside(plain));
    // What has no frequency has no price.
    EXPECT_FALSE(candidate(0, 1).is_chance_beside(plain));
}

// A linear damping and a quadratic one agree at the small input of the record. What separates them is a larger range of
// velocities, within the input that was seen.
TEST(SystemNextExperiment, SeparatesRivalsWithinTheInputsSeen) {
    const TemporaryFolder folder;
    const auto candidate = [&](const std::string& friction) {
        SystemCandidate one{.model = model_of(folder, R"(
            parameters = { d = 0.5 }, inputs = { u = 0 }, states = { v = 0.5 },
            der = function(s) return { v = s.u - s.d * )" +
                                                          friction + R"( } end,
            outputs = function(s) return { y = s.v } end)")};
        one.values = one.model.values(1);
        return one;
    };
    const auto first = candidate("s.v"), second = candidate("s.v * math.abs(s.v) * 2");
    const std::vector<SystemRecord> records = {record_of(400, 0.1, {[](double t) { return t < 38 ? 0.25 : -1.5; }})};
    const auto next = next_system_experiment(first, {second}, records, {1}, Interpolation::hold, 0.01, {});
    ASSERT_TRUE(next);
    EXPECT_GT(next->apart, 3);
    ASSERT_EQ(next->record.inputs.size(), 1u);
    for (const double u : next->record.inputs[0]) {
        EXPECT_GE(u, -1.5 - 1e-12);
        EXPECT_LE(u, 0.25 + 1e-12);
    }
    // Of what the second model does on both records the first one explains, with any values, no more than it says.
    const auto least = [&](std::vector<SystemRecord> on) {
        const std::vector<SystemRecord> all = std::move(on);
        std::vector<std::size_t> whole;
        for (const auto& record : all) whole.push_back(record.size());
        return SystemFit(all, {1}, Interpolation::hold, whole)
            .fit(first.model, first.model.values(all.size()), 40, never)
            .sum;
    };
    SystemRecord present = records[0];
    present.outputs =
        SystemFit(records, {1}, Interpolation::hold, {400}).simulate(second.model, second.values, 0, 400)->outputs;
    const double rise = least({present, next->record}) - least({present});
    EXPECT_GT(std::sqrt(rise / static_cast<double>(next->record.size())) / 0.01, 0.5 * next->apart);
    // The same model twice cannot be told apart.
    EXPECT_FALSE(next_system_experiment(first, {first}, records, {1}, Interpolation::hold, 0.01, {}));
    // Where they hardly differ the record is three times as long, where they do, it is not.
    EXPECT_EQ(next->record.size(), 400u);
    const auto longer =
        next_system_experiment(first, {second}, records, {1}, Interpolation::hold, 0.01 * next->apart * 2, {});
    ASSERT_TRUE(longer);
    EXPECT_EQ(longer->record.size(), 1200u);
    EXPECT_LT(longer->apart, 1);
}

// A short pulse of the input is in its range. Held for long it would lead the outputs far beyond theirs.
TEST(SystemNextExperiment, StaysWhereTheOutputsWere) {
    const TemporaryFolder folder;
    const auto candidate = [&](const std::string& more) {
        SystemCandidate one{
            .model =
                model_of(folder, fmt::format(R"(parameters = {{ d = 0.5 }}, inputs = {{ u = 0 }}, states = {{ v = 0 }},
            der = function(s) return {{ v = s.u - s.d * s.v + {} }} end, outputs = function(s) return {{ y = s.v }} end)",
                                             more))};
        one.values = one.model.values(1);
        return one;
    };
    const auto first = candidate("0"), second = candidate("0.02 * s.v ^ 3");
    std::vector<SystemRecord> records = {record_of(400, 0.1, {[](double t) {
                                                       return 0.3 * std::sin(t) + (t > 10 && t < 10.5 ? 2.0 : 0) -
                                                              (t > 20 && t < 20.5 ? 2.0 : 0);
                                                   }})};
    records[0].outputs =
        SystemFit(records, {1}, Interpolation::hold, {400}).simulate(second.model, second.values, 0, 400)->outputs;
    const auto [low, high] = std::ranges::minmax(records[0].outputs[0]);
    for (const double left : {1e-5, 1e-4}) {
        const auto next = next_system_experiment(first, {second}, records, {1}, Interpolation::hold, left, {});
        ASSERT_TRUE(next);
        EXPECT_GT(next->apart, 1);
        for (const double y : next->record.outputs[0]) {
            EXPECT_GE(y, low - 0.5 * (high - low));
            EXPECT_LE(y, high + 0.5 * (high - low));
        }
    }
    // Where only what lies beyond tells the models apart it is taken.
    const auto far = next_system_experiment(first, {second}, records, {1}, Interpolation::hold, 0.3, {});
    ASSERT_TRUE(far);
    EXPECT_GT(std::ranges::max(far->record.outputs[0]), high + 0.5 * (high - low));
    EXPECT_NE(far->text.find("see first that the machine allows it"), std::string::npos);
    // A model that runs away differs most of all. It is proposed up to ten times the range, and not at all beyond.
    const auto away = candidate("0.5 * s.u * s.v");
    const auto bounded = next_system_experiment(first, {away}, records, {1}, Interpolation::hold, 3, {});
    ASSERT_TRUE(bounded);
    const auto [least, most] = std::ranges::minmax(bounded->record.outputs[0]);
    EXPECT_GT(least, low - 10 * (high - low));
    EXPECT_LT(most, high + 10 * (high - low));
    EXPECT_FALSE(next_system_experiment(first, {away}, records, {1}, Interpolation::hold, 30, {}));
    // An output that did not move has its scale for a range.
    std::ranges::fill(records[0].outputs[0], 0);
    EXPECT_FALSE(next_system_experiment(first, {away}, records, {1}, Interpolation::hold, 30, {}));
}

// Of what is sampled faster than it moves, as many samples are left out as follow from the others within the noise.
TEST(ThinnedRecords, WhatFollowsFromTheOthersIsLeftOut) {
    const TemporaryFolder folder;
    const SystemModel model = model_of(folder, R"(
        parameters = { k = 40 }, inputs = { u = 0 }, states = { x = 0, v = 0 },
        der = function(s) return { x = s.v, v = s.u - s.k * s.x } end, outputs = function(s) return { y = s.x } end)");
    const auto record_with = [](std::size_t samples, double fast, double (*input)(double)) {
        auto record = record_of(samples, 0.002, {input});
        record.outputs.emplace_back();
        for (std::size_t k = 0; k < samples; ++k) {
            const double t = record.t[k];
            record.outputs[0].push_back(std::sin(6.3 * t) + fast * std::sin(250 * t) + 2e-4 * uniform(1, 2, k));
        }
        return record;
    };
    const auto slow = [](double t) { return std::sin(t); };
    const auto steps = [](double t) { return std::fmod(t, 1) < 0.5 ? 1.0 : -1.0; };
    const auto quick = [](double t) { return std::fmod(t, 0.01) < 0.005 ? 1.0 : -1.0; };
    const auto every = [&](const SystemModel& of, const std::vector<SystemRecord>& records, double negligible = 0) {
        const auto some = thinned(of, records, {negligible});
        for (std::size_t r = 0; r < records.size(); ++r) {
            EXPECT_EQ(some[r].every, some[0].every);
            for (std::size_t k = 0; k < some[r].size(); ++k) {
                EXPECT_EQ(some[r].t[k], records[r].t[k * some[r].every]);
                EXPECT_EQ(some[r].inputs[0][k], records[r].inputs[0][k * some[r].every]);
            }
        }
        return some[0].every;
    };
    const auto record = record_with(20000, 0, slow);
    EXPECT_EQ(every(model, {record}), 8u) << "2500 are left, of 16 there would be 1250";
    EXPECT_EQ(every(model, {record, record}), 16u);
    EXPECT_EQ(every(model, {record_with(20000, 0, steps)}), 8u);
    EXPECT_EQ(every(model, {record_with(7000, 0, slow)}), 1u) << "too few";
    EXPECT_EQ(every(model, {record, record_with(20000, 0.01, slow)}), 1u) << "something is fast";
    EXPECT_EQ(every(model, {record, record_with(20000, 0.01, slow)}, 0.02), 16u) << "but does not count";
    EXPECT_EQ(every(model, {record_with(20000, 0, quick)}), 1u) << "the input is fast";
    auto other = record;
    other.outputs[0][7] = std::nan("");
    EXPECT_EQ(every(model, {other}), 1u);
    other = record;
    other.t[7] += 0.0005;
    EXPECT_EQ(every(model, {other}), 1u);
    const SystemModel direct = model_of(folder, R"(
        parameters = { k = 40 }, inputs = { u = 0 }, states = { x = 0, v = 0 },
        der = function(s) return { x = s.v, v = s.u - s.k * s.x } end,
        outputs = function(s) return { y = s.x + s.u } end)");
    EXPECT_EQ(every(direct, {record}), 1u);
    const SystemModel clocked = model_of(folder, R"(
        parameters = { k = 40 }, inputs = { u = 0 }, states = { x = 0, v = 0 }, discrete = { n = 0 },
        der = function(s) return { x = s.v, v = s.n - s.k * s.x } end, outputs = function(s) return { y = s.x } end,
        sample = { { name = "hold", period_s = 0.1, set = function(s) return { n = s.u } end } })");
    EXPECT_EQ(every(clocked, {record}), 1u);
}

// With fewer samples a model moves as with all: inputs act in between as they do there, in fixed steps as in others, also of a part.
TEST(ThinnedRecords, InputsActAsWithAllSamples) {
    const TemporaryFolder folder;
    const std::string text = R"(
        parameters = { T = 0.013 }, inputs = { u = 0 }, states = { x = 0, v = 0 },
        der = function(s) return { x = s.v, v = tb.delay(s.u, s.T) - 4 * s.x - s.v } end,
        outputs = function(s) return { y = s.x } end)";
    const SystemModel model = model_of(folder, text);
    // What comes to the same has an event at which nothing happens, and so goes without fixed steps.
    const SystemModel by_runs = model_of(folder, text + R"(, discrete = { n = 0 },
        when = { { name = "never", crossing = function(s) return s.x - 100 end, set = function() return { n = 1 } end } })");
    ASSERT_TRUE(FixedSteps::of(model));
    ASSERT_FALSE(FixedSteps::of(by_runs));
    auto record = record_of(20000, 0.002, {[](double t) { return std::fmod(t, 1) < 0.5 ? std::sin(t) : 1.5; }});
    record.outputs.emplace_back(record.size());
    const auto some = thinned(model, {record}, {0});
    ASSERT_EQ(some[0].every, 8u);
    for (const auto between : {Interpolation::hold, Interpolation::linear, Interpolation::band_limited}) {
        const std::vector<SystemRecord> all = {record}, part = {some[0].part(100, 700)};
        const SystemFit whole(all, {1}, between, {record.size()}), few(some, {1}, between, {some[0].size()});
        const auto wanted = whole.errors(model, model.values(1));
        const auto found = few.errors(model, model.values(1)), runs = few.errors(by_runs, by_runs.values(1));
        ASSERT_EQ(found.size(), some[0].size());
        ASSERT_EQ(runs.size(), found.size());
        // The delayed input is a line of 16 ms, which a step at its ends has moved by its mean and moment.
        for (std::size_t k = 0; k < found.size(); ++k) {
            EXPECT_NEAR(found[k], wanted[8 * k], 1e-4) << k;
            EXPECT_NEAR(runs[k], wanted[8 * k], 1e-4) << k;
        }
        const auto trace = few.simulate(model, model.values(1), 0, some[0].size());
        ASSERT_TRUE(trace);
        const SystemModel later = [&] {
            auto one = model;
            for (std::size_t i = 0; i < 2; ++i) one.equations.states[i].start = trace->states[i][100];
            return one;
        }();
        const SystemFit of_part(part, {1}, between, {part[0].size()});
        const auto own = of_part.errors(later, later.values(1));
        ASSERT_EQ(own.size(), 700u);
        for (std::size_t k = 50; k < own.size(); ++k) EXPECT_NEAR(own[k], found[100 + k], 1e-3) << k;
    }
}

} // namespace
} // namespace tribode
