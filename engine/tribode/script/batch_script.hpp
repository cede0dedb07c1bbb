#pragma once
#include "tribode/batch/merge.hpp"
#include "tribode/script/script_run.hpp"

#include <filesystem>
#include <optional>

struct lua_State;

namespace tribode {

// tb.batch: hands the batch that its options table describes to the run. [-1, +0]
int describe_batch(lua_State* lua, ScriptRun& run);

// What `tribode batch plan` asks for.
struct BatchPlanRequest {
    ScriptRequest script;
    std::filesystem::path folder; // of the batch
    std::optional<std::size_t> shards;
    double shard_seconds = 120;
};

struct PlannedBatch {
    std::size_t points, shards;
    double seconds_per_point;          // 0: unknown
    std::vector<std::string> warnings; // of the pilot
};

// Reads the script and plans its batch. Throws InputError, OutputError.
PlannedBatch plan_script_batch(const BatchPlanRequest& request, const RunControl& control);

// What `tribode batch run` and `shard` ask for.
struct BatchRunRequest {
    std::filesystem::path folder;               // of the batch
    std::optional<std::size_t> shard;           // only this one
    std::map<std::string, std::string> defines; // as when it was planned; what they name, the script may read
    bool compile = false, confine = false;      // as of ScriptRequest
};

// Runs the missing shards of a planned batch. Goes to the working folder of the plan. Returns false where it was stopped.
//
// The folder may come from a stranger, who has chosen the options in its manifest. So the script may read what they name
// only where that lies in the folder, or is a file whose bytes the plan knew (their hash is in the manifest), or where the
// request has the same option. Throws InputError where they name something else, or anything has changed since the plan;
// OutputError.
bool run_script_batch(const BatchRunRequest& request, const RunControl& control);

// The folder of a batch and the files of its manifest: what merging it reads. Throws InputError.
std::vector<std::filesystem::path> files_of_batch(const std::filesystem::path& folder);

// That check of the options alone. Throws InputError.
void require_defines(const std::filesystem::path& folder, const Manifest& manifest,
                     const std::map<std::string, std::string>& given);

// The batch of a script that is run as a whole: planned in `folder` where nothing is there yet, else gone on with. Returns
// false where it was stopped. Throws as above.
bool run_batch_of(ScriptRun& script, const std::filesystem::path& folder, const RunControl& control);

// Merges a planned batch (merge_batch). Throws InputError also where anything has changed since the plan.
MergeSummary merge_script_batch(const std::filesystem::path& folder, const std::filesystem::path& output,
                                const RunControl& control);

// All points of a complete batch, as tb.read_batch returns them. Throws InputError.
Json merged_batch(const std::filesystem::path& folder);

// Points run beside one another, so each keeps to one thread and shows no progress of its own.
RunControl inside_a_point(const RunControl& control);

} // namespace tribode
