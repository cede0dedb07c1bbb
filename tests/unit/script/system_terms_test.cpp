#include "tribode/base/error.hpp"
#include "tribode/diagnosis/inner_signals.hpp"
#include "tribode/diagnosis/system_record.hpp"
#include "tribode/diagnosis/system_terms.hpp"
#include "tribode/script/system_file.hpp"
#include "tribode/system/equations_lua.hpp"
#include "unit/script/temporary_folder.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <map>
#include <set>

namespace tribode {
namespace {

Equations read_system(const TemporaryFolder& folder, const std::string& text) {
    ScriptRequest request;
    request.script = folder.write("system.lua", text);
    request.folder = folder / "out";
    ScriptRun run(request, {});
    return system_of_file(run);
}

// A system and a record of it, and the terms that the library has for it.
struct Case {
    SystemModel model;
    std::vector<SystemRecord> records;
    std::vector<double> scale;
    std::vector<SystemTerm> terms;

    Case(const TemporaryFolder& folder, const std::string& text, const std::string& columns) {
        std::string rows = columns + "\n";
        for (int k = 0; k < 150; ++k) {
            const double t = 0.02 * k;
            rows += std::to_string(t) + "," + std::to_string(std::sin(3 * t)) + "," + std::to_string(std::cos(2 * t)) +
                    "\n";
        }
        const auto file = folder.write("record.csv", rows);
        model = with_inner_signals(system_model_of(read_system(folder, text), {}, {}, {file}));
        records.push_back(read_system_record(file, model, {}));
        scale.assign(model.measured.size(), 1);
        const auto trace = fit().simulate(model, model.values(1), 0, 150);
        if (!trace) throw std::runtime_error("the system does not run");
        const auto errors = fit().errors(model, model.values(1));
        const std::size_t states = model.equations.states.size();
        terms = system_terms(model, states, fit(), variables_of(model, states, fit(), {*trace}), errors);
    }

    SystemFit fit() const { return {records, scale, Interpolation::linear, {150}}; }
    std::vector<std::vector<double>> outputs(const SystemModel& of, const std::vector<double>& values) const {
        const auto trace = fit().simulate(of, values, 0, 150);
        return trace ? trace->outputs : std::vector<std::vector<double>>{};
    }
};

constexpr const char* vehicle = R"(
    local tb = require "tribode"
    return tb.system {
        parameters = { d = { value = 0.4, unit = "1/s" }, g = { value = 20, unit = "m/s2/V" },
            m = { value = 2, unit = "kg" } },
        inputs = { u = { unit = "V" }, load = { value = 0.3, unit = "N" } },
        states = { x = { start = 0, unit = "m" }, v = { start = -3, unit = "m/s" }, w = { start = 1, unit = "m/s" } },
        der = function(s) return { x = s.v, v = s.g * s.u - s.d * s.v - s.load / s.m, w = s.d * (s.v - s.w) } end,
        outputs = function(s) return { sum = { s.v + s.w, unit = "m/s" } } end,
        free = { "d", "x.start" },
    })";
constexpr const char* seal = R"(
    local tb = require "tribode"
    return tb.system {
        parameters = { area = { value = 0.5, unit = "m2" } },
        inputs = { p = { unit = "Pa" }, x = { unit = "m" } },
        outputs = function(s) return { F = { s.area * s.p, unit = "N" } } end,
    })";

const char* const heater = R"(
    local tb = require "tribode"
    return tb.system {
        parameters = { k = { value = 0.5, unit = "K/s/V" }, c = { value = 0.7, unit = "1/s" }, around = { value = 2, unit = "K" } },
        inputs = { u = { value = 4, unit = "V" } }, states = { T = { start = 1, unit = "K" }, w = { start = 0, unit = "K" } },
        der = function(s) return { T = s.k * s.u - s.c * (s.T - s.around), w = s.c * (s.T - s.w) } end,
        outputs = function(s) return { T = { s.T, unit = "K" } } end,
        free = { "k", "around", "T.start" },
    })";

