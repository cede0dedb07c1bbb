#include "tribode/base/error.hpp"
#include "tribode/base/kernel_sandbox.hpp"
#include "tribode/base/run_control.hpp"
#include "tribode/base/text.hpp"
#include "tribode/batch/merge.hpp"
#include "tribode/batch/slurm.hpp"
#include "tribode/batch/status.hpp"
#include "tribode/batch/workers.hpp"
#include "tribode/diagnosis/diagnosis_files.hpp"
#include "tribode/experiment/comparison.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/csv.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/record_file.hpp"
#include "tribode/script/batch_script.hpp"
#include "tribode/script/lua_force.hpp"
#include "tribode/script/machine_file.hpp"
#include "tribode/script/script_run.hpp"

#include <CLI/CLI.hpp>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <new>
#include <optional>
#include <thread>
#include <unistd.h>

using namespace tribode;

// OpenBLAS, which Ceres brings along, asks this function of its own for the number of its threads as soon as it is loaded.
// None are of use here. Under a limit of the address space they would wait for memory for ever, and the end of the program
// for them; and threads from before main would be outside the kernel's sandbox.
extern "C" __attribute__((visibility("default"))) int openblas_num_threads_env() { return 1; }

namespace {

enum ExitCode { done = 0, anything_else = 1, wrong_input = 2, ended_early = 3, shard_interrupted = 75 };

std::atomic<bool> stop_requested{false};

// The first Ctrl-C asks the work to end where it can go on later; the second ends the program at once.
void on_interrupt(int signal) {
    stop_requested = true;
    std::signal(signal, SIG_DFL);
}

// A line on standard error: bar, count, time left. Where that is no terminal, a line every tenth of the way, and none
// for work of a second or two.
class ProgressDisplay {
  public:
    void show(const std::string& what, std::size_t done, std::size_t of) {
        const auto now = std::chrono::steady_clock::now();
        if (what != what_ || done < done_) {
            what_ = what;
            start_ = now;
            first_ = done;
            tenth_ = 0;
            shown_ = {};
        }
        done_ = done;
        const bool last = done == of;
        const double elapsed = std::chrono::duration<double>(now - start_).count();
        if (terminal_ ? !last && now - shown_ < std::chrono::milliseconds(100)
                      : elapsed < 2 || done * 10 < of * (tenth_ + 1)) {
            return;
        }
        shown_ = now;
        tenth_ = of ? done * 10 / of : 0;
        const auto made = static_cast<double>(done - first_);
        const double left = made > 0 ? elapsed * static_cast<double>(of - done) / made : 0;
        const double rate = elapsed > 0 ? made / elapsed : 0;
        constexpr std::size_t width = 30;
        const std::size_t filled = of ? width * done / of : width;
        std::fprintf(stderr, "%s%s", terminal_ ? "\r" : "",
                     fmt::format("{} [{:#<{}}{:.<{}}] {}/{}  {:.3g}/s  {}{}", printable(what), "", filled, "",
                                 width - filled, done, of, rate,
                                 last ? fmt::format("{:.1f} s    ", elapsed) : fmt::format("{:.0f} s left ", left),
                                 terminal_ && !last ? "" : "\n")
                         .c_str());
        std::fflush(stderr);
        open_ = terminal_ && !last;
    }

    // So that what is said next stands in a line of its own.
    void close_line() {
        if (open_) std::fputc('\n', stderr);
        open_ = false;
    }

  private:
    const bool terminal_ = isatty(STDERR_FILENO) != 0;
    std::string what_;
    std::chrono::steady_clock::time_point start_, shown_;
    std::size_t first_ = 0, done_ = 0, tenth_ = 0;
    bool open_ = false; // the bar stands in an unfinished line
};

ProgressDisplay display;

struct Common {
    bool quiet = false;
    unsigned workers = std::max(1u, std::thread::hardware_concurrency());

