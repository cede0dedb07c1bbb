#pragma once
#include "tribode/batch/batch_files.hpp"

namespace tribode {

// How far a batch is, from its files alone: the same for local workers and for those of a cluster.
struct BatchStatus {
    std::string name;
    std::size_t points = 0, done = 0, failed = 0;
    std::size_t shards = 0, complete_shards = 0;
    std::size_t active_shards = 0;              // attempts that a process is at work on
    std::vector<std::filesystem::path> damaged; // files that have the name of a complete shard and are none
    double seconds_per_point = 0;               // on average of the points done, on one worker [s]; 0: unknown
    double points_per_second = 0;               // of all that is active
    double seconds_left = 0;                    // 0: unknown, or nothing is active

    bool complete() const { return complete_shards == shards; }
    Json json() const;
    std::string text() const;
};

// Throws InputError where a result belongs to another batch, EndedEarly on a stop request.
BatchStatus read_status(BatchFiles& files, const Manifest& manifest, const RunControl& control = {});
BatchStatus read_status(const std::filesystem::path& folder, const Manifest& manifest, const RunControl& control = {});

} // namespace tribode
