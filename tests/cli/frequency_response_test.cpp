#include "cli/program.hpp"
#include "tribode/base/json.hpp"
#include "tribode/base/text.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cmath>
#include <complex>
#include <cstdlib>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <map>
#include <numbers>
#include <sstream>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;
using std::numbers::pi;

const std::string table_model = (fs::path(TRIBODE_SOURCE_DIR) / "models/linear_motor_table.lua").string();
constexpr double ts = 5e-4;

// Rows of a CSV file by column; "nan" is a number as well.
std::map<std::string, std::vector<std::string>> columns_of(const std::string& text) {
    std::istringstream lines(text);
    std::string line;
    std::vector<std::string> names;
    std::map<std::string, std::vector<std::string>> columns;
    while (std::getline(lines, line)) {
        std::istringstream cells(line);
        std::string cell;
        for (std::size_t column = 0; std::getline(cells, cell, ','); ++column) {
            if (columns.size() <= column && names.size() <= column) {
                names.push_back(cell);
            } else if (column < names.size()) {
                columns[names[column]].push_back(cell);
            }
        }
    }
    return columns;
}

double number(const std::string& text) { return std::strtod(text.c_str(), nullptr); }

// A record of 0.5 s of a sine, as text; a signal that is left out keeps its sine.
struct Log {
    std::size_t count = 1000;
    double sample_time = ts;
    std::function<double(double t)> thrust = [](double t) { return 30 * std::sin(2 * pi * 20 * t); };
    std::function<double(double t)> position = [](double t) { return 1e-4 * std::sin(2 * pi * 20 * t - 3); };

    std::string text() const {
        std::string csv = "t,u,y\n";
        for (std::size_t k = 0; k < count; ++k) {
            const double t = static_cast<double>(k) * sample_time;
            csv += fmt::format("{:.17g},{:.17g},{:.17g}\n", t, thrust(t), position(t));
        }
        return csv;
    }
};

class FrequencyResponse : public ::testing::Test {
  protected:
    FrequencyResponse() { folder.write("mass.json", R"({"rigid_gain_per_kg": 0.1})"); }