    RunControl control() const {
        RunControl control;
        control.stop = &stop_requested;
        control.workers = workers;
        if (!quiet) {
            control.progress = [](const std::string& what, std::size_t now, std::size_t of) {
                display.show(what, now, of);
            };
        }
        return control;
    }
};

// -D name=value, each once or more: the last counts.
std::map<std::string, std::string> defines_of(const std::vector<std::string>& defines) {
    std::map<std::string, std::string> values;
    for (const auto& define : defines) {
        const std::size_t equals = define.find('=');
        if (equals == 0 || equals == std::string::npos) {
            throw InputError(fmt::format("-D {}: must be name=value", define));
        }
        values[define.substr(0, equals)] = define.substr(equals + 1);
    }
    return values;
}

MachineModel read_machine(const std::string& file, const Common& common) {
    return MachineModel::from_description(read_description(file, {}, nullptr, nullptr, common.control()), file);
}

// A machine and the record that drives it, as simulate and compare take them.
struct MachineAndRecord {
    std::string machine, input, columns, scale;

    void add_to(CLI::App& app) {
        app.add_option("--machine", machine, "machine description, .lua or .json")->required();
        app.add_option("--input", input, "record, CSV, MAT or HDF5, with t,u (open loop) or t,r,exc (closed loop)")
            ->required();
        app.add_option("--columns", columns, "names in the input, e.g. t=t_s,u=u_V");
        app.add_option("--scale", scale, "factors that bring input columns to SI, e.g. u=35.15");
    }

    MachineModel model(const Common& common) const { return read_machine(machine, common); }

    DriveRecord record(const MachineModel& model) const {
        const Record measured = read_record(input, RecordOptions::parse(columns, scale), DriveRecord::columns());
        return DriveRecord::from_table(measured.table, model, input);
    }
};

// For commands that read files of others and write one of their own. A machine may be a program that requires what lies beside it.
void confine(const std::string& machine, const std::vector<std::string>& read, const std::vector<std::string>& write) {
    KernelSandbox sandbox;
    sandbox.read.assign(read.begin(), read.end());
    if (!machine.empty()) {
        const std::filesystem::path file = machine;
        sandbox.read.insert(sandbox.read.end(), {file, file.has_parent_path() ? file.parent_path() : "."});
    }
    for (const auto& file : write) sandbox.allow_output(file);
    sandbox.allow_program("gnuplot");
    sandbox.enter();
}

struct SimulateCommand {
    MachineAndRecord what;
    std::string output, events;
    std::string solver = name_of(SolverOptions{}.method);
    SolverOptions options;
    std::optional<double> step; // none: Ts/10 [s]
    std::uint64_t seed = 0;

    void add_to(CLI::App& app, Common& common) {
        what.add_to(app);
        app.add_option("-o,--out", output, "file to write, .csv, .mat or .h5: t,r,u,y,x,v,f")->required();
        app.add_option("--events", events, "CSV to write: t,element,kind");
        app.add_option("--solver", solver,
                       fmt::format("{} (default auto: exact where possible, else erk)",
                                   fmt::join(SolverOptions::method_names(), ", ")));
        app.add_option("--rtol", options.relative_tolerance, "relative tolerance (default 1e-8)");
        app.add_option("--atol", options.absolute_tolerance, "absolute tolerance in metres (default 1e-12)");
        app.add_option("--step", step, "step of the fixed-step solvers in seconds (default Ts/10)");
        app.add_option("--seed", seed, "seed of the noise (default 0)");
        app.add_flag("--quiet", common.quiet, "no progress display");
    }

