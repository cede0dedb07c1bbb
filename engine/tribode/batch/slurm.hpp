#pragma once
#include "tribode/batch/manifest.hpp"

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace tribode {

// The missing shards of a batch as arrays of the workload manager Slurm. Slurm is only an accelerator: what is done is said
// by the files of the batch, and a task that Slurm forgot, or a site where it may not start one again, costs another
// `tribode batch slurm` or `resume`.
struct SlurmOptions {
    std::size_t max_running = 0;                // tasks of one array at one time; 0: as many as the site lets
    int restarts = 3;                           // of a task that was killed or interrupted
    std::vector<std::string> sbatch;            // options of the site, e.g. "--partition=short": a line #SBATCH each
    std::string program;                        // path of tribode, the same on every node
    std::map<std::string, std::string> defines; // -D of each task
};

// One array: task i runs shard offset + i.
struct SlurmArray {
    std::size_t offset = 0;
    std::size_t tasks = 0;
    std::string script; // text
};

// `largest_index`: of an array at this site. Shards above it go to further arrays.
std::vector<SlurmArray> slurm_arrays(const std::filesystem::path& folder, const Manifest& manifest,
                                     const std::vector<std::size_t>& shards, const SlurmOptions& options,
                                     std::size_t largest_index);

// "1-4,7,9-12" for a sorted list.
std::string index_list(const std::vector<std::size_t>& indices);

// MaxArraySize - 1 of the site; 1000, Slurm's default, where it cannot be asked.
std::size_t slurm_largest_index();

// Those of the shards that no task of arrays submitted before is waiting for or running, as far as Slurm knows.
std::vector<std::size_t> without_queued(const std::filesystem::path& folder, const std::vector<std::size_t>& shards);

// Submits with sbatch and notes the job in slurm/jobs.txt. Returns its number. Throws InputError where there is no sbatch
// or it refuses.
std::string submit(const std::filesystem::path& folder, const SlurmArray& array);

} // namespace tribode