// With the values at which it is screened each term does something, and nothing where it is neutral. Written as Lua, with all
// units, and read again the system runs as before.
void check_terms(const std::string& text, const std::string& columns, const std::set<std::string>& names) {
    const TemporaryFolder folder;
    const Case c(folder, text, columns);
    std::set<std::string> found;
    const auto before = c.outputs(c.model, c.model.values(1));
    for (const auto& term : c.terms) {
        SCOPED_TRACE(term.kind());
        found.insert(term.name);
        std::vector<double> values, neutral;
        for (std::size_t i = 0; i < term.parameters.size(); ++i) {
            values.push_back(term.parameters[i].start);
            neutral.push_back(i < term.amplitudes ? term.neutral[i] : term.parameters[i].start);
        }
        const SystemModel with = extended(c.model, term, values);
        const auto after = c.outputs(with, more_values(c.model, c.model.values(1), values));
        const auto same = c.outputs(with, more_values(c.model, c.model.values(1), neutral));
        ASSERT_EQ(after.size(), before.size());
        ASSERT_EQ(same.size(), before.size());
        const Equations again = read_system(folder, equations_lua(without_measured_states(with), "-- a test\n"));
        SystemModel read = system_model_of(again, {}, {}, {folder / "record.csv"});
        read.parameters.clear();
        const auto written = c.outputs(read, read.values(1));
        ASSERT_EQ(written.size(), after.size());
        double moved = 0;
        for (std::size_t o = 0; o < before.size(); ++o) {
            for (std::size_t k = 0; k < before[o].size(); ++k) {
                moved = std::max(moved, std::abs(after[o][k] - before[o][k]));
                ASSERT_NEAR(written[o][k], after[o][k], 1e-5 * std::max(1.0, std::abs(after[o][k])));
                // A lag of nothing is a short one, and so is that of what follows without a limit; limits of an output leave alone
                // what the record shows, and this model shows more.
                const bool is_lag = term.name == "lag" || (term.name == "rate_limit" && !term.constants.empty());
                const bool is_limit = term.name == "clipping" || term.kind().starts_with("saturation in output");
                if (!is_lag && !is_limit) {
                    ASSERT_NEAR(same[o][k], before[o][k], 1e-5);
                }
            }
        }
        EXPECT_GT(moved, 1e-9);
        EXPECT_NE(term.equation, "input load"); // which does not move
    }
    for (const auto& name : names) EXPECT_TRUE(found.contains(name)) << name;
}

TEST(SystemTerms, EachOfADrivenVehicleRunsAndCanBeWritten) {
    check_terms(vehicle, "t,u,sum",
                {"constant_force",
                 "viscous_friction",
                 "quadratic_drag",
                 "coulomb_friction",
                 "preloaded_spring",
                 "spring_force",
                 "cubic_stiffness",
                 "presliding_hysteresis",
                 "bouc_wen_friction",
                 "force_ripple",
                 "periodic_disturbance",
                 "constant",
                 "linear",
                 "threshold",
                 "product",
                 "overflow",
                 "dead_zone",
                 "saturation",
                 "offset",
                 "gain",
                 "power_law",
                 "lag",
                 "play",
                 "delay",
                 "resonant_mode",
                 "clipping",
                 "curve"});
}

// Two masses behind a coupling, under a controller of their difference to a reference: what is between them acts on both.
TEST(SystemTerms, EachOfACouplingRunsAndCanBeWritten) {
    check_terms(
        R"(
        local tb = require "tribode"
        return tb.system {
            parameters = { k = { value = 50, unit = "1/s2" }, d = { value = 0.5, unit = "1/s" }, m = 2, kp = 20 },
            inputs = { r = { unit = "m" } },
            states = { x1 = { start = 1.5, unit = "m" }, v1 = { start = 0, unit = "m/s" },
              x2 = { start = 0, unit = "m" }, v2 = { start = 0, unit = "m/s" } },
            der = function(s)
              local spring = s.k * (s.x1 - s.x2) + s.d * (s.v1 - s.v2)
              return { x1 = s.v1, v1 = s.kp * (s.r - s.x2) - spring, x2 = s.v2, v2 = s.m * spring }
            end,
            outputs = function(s) return { bend = { s.x1 - s.x2, unit = "m" } } end,
            free = { "d", "x1.start" },
        })",
        "t,r,bend",
        {"backlash", "saturation", "dead_zone", "one_way", "cubic_stiffness", "coulomb_friction", "quadratic_drag"});
}

