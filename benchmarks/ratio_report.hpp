#pragma once
#include <benchmark/benchmark.h>
#include <cstdio>
#include <string>
#include <unistd.h>
#include <utility>
#include <vector>

namespace tribode {

// Which time is compared: the processor's is steadier on a machine with other work, wall time shows what
// workers gain.
enum class Time { processor, wall };

// Prints as the console does, and keeps the time of each benchmark.
class RatioReporter final : public benchmark::ConsoleReporter {
  public:
    explicit RatioReporter(Time time)
        : ConsoleReporter(isatty(STDOUT_FILENO) ? OO_ColorTabular : OO_Tabular),
          time_(time) {}

    void ReportRuns(const std::vector<Run>& runs) override {
        ConsoleReporter::ReportRuns(runs);
        for (const auto& run : runs) {
            if (run.run_type == Run::RT_Iteration && !run.error_occurred) {
                times_.emplace_back(run.run_name.function_name + slash(run.run_name.args),
                                    time_ == Time::wall ? run.GetAdjustedRealTime()
                                                        : run.GetAdjustedCPUTime());
            }
        }
    }

    // Every time over that of the baseline; nothing where the baseline was not run.
    void print_ratios(const std::string& baseline) const {
        for (const auto& [name, base] : times_) {
            if (name != baseline) continue;
            std::printf("\n%s time as a multiple of %s:\n", time_ == Time::wall ? "Wall" : "Processor",
                        baseline.c_str());
            for (const auto& [other, time] : times_)
                std::printf("  %-28s %8.3f\n", other.c_str(), time / base);
            return;
        }
    }

  private:
    static std::string slash(const std::string& args) { return args.empty() ? args : "/" + args; }

    Time time_;
    std::vector<std::pair<std::string, double>> times_;
};

// The main function of a benchmark program.
inline int run_with_ratios(int argc, char** argv, const std::string& baseline, Time time) {
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
    RatioReporter reporter(time);
    benchmark::RunSpecifiedBenchmarks(&reporter);
    reporter.print_ratios(baseline);
    return 0;
}

} // namespace tribode