    int run(const Common& common) {
        confine(what.machine, {what.input}, events.empty() ? std::vector{output} : std::vector{output, events});
        const MachineModel model = what.model(common);
        options.method = method_named(solver);
        options.fixed_step = step.value_or(model.sample_time / 10);
        for (const auto& [name, value] : {std::pair{"--rtol", options.relative_tolerance},
                                          {"--atol", options.absolute_tolerance},
                                          {"--step", options.fixed_step}}) {
            if (!(value > 0) || !std::isfinite(value)) {
                throw InputError(fmt::format("{} {}: must be positive and finite", name, to_text(value)));
            }
        }
        const Simulation result = simulate(model, what.record(model), options, seed, common.control());
        if (!result.outcome.ok()) {
            // What was reached is kept, but not under the name of a whole result.
            const std::string partial = output + ".partial.csv";
            write_csv(partial, to_table(result.trace));
            throw EndedEarly(fmt::format("{}; the {} samples reached are in {}", result.outcome.message,
                                         result.trace.t.size(), partial));
        }
        write_record(output, to_table(result.trace));
        if (!events.empty()) write_file(events, to_csv(result.events));
        if (!common.quiet) {
            const RunStatistics& n = result.statistics;
            fmt::print("{} samples with {}: {} events, {} steps ({} rejected), {} derivative evaluations, {} restarts, "
                       "{:.3g} s integrating, {:.3g} s in events and samples\n",
                       result.trace.t.size(), name_of(result.method), n.events, n.steps, n.rejected_steps,
                       n.derivative_evaluations, n.restarts, n.seconds_integrating, n.seconds_events);
        }
        return done;
    }
};

struct CompareCommand {
    MachineAndRecord what;
    std::string output = "results/compare";
    ComparisonOptions options;

    void add_to(CLI::App& app, Common& common) {
        what.add_to(app);
        app.add_option("-o,--out", output, "folder of table and plots (default results/compare)");
        app.add_option("--seed", options.seed, "seed of the noise (default 0)");
        app.add_flag("--quiet", common.quiet, "no progress display");
    }

    int run(const Common& common) {
        confine(what.machine, {what.input}, {output});
        const MachineModel model = what.model(common);
        const DriveRecord record = what.record(model);
        RunFolder folder(output); // first: a folder that cannot be made is said before the work
        const Comparison comparison = compare(model, record, options, common.control());
        write_comparison(comparison, model, folder);
        fmt::print("{}\n", comparison.text());
        folder.write_manifest({{"program", "tribode compare"},
                               {"machine", model.hash()},
                               {"input", {{"file", what.input}, {"sha256", sha256(read_file(what.input))}}},
                               {"seed", options.seed}});
        return done;
    }
};

struct DiagnoseCommand {
    std::string machine, columns, scale, validate, output = "results/diagnose";
    std::vector<std::string> data;
    DiagnosisOptions options;

    void add_to(CLI::App& app, Common& common) {
        app.add_option("--machine", machine, "machine description, .lua or .json")->required();
        app.add_option("--data", data, "measured record: t,r,u,y (closed loop) or t,u,y; may be given again")
            ->required()
            ->take_all()
            ->allow_extra_args(false);
        app.add_option("--validate", validate,
                       "validation record, not used in the fit (default: the last third of the first record)");
        app.add_option("-o,--out", output, "folder of verdict, machine, report (default results/diagnose)");
        app.add_option("--max-effects", options.max_effects, "how many effects may be missing together (default 3)")
            ->check(CLI::Range(1u, 6u));
        app.add_option("--columns", columns, "names in the records, e.g. t=t_s,u=u_V");
        app.add_option("--scale", scale, "factors that bring columns to SI, e.g. u=35.15");
        app.add_option("-j,--workers", common.workers, "threads (default: all cores); the results do not depend on it")
            ->check(CLI::Range(1u, 4096u));
        app.add_flag("--quiet", common.quiet, "no progress display");
    }