// What remembers begins in each record at rest behind what it follows there, or as its output was measured first; what an input was
// before the records may also be its own value.
TEST(SystemTerms, WhatRemembersBeginsWithEachRecord) {
    const TemporaryFolder folder;
    const Case c(folder, heater, "t [s],u [V],T [K]");
    SystemRecord other = c.records[0].part(20, 100);
    other.outputs[0][0] = std::nan("");
    const std::vector<SystemRecord> records = {c.records[0], other};
    const SystemFit fit(records, c.scale, Interpolation::linear, {150, 100});
    const double first = c.records[0].inputs[0][0], later = c.records[0].inputs[0][20];
    ASSERT_NE(first, later);
    // k, around, the starts of T.
    const std::vector<double> given = {0.5, 2, 1, 7};
    const std::map<std::string, std::vector<std::pair<double, double>>> expected = {
        {"lag in output T_measured", {{c.records[0].outputs[0][0], c.records[0].outputs[0][21]}}},
        {"lag in input u", {{first, later}, {4, 4}}},
        {"memory in der(T) of T", {{1, 7}}},
        {"lag in T - w", {{1, 7}}},
    };
    std::map<std::string, std::set<std::pair<double, double>>> found;
    for (const auto& term : c.terms) {
        if (!expected.contains(term.kind())) continue;
        SCOPED_TRACE(term.kind());
        std::vector<double> own;
        for (const auto& parameter : term.parameters) own.push_back(parameter.start);
        if (term.name == "memory") own = {-0.5, 0.3}; // as large as all else
        const SystemModel with = extended(c.model, term, own);
        const auto values = more_values(c.model, given, own);
        std::vector<double> starts;
        for (std::size_t r = 0; r < 2; ++r) starts.push_back(with.begun(values, r, records[r]).states.back().start);
        found[term.kind()].insert({starts[0], starts[1]});
        // So it does for all solvers, and derivatives follow.
        const auto errors = fit.errors(with, values);
        std::vector<double> by_runs;
        for (std::size_t r = 0; r < 2; ++r) {
            const auto trace = fit.simulate(with, values, r, records[r].size());
            ASSERT_TRUE(trace);
            for (std::size_t k = 0; k < records[r].size(); ++k) {
                const double measured = records[r].outputs[0][k];
                if (!std::isnan(measured)) by_runs.push_back(measured - trace->outputs[0][k]);
            }
        }
        ASSERT_EQ(by_runs.size(), errors.size());
        for (std::size_t k = 0; k < errors.size(); ++k) ASSERT_NEAR(by_runs[k], errors[k], 5e-3) << k;
        SystemModel sampled = with; // of a clock the variational equations are solved
        sampled.equations.clocks.push_back({.name = "none", .period = 1});
        const auto exact = fit.jacobian(sampled, values, by_runs), steps = fit.jacobian(with, values, errors);
        EXPECT_LT((exact - steps).norm(), 0.01 * steps.norm()); // these steps are as long as a fit allows
        EXPECT_GT(exact.norm(), 0.1);
    }
    for (const auto& [kind, pairs] : expected) {
        ASSERT_EQ(found[kind].size(), pairs.size()) << kind;
        for (const auto& [a, b] : pairs) {
            EXPECT_TRUE(std::ranges::any_of(
                found[kind],
                [&](const auto& one) { return std::abs(one.first - a) < 1e-12 && std::abs(one.second - b) < 1e-12; }))
                << kind << " " << a << " " << b;
        }
    }
}

// From rest to a turn dz/dx = (1 - z^2)/D, and with beta = 1/2 dz/dx = 1/D on the way back to z = 0, at whatever speed. The speed is that
// of the record, off by 5e-4 of it.
TEST(SystemTerms, BoucWenFollowsItsClosedForms) {
    const TemporaryFolder folder;
    const Case c(folder, R"(
        return require "tribode".system { parameters = { k = { value = 0.5, unit = "N/m" } }, inputs = { x = { unit = "m" } },
            outputs = function(s) return { F = { s.k * s.x, unit = "N" } } end })",
                 "t,x,F");
    const auto term = std::ranges::find_if(
        c.terms, [](const auto& one) { return one.kind() == "bouc_wen_friction in output F of x"; });
    ASSERT_NE(term, c.terms.end());
    const double distance = 0.6, hardening = 0.5;
    const std::vector<double> own = {1, hardening, distance, 0.5};
    const auto with = c.outputs(extended(c.model, *term, own), more_values(c.model, c.model.values(1), own));
    const auto without = c.outputs(c.model, c.model.values(1));
    const auto x = [](int k) { return std::sin(0.06 * k); };
    const int turn = 26; // the sample where x is largest
    const double top = std::tanh(x(turn) / distance);
    for (int k = 0; k < 45; ++k) {
        const double z = k <= turn ? std::tanh(x(k) / distance) : top - (x(turn) - x(k)) / distance;
        if (z < 0) break;
        EXPECT_NEAR(with[0][static_cast<std::size_t>(k)] - without[0][static_cast<std::size_t>(k)],
                    z + hardening * z * z * z, 3e-3)
            << k;
    }
}

