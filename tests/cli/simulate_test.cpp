#include "cli/program.hpp"
#include "problems/golden_runs.hpp"
#include "tribode/base/json.hpp"
#include "tribode/base/text.hpp"
#include "unit/script/temporary_folder.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <gtest/gtest.h>
#include <sstream>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

// A CSV file, cell by cell.
class Sheet {
  public:
    explicit Sheet(const fs::path& file) {
        std::istringstream lines(text_of(file));
        std::string line;
        std::getline(lines, line);
        header_ = cells_of(line);
        while (std::getline(lines, line)) rows_.push_back(cells_of(line));
    }

    const std::vector<std::string>& header() const { return header_; }
    const std::vector<std::vector<std::string>>& rows() const { return rows_; }

    std::vector<std::string> texts(const std::string& name) const {
        const auto place = std::find(header_.begin(), header_.end(), name) - header_.begin();
        std::vector<std::string> column;
        for (const auto& row : rows_) column.push_back(row.at(static_cast<std::size_t>(place)));
        return column;
    }

    std::vector<double> operator[](const std::string& name) const {
        std::vector<double> column;
        for (const auto& text : texts(name)) column.push_back(parse_number(text).value());
        return column;
    }

  private:
    static std::vector<std::string> cells_of(const std::string& line) {
        std::vector<std::string> cells;
        std::istringstream stream(line);
        for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(cell);
        return cells;
    }

    std::vector<std::string> header_;
    std::vector<std::vector<std::string>> rows_;
};

constexpr double sample_time = 5e-4;

// k Ts as text, in the five digits a user would write, and the values of a column.
std::string record(const std::string& header, const std::vector<std::vector<double>>& columns, double start = 0) {
    std::string text = header + "\n";
    for (std::size_t k = 0; k < columns.front().size(); ++k) {
        char t[32];
        std::snprintf(t, sizeof t, "%.4f", start + static_cast<double>(k) * sample_time);
        text += t;
        for (const auto& column : columns) text.append(",").append(to_text(column[k]));
        text += '\n';
    }
    return text;
}

// The table of the golden runs, as a description.
Json golden_table() {
    const auto table = problems::linear_motor_table();
    Json description = {{"Ts", table.sample_time}, {"rigid_gain_per_kg", table.rigid_gain}};
    for (const auto& mode : table.modes) {
        description["modes"].push_back({{"gain", mode.gain}, {"freq_hz", mode.freq_hz}, {"zeta", mode.zeta}});
    }
    description["friction"]["viscous"] = table.viscous;
    for (const auto& e : table.elements) {
        description["friction"]["elements"].push_back({{"K", e.K}, {"F", e.F}, {"D", e.D}});
    }
    return description;
}

Json golden_table_in_loop() {
    Json description = golden_table();
    description["controller"] = {{"type", "pid"}, {"kp", 2.05e4}, {"ki", 1.8e5}, {"kd", 653.0}};
    description["input_delay_s"] = 0.0005;
    description["output_delay_s"] = 0.000418;
    description["current_loop_hz"] = 750.0;
    description["encoder_resolution_m"] = 1e-7;
    return description;
}

