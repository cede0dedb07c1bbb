#include "summary.hpp"

#include "tribode/base/json.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/output_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fmt/format.h>
#include <memory>
#include <sstream>

namespace tribode::bench {

namespace {

double median(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

double largest_error(const std::vector<double>& x, const Reference& reference) {
    if (x.size() != reference.x.size()) return Row::unknown;
    double worst = 0;
    for (std::size_t k = 0; k < x.size(); ++k) worst = std::max(worst, std::abs(x[k] - reference.x[k]));
    return worst;
}

// The exact solver's time per sample in the row's scenario.
double baseline(const std::vector<Row>& rows, const std::string& scenario) {
    for (const Row& row : rows) {
        if (row.scenario == scenario && row.method.starts_with("exact")) return row.us_per_sample;
    }
    return Row::unknown;
}

// In the order in which the scenarios first appear.
std::vector<Row> grouped(const std::vector<Row>& rows) {
    std::vector<std::string> order;
    for (const Row& row : rows) {
        if (std::find(order.begin(), order.end(), row.scenario) == order.end()) order.push_back(row.scenario);
    }
    std::vector<Row> all;
    for (const auto& scenario : order) {
        for (const Row& row : rows) {
            if (row.scenario == scenario) all.push_back(row);
        }
    }
    return all;
}

// Blank where there is none.
std::string cell(double value, const char* format) {
    return std::isnan(value) ? std::string() : fmt::format(fmt::runtime(format), value);
}

} // namespace

void measure(benchmark::State& state, const Entry& entry) {
    Run run;
    try {
        for (auto _ : state) {
            run = entry.run();
            benchmark::DoNotOptimize(run.x.data());
        }
    } catch (const std::exception& error) {
        state.SkipWithError(error.what());
        return;
    }
    state.counters["samples"] = static_cast<double>(run.samples);
    state.counters["steps"] = static_cast<double>(run.steps);
    state.counters["events"] = static_cast<double>(run.events);
    state.counters["error_m"] = entry.reference ? largest_error(run.x, *entry.reference) : Row::unknown;
}

void Collector::ReportRuns(const std::vector<Run>& runs) {
    for (const Run& run : runs) {
        if (run.error_occurred) {
            std::fprintf(stderr, "%s: %s\n", run.run_name.function_name.c_str(), run.error_message.c_str());
        } else if (run.run_type == Run::RT_Iteration) {
            runs_[run.run_name.function_name].push_back(run);
        }
    }
}

std::vector<Row> Collector::rows(const std::vector<Entry>& entries) const {
    std::vector<Row> rows;
    for (const Entry& entry : entries) {
        const auto found = runs_.find(entry.name());
        if (found == runs_.end()) continue;
        const std::vector<Run>& runs = found->second;
        const auto seconds = [&](double Run::*total) {
            std::vector<double> all;
            for (const Run& run : runs) all.push_back(run.*total / static_cast<double>(run.iterations));
            return median(std::move(all));
        };
        const auto counter = [&](const char* name) { return runs.front().counters.at(name).value; };
        const double cpu = seconds(&Run::cpu_accumulated_time);
        rows.push_back({entry.scenario, entry.method, 1e6 * cpu / counter("samples"), 1e6 * cpu / counter("steps"), cpu,
                        seconds(&Run::real_accumulated_time), counter("error_m"), counter("events")});
    }
    return rows;
}

void write_scenarios(const std::filesystem::path& file, const std::vector<Scenario>& scenarios,
                     const std::vector<Reference>& references) {
    Json all = Json::array();
    for (std::size_t i = 0; i < scenarios.size(); ++i) {
        const Scenario& s = scenarios[i];
        Json modes = Json::array(), elements = Json::array(), loop, excitation = Json::array();
        for (const auto& mode : s.table.modes) modes.push_back({mode.gain, mode.freq_hz, mode.zeta});
        for (const auto& element : s.table.elements) elements.push_back({element.K, element.F, element.D});
        if (s.loop) {
            loop = {{"kp", s.loop->kp},
                    {"ki", s.loop->ki},
                    {"kd", s.loop->kd},
                    {"encoder_resolution", s.loop->encoder_resolution}};
        }
        for (std::size_t k = 0; k < s.samples; ++k) excitation.push_back(s.excitation(k));
        all.push_back({{"name", s.name},
                       {"sample_time", s.table.sample_time},
                       {"rigid_gain", s.table.rigid_gain},
                       {"modes", modes},
                       {"elements", elements},
                       {"viscous", s.table.viscous},
                       {"lag_hz", s.table.lag_hz},
                       {"loop", loop},
                       {"excitation", excitation},
                       {"position", references[i].x}});
    }
    write_file(file, all.dump());
}

std::vector<Row> run_peers(const std::string& python, const std::filesystem::path& scenarios) {
    std::vector<Row> rows;
    for (const auto* peer : {"numba_rk4.py", "drake_loop.py"}) {
        const std::string command =
            fmt::format("'{}' '{}/benchmarks/peers/{}' '{}'", python, TRIBODE_SOURCE_DIR, peer, scenarios.string());
        const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), pclose);
        std::array<char, 1000> line;
        while (pipe && std::fgets(line.data(), line.size(), pipe.get())) {
            std::istringstream fields(line.data());
            Row row;
            std::getline(fields, row.scenario, ',');
            std::getline(fields, row.method, ',');
            for (double* value : {&row.us_per_sample, &row.error, &row.events}) {
                std::string text;
                std::getline(fields, text, ',');
                *value = parse_number(text).value_or(Row::unknown);
            }
            rows.push_back(std::move(row));
        }
    }
    return rows;
}

void print_table(const std::vector<Row>& rows) {
    fmt::print("{:<12} {:<26} {:>10} {:>8} {:>8} {:>8} {:>9} {:>7} {:>9}\n", "scenario", "method", "us/sample",
               "us/step", "cpu s", "wall s", "error m", "events", "to exact");
    std::string last;
    for (const Row& row : grouped(rows)) {
        if (!last.empty() && row.scenario != last) fmt::print("\n");
        last = row.scenario;
        fmt::print("{:<12} {:<26} {:>10} {:>8} {:>8} {:>8} {:>9} {:>7} {:>9}\n", row.scenario, row.method,
                   cell(row.us_per_sample, "{:.3f}"), cell(row.us_per_step, "{:.3f}"), cell(row.seconds, "{:.4f}"),
                   cell(row.wall_seconds, "{:.4f}"), cell(row.error, "{:.1e}"), cell(row.events, "{:.0f}"),
                   cell(row.us_per_sample / baseline(rows, row.scenario), "{:.2f}"));
    }
}

void write_table(const std::filesystem::path& file, const std::vector<Row>& rows) {
    std::string text = "scenario,method,us_per_sample,us_per_step,cpu_s,wall_s,error_m,events,ratio_to_exact\n";
    for (const Row& row : grouped(rows)) {
        text += row.scenario + "," + row.method;
        for (const double value : {row.us_per_sample, row.us_per_step, row.seconds, row.wall_seconds, row.error,
                                   row.events, row.us_per_sample / baseline(rows, row.scenario)}) {
            text += ',';
            append_text(text, value);
        }
        text += '\n';
    }
    write_file(file, text);
}

} // namespace tribode::bench