// What holds a velocity already has no second friction that holds it.
TEST(SystemTerms, OneFrictionHoldsAVelocity) {
    const TemporaryFolder folder;
    const auto count_of = [&](const std::string& part, const std::string& force) {
        const Case c(folder,
                     R"(
            return require "tribode".system { inputs = { u = 0 }, states = { x = 0, v = 0.5 }, )" +
                         part + R"(
                der = function(s) return { x = s.v, v = 3 * s.u - s.x )" +
                         force + R"( } end,
                outputs = function(s) return { y = s.x } end })",
                     "t,u,y");
        return std::ranges::count_if(c.terms, [](const auto& term) { return term.parameters[0].name == "level"; });
    };
    EXPECT_EQ(count_of("", ""), 1);
    EXPECT_EQ(
        count_of("parts = { f = require \"tribode\".parts.coulomb { velocity = \"v\", level = 0.2 } },", "- s.f.force"),
        0);
}

// A term with its values is the system in which it is written out.
void expect_written_out(const Case& plain, const std::string& kind, const std::string& first_parameter,
                        const std::vector<double>& own, const Case& written, double near = 1e-7) {
    const auto term = std::find_if(plain.terms.begin(), plain.terms.end(), [&](const auto& one) {
        return one.kind() == kind && one.parameters.front().name == first_parameter;
    });
    ASSERT_NE(term, plain.terms.end()) << kind;
    const auto found =
        plain.outputs(extended(plain.model, *term, own), more_values(plain.model, plain.model.values(1), own));
    const auto there = written.outputs(written.model, written.model.values(1));
    const auto without = plain.outputs(plain.model, plain.model.values(1));
    ASSERT_EQ(found.size(), there.size()) << kind;
    double moved = 0;
    for (std::size_t k = 0; k < there[0].size(); ++k) {
        ASSERT_NEAR(found[0][k], there[0][k], near) << kind;
        moved = std::max(moved, std::abs(there[0][k] - without[0][k]));
    }
    EXPECT_GT(moved, 1e-3) << kind;
}

TEST(SystemTerms, AControllersOutputMayActLate) {
    const TemporaryFolder folder;
    const auto with = [&](const std::string& states, const std::string& drive, const std::string& more) {
        return Case(folder,
                    R"(
            return require "tribode".system { inputs = { r = 0 }, states = { x = 0.1, v = 0)" +
                        states + R"( },
                der = function(s)
                  local ahead = 30 * (s.r - s.x) - 4 * s.v
                  return { x = s.v, v = math.sin()" +
                        drive + ")" + more + R"( }
                end,
                outputs = function(s) return { y = s.x } end })",
                    "t,r,y");
    };
    // It begins where it is: 30 (0 - 0.1).
    const Case plain = with("", "ahead", "");
    const auto lag = std::ranges::find_if(plain.terms, [](const auto& term) {
        return term.name == "lag" && term.equation.find("r - x") != std::string::npos &&
               term.equation.find("v") != std::string::npos;
    });
    ASSERT_NE(lag, plain.terms.end());
    expect_written_out(plain, lag->kind(), "time", {0.05}, with(", i = -3", "s.i", ", i = (ahead - s.i)/0.05"));
    // Or follow no faster than so, with a lag of a fifth of a sample. Where limits are written out the solver locates their events.
    constexpr double passed_over = 1e-6;
    const auto limited = [](const std::string& wanted, const std::string& most) {
        return "math.max(math.min((" + wanted + ")/0.004, " + most + "), -" + most + ")";
    };
    const std::string signal = lag->kind().substr(std::string("lag in ").size());
    expect_written_out(plain, "rate_limit in " + signal, "limit", {15},
                       with(", i = -3", "s.i", ", i = " + limited("ahead - s.i", "15")), passed_over);
    expect_written_out(plain, "rate_limit in input r", "limit", {1.2},
                       with(", f = 0", "(ahead + 30 * (s.f - s.r))", ", f = " + limited("s.r - s.f", "1.2")),
                       passed_over);
}