    Ending fra(const std::vector<std::string>& more) {
        std::vector<std::string> arguments = {"fra", "--quiet"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return run(arguments, {.folder = folder.path()});
    }

    // One sentence, exit code 2, and no file.
    void expect_refused(const Log& log, const std::vector<std::string>& parts,
                        const std::vector<std::string>& more = {}) {
        folder.write("log.csv", log.text());
        const auto before = files_in(folder.path());
        std::vector<std::string> arguments = {"--machine", "mass.json", "--data", "log.csv", "-o", "out"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        expect_sentence(fra(arguments), 2, parts);
        EXPECT_EQ(files_in(folder.path()), before);
    }

    TemporaryFolder folder;
};

// The records of the sweep behind scripts/fra_comparison.lua hold its responses, to rounding.
TEST_F(FrequencyResponse, OfTheRecordsOfASweepIsThatOfTheSweep) {
    const auto script = (fs::path(TRIBODE_SOURCE_DIR) / "scripts/fra_comparison.lua").string();
    auto ending =
        run({"run", script, "--quiet", "-D", "frequencies=12.3,33,82,140", "-o", "sweep"}, {.folder = folder.path()});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const auto wanted = columns_of(text_of(folder / "sweep/responses.csv"));
    folder.write("logs.lua", R"(
        local tb = require "tribode"
        local option = tb.options { sweep = "" }
        local names = { frequency_hz = "frequency_hz", settling_time_s = "settling_time_s" }
        local sweep = tb.read_record { file = option.sweep, columns = names }.data
        local machine = tb.machine "models/linear_motor_table.lua"
        for i, f in ipairs(sweep.frequency_hz) do
          local period = 1 / (f * machine.Ts)
          local periods = math.max(10, math.ceil(0.1 * f - 1e-9))
          local samples = math.floor(sweep.settling_time_s[i] / machine.Ts + 0.5) + math.floor(periods * period + 0.5)
          local exc = {}
          for k = 1, samples do exc[k] = 15 * math.sin(2 * math.pi * f * (k - 1) * machine.Ts) end
          local run = tb.simulate { machine = machine, exc = exc, relative_tolerance = 1e-6,
            absolute_tolerance_m = 1e-10 }
          tb.write_csv { file = i .. ".csv", columns = { { name = "t", unit = "s", values = run.t },
            { name = "exc", unit = "N", values = exc }, { name = "u", unit = "N", values = run.u },
            { name = "y", unit = "m", values = run.y } } }
        end)");
    ending =
        run({"run", "logs.lua", "--quiet", "-D", "sweep=sweep/responses.csv", "-o", "logs"}, {.folder = folder.path()});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    for (std::size_t i = 0; i < 4; ++i) {
        const double f = number(wanted.at("frequency_hz")[i]);
        const double periods = std::max(10.0, std::ceil(0.1 * f - 1e-9));
        ending = fra({"--machine", table_model, "--data", fmt::format("logs/{}.csv", i + 1), "-o", "out", "--periods",
                      fmt::format("{}", periods), "--keep-transients", "--delay", "1.38e-3"});
        ASSERT_EQ(ending.exit_code, 0) << ending.err;
        const auto found = columns_of(text_of(folder / "out/response.csv"));
        ASSERT_EQ(found.at("method").size(), 4u); // Improved as well
        const std::vector<std::string> names = {"fra1", "fra2", "proposed"};
        for (std::size_t a = 0; a < 3; ++a) {
            ASSERT_EQ(found.at("method")[a], names[a]);
            const std::complex<double> truth(number(wanted.at(names[a] + "_real_m_per_N")[i]),
                                             number(wanted.at(names[a] + "_imag_m_per_N")[i]));
            const auto value = std::polar(std::pow(10, number(found.at("gain_db")[a]) / 20),
                                          pi / 180 * number(found.at("phase_deg")[a]));
            EXPECT_LT(std::abs(value / truth - 1.0), 1e-12) << names[a] << " at " << f << " Hz";
        }
        fs::remove_all(folder / "out");
    }
}

// From plan to identified machine. The truth is within 1 % (gains, frequencies) and 5 % (damping ratios) where the distortion
// calls the friction model good; a Stribeck curve, which elements cannot show, is called bad.
TEST_F(FrequencyResponse, MeasuresAHiddenMachineAndKnowsWhereTheFrictionModelIsBad) {
    const auto script = (fs::path(TRIBODE_SOURCE_DIR) / "scripts/measure_machine.lua").string();
    const auto measure = [&](const std::string& hidden, const std::string& iterations) {
        const auto ending = run({"run", script, "--quiet", "-D", "hidden=" + hidden, "-D", "iterations=" + iterations,
                                 "-D", "friction=elements", "-D", "periods=3", "-D", "plots=false", "-o", "machine"},
                                {.folder = folder.path()});
        EXPECT_EQ(ending.exit_code, 0) << ending.err;
        return Json::parse(text_of(folder / "machine/summary.json"));
    };
    const Json rolling = measure("11", "30");
    EXPECT_TRUE(rolling.at("friction_model_is_good"));
    EXPECT_EQ(rolling.at("modes"), rolling.at("true_modes"));
    EXPECT_GE(rolling.at("parameters").size(), 4u);
    for (const auto& parameter : rolling.at("parameters")) {
        ASSERT_TRUE(parameter.contains("truth")) << parameter;
        const auto name = parameter.at("name").get<std::string>();
        const double ratio = parameter.at("value").get<double>() / parameter.at("truth").get<double>();
        EXPECT_NEAR(ratio, 1, name.starts_with("zeta") ? 0.05 : 0.01) << name;
        const double error = parameter.at("value").get<double>() - parameter.at("truth").get<double>();
        EXPECT_LT(std::abs(error), 4 * parameter.at("standard_error").get<double>()) << name;
    }
    EXPECT_FALSE(measure("3", "3").at("friction_model_is_good"));
}

// All parameters at once from a log, by the command; what it writes is a machine for others.
TEST_F(FrequencyResponse, IdentifyFindsTheParametersAndWritesTheMachine) {
    folder.write("truth.json", R"({"rigid_gain_per_kg": 0.1, "friction": {"viscous": 20}})");
    folder.write("start.json", R"({"rigid_gain_per_kg": 0.12, "friction": {"viscous": 10}})");
    Log drive;
    drive.thrust = [](double t) { // at rest at first, so that where it starts is known exactly
        return t < 0.02 ? 0 : 30 * std::sin(2 * pi * 9 * t) + 20 * std::sin(2 * pi * 23 * t);
    };
    folder.write("drive.csv", drive.text());
    ASSERT_EQ(run({"simulate", "--machine", "truth.json", "--input", "drive.csv", "-o", "log.csv", "--quiet"},
                  {.folder = folder.path()})
                  .exit_code,
              0);
    const auto ending = run({"identify", "--machine", "start.json", "--data", "log.csv", "--columns", "t=t,u=u,y=y",
                             "--parameters", "rigid_gain_per_kg,friction.viscous", "-o", "out", "--quiet"},
                            {.folder = folder.path()});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const auto machine = Json::parse(text_of(folder / "out/machine.json"));
    EXPECT_NEAR(machine.at("rigid_gain_per_kg").get<double>(), 0.1, 1e-6);
    EXPECT_NEAR(machine.at("friction").at("viscous").get<double>(), 20, 1e-3);
    const auto parameters = columns_of(text_of(folder / "out/parameters.csv"));
    EXPECT_EQ(parameters.at("name"), (std::vector<std::string>{"rigid_gain_per_kg", "friction.viscous"}));
    EXPECT_EQ(parameters.at("start"), (std::vector<std::string>{"0.12", "10"}));
    for (const auto* name : {"identify.json", "residual.png", "manifest.json"}) {
        EXPECT_TRUE(fs::exists(folder / "out" / name)) << name;
    }
    EXPECT_EQ(run({"simulate", "--machine", "out/machine.json", "--input", "drive.csv", "-o", "again.csv", "--quiet"},
                  {.folder = folder.path()})
                  .exit_code,
              0);
}

TEST_F(FrequencyResponse, IdentifyRefusesWhatCannotBeFitted) {
    folder.write("log.csv", Log{}.text());
    const auto refused = [&](const std::vector<std::string>& more, const std::vector<std::string>& parts) {
        std::vector<std::string> arguments = {"identify", "--quiet", "--machine", "mass.json",
                                              "--data",   "log.csv", "-o",        "out"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        expect_sentence(run(arguments, {.folder = folder.path()}), 2, parts);
        EXPECT_FALSE(fs::exists(folder / "out/machine.json"));
    };
    refused({"--parameters", "rigid_gain"}, {"\"rigid_gain\"", "rigid_gain_per_kg"});
    refused({"--iterations", "1001"}, {"--iterations", "0 to 1000"});
    folder.write("log.csv", "t,u\n0,1\n0.0005,2\n0.001,1\n");
    refused({}, {"log.csv", "column y"});
    Log still;
    still.position = [](double) { return 1e-3; };
    folder.write("log.csv", still.text());
    refused({}, {"log.csv", "y is constant"});
}

TEST_F(FrequencyResponse, WritesItsFilesAndTheirColumns) {
    folder.write("log.csv", Log{}.text());
    const auto ending = fra({"--machine", "mass.json", "--data", "log.csv", "-o", "out"});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(text_of(folder / "out/response.csv")
                  .find("frequency_hz,method,gain_db,phase_deg,std_gain_db,"
                        "std_phase_deg,coherence,odd_distortion_db,"
                        "even_distortion_db,settled"),
              0u);
    for (const auto* name : {"fit.json", "report.html", "bode.png"}) EXPECT_TRUE(fs::exists(folder / "out" / name));
    const auto response = columns_of(text_of(folder / "out/response.csv"));
    EXPECT_NEAR(number(response.at("frequency_hz").at(0)), 20, 1e-9);
    EXPECT_NEAR(number(response.at("gain_db").at(0)), 20 * std::log10(1e-4 / 30), 1e-6);
}

// A figure of an earlier analysis would be taken for one of this.
TEST_F(FrequencyResponse, LeavesNoImageOfAnEarlierAnalysis) {
    folder.write("log.csv", Log{}.text());
    const std::vector<std::string> command = {"--machine", "mass.json", "--data", "log.csv", "-o", "out"};
    ASSERT_EQ(fra(command).exit_code, 0);
    Json manifest = Json::parse(text_of(folder / "out/manifest.json"));
    for (const auto* name : {"loops.png", "mine.png", "notes.txt"}) {
        folder.write(std::string("out/") + name, "old");
        manifest["files"][name] = sha256("old");
    }
    folder.write("out/manifest.json", manifest.dump());
    folder.write("out/mine.png", "changed since");
    folder.write("out/other.png", "not of Tribode");
    ASSERT_EQ(fra(command).exit_code, 0);
    EXPECT_FALSE(fs::exists(folder / "out/loops.png"));
    for (const auto* name : {"mine.png", "other.png", "notes.txt", "bode.png", "manifest.json"}) {
        EXPECT_TRUE(fs::exists(folder / "out" / name)) << name;
    }
}

TEST_F(FrequencyResponse, ARecordWithoutExcitationIsRefused) {
    Log log;
    log.thrust = [](double) { return 0.0; };
    expect_refused(log, {"log.csv", "u is constant", "excitation"});
    log = {};
    log.position = [](double) { return 1e-3; };
    expect_refused(log, {"log.csv", "y is constant", "nothing moves"});
}

TEST_F(FrequencyResponse, AnAliasedRecordIsRefused) {
    Log log;
    log.thrust = [](double t) { return 30 * std::sin(2 * pi * 960 * t); };
    log.position = [](double t) { return 1e-7 * std::sin(2 * pi * 960 * t); };
    expect_refused(log, {"log.csv", "960 Hz", "alias"});
}

TEST_F(FrequencyResponse, AClippedRecordIsRefused) {
    Log log;
    log.position = [](double t) { return std::min(6e-5, 1e-4 * std::sin(2 * pi * 20 * t)); };
    expect_refused(log, {"log.csv", "y stands at its largest values", "clipped"});
    log = {};
    log.thrust = [](double t) { return std::clamp(30 * std::sin(2 * pi * 20 * t), -20.0, 20.0); };
    expect_refused(log, {"log.csv", "u stands at its largest values", "clipped"});
}

TEST_F(FrequencyResponse, ARecordOfAnotherSampleTimeIsRefused) {
    Log log;
    log.sample_time = 1e-3;
    expect_refused(log, {"log.csv", "0.001 s", "0.0005 s", "sample time"});
    log.sample_time = 1.25e-4;
    expect_refused(log, {"log.csv", "0.000125 s", "0.0005 s", "sample time"});
}

// Of several lines, with this period.
double several_lines(double t, double period) {
    double sum = 0;
    for (int line = 3; line < 40; line += 2) sum += std::sin(2 * pi * line * t / period + line * line);
    return sum;
}

TEST_F(FrequencyResponse, AMultisineWithoutWholePeriodsIsRefused) {
    Log log;
    const auto with_period = [&](double period) {
        log.thrust = [period](double t) { return several_lines(t, period); };
        log.position = [period](double t) { return 1e-6 * several_lines(t - 2e-3, period); };
    };
    log.count = 3000; // one and a half
    with_period(1);
    expect_refused(log, {"log.csv", "repeats itself after 1 s", "1.5 s long", "two at least"});
    log.count = 8000; // a period of 2000.4 samples
    with_period(2000.4 * ts);
    expect_refused(log, {"log.csv", "every 2000.", "whole number of samples"});
}

TEST_F(FrequencyResponse, ADelayLongerThanTheRecordIsRefused) {
    expect_refused({}, {"log.csv", "the delay of 3 s is longer than the record of 0.5 s"}, {"--delay", "3"});
}

TEST_F(FrequencyResponse, ARecordThatIsTooShortIsRefused) {
    Log log;
    log.count = 40;
    expect_refused(log, {"log.csv", "40 samples", "64"});
}

TEST_F(FrequencyResponse, AMethodThatIsUnknownIsRefused) {
    expect_refused({}, {"--methods has \"fra3\", must have some of fra1"}, {"--methods", "fra3"});
}

} // namespace
} // namespace tribode::cli