    int run(const Common& common) {
        const auto start = std::chrono::steady_clock::now();
        std::vector<std::string> records_to_read = data;
        if (!validate.empty()) records_to_read.push_back(validate);
        confine(machine, records_to_read, {output});
        const MachineModel model = read_machine(machine, common);
        std::vector<std::string> hashes;
        const auto measurement = [&](const std::string& file) {
            hashes.push_back(sha256(read_file(file)));
            return read_measurement(file, model, RecordOptions::parse(columns, scale));
        };
        std::vector<Measurement> records;
        for (const auto& file : data) records.push_back(measurement(file));
        std::optional<Measurement> proof;
        if (!validate.empty()) proof = measurement(validate);
        RunFolder folder(output);
        const Diagnosis diagnosis = diagnose(model, std::move(records), std::move(proof), options, common.control());
        const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        const Json summary = diagnosis_json(diagnosis, hashes, model.hash(), seconds);
        write_diagnosis(diagnosis, summary, folder, common.control());
        fmt::print("{}", diagnosis_text(summary));
        return done;
    }
};

void add_compile(CLI::App& app, ScriptRequest& request) {
    app.add_flag("--compile", request.compile,
                 "equations of tb.run_system through the system's C compiler: faster, the same results");
}

struct RunCommand {
    ScriptRequest request;
    std::vector<std::string> defines;
    std::string machine, data, input;
    std::size_t memory_mib = ScriptLimits{}.memory_bytes >> 20, cpu_seconds = 0; // 0: no limit
    CLI::Option* memory = nullptr;

    void add_to(CLI::App& app, Common& common) {
        app.add_option("script", request.script, "experiment script, .lua")->required();
        app.add_option("-o,--out", request.folder, "folder of the results (default results/<script>)");
        app.add_option("-D", defines, "name=value: sets an option of the script")->take_all()->allow_extra_args(false);
        app.add_option("--machine", machine, "the script's option machine: a file");
        app.add_option("--data", data, "the script's option data: a file");
        app.add_option("--input", input, "the script's option input: a file");
        app.add_option("-j,--workers", common.workers, "threads (default: all cores); the results do not depend on it")
            ->check(CLI::Range(1u, 4096u));
        app.add_flag("--quick", request.quick, "a small version of the work, to try a script");
        app.add_flag("--allow-all", request.allow_all,
                     "let the script open any file and use the whole standard library of Lua");
        add_compile(app, request);
        app.add_option("--max-instructions", request.limits.instructions, "limit of the script's Lua instructions");
        memory = app.add_option("--max-memory", memory_mib, "limit of the script's memory in MiB");
        app.add_option("--max-cpu", cpu_seconds, "limit of the processor time of each process in seconds")
            ->check(CLI::PositiveNumber);
        app.add_flag("--quiet", common.quiet, "no progress display");
    }

    int run(const Common& common) {
        request.defines = defines_of(defines);
        for (const auto& [name, file] : {std::pair{"machine", machine}, {"data", data}, {"input", input}}) {
            if (!file.empty()) request.defines[name] = file;
        }
        for (const auto& [name, value] : request.defines) request.named.emplace_back(value);
        request.limits.memory_bytes = memory_mib << 20;
        request.confine = true;
        // The engine may hold more than the script, such as the data of a plot, but not without end.
        const std::size_t besides = std::size_t{1} << 30;
        limit_process(memory->count() > 0 ? 4 * request.limits.memory_bytes + besides : 0, cpu_seconds);
        ScriptRun run(request, common.control());
        run.confine();
        run.execute();
        return done;
    }
};

struct BatchCommand {
    BatchPlanRequest plan;
    std::vector<std::string> defines;
    std::string folder, output;
    std::size_t shards = 0, shard = 0;
    bool as_json = false, watch = false, dry_run = false, again = false;
    SlurmOptions slurm;
    CLI::App *plan_app, *run_app, *slurm_app, *resume_app, *shard_app, *status_app, *merge_app;

