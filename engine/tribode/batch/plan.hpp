#pragma once
#include "tribode/batch/manifest.hpp"

#include <functional>
#include <optional>

namespace tribode {

struct PlanOptions {
    std::optional<std::size_t> shards; // default: by the pilot
    double shard_seconds = 120;        // of the longest shards [s]
};

// Some points, run in a process of their own before the batch is planned.
struct Pilot {
    std::size_t points = 0;
    double seconds_per_point = 0; // 0: not even one ended in time
    std::size_t failed = 0;
    std::string failure;            // the first
    bool repeatable = true;         // a point gave the same when it was the first of its process
    std::vector<std::string> files; // read for the points
};

// Takes about half a second, and no more than ten.
Pilot run_pilot(const Batch& batch);

// How many shards: as many as keep each below options.shard_seconds, or up to 64 shorter ones of half a second and more,
// so that a few workers end together.
std::size_t shard_count(std::size_t points, double seconds_per_point, const PlanOptions& options);

// Writes points.csv and, last, the manifest. `draft` has what the batch itself does not know: defines, quick, working
// folder. `source` turns a file that was read into its entry of the manifest; the script's comes first.
// Throws InputError where the folder holds a batch already or a point cannot be made; OutputError.
Manifest plan_batch(const std::filesystem::path& folder, const Batch& batch, const PlanOptions& options, Manifest draft,
                    const std::function<SourceFile(const std::string&)>& source);

} // namespace tribode
