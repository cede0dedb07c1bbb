// Methods side by side on one machine, in one run: see docs/benchmarks.md.
//
//     tribode_benchmarks [--out DIR] [--quick] [options of Google Benchmark]
//     tribode_benchmarks --once S1/exact         runs that once, for a profiler
//
// The environment variable PYTHON names the interpreter for peers/ (default python3).

#include "summary.hpp"
#include "sweeps.hpp"

#include <cstdio>
#include <cstdlib>
#include <fmt/format.h>

namespace tribode::bench {

namespace {

struct Arguments {
    std::filesystem::path out = "results/benchmarks";
    std::string once; // the name of an entry
    bool quick = false;
    std::vector<char*> library; // the program's name and what is left to Google Benchmark
};

Arguments read_arguments(int argc, char** argv) {
    Arguments arguments;
    for (int i = 0; i < argc; ++i) {
        const std::string text = argv[i];
        if (text == "--quick") {
            arguments.quick = true;
        } else if (text == "--out" && i + 1 < argc) {
            arguments.out = argv[++i];
        } else if (text == "--once" && i + 1 < argc) {
            arguments.once = argv[++i];
        } else {
            arguments.library.push_back(argv[i]);
        }
    }
    return arguments;
}

Entry entry(const Scenario& scenario, const Contender& contender, const Reference* reference) {
    return {scenario.name, contender.name, [scenario, run = contender.run] { return run(scenario); }, reference};
}

// All frequencies, one after the other.
Entry pure_loop(const std::vector<Scenario>& scenarios, const Contender& contender) {
    return {scenarios.front().name, contender.name, [scenarios, run = contender.run] {
                Run all;
                for (const Scenario& scenario : scenarios) {
                    const Run one = run(scenario);
                    all.samples += one.samples;
                    all.steps += one.steps;
                    all.events += one.events;
                }
                return all;
            }};
}

// references: of S1 and S2.
std::vector<Entry> all_entries(const std::vector<Reference>& references) {
    const std::vector<Contender> engine = engine_methods();
    const Contender& exact = engine.front();
    const Contender rk4 = rk4_by_hand(10), fine_rk4 = rk4_by_hand(100), arkode = arkode_by_hand(1e-6);
    std::vector<Entry> entries;
    for (const auto& [scenario, reference] : {std::pair(s1(), &references[0]), std::pair(s2(), &references[1])}) {
        for (const Contender& contender : engine) entries.push_back(entry(scenario, contender, reference));
        for (const Contender& contender : machine_as_system()) entries.push_back(entry(scenario, contender, reference));
        for (const Contender& contender : {engine_with_all_columns(), rk4, fine_rk4, arkode, arkode_by_hand(1e-8),
                                           arkode_by_hand(1e-6, Restart::anew), cvode_by_hand(Multistep::adams, 1e-6),
                                           cvode_by_hand(Multistep::bdf, 1e-6)}) {
            entries.push_back(entry(scenario, contender, reference));
        }
    }
    for (const Contender& contender : {exact, rk4, fine_rk4, arkode}) entries.push_back(pure_loop(s3(), contender));
    for (const Method method : {Method::exact, Method::erk}) {
        entries.push_back({"S3 analysed", name_of(method), [method] { return analysed_sweep(method); }});
    }
    for (const unsigned workers : {1u, 2u}) {
        entries.push_back({"judged sweep", fmt::format("exact {} worker{}", workers, workers == 1 ? "" : "s"),
                           [workers] { return judged_sweep(workers); }});
    }
    for (const std::size_t count : {20, 200, 2000}) {
        Entry e = entry(with_elements(count), exact, nullptr);
        e.method += fmt::format(" {} elements", count);
        entries.push_back(std::move(e));
    }
    return entries;
}

// Apart, so that a profiler can tell it from the set-up.
[[gnu::noinline]] void run_once(const Entry& entry) { benchmark::DoNotOptimize(entry.run()); }

int run_named(const std::vector<Entry>& entries, const std::string& name) {
    for (const Entry& entry : entries) {
        if (entry.name() != name) continue;
        run_once(entry);
        return 0;
    }
    std::fprintf(stderr, "--once %s: no such benchmark; they are\n", name.c_str());
    for (const Entry& entry : entries) std::fprintf(stderr, "  %s\n", entry.name().c_str());
    return 2;
}

int run_all(Arguments& arguments) {
    // Repetitions of different benchmarks take turns, so that other work on the machine meets all of them alike. What
    // the user says comes later and counts.
    std::vector<std::string> defaults = {"--benchmark_enable_random_interleaving=true"};
    defaults.push_back(arguments.quick ? "--benchmark_repetitions=1" : "--benchmark_repetitions=5");
    defaults.push_back(arguments.quick ? "--benchmark_min_time=0.001" : "--benchmark_min_time=0.05");
    std::vector<char*>& argv = arguments.library;
    for (std::size_t i = 0; i < defaults.size(); ++i) {
        argv.insert(argv.begin() + 1 + static_cast<std::ptrdiff_t>(i), defaults[i].data());
    }
    int argc = static_cast<int>(argv.size());
    benchmark::Initialize(&argc, argv.data());
    if (benchmark::ReportUnrecognizedArguments(argc, argv.data())) return 2;

    const std::vector<Reference> references = {reference(s1()), reference(s2())};
    const std::vector<Entry> entries = all_entries(references);
    for (const Entry& entry : entries) {
        benchmark::RegisterBenchmark(entry.name().c_str(), measure, entry)->MeasureProcessCPUTime()->UseRealTime();
    }
    Collector collector;
    benchmark::RunSpecifiedBenchmarks(&collector);

    std::vector<Row> rows = collector.rows(entries);
    for (const auto& [name, found] : {std::pair("S1", &references[0]), std::pair("S2", &references[1])}) {
        rows.push_back({.scenario = name, .method = "reference", .events = static_cast<double>(found->events)});
    }
    const std::filesystem::path scenarios = arguments.out / "scenarios.json";
    write_scenarios(scenarios, {s1(), s2()}, references);
    const char* python = std::getenv("PYTHON");
    const std::vector<Row> peers = run_peers(python ? python : "python3", scenarios);
    rows.insert(rows.end(), peers.begin(), peers.end());
    print_table(rows);
    write_table(arguments.out / "summary.csv", rows);
    return 0;
}

} // namespace

} // namespace tribode::bench

int main(int argc, char** argv) {
    using namespace tribode::bench;
    Arguments arguments = read_arguments(argc, argv);
    if (arguments.once.empty()) return run_all(arguments);
    return run_named(all_entries(std::vector<Reference>(2)), arguments.once);
}