    void add_to(CLI::App& app, Common& common) {
        app.require_subcommand(1);
        plan_app = app.add_subcommand("plan", "describes the points of a script and divides them into shards");
        run_app = app.add_subcommand("run", "runs what is missing on this computer");
        resume_app = app.add_subcommand("resume", "the same: goes on with what is missing");
        shard_app = app.add_subcommand("shard", "runs one shard: what a task of a cluster calls");
        slurm_app = app.add_subcommand("slurm", "submits what is missing to a cluster, as arrays of Slurm");
        status_app = app.add_subcommand("status", "how far a batch is");
        merge_app = app.add_subcommand("merge", "all points as one file");
        plan_app->add_option("script", plan.script.script, "batch script, .lua")->required();
        plan_app->add_option("-o,--out", plan.folder, "folder of the batch, a new one")->required();
        plan_app->add_option("-D", defines, "name=value: sets an option of the script")
            ->take_all()
            ->allow_extra_args(false);
        for (auto* command : {run_app, resume_app, shard_app, slurm_app}) {
            command
                ->add_option("-D", defines,
                             "name=value: an option as it was planned, again: lets the script read what it names")
                ->take_all()
                ->allow_extra_args(false);
        }
        plan_app->add_option("--shards", shards, "how many (default: by the time of some points)")
            ->check(CLI::Range(std::size_t{1}, Manifest::max_shards));
        plan_app->add_option("--shard-seconds", plan.shard_seconds, "duration of the longest shards (default 120)")
            ->check(CLI::PositiveNumber);
        plan_app->add_flag("--quick", plan.script.quick, "a small version of the work, to try a script");
        for (auto* command : {run_app, resume_app, shard_app, slurm_app, status_app, merge_app}) {
            command->add_option("folder", folder, "folder of the batch")->required();
        }
        for (auto* command : {run_app, resume_app}) {
            command->add_option("-j,--workers", common.workers, "processes (default: all cores)")
                ->check(CLI::Range(1u, 4096u));
        }
        for (auto* command : {run_app, resume_app, shard_app}) add_compile(*command, plan.script);
        shard_app->add_option("shard", shard, "its number, from 1")->required();
        slurm_app->add_option("--max-running", slurm.max_running, "tasks of one array at one time (default: no limit)")
            ->check(CLI::PositiveNumber);
        slurm_app->add_option("--restarts", slurm.restarts, "of a task that was killed or interrupted (default 3)")
            ->check(CLI::NonNegativeNumber);
        slurm_app
            ->add_option("--sbatch", slurm.sbatch, "an option of the site for sbatch, e.g. --sbatch=--partition=short")
            ->take_all()
            ->allow_extra_args(false);
        slurm_app->add_flag("--dry-run", dry_run, "show the scripts, submit nothing");
        slurm_app->add_flag("--again", again, "also what Slurm says to be waiting or running");
        status_app->add_flag("--json", as_json, "as JSON");
        status_app->add_flag("--watch", watch, "a progress display until the batch is complete");
        merge_app->add_option("-o,--out", output, "file to write: .h5, .csv or .mat")->required();
        for (auto* command : app.get_subcommands(nullptr)) {
            command->add_flag("--quiet", common.quiet, "no progress display");
            command->set_version_flag("--version", "tribode " + version());
        }
    }

    int run(Common common) {
        if (plan_app->parsed()) return run_plan(common);
        if (status_app->parsed()) return show_status(common);
        if (merge_app->parsed()) return merge(common);
        if (slurm_app->parsed()) return submit_missing(common);
        if (shard_app->parsed()) {
            common.workers = 1;
            return run_script_batch(request(shard), common.control()) ? done : shard_interrupted;
        }
        return run_missing(common);
    }

    BatchRunRequest request(std::optional<std::size_t> one) const {
        return {folder, one, defines_of(defines), plan.script.compile, true};
    }

    int run_plan(const Common& common) {
        plan.script.confine = true;
        plan.script.defines = defines_of(defines);
        for (const auto& [name, value] : plan.script.defines) plan.script.named.emplace_back(value);
        if (shards) plan.shards = shards;
        const PlannedBatch planned = plan_script_batch(plan, common.control());
        for (const auto& warning : planned.warnings) std::fprintf(stderr, "tribode: warning: %s\n", warning.c_str());
        if (common.quiet) return done;
        fmt::print("{} points in {} shards", planned.points, planned.shards);
        if (planned.seconds_per_point > 0) {
            fmt::print(", {:.3g} ms a point, {:.3g} s in all on one core", 1e3 * planned.seconds_per_point,
                       planned.seconds_per_point * static_cast<double>(planned.points));
        }
        fmt::print("; tribode batch run {}\n", plan.folder.string());
        return done;
    }