TEST(SystemTerms, FrictionRisesTowardRestAsThatOfAPartDoes) {
    const TemporaryFolder folder;
    const auto with = [&](const std::string& options) {
        return Case(folder,
                    R"(
            return require "tribode".system { inputs = { u = 0 }, states = { x = 0, v = 0.5 },
                parameters = { level = { value = 0.2, unit = "N" } },
                parts = { f = require "tribode".parts.coulomb { velocity = "v",
                          level = function(s) return s.level end)" +
                        options + R"( } },
                der = function(s) return { x = s.v, v = (s.u - s.x - s.f.force) / 0.3 } end,
                outputs = function(s) return { y = s.x } end })",
                    "t,u,y");
    };
    const Case plain = with("");
    expect_written_out(plain, "stribeck_friction in der(v) of v", "rise", {0.3, 0.1},
                       with(", static = 0.5, stribeck_velocity = 0.1, exponent = 2"));
    const auto term = std::ranges::find(plain.terms, "stribeck_friction", &SystemTerm::name);
    EXPECT_EQ(term->parameters[0].unit, "N"); // that of the level, and not of the derivative
}

TEST(SystemTerms, AForceMayActAboutAPlace) {
    const TemporaryFolder folder;
    const auto with = [&](const std::string& force) {
        return Case(folder,
                    R"(
            return require "tribode".system { inputs = { u = 0 }, states = { x = 0.3, v = 0 },
                der = function(s)
                  local r = (s.x - 0.1) / 0.05
                  return { x = s.v, v = 3 * s.u - 20 * s.x)" +
                        force + R"( }
                end,
                outputs = function(s) return { y = s.x } end })",
                    "t,u,y");
    };
    const Case plain = with("");
    expect_written_out(plain, "local_force in der(v) of x", "a", {0.7, 0.1, 0.05}, with("+ 0.7*math.exp(-r*r)"));
    expect_written_out(plain, "detent in der(v) of x", "a", {0.7, 0.1, 0.05}, with("+ 0.7*r*math.exp(-r*r)"));
}

// A formula says what is added, and names what was there.
TEST(SystemTerms, FormulasNameWhatWasThere) {
    const TemporaryFolder folder;
    const Case c(folder, R"(
        return require "tribode".system { inputs = { r = 0 }, states = { x = 0.1, v = 0 },
            der = function(s) return { x = s.v, v = 30 * math.sin(s.r - s.x) - 4 * s.v } end,
            outputs = function(s) return { y = s.x } end })",
                 "t,r,y");
    const auto text_of = [&](SystemModel model, const std::vector<std::string>& kinds) {
        std::string text;
        for (const auto& kind : kinds) {
            const auto term = std::ranges::find_if(c.terms, [&](const auto& one) { return one.kind() == kind; });
            if (term == c.terms.end()) return "no " + kind;
            std::vector<double> own;
            for (const auto& parameter : term->parameters) own.push_back(parameter.start);
            model = extended(model, *term, own, &text);
        }
        return text;
    };
    EXPECT_EQ(text_of(c.model, {"saturation in r - x", "dead_zone in r - x"}),
              "(r - x) - min(dead_zone_width, max(r - x, -dead_zone_width))");
    EXPECT_EQ(text_of(c.model, {"rate_limit in der(v)"}), "min(rate_limit_limit, max(der(v), -rate_limit_limit))");
}

TEST(InnerSignals, ATermOfWhatIsSharedActsOnBothSides) {
    const TemporaryFolder folder;
    const auto with = [&](const std::string& spring) {
        return R"(
        local tb = require "tribode"
        return tb.system {
            parameters = { k = 50, m = 2, a = 300, gap = 0.02 }, inputs = { u = 0 },
            states = { x1 = 0.1, v1 = 0, x2 = 0, v2 = 0 },
            der = function(s)
              local bend = s.x1 - s.x2
              local spring = )" +
               spring + R"(
              return { x1 = s.v1, v1 = s.u - spring, x2 = s.v2, v2 = s.m * spring }
            end,
            outputs = function(s) return { bend = s.x1 - s.x2 } end,
        })";
    };
    const Case plain(folder, with("s.k * bend"), "t,u,bend");
    struct Pair {
        std::string kind, spring;
        double value;
    };
    for (const auto& [kind, spring, value] :
         {Pair{"cubic_stiffness in x1 - x2", "s.k * (bend + 6 * bend ^ 3)", 6},
          Pair{"backlash in x1 - x2", "s.k * (bend - math.min(math.max(bend, -s.gap), s.gap))", 0.02},
          Pair{"cubic_stiffness in what der(v1) and der(v2) share of x1 - x2", "s.k * bend + s.a * bend ^ 3", 300}}) {
        const std::string parameter = kind.starts_with("backlash") ? "width" : "a";
        expect_written_out(plain, kind, parameter, {value}, Case(folder, with(spring), "t,u,bend"));
    }
    for (const auto& [closed, spring] :
         {std::pair{"closed_below", "s.k * (bend - 0.9 * (bend - math.max(bend - s.gap, 0)))"},
          {"closed_above", "s.k * (bend - 0.9 * (bend - math.min(bend + s.gap, 0)))"}}) {
        expect_written_out(plain, "one_way in x1 - x2", closed, {0.9, 0.02}, Case(folder, with(spring), "t,u,bend"));
    }
    // What only the search needs is not shown.
    EXPECT_EQ(without_inner_signals(plain.model).outputs.size(), 1u);
}

