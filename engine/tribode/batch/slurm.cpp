#include "tribode/batch/slurm.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/output_file.hpp"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <map>
#include <set>
#include <spawn.h>
#include <sstream>
#include <sys/wait.h>
#include <unistd.h>

namespace tribode {

namespace fs = std::filesystem;

namespace {

struct CommandResult {
    int status = -1;  // exit code; -1: it could not be started or was killed
    std::string text; // standard output and errors
};

// Without a shell.
CommandResult run_command(std::vector<std::string> words) {
    std::vector<char*> pointers;
    for (auto& word : words) pointers.push_back(word.data());
    pointers.push_back(nullptr);
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) throw Error(fmt::format("no pipe can be made ({})", std::strerror(errno)));
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDERR_FILENO);
    pid_t process = 0;
    const int problem = ::posix_spawnp(&process, pointers[0], &actions, nullptr, pointers.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    ::close(ends[1]);
    CommandResult result;
    char bytes[4096];
    for (ssize_t got; problem == 0 && (got = ::read(ends[0], bytes, sizeof bytes)) != 0;) {
        if (got > 0) result.text.append(bytes, static_cast<std::size_t>(got));
        if (got < 0 && errno != EINTR) break;
    }
    ::close(ends[0]);
    int status = 0;
    if (problem == 0 && ::waitpid(process, &status, 0) == process && WIFEXITED(status)) {
        result.status = WEXITSTATUS(status);
    }
    return result;
}

void require_one_line(const std::string& text) {
    if (std::none_of(text.begin(), text.end(), [](unsigned char c) { return std::iscntrl(c); })) return;
    throw InputError(fmt::format("\"{}\" has a line break or another control character, which a script of Slurm cannot "
                                 "hold; choose another name",
                                 printable(text)));
}

// In a script, where a line break would end a comment line of sbatch and begin a command.
std::string quoted(const std::string& text) {
    require_one_line(text);
    std::string result = "'";
    for (const char c : text) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return result + "'";
}

// A job's name without what sbatch would take apart.
std::string job_name(const std::string& name) {
    std::string result = "tribode-";
    for (const char c : name) result += std::isalnum(static_cast<unsigned char>(c)) ? c : '-';
    return result;
}

fs::path jobs_file(const fs::path& folder) { return folder / "slurm" / "jobs.txt"; }

// Job number -> offset, of all arrays submitted so far.
std::map<std::string, std::size_t> submitted_jobs(const fs::path& folder) {
    std::map<std::string, std::size_t> jobs;
    if (!fs::exists(jobs_file(folder))) return jobs;
    std::istringstream lines(read_file(jobs_file(folder)));
    std::string job;
    for (std::size_t offset; lines >> job >> offset;) jobs[job] = offset;
    return jobs;
}

} // namespace

std::string index_list(const std::vector<std::size_t>& indices) {
    std::string text;
    for (std::size_t i = 0; i < indices.size();) {
        std::size_t last = i;
        while (last + 1 < indices.size() && indices[last + 1] == indices[last] + 1) ++last;
        text += fmt::format("{}{}", text.empty() ? "" : ",", indices[i]);
        if (last > i) text += fmt::format("-{}", indices[last]);
        i = last + 1;
    }
    return text;
}