    int run_missing(const Common& common) {
        const auto place = std::filesystem::absolute(folder); // the work goes to another folder
        const bool complete = run_script_batch(request(std::nullopt), common.control());
        const BatchStatus status = read_status(place, Manifest::read(place));
        if (!complete) {
            throw EndedEarly(
                fmt::format("interrupted after {} of {} points; they are kept, and tribode batch resume {} "
                            "goes on from there",
                            status.done, status.points, folder));
        }
        if (!common.quiet) {
            fmt::print("{} points done, {} failed; tribode batch merge {} -o FILE\n", status.done, status.failed,
                       folder);
        }
        return done;
    }

    int submit_missing(const Common& common) {
        const Manifest manifest = Manifest::read(folder);
        const auto place = std::filesystem::canonical(folder);
        const auto missing = missing_shards(place, manifest);
        const auto open = again ? missing : without_queued(place, missing);
        slurm.program = std::filesystem::read_symlink("/proc/self/exe").string();
        slurm.defines = defines_of(defines);
        require_defines(place, manifest, slurm.defines);
        const auto arrays = slurm_arrays(place, manifest, open, slurm, slurm_largest_index());
        if (dry_run) {
            for (const auto& array : arrays) fmt::print("{}\n", array.script);
            return done;
        }
        const FolderLock lock(place);
        for (const auto& array : arrays) {
            const std::string job = submit(place, array);
            if (!common.quiet) fmt::print("job {}: {} shards\n", job, array.tasks);
        }
        if (!common.quiet) {
            fmt::print("{} of {} shards missing, {} of them queued before; tribode batch status --watch {}\n",
                       missing.size(), manifest.shards, missing.size() - open.size(), folder);
        }
        return done;
    }

    int show_status(const Common& common) const {
        confine("", {folder}, {});
        const Manifest manifest = Manifest::read(folder);
        const RunControl control = common.control();
        BatchFiles files(folder, manifest);
        BatchStatus status = read_status(files, manifest, control);
        while (watch && !status.complete()) {
            if (control.progress) control.progress(status.name, status.done, status.points);
            std::this_thread::sleep_for(std::chrono::seconds(1));
            if (control.stop_requested()) break;
            status = read_status(files, manifest, control);
        }
        fmt::print("{}\n", as_json ? status.json().dump(2) : status.text());
        return done;
    }