// Of two sensors of a motion one may be late. A single one that is late is not told from inputs that act late.
TEST(SystemTerms, OneOfSeveralOutputsMayBeLate) {
    const TemporaryFolder folder;
    const auto with = [&](const std::string& outputs, const std::string& columns) {
        return Case(folder,
                    "return require \"tribode\".system { inputs = { u = 0 }, states = { x = 0.3, v = 0 }, "
                    "der = function(s) return { x = s.v, v = s.u - 9 * s.x - s.v } end, outputs = "
                    "function(s) return { " +
                        outputs + " } end }",
                    columns);
    };
    const auto is_late = [](const SystemTerm& term) { return term.kind() == "delay in output b"; };
    const Case one = with("b = s.x", "t,u,b");
    EXPECT_TRUE(std::ranges::none_of(one.terms, is_late));
    const Case two = with("b = s.x, c = s.v", "t,b,c");
    const auto late = std::ranges::find_if(two.terms, is_late);
    ASSERT_NE(late, two.terms.end());
    const std::vector<double> own = {0.06}; // three samples
    const auto found = two.outputs(extended(two.model, *late, own), more_values(two.model, two.model.values(1), own));
    const auto before = two.outputs(two.model, two.model.values(1));
    double moved = 0;
    for (std::size_t k = 3; k < before[0].size(); ++k) {
        ASSERT_NEAR(found[0][k], before[0][k - 3], 5e-5); // at first: its acceleration jumps where the record begins
        ASSERT_NEAR(found[1][k], before[1][k], 1e-8);
        moved = std::max(moved, std::abs(found[0][k] - before[0][k]));
    }
    EXPECT_GT(moved, 0.03);
}

// An offset that is found after a lag of the same input: what lags begins at rest behind both.
TEST(SystemTerms, WhatHasMemoryBeginsBehindLaterTerms) {
    const TemporaryFolder folder;
    const Case c(folder,
                 "return require \"tribode\".system { inputs = { u = 0 }, states = { x = 0 }, "
                 "der = function(s) return { x = s.u - s.x } end, outputs = function(s) return { y = s.x } end }",
                 "t,u,y");
    const auto term = [&](const std::string& kind) {
        return *std::ranges::find_if(c.terms, [&](const SystemTerm& one) { return one.kind() == kind; });
    };
    const SystemModel lagging = extended(c.model, term("lag in input u"), {0.5});
    const SystemModel both = extended(lagging, term("offset in input u"), {0.4});
    const auto start_of = [&](const SystemModel& model) {
        const Equations begun = model.begun(model.values(1), 0, c.records[0]);
        return std::ranges::find(begun.states, "u_behind", &Equations::State::name)->start;
    };
    EXPECT_NEAR(start_of(lagging), 0, 1e-12); // u is sin(3 t)
    EXPECT_NEAR(start_of(both), 0.4, 1e-12);
}

// What a controller asks for, to which the plant adds its friction, may be limited.
TEST(InnerSignals, ASumOfThePartsOfASumIsOne) {
    const TemporaryFolder folder;
    const auto with = [&](const std::string& drive) {
        return "local tb = require \"tribode\" return tb.system { parameters = { kp = 60, ki = 20, d = 2, most = 1.5 "
               "}, inputs = { r = 0 }, "
               "states = { x = 0.1, v = 0, z = 0 }, der = function(s) local force = s.kp * (s.r - s.x) + s.ki * s.z "
               "return { x = s.v, v = " +
               drive + " - s.d * s.v, z = s.r - s.x } end, outputs = function(s) return { y = s.x } end }";
    };
    const Case plain(folder, with("force"), "t,r,y");
    expect_written_out(plain, "saturation in kp*(r - x) + ki*z", "limit", {1.5},
                       Case(folder, with("math.max(math.min(force, s.most), -s.most)"), "t,r,y"));
}

