#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/batch/manifest.hpp"

#include <filesystem>
#include <map>
#include <vector>

namespace tribode {

// How far a shard is: by its complete file, else by the attempt with the most points.
struct ShardState {
    bool complete = false;            // a file with all points, each of them whole
    std::size_t done = 0, failed = 0; // points that are kept, and those of them without a result
    double seconds = 0;               // spent on them
    std::size_t active = 0;           // attempts that a process is at work on
    std::filesystem::path damaged;    // the file that has the name of a complete one and is none; empty: there is none
};

// The files of a batch, read as a merge reads them: what is damaged is not counted. What was read once is read again
// only where the size or the time of the file has changed.
class BatchFiles {
  public:
    BatchFiles(std::filesystem::path folder, const Manifest& manifest);

    // The shards of which there is a file, by number. Costs time for the files there are, not for all shards.
    // Throws InputError where a file in the place of a result belongs to another batch, EndedEarly on a stop request.
    std::map<std::size_t, ShardState> look(const RunControl& control = {});

  private:
    struct Known {
        std::uintmax_t size;
        std::filesystem::file_time_type time;
        ShardState state;
    };
    const ShardState& read(const std::filesystem::path& file, std::size_t shard);

    std::filesystem::path folder_;
    const Manifest& manifest_;
    std::map<std::filesystem::path, Known> known_;
};

// The state of one shard alone; throws as above.
ShardState shard_state(const std::filesystem::path& folder, const Manifest& manifest, std::size_t shard);

// The shards without a complete result, in order. Throws as above.
std::vector<std::size_t> missing_shards(const std::filesystem::path& folder, const Manifest& manifest,
                                        const RunControl& control = {});

} // namespace tribode