class Simulate : public ::testing::Test {
  protected:
    Ending simulate(const std::string& machine, const std::vector<std::string>& more = {}) {
        std::vector<std::string> arguments = {"simulate", "--machine", machine,    "--input",   "in.csv",
                                              "-o",       "out.csv",   "--events", "events.csv"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return run(arguments, {.folder = folder.path()});
    }

    Sheet trace(const std::string& machine, const std::vector<std::string>& more = {}) {
        const auto ending = simulate(machine, more);
        EXPECT_EQ(ending.exit_code, 0) << ending.err;
        EXPECT_EQ(ending.err, "");
        return Sheet(folder / "out.csv");
    }

    TemporaryFolder folder;
};

// ---- golden runs
// -----------------------------------------------------------------------------------------------------

Sheet golden(const std::string& name) { return Sheet(fs::path(TRIBODE_SOURCE_DIR) / "tests/golden" / (name + ".csv")); }

// Largest distance from the golden run, at every tenth sample instant.
double distance(const Sheet& found, const Sheet& golden, const std::string& column) {
    const auto a = found[column], b = golden[column];
    EXPECT_EQ(a.size(), 10 * (b.size() - 1) + 1);
    double largest = 0;
    for (std::size_t i = 0; i < b.size(); ++i) largest = std::max(largest, std::abs(a[10 * i] - b[i]));
    return largest;
}

void expect_same_events(const Sheet& found, const Sheet& golden, double time_tolerance) {
    EXPECT_EQ(found.header(), golden.header());
    EXPECT_EQ(found.rows().size(), golden.rows().size());
    for (const std::string kind : {"slip_forward", "slip_backward", "stick"}) {
        const auto count = [&](const Sheet& sheet) {
            const auto kinds = sheet.texts("kind");
            return std::count(kinds.begin(), kinds.end(), kind);
        };
        EXPECT_EQ(count(found), count(golden)) << kind;
    }
    const auto t = found["t"], exact = golden["t"];
    EXPECT_TRUE(std::is_sorted(t.begin(), t.end()));
    constexpr std::size_t first_ones = 50;
    for (std::size_t i = 0; i < std::min({first_ones, t.size(), exact.size()}); ++i) {
        EXPECT_NEAR(t[i], exact[i], time_tolerance) << "event " << i + 1;
        // Elements that come to rest at one instant may stand in any order.
        if (found.rows()[i][2] == "stick") continue;
        EXPECT_EQ(found.rows()[i][1], golden.rows()[i][1]) << "event " << i + 1;
        EXPECT_EQ(found.rows()[i][2], golden.rows()[i][2]) << "event " << i + 1;
    }
}

struct GoldenCase {
    std::string solver;
    std::vector<std::string> options;
    double position;   // [m]
    double event_time; // [s]
};

void PrintTo(const GoldenCase& one, std::ostream* out) { *out << one.solver; }

class Golden : public Simulate, public ::testing::WithParamInterface<GoldenCase> {
  protected:
    Sheet solve(const Json& machine, const std::string& input) {
        folder.write("machine.json", machine.dump());
        folder.write("in.csv", input);
        auto options = GetParam().options;
        options.insert(options.end(), {"--solver", GetParam().solver});
        return trace("machine.json", options);
    }

    void compare(const Sheet& found, const std::string& name) {
        const Sheet wanted = golden(name);
        EXPECT_LT(distance(found, wanted, "x"), GetParam().position);
        // Within 1/500 s, far below the period of the fastest mode, an error of x is one of v.
        EXPECT_LT(distance(found, wanted, "v"), 500 * GetParam().position);
        // The stiffness of the elements that still stick where the table turns, and D_20 and D_v times the
        // velocity.
        EXPECT_LT(distance(found, wanted, "f"), 3e6 * GetParam().position);
        expect_same_events(Sheet(folder / "events.csv"), golden(name + "_events"), GetParam().event_time);
    }

