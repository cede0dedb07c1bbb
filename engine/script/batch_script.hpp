#pragma once
#include "script/script_run.hpp"

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

// Runs the missing shards of a planned batch, all or only one of them; `compile` as of ScriptRequest. Goes to the working
// folder of the plan. Returns false where it was stopped. Throws InputError where anything has changed since the plan,
// OutputError.
bool run_script_batch(const std::filesystem::path& folder, std::optional<std::size_t> shard, bool compile,
                      const RunControl& control);

// The batch of a script that is run as a whole: planned in `folder` where nothing is there yet, else gone on with. Returns
// false where it was stopped. Throws as above.
bool run_batch_of(ScriptRun& script, const std::filesystem::path& folder, const RunControl& control);

// All points of a complete batch, as tb.read_batch returns them. Throws InputError.
Json merged_batch(const std::filesystem::path& folder);

// Points run beside one another, so each keeps to one thread and shows no progress of its own.
RunControl inside_a_point(const RunControl& control);

} // namespace tribode