std::vector<SlurmArray> slurm_arrays(const fs::path& folder, const Manifest& manifest,
                                     const std::vector<std::size_t>& shards, const SlurmOptions& options,
                                     std::size_t largest_index) {
    std::map<std::size_t, std::vector<std::size_t>> tasks; // by offset
    for (const std::size_t shard : shards) {
        const std::size_t offset = (shard - 1) / largest_index * largest_index;
        tasks[offset].push_back(shard - offset);
    }
    std::string defines;
    for (const auto& [name, value] : options.defines) defines += " -D " + quoted(name + "=" + value);
    std::vector<SlurmArray> arrays;
    for (const auto& [offset, indices] : tasks) {
        std::string text = fmt::format("#!/bin/bash\n"
                                       "#SBATCH --job-name={}\n"
                                       "#SBATCH --array={}{}\n"
                                       "#SBATCH --ntasks=1 --cpus-per-task=1\n"
                                       "#SBATCH --requeue --open-mode=append\n"
                                       "#SBATCH --signal=B:TERM@60\n"
                                       "#SBATCH --output={}\n",
                                       job_name(manifest.name), index_list(indices),
                                       options.max_running ? fmt::format("%{}", options.max_running) : "",
                                       quoted((folder / "slurm" / "%A_%a.log").string()));
        for (const auto& line : options.sbatch) {
            require_one_line(line);
            text += fmt::format("#SBATCH {}\n", line);
        }
        text += fmt::format("\n"
                            "{} batch shard {} $(({} + SLURM_ARRAY_TASK_ID)){} --quiet &\n"
                            "task=$!\n"
                            "trap 'kill -TERM $task 2>/dev/null' TERM\n"
                            "wait $task\n"
                            "status=$?\n"
                            "# wait returns when a signal comes; the task still has its points to write\n"
                            "while kill -0 $task 2>/dev/null; do wait $task; status=$?; done\n"
                            "# interrupted (75) or killed: once more, whether or not the site sets RequeueExit\n"
                            "if [ $status -eq 75 ] || [ $status -ge 128 ]; then\n"
                            "    if [ \"${{SLURM_RESTART_COUNT:-0}}\" -lt {} ]; then\n"
                            "        scontrol requeue \"${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID\" && sleep 60\n"
                            "        exit 75\n"
                            "    fi\n"
                            "    exit 1\n"
                            "fi\n"
                            "exit $status\n",
                            quoted(options.program), quoted(folder.string()), offset, defines, options.restarts);
        arrays.push_back({offset, indices.size(), std::move(text)});
    }
    return arrays;
}

std::size_t slurm_largest_index() {
    constexpr std::size_t default_largest = 1000;
    const CommandResult config = run_command({"scontrol", "show", "config"});
    const std::size_t at = config.text.find("MaxArraySize");
    if (config.status != 0 || at == std::string::npos) return default_largest;
    std::istringstream line(config.text.substr(at));
    std::string name, equals;
    std::size_t size = 0;
    line >> name >> equals >> size;
    if (size < 2) throw InputError("this site does not allow job arrays (MaxArraySize of Slurm is below 2)");
    return size - 1;
}

std::vector<std::size_t> without_queued(const fs::path& folder, const std::vector<std::size_t>& shards) {
    const auto jobs = submitted_jobs(folder);
    if (jobs.empty()) return shards;
    const CommandResult queue = run_command({"squeue", "--noheader", "--array", "--me", "--format=%F %K"});
    if (queue.status != 0) return shards;
    std::set<std::size_t> queued;
    std::istringstream lines(queue.text);
    std::string job, task;
    while (lines >> job >> task) {
        const auto known = jobs.find(job);
        const auto index = parse_number(task);
        if (known != jobs.end() && index) queued.insert(known->second + static_cast<std::size_t>(*index));
    }
    std::vector<std::size_t> left;
    std::copy_if(shards.begin(), shards.end(), std::back_inserter(left),
                 [&](std::size_t shard) { return !queued.contains(shard); });
    return left;
}

std::string submit(const fs::path& folder, const SlurmArray& array) {
    auto jobs = submitted_jobs(folder);
    const fs::path script = folder / "slurm" / fmt::format("array-{}.sh", jobs.size() + 1);
    write_file(script, array.script);
    const CommandResult result = run_command({"sbatch", "--parsable", script.string()});
    if (result.status == -1) throw InputError("there is no sbatch here; is this a computer of the cluster?");
    if (result.status != 0) {
        throw InputError(fmt::format("sbatch refused {}: {}", script.string(), trim(result.text)));
    }
    // The last line, since a site may print a greeting; with a cluster's name: 123;cluster.
    const auto text = trim(result.text);
    const auto line = text.substr(text.rfind('\n') + 1);
    std::string job(line.substr(0, line.find(';')));
    jobs[job] = array.offset;
    std::string list;
    for (const auto& [number, offset] : jobs) list += fmt::format("{} {}\n", number, offset);
    write_file(jobs_file(folder), list);
    return job;
}

} // namespace tribode