TEST(InnerSignals, TheirUnitsFollowFromThoseOfTheSystem) {
    const TemporaryFolder folder;
    const Case loop(folder, R"(
        return require "tribode".system {
            parameters = { kp = { value = 30, unit = "N/m" }, kd = { value = 4, unit = "N s/m" }, m = { value = 2, unit = "kg" } },
            inputs = { r = { unit = "m" } }, states = { x = { start = 0.1, unit = "m" }, v = { start = 0, unit = "m/s" } },
            der = function(s) return { x = s.v, v = (s.kp * (s.r - s.x) - s.kd * s.v) / s.m } end,
            outputs = function(s) return { y = s.x } end })",
                    "t,r,y");
    const auto unit_of = [&](const std::string& name) {
        const auto& outputs = loop.model.equations.outputs;
        const auto own = std::ranges::find(outputs, name, &Equations::Output::name);
        return own == outputs.end() ? "none of this name" : own->unit;
    };
    EXPECT_EQ(unit_of("r - x"), "m");
    EXPECT_EQ(unit_of("kp*(r - x) - kd*v"), "N");
}

TEST(SystemTerms, RecordsComeInTheUnitsOfTheSystem) {
    const TemporaryFolder folder;
    const char* const text = R"lua(local tb = require "tribode"
return tb.system {
  parameters = { k = { value = 1, unit = "rad/(V s)" } },
  inputs = { u = { unit = "V" }, p = { unit = "mm" } }, states = { y = { start = 0, unit = "rad" } },
  der = function(s) return { y = s.k * s.u } end })lua";
    const auto record_of = [&](const std::string& header) {
        std::string rows = header + "\n";
        for (int k = 0; k < 150; ++k) rows += std::to_string(0.02 * k) + ",3,2,180\n";
        const auto file = folder.write("record.csv", rows);
        return read_system_record(file, system_model_of(read_system(folder, text), {}, {}, {file}), {});
    };
    const SystemRecord record = record_of("t [s],u [mV],p [mm],y [deg]");
    EXPECT_EQ(record.inputs[0][0], 2); // p
    EXPECT_EQ(record.inputs[1][0], 3e-3);
    EXPECT_NEAR(record.outputs[0][0], std::acos(-1.0), 1e-15);
    try {
        record_of("t [s],u [N],p [mm],y [deg]");
        ADD_FAILURE() << "is not refused";
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("column u is in N, must be in V"), std::string::npos) << error.what();
    }
}

TEST(SystemTerms, AnOutputHasTheUnitOfWhatItIs) {
    const TemporaryFolder folder;
    const Equations equations = read_system(folder, R"lua(local tb = require "tribode"
return tb.system {
  parameters = { b = { value = 1, unit = "deg" }, m = { value = 2, unit = "kg" }, rate = 3 },
  inputs = { u = { unit = "N" } },
  states = { a = { start = 0, unit = "deg" }, v = { start = 0, unit = "m/s" } },
  der = function(s) return { a = s.b * s.rate, v = s.u / s.m } end,
  outputs = function(s)
    return { angle = s.a, shifted = s.a + s.b, speed = s.v, p = s.m * s.v, own = { s.v, unit = "m/s" } }
  end })lua");
    std::map<std::string, std::string> units;
    for (const auto& output : equations.outputs) units[output.name] = output.unit;
    const std::map<std::string, std::string> wanted = {
        {"angle", "deg"}, {"shifted", "deg"}, {"speed", "m/s"}, {"p", ""}, {"own", "m/s"}};
    EXPECT_EQ(units, wanted);
}

TEST(SystemTerms, AUnitThatOnlyTheSystemKnowsIsTakenAsItIs) {
    const TemporaryFolder folder;
    const char* const text = R"(local tb = require "tribode"
return tb.system { parameters = { a = { value = 1, unit = "1/s" } }, states = { y = { start = 1, unit = "inc" } },
  der = function(s) return { y = -s.a * s.y } end })";
    std::string rows = "t,y\nms,inc\n";
    for (int k = 0; k < 150; ++k) rows += std::to_string(20 * k) + ",3\n";
    const auto file = folder.write("record.csv", rows);
    const SystemRecord record =
        read_system_record(file, system_model_of(read_system(folder, text), {}, {}, {file}), {});
    EXPECT_EQ(record.outputs[0][0], 3);
    EXPECT_EQ(record.t[1], 0.02);
}