    void compare_open_loop(const std::string& name, double amplitude, double frequency_hz) {
        const auto u = problems::sampled_sine(amplitude, frequency_hz, sample_time, 1001);
        compare(solve(golden_table(), record("t,u", {u})), name);
    }
};

TEST_P(Golden, OpenLoopAt15N) { compare_open_loop("g1", 15, 10); }
TEST_P(Golden, OpenLoopAt30N) { compare_open_loop("g2", 30, 34); }

TEST_P(Golden, ClosedLoop) {
    const auto excitation = problems::sampled_sine(15, 10, sample_time, 1001);
    const Sheet found = solve(golden_table_in_loop(), record("t,r,exc", {std::vector<double>(1001), excitation}));
    compare(found, "loop");
    // What the encoder sees is rounded to 1e-7 m, so the detected positions and the thrust made of them are
    // the same but for the last digits.
    EXPECT_LT(distance(found, golden("loop"), "y"), 1e-15);
    EXPECT_LT(distance(found, golden("loop"), "u"), 1e-9);
}

// The same as a system of equations, whose events have no element: each slip of the golden run is one of the system, where
// several may be one, and so is each reversal.
TEST_F(Simulate, TheTableAsASystemOfEquationsGivesTheGoldenRuns) {
    folder.write("open.json", golden_table().dump());
    folder.write("loop.json", golden_table_in_loop().dump());
    folder.write("s.lua", R"(
        local tb = require "tribode"
        local servo = require "servo"
        local cases = { g1 = { "open", "u", 15, 10 }, g2 = { "open", "u", 30, 34 }, loop = { "loop", "exc", 15, 10 } }
        for name, case in pairs(cases) do
          local list = {}
          for k = 0, 1000 do list[k + 1] = case[3] * math.sin(2 * math.pi * case[4] * k * 5e-4) end
          local run = tb.run_system {
            system = servo.wire(servo.parts(tb.machine(case[1] .. ".json"))), duration_s = 0.5, output_step_s = 5e-4,
            solver = "exact", inputs = { [case[2]] = { sample_time_s = 5e-4, values = list } },
          }
          assert(run.ok, run.message)
          local values = run.values
          tb.write_csv { file = name .. ".csv", columns = {
            { name = "x", values = values["plant.y"] }, { name = "v", values = values["plant.v"] },
            { name = "f", values = values["friction.friction"] },
          } }
          local slips, reversals = {}, {}
          for _, event in ipairs(run.events) do
            table.insert(event.name:find "slips" and slips or reversals, event.t)
          end
          tb.write_csv { file = name .. "_slips.csv", columns = { { name = "t", values = slips } } }
          tb.write_csv { file = name .. "_reversals.csv", columns = { { name = "t", values = reversals } } }
        end
    )");
    const auto ending = run({"run", "s.lua", "-o", "out", "--allow-all"}, {.folder = folder.path()});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    for (const std::string name : {"g1", "g2", "loop"}) {
        const Sheet found(folder / ("out/" + name + ".csv")), wanted = golden(name), events = golden(name + "_events");
        EXPECT_LT(distance(found, wanted, "x"), 1e-15) << name;
        EXPECT_LT(distance(found, wanted, "v"), 500 * 1e-15) << name;
        EXPECT_LT(distance(found, wanted, "f"), 3e6 * 1e-15) << name;
        const auto t = events["t"];
        const auto kinds = events.texts("kind");
        for (const std::string kind : {"slips", "reversals"}) {
            const auto instants = Sheet(folder / ("out/" + name + "_" + kind + ".csv"))["t"];
            for (std::size_t i = 0; i < t.size(); ++i) {
                if ((kinds[i] == "stick") != (kind == "reversals")) continue;
                const auto next = std::lower_bound(instants.begin(), instants.end(), t[i] - 1e-12);
                EXPECT_TRUE(next != instants.end() && *next < t[i] + 1e-12) << name << ", " << kind << " at " << t[i];
            }
        }
    }
}

const std::vector<std::string> tight = {"--rtol", "1e-10", "--atol", "1e-13"};

// exact: rounding, over 500 restarts and more; the others what they claim at these tolerances. fixed sees an
// event at the end of its step of 1 us.
INSTANTIATE_TEST_SUITE_P(Solvers, Golden,
                         ::testing::Values(GoldenCase{"exact", {}, 1e-15, 1e-14}, GoldenCase{"erk", tight, 1e-9, 1e-9},
                                           GoldenCase{"adams", tight, 1e-8, 1e-8}, GoldenCase{"bdf", tight, 1e-8, 1e-8},
                                           GoldenCase{"fixed", {"--step", "1e-6"}, 1e-9, 1.01e-6}),
                         [](const auto& one) { return one.param.solver; });

// ---- solvers
// ---------------------------------------------------------------------------------------------------------

class Solvers : public Simulate {
  protected:
    Solvers() {
        folder.write("affine.json", golden_table().dump());
        Json machine = golden_table();
        machine["friction"]["coulomb"] = 2;
        machine["friction"]["stribeck"] = {{"static", 3}, {"velocity", 0.01}};
        folder.write("stribeck.json", machine.dump());
        folder.write("in.csv", record("t,u", {problems::sampled_sine(15, 10, sample_time, 200)}));
    }
};

TEST_F(Solvers, TheDefaultIsExactWherePossibleElseErk) {
    EXPECT_EQ(trace("affine.json").rows(), trace("affine.json", {"--solver", "exact"}).rows());
    EXPECT_EQ(trace("stribeck.json").rows(), trace("stribeck.json", {"--solver", "erk"}).rows());
}

TEST_F(Solvers, CvodeIsAnotherNameOfBdf) {
    trace("affine.json", {"--solver", "bdf"});
    const std::string bytes = text_of(folder / "out.csv");
    trace("affine.json", {"--solver", "cvode"});
    EXPECT_EQ(text_of(folder / "out.csv"), bytes);
    EXPECT_NE(bytes.find('\n'), std::string::npos);
}

TEST_F(Solvers, ExactIsRefusedWithTheReasonWhereAMachineIsNotAffine) {
    expect_sentence(simulate("stribeck.json", {"--solver", "exact"}), 2, {"\"exact\"", "Stribeck", "erk"});
    EXPECT_FALSE(fs::exists(folder / "out.csv"));
}

TEST_F(Solvers, TolerancesDoNothingForExactAndFixed) {
    for (const std::string solver : {"exact", "fixed"}) {
        EXPECT_EQ(trace("affine.json", {"--solver", solver}).rows(),
                  trace("affine.json", {"--solver", solver, "--rtol", "0.1", "--atol", "0.1"}).rows());
    }
    EXPECT_NE(trace("affine.json", {"--solver", "erk"}).rows(),
              trace("affine.json", {"--solver", "erk", "--rtol", "1e-3"}).rows());
}

TEST_F(Solvers, TheDefaultStepOfFixedIsATenthOfTheSampleTime) {
    const auto plain = trace("affine.json", {"--solver", "fixed"});
    EXPECT_EQ(trace("affine.json", {"--solver", "fixed", "--step", "5e-5"}).rows(), plain.rows());
    EXPECT_NE(trace("affine.json", {"--solver", "fixed", "--step", "2e-5"}).rows(), plain.rows());
}

// ---- files
// -----------------------------------------------------------------------------------------------------------

TEST_F(Simulate, EveryNumberIsTheShortestTextThatReadsBackToTheSameDouble) {
    folder.write("machine.json", golden_table_in_loop().dump());
    folder.write("in.csv", record("t,r,exc", {std::vector<double>(200, 1e-6), std::vector<double>(200, 9.0)}));
    const Sheet found = trace("machine.json");
    EXPECT_EQ(found.header(), (std::vector<std::string>{"t", "r", "u", "y", "x", "v", "f"}));
    ASSERT_EQ(found.rows().size(), 200u);
    for (const auto& row : found.rows()) {
        for (const auto& cell : row) EXPECT_EQ(cell, to_text(parse_number(cell).value()));
    }
}

// Also where it begins late and is rounded: 100.0005 is not 100 + 1 * 0.0005 in doubles.
TEST_F(Simulate, TheTimesAreThoseOfTheInput) {
    folder.write("machine.json", golden_table().dump());
    folder.write("in.csv", record("t,u", {std::vector<double>(300, 5.0)}, 100));
    const Sheet found = trace("machine.json");
    EXPECT_EQ(found["t"], Sheet(folder / "in.csv")["t"]);
    // Nothing else depends on where the record begins.
    folder.write("in.csv", record("t,u", {std::vector<double>(300, 5.0)}));
    EXPECT_EQ(trace("machine.json")["x"], found["x"]);
}

TEST_F(Simulate, ColumnsAndScalesMapARecord) {
    folder.write("machine.json", golden_table().dump());
    const auto u = problems::sampled_sine(8, 5, sample_time, 400);
    folder.write("in.csv", record("t,u", {u}));
    const auto plain = trace("machine.json");
    auto volts = u;
    for (double& value : volts) value /= 4; // a power of two: no rounding
    folder.write("in.csv", record("t_s,current_A,u_V", {std::vector<double>(400, 7.0), volts}));
    const auto mapped = trace("machine.json", {"--columns", "t=t_s,u=u_V", "--scale", "u=4"});
    EXPECT_EQ(mapped.rows(), plain.rows());
}

TEST_F(Simulate, AResultInAnyFormatIsARecordForTheNextRun) {
    folder.write("machine.json", golden_table().dump());
    folder.write("in.csv", record("t,u", {problems::sampled_sine(8, 5, sample_time, 200)}));
    const auto plain = trace("machine.json").rows();
    const auto simulate_file = [&](const std::string& in, const std::string& out) {
        const auto ending =
            run({"simulate", "--machine", "machine.json", "--input", in, "-o", out}, {.folder = folder.path()});
        EXPECT_EQ(ending.exit_code, 0) << ending.err;
    };
    for (const std::string file : {"x.csv", "x.mat", "x.h5", "x.csv.gz"}) {
        simulate_file("in.csv", file);
        simulate_file(file, "again.csv");
        EXPECT_EQ(Sheet(folder / "again.csv").rows(), plain) << file;
    }
    EXPECT_TRUE(text_of(folder / "x.mat").starts_with("MATLAB 5.0"));
    EXPECT_EQ(text_of(folder / "x.h5").substr(1, 3), "HDF");
    EXPECT_EQ(text_of(folder / "x.csv.gz").substr(0, 2), "\x1f\x8b");
}

TEST_F(Simulate, WithoutEventsNoSuchFileIsWritten) {
    folder.write("machine.json", golden_table().dump());
    folder.write("in.csv", record("t,u", {std::vector<double>(10, 5.0)}));
    EXPECT_EQ(
        run({"simulate", "--machine", "machine.json", "--input", "in.csv", "-o", "out.csv"}, {.folder = folder.path()})
            .exit_code,
        0);
    EXPECT_EQ(files_in(folder.path()), (std::vector<std::string>{"in.csv", "machine.json", "out.csv"}));
}

TEST_F(Simulate, TheSeedMakesTheNoise) {
    Json machine = golden_table();
    machine["noise_rms_m"] = 1e-6;
    folder.write("machine.json", machine.dump());
    folder.write("in.csv", record("t,u", {std::vector<double>(100, 5.0)}));
    const auto first = trace("machine.json", {"--seed", "1"})["y"];
    EXPECT_EQ(trace("machine.json", {"--seed", "1"})["y"], first);
    EXPECT_NE(trace("machine.json", {"--seed", "2"})["y"], first);
}

TEST_F(Simulate, DescriptionsInLuaAndJsonAreTheSameMachine) {
    folder.write("in.csv", record("t,u", {problems::sampled_sine(15, 10, sample_time, 200)}));
    const std::string lua = "return { rigid_gain_per_kg = 0.1, friction = { viscous = 2, coulomb = 3 } }";
    folder.write("machine.lua", lua);
    folder.write("machine.json", R"({"rigid_gain_per_kg": 0.1, "friction": {"viscous": 2, "coulomb": 3}})");
    EXPECT_EQ(trace("machine.lua").rows(), trace("machine.json").rows());
}

// ---- open loop, closed loop
// ------------------------------------------------------------------------------------------

TEST_F(Simulate, AThrustRecordRunsOpenLoopAlsoForAMachineInClosedLoop) {
    Json machine = golden_table_in_loop();
    machine["closed_loop"] = true;
    folder.write("closed.json", machine.dump());
    machine["closed_loop"] = false;
    folder.write("open.json", machine.dump());
    folder.write("in.csv", record("t,u", {problems::sampled_sine(15, 10, sample_time, 200)}));
    const auto closed = trace("closed.json");
    EXPECT_EQ(closed["u"], Sheet(folder / "in.csv")["u"]);
    EXPECT_EQ(closed.rows(), trace("open.json").rows());
}

TEST_F(Simulate, ClosedLoopDecidesOverARecordWithBoth) {
    Json machine = golden_table_in_loop();
    const std::vector<double> r(200, 1e-4), u(200, 3.0), y(200, 0.0);
    folder.write("in.csv", record("t,r,u,y", {r, u, y}));
    machine["closed_loop"] = false;
    folder.write("open.json", machine.dump());
    EXPECT_EQ(trace("open.json")["u"], u);
    machine["closed_loop"] = true;
    folder.write("closed.json", machine.dump());
    const auto closed = trace("closed.json");
    EXPECT_EQ(closed["r"], r);
    EXPECT_NE(closed["u"], u);
}

TEST_F(Simulate, AReferenceAloneOrAnExcitationAloneIsEnough) {
    folder.write("machine.json", golden_table_in_loop().dump());
    const std::vector<double> none(200), some(200, 1e-4);
    folder.write("in.csv", record("t,r,exc", {some, none}));
    const auto both = trace("machine.json");
    folder.write("in.csv", record("t,r", {some}));
    EXPECT_EQ(trace("machine.json").rows(), both.rows());
    folder.write("in.csv", record("t,r,exc", {none, some}));
    const auto excited = trace("machine.json");
    folder.write("in.csv", record("t,exc", {some}));
    EXPECT_EQ(trace("machine.json").rows(), excited.rows());
}

// The rows of the file of events, as the message and the report count them.
TEST_F(Simulate, EventsAreCountedAsTheirFileListsThem) {
    folder.write("in.csv", record("t,u", {problems::sampled_sine(15, 10, sample_time, 200)}));
    const auto file = (fs::path(TRIBODE_SOURCE_DIR) / "models/linear_motor_table.lua").string();
    const auto ending = simulate(file);
    const auto rows = Sheet(folder / "events.csv").rows().size();
    EXPECT_GT(rows, 0U);
    EXPECT_NE(ending.out.find(": " + std::to_string(rows) + " events, "), std::string::npos) << ending.out;
    EXPECT_EQ(Json::parse(simulate(file, {"--json"}).out).at("events"), rows);
}

TEST_F(Simulate, NoFileIsWrittenTwiceOrOverAnInput) {
    folder.write("mass.json", R"({"Ts": 5e-4, "rigid_gain_per_kg": 1})");
    const std::string input = record("t,u", {std::vector<double>(10, 1.0)});
    folder.write("in.csv", input);
    fs::create_symlink("in.csv", folder / "link.csv");
    fs::create_directory(folder / "deep");
    const auto with = [&](const std::string& output, const std::string& events) {
        std::vector<std::string> words = {"simulate", "--machine", "mass.json", "--input", "in.csv", "-o", output};
        if (!events.empty()) words.insert(words.end(), {"--events", events});
        return run(words, {.folder = folder.path()});
    };
    for (const auto* same : {"out.csv", "./out.csv", "deep/../out.csv"}) {
        expect_sentence(with("out.csv", same), 2, {"out.csv: would be written twice"});
        EXPECT_FALSE(fs::exists(folder / "out.csv"));
    }
    for (const auto* input_again : {"in.csv", "./in.csv", "link.csv"}) {
        expect_sentence(with(input_again, ""), 2, {input_again, "is an input and would be overwritten"});
        expect_sentence(with("out.csv", input_again), 2, {input_again, "is an input and would be overwritten"});
    }
    expect_sentence(with("mass.json", ""), 2, {"mass.json: is an input"});
    EXPECT_EQ(text_of(folder / "in.csv"), input);
    EXPECT_EQ(with("/dev/null", "/dev/null").exit_code, 0);
    EXPECT_EQ(with("out.csv", "events.csv").exit_code, 0);
}

TEST_F(Simulate, AnUnstableLoopEndsEarlyAndKeepsWhatWasReached) {
    folder.write("machine.json", R"({"rigid_gain_per_kg": 0.1, "controller": {"type": "pid", "kp": -1e9}})");
    folder.write("in.csv", record("t,r", {std::vector<double>(2000, 1e-3)}));
    expect_sentence(simulate("machine.json"), 3, {"diverges", "t = ", "unstable", "out.csv.partial.csv"});
    EXPECT_EQ(files_in(folder.path()), (std::vector<std::string>{"in.csv", "machine.json", "out.csv.partial.csv"}));
    const Sheet partial(folder / "out.csv.partial.csv");
    EXPECT_GT(partial.rows().size(), 10u);
    EXPECT_LT(partial.rows().size(), 2000u);
}

TEST_F(Simulate, AnImplausibleMachineIsSimulatedWithAWarning) {
    folder.write("in.csv", record("t,u", {{1, 1, 1}}));
    folder.write("plain.json", R"({"rigid_gain_per_kg": 12, "encoder_resolution_m": 1})");
    const auto ending = simulate("plain.json");
    EXPECT_EQ(ending.exit_code, 0);
    EXPECT_EQ(
        ending.err,
        "tribode: warning: plain.json: rigid_gain_per_kg = 12 m/(N s^2) is implausible, 1e-06 to 10 is usual; it is "
        "the inverse of the moving mass, not the mass\n"
        "tribode: warning: plain.json: encoder_resolution_m = 1 m is implausible, 1e-14 to 0.001 is usual; it is in "
        "meters\n");
    EXPECT_EQ(Sheet(folder / "out.csv").rows().size(), 3u);
    folder.write("script.lua", "local tb = require 'tribode'\nlocal o = tb.options { machine = '' }\n"
                               "tb.machine(o.machine)\ntb.machine(o.machine)\n");
    EXPECT_EQ(run({"run", "script.lua", "--machine", "plain.json", "-o", "results"}, {.folder = folder.path()}).err,
              ending.err); // once
}

} // namespace
} // namespace tribode::cli
