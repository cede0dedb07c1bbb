#include "commands/command.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/kernel_sandbox.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/base/text.hpp"
#include "tribode/batch/merge.hpp"
#include "tribode/batch/slurm.hpp"
#include "tribode/batch/status.hpp"
#include "tribode/batch/workers.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/script/batch_script.hpp"

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <optional>
#include <thread>

namespace tribode {

namespace {

struct BatchCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        app.require_subcommand(1);
        plan_app = app.add_subcommand("plan", "describes the points of a script and divides them into shards");
        run_app = app.add_subcommand("run", "runs what is missing on this computer");
        resume_app = app.add_subcommand("resume", "the same: goes on with what is missing");
        shard_app = app.add_subcommand("shard", "runs one shard: what a task of a cluster calls");
        slurm_app = app.add_subcommand("slurm", "submits what is missing to a cluster, as arrays of Slurm");
        status_app = app.add_subcommand("status", "how far a batch is");
        merge_app = app.add_subcommand("merge", "all points as one file");
        plan_app->add_option("script", plan.script.script, "batch script, .lua")->required();
        add_output(*plan_app, plan.folder, "folder of the batch, a new one")->required();
        add_defines(*plan_app, defines, "name=value: sets an option of the script");
        for (auto* command : {run_app, resume_app, shard_app, slurm_app}) {
            add_defines(*command, defines,
                        "name=value: an option as it was planned, again: lets the script read what it names");
        }
        plan_app->add_option("--shards", shards, "how many (default: by the time of some points)")
            ->check(is_whole(1, Manifest::max_shards));
        plan_app->add_option("--shard-seconds", plan.shard_seconds, "duration of the longest shards (default 120)")
            ->check(is_positive());
        plan_app->add_flag("--quick", plan.script.quick, "a small version of the work, to try a script");
        for (auto* command : {run_app, resume_app, shard_app, slurm_app, status_app, merge_app}) {
            command->add_option("folder", folder, "folder of the batch")->required();
        }
        for (auto* command : {run_app, resume_app}) {
            common.add_workers(*command, "processes (default: all cores)");
        }
        for (auto* command : {run_app, resume_app, shard_app}) add_compile(*command, plan.script);
        shard_app->add_option("shard", shard, "its number, from 1")->required();
        slurm_app->add_option("--max-running", slurm.max_running, "tasks of one array at one time (default: no limit)")
            ->check(is_whole(1, 1'000'000));
        slurm_app->add_option("--restarts", slurm.restarts, "of a task that was killed or interrupted (default 3)")
            ->check(is_whole(0, 1'000'000));
        slurm_app
            ->add_option("--sbatch", slurm.sbatch, "an option of the site for sbatch, e.g. --sbatch=--partition=short")
            ->take_all()
            ->allow_extra_args(false);
        slurm_app->add_flag("--dry-run", dry_run, "show the scripts, submit nothing");
        slurm_app->add_flag("--again", again, "also what Slurm says to be waiting or running");
        status_app->add_flag("--watch", watch, "a progress display until the batch is complete");
        add_output(*merge_app, output, "file to write: .h5, .csv or .mat; - for CSV on standard output")->required();
        for (auto* command : app.get_subcommands(nullptr)) {
            common.add_quiet(*command);
            if (command != shard_app) common.add_json(*command);
            command->set_version_flag("--version", "tribode " + version());
        }
    }