TEST(SystemTerms, OverAFewLevelsThereAreNoWaves) {
    const TemporaryFolder folder;
    const char* const text = R"(local tb = require "tribode"
return tb.system {
  parameters = { a = 1 }, inputs = { u = 0 }, states = { y = 0 },
  der = function(s) return { y = s.u - s.a * s.y } end })";
    // Waves over u where it follows this function of a triangle between 0 and 1.
    const auto waves = [&](const auto& input) {
        std::string rows = "t,u,y\n";
        for (int k = 0; k < 600; ++k) {
            const double phase = std::fmod(k / 100.0, 2.0), u = input(phase < 1 ? phase : 2 - phase);
            rows += std::to_string(0.05 * k) + "," + std::to_string(u) + "," + std::to_string(10 * std::sin(300 * u)) +
                    "\n";
        }
        const auto file = folder.write("record.csv", rows);
        const SystemModel model = system_model_of(read_system(folder, text), {}, {}, {file});
        const std::vector<SystemRecord> records = {read_system_record(file, model, {})};
        const SystemFit fit(records, {1}, Interpolation::hold, {600});
        const auto trace = fit.simulate(model, model.values(1), 0, 600);
        std::vector<double> periods;
        for (const auto& term :
             system_terms(model, 1, fit, variables_of(model, 1, fit, {*trace}), fit.errors(model, model.values(1)))) {
            if (term.name == "periodic" && term.of == "u") periods.push_back(term.parameters[2].start);
        }
        return periods;
    };
    const auto steps = [](int levels) {
        return [levels](double place) { return std::min(std::floor(place * levels), levels - 1.0) / levels; };
    };
    EXPECT_TRUE(waves(steps(4)).empty());
    EXPECT_FALSE(waves(steps(10)).empty());
    for (const double period : waves(steps(10))) EXPECT_GT(period, 0.9 / 5); // two of ten levels a turn
    // Two regions that lie far apart, each with two turns of the wave of y over u.
    const auto regions = waves([](double place) { return place < 0.5 ? 0.08 * place : 0.96 + 0.08 * (place - 0.5); });
    EXPECT_TRUE(std::ranges::any_of(regions, [](double period) { return std::abs(period - 0.0209) < 0.001; }));
}

TEST(SystemTerms, EachOfAnImposedMotionRunsAndCanBeWritten) {
    const TemporaryFolder folder;
    std::string rows = "t,x,p,F\n";
    for (int k = 0; k < 150; ++k) {
        const double t = 0.02 * k;
        rows += std::to_string(t) + "," + std::to_string(std::sin(3 * t)) + "," + std::to_string(2 + std::cos(2 * t)) +
                "," + std::to_string(std::cos(2 * t)) + "\n";
    }
    const auto file = folder.write("record.csv", rows);
    const SystemModel model = system_model_of(read_system(folder, seal), {}, {}, {file});
    const std::vector<SystemRecord> records = {read_system_record(file, model, {})};
    // The rate of x is that of the record.
    for (std::size_t i = 0; i < model.equations.inputs.size(); ++i) {
        if (model.equations.inputs[i].name != "x_rate") continue;
        EXPECT_NEAR(records[0].inputs[i][50], 3 * std::cos(3.0), 1e-2);
    }
    const SystemFit fit(records, {1}, Interpolation::linear, {150});
    const auto trace = fit.simulate(model, model.values(1), 0, 150);
    ASSERT_TRUE(trace);
    const auto errors = fit.errors(model, model.values(1));
    std::set<std::string> found;
    for (const auto& term : system_terms(model, 0, fit, variables_of(model, 0, fit, {*trace}), errors)) {
        SCOPED_TRACE(term.kind());
        found.insert(term.name);
        std::vector<double> values;
        for (const auto& parameter : term.parameters) values.push_back(parameter.start);
        const SystemModel with = extended(model, term, values);
        const auto after = fit.simulate(with, more_values(model, model.values(1), values), 0, 150);
        ASSERT_TRUE(after);
        const SystemModel read =
            system_model_of(read_system(folder, equations_lua(with.equations, "")), {}, {}, {file});
        const std::vector<SystemRecord> again = {read_system_record(file, read, {})};
        const auto written = SystemFit(again, {1}, Interpolation::linear, {150}).simulate(read, read.values(1), 0, 150);
        ASSERT_TRUE(written);
        for (std::size_t k = 0; k < 150; ++k) ASSERT_NEAR(written->outputs[0][k], after->outputs[0][k], 1e-5);
    }
    for (const char* name : {"coulomb_friction", "viscous_friction", "spring_force", "presliding_hysteresis",
                             "load_dependent_friction", "load_dependent_presliding"}) {
        EXPECT_TRUE(found.contains(name)) << name;
    }
}

} // namespace
} // namespace tribode
