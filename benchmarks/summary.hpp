#pragma once
#include "contender.hpp"

#include <benchmark/benchmark.h>
#include <filesystem>
#include <limits>
#include <map>

namespace tribode::bench {

// One line of the table. What is not known, or was not asked for, is nan.
struct Row {
    static constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

    std::string scenario, method;
    double us_per_sample = unknown; // processor time of all threads
    double us_per_step = unknown;   // the same for each step of the integrator
    double seconds = unknown;       // processor time of the run
    double wall_seconds = unknown;
    double error = unknown; // largest, of the position at the sample instants [m]
    double events = unknown;
};

// Runs the entry as often as `state` asks for.
void measure(benchmark::State& state, const Entry& entry);

// Keeps what measure() found; prints errors only.
class Collector final : public benchmark::BenchmarkReporter {
  public:
    bool ReportContext(const Context&) override { return true; }
    void ReportRuns(const std::vector<Run>& runs) override;

    // Of the entries that were run, in their order; times are medians of the repetitions.
    std::vector<Row> rows(const std::vector<Entry>& entries) const;

  private:
    std::map<std::string, std::vector<Run>> runs_; // by name
};

// The scenarios as JSON, for the programs of peers/: parameters and the reference of the position.
void write_scenarios(const std::filesystem::path& file, const std::vector<Scenario>& scenarios,
                     const std::vector<Reference>& references);

// What the programs of peers/ measure. Each gets the file of write_scenarios and prints a line per row:
// scenario,method,us_per_sample,error_m,events. One that cannot run says why on the error output and prints none.
// `python`: the interpreter.
std::vector<Row> run_peers(const std::string& python, const std::filesystem::path& scenarios);

// Scenario by scenario. The last column is the time per sample as a multiple of that of the exact solver there.
void print_table(const std::vector<Row>& rows);
// The same as CSV, unrounded, nan where a number is not known.
void write_table(const std::filesystem::path& file, const std::vector<Row>& rows);

} // namespace tribode::bench