    int run(const Common& common) override {
        if (plan_app->parsed()) return run_plan(common);
        if (status_app->parsed()) return show_status(common);
        if (merge_app->parsed()) return merge(common);
        if (slurm_app->parsed()) return submit_missing(common);
        if (shard_app->parsed()) {
            Common alone = common;
            alone.workers = 1;
            return run_script_batch(request(shard), alone.control()) ? done : shard_interrupted;
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
        std::string text = fmt::format("{} points in {} shards", planned.points, planned.shards);
        if (planned.seconds_per_point > 0) {
            const double all = planned.seconds_per_point * static_cast<double>(planned.points);
            text += fmt::format(", {} a point, {} in all on one core",
                                format_quantity(planned.seconds_per_point, "s", 3), format_quantity(all, "s", 3));
        }
        common.note(text + fmt::format("; tribode batch run {}\n", plan.folder.string()),
                    {{"folder", plan.folder.string()},
                     {"points", planned.points},
                     {"shards", planned.shards},
                     {"seconds_per_point", planned.seconds_per_point},
                     {"warnings", planned.warnings}});
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
        common.note(fmt::format("{} points done, {} failed; tribode batch merge {} -o FILE\n", status.done,
                                status.failed, folder),
                    status.json());
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
            std::string text;
            Json scripts = Json::array();
            for (const auto& array : arrays) {
                text += array.script + "\n";
                scripts.push_back(array.script);
            }
            common.print(text, {{"scripts", scripts}});
            return done;
        }
        const FolderLock lock(place);
        Json jobs = Json::array();
        for (const auto& array : arrays) {
            jobs.push_back({{"job", submit(place, array)}, {"shards", array.tasks}});
            // At once: what is submitted should be known also where the next fails.
            if (!common.json && !common.quiet) {
                fmt::print("job {}: {} shards\n", jobs.back()["job"].get<std::string>(), array.tasks);
            }
        }
        const std::size_t queued = missing.size() - open.size();
        common.note(fmt::format("{} of {} shards missing, {} of them queued before; tribode batch status --watch {}\n",
                                missing.size(), manifest.shards, queued, folder),
                    {{"jobs", jobs}, {"shards", manifest.shards}, {"missing", missing.size()}, {"queued", queued}});
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
        common.print(status.text() + "\n", status.json());
        return done;
    }

    int merge(const Common& common) const {
        KernelSandbox sandbox;
        sandbox.read = files_of_batch(folder);
        refuse_to_overwrite_batch(sandbox.read);
        if (output != standard_output) sandbox.allow_output(output);
        if (output == standard_output && common.json) {
            throw InputError("only one of -o - and --json can have the standard output");
        }
        sandbox.enter();
        const MergeSummary summary = merge_script_batch(folder, output, common.control());
        std::string text = fmt::format("{} points, {} failed, in {}\n", summary.points, summary.failed, output);
        if (!summary.left_out.empty()) {
            const std::string gap =
                fmt::format("too long for such a table, and so only in .h5: {}\n", fmt::join(summary.left_out, ", "));
            if (output == standard_output) fmt::print(stderr, "tribode: warning: {}", gap);
            text += gap;
        }
        if (output != standard_output) {
            common.note(text, {{"file", output},
                               {"points", summary.points},
                               {"failed", summary.failed},
                               {"left_out", summary.left_out}});
        }
        return done;
    }

    // The results may lie in the folder of the batch, but not in place of what they are made from.
    void refuse_to_overwrite_batch(const std::vector<std::filesystem::path>& files) const {
        const std::filesystem::path place = folder;
        std::vector<std::string> read = {(place / "manifest.json").string(), (place / "points.csv").string()};
        for (const auto& file : files) read.push_back(file.string());
        refuse_overwriting(read, {output});
        if (output == standard_output) return;
        const auto where = std::filesystem::weakly_canonical(std::filesystem::absolute(output)).parent_path();
        for (const char* part : {"shards", "parts"}) {
            if (where != std::filesystem::weakly_canonical(place / part)) continue;
            throw InputError(fmt::format("{}: lies among the points of the batch; choose another output", output));
        }
    }

    BatchPlanRequest plan;
    std::vector<std::string> defines;
    std::string folder, output;
    std::size_t shards = 0, shard = 0;
    bool watch = false, dry_run = false, again = false;
    SlurmOptions slurm;
    CLI::App *plan_app, *run_app, *slurm_app, *resume_app, *shard_app, *status_app, *merge_app;
};

} // namespace

std::unique_ptr<Command> batch_command() { return std::make_unique<BatchCommand>(); }

} // namespace tribode