    int merge(const Common& common) const {
        KernelSandbox sandbox;
        sandbox.read = files_of_batch(folder);
        sandbox.allow_output(output);
        sandbox.enter();
        const MergeSummary summary = merge_script_batch(folder, output, common.control());
        if (!common.quiet) {
            fmt::print("{} points, {} failed, in {}\n", summary.points, summary.failed, output);
            if (!summary.left_out.empty()) {
                fmt::print("too long for such a table, and so only in .h5: {}\n", fmt::join(summary.left_out, ", "));
            }
        }
        return done;
    }
};

int report(const std::string& problem, ExitCode code) {
    std::fflush(stdout);
    display.close_line();
    std::fprintf(stderr, "tribode: %s\n", printable(problem, "\n\t").c_str());
    return code;
}

std::vector<std::string> option_names(const CLI::App& command) {
    std::vector<std::string> names;
    for (const auto* option : command.get_options()) {
        for (const auto& name : option->get_lnames()) names.push_back("--" + name);
    }
    return names;
}

std::vector<std::string> command_names(const CLI::App& app) {
    std::vector<std::string> names;
    for (const auto* command : app.get_subcommands(nullptr)) names.push_back(command->get_name());
    return names;
}

// What is wrong with the command line. A word that nobody knows comes first: it is often why something else is missing.
std::string usage_problem(const CLI::App& app, const CLI::ParseError& problem) {
    const CLI::App* found = &app;
    std::string name = "tribode";
    while (!found->get_subcommands().empty()) {
        found = found->get_subcommands().front();
        name += " " + found->get_name();
    }
    const CLI::App& command = *found;
    const bool is_group = !command_names(command).empty(); // a command is still to come
    if (const auto unknown = app.remaining(true); !unknown.empty()) {
        const std::string word = unknown.front().substr(0, unknown.front().find('='));
        if (word.starts_with('-')) {
            return fmt::format("{} is not an option of {}{}", word, name, suggestion(word, option_names(command)));
        }
        if (!is_group) return fmt::format("{} takes no further argument \"{}\"", name, word);
        return fmt::format("\"{}\" is not a command{}{}", word, &command == &app ? "" : " of " + name,
                           suggestion(word, command_names(command)));
    }
    if (is_group)
        return fmt::format("{}a command is missing{}", &command == &app ? "" : name + ": ",
                           suggestion("", command_names(command)));
    return fmt::format("{}: {}; {} --help tells what is allowed", name, problem.what(), name);
}

int run_program(int argc, char** argv) {
    tribode::enable_lua_forces();
    std::signal(SIGINT, on_interrupt);
    std::signal(SIGTERM, on_interrupt);
    std::signal(SIGXCPU, on_interrupt); // at the limit of the processor's time
    std::signal(SIGXFSZ, SIG_IGN);      // a file above the size limit is an error of the write, also in a script
    CLI::App app("Tribode: simulation and frequency-response analysis of servo systems with friction", "tribode");
    app.set_version_flag("--version", "tribode " + version());
    app.require_subcommand(1);
    Common common;
    SimulateCommand simulate_command;
    CompareCommand compare_command;
    DiagnoseCommand diagnose_command;
    RunCommand run_command;
    BatchCommand batch_command;
    auto* simulate_app = app.add_subcommand("simulate", "one machine under a recorded input");
    auto* compare_app = app.add_subcommand("compare", "one machine and one input through every method");
    auto* diagnose_app = app.add_subcommand("diagnose", "the effect that a machine lacks, from measured records");
    auto* run_app = app.add_subcommand("run", "an experiment script in Lua");
    auto* batch_app = app.add_subcommand("batch", "many independent points, that survive what may happen");
    simulate_command.add_to(*simulate_app, common);
    compare_command.add_to(*compare_app, common);
    diagnose_command.add_to(*diagnose_app, common);
    run_command.add_to(*run_app, common);
    batch_command.add_to(*batch_app, common);
    for (auto* command : {simulate_app, compare_app, diagnose_app, run_app, batch_app}) {
        command->set_version_flag("--version", "tribode " + version());
    }
    try {
        app.parse(argc, argv);
    } catch (const CLI::Success& help_or_version) {
        return app.exit(help_or_version);
    } catch (const CLI::ParseError& problem) {
        return report(usage_problem(app, problem), wrong_input);
    }
    try {
        if (simulate_app->parsed()) return simulate_command.run(common);
        if (compare_app->parsed()) return compare_command.run(common);
        if (diagnose_app->parsed()) return diagnose_command.run(common);
        if (batch_app->parsed()) return batch_command.run(common);
        return run_command.run(common);
    } catch (const InputError& problem) {
        return report(problem.what(), wrong_input);
    } catch (const EndedEarly& problem) {
        return report(problem.what(), ended_early);
    } catch (const std::bad_alloc&) {
        return report("there is not enough memory, or less than --max-memory leaves", anything_else);
    } catch (const std::exception& problem) {
        return report(problem.what(), anything_else);
    }
}

} // namespace

int main(int argc, char** argv) {
    const int code = run_program(argc, argv);
    // What was printed may still wait in a buffer, and a device that is full shows only now.
    const bool flushed = std::fflush(stdout) == 0;
    if ((flushed && !std::ferror(stdout)) || code != done) return code;
    return report(fmt::format("standard output: cannot be written ({})",
                              flushed ? "an earlier write failed" : std::strerror(errno)),
                  anything_else);
}
