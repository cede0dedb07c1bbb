#pragma once
#include "tribode/batch/batch.hpp"

#include "tribode/base/json.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace tribode {

// A file that a batch was planned from. The name is relative to the working folder of the plan where it lies there.
struct SourceFile {
    std::string name, sha256;
};

// The points first..last of a shard, both included, from 1.
struct ShardRange {
    std::size_t first = 1, last = 0;
    std::size_t size() const { return last + 1 - first; }
};

// What a planned batch is: `manifest.json` in the folder of the batch. Everything that a result depends on goes into its
// identity, which every result file carries; the number of shards and the pilot do not.
struct Manifest {
    static constexpr int schema = 1; // of the folder and its files
    // The index of a point is a double in the results, and each shard is a file.
    static constexpr std::size_t max_points = std::size_t{1} << 53, max_shards = 1'000'000;

    std::string version; // of the program that planned it
    std::string name;
    std::uint64_t seed = 0;
    std::size_t count = 0;
    std::size_t shards = 0;
    std::vector<std::string> parameters;
    std::map<std::string, std::string> units;
    std::vector<SourceFile> files; // the script, then what it has read
    std::map<std::string, std::string> defines;
    bool quick = false;
    std::string working_folder; // relative to the folder of the batch
    std::string points_sha256;  // of points.csv
    Json pilot;                 // what the timed points said

    std::string identity() const;              // SHA-256
    ShardRange range(std::size_t shard) const; // shard from 1

    // Written last when a batch is planned: a folder without it is no batch.
    void write(const std::filesystem::path& folder) const;
    // Throws InputError: no batch, another schema, changed by hand.
    static Manifest read(const std::filesystem::path& folder);
    // The fields of the file, whatever it says of its identity. `where` begins the messages. Throws InputError.
    static Manifest from_json(const Json& json, const std::string& where);
    // Throws InputError where another version of the program planned the batch, or a file has changed since.
    // `path_of` turns the name of a file into its place.
    void require_unchanged(const std::filesystem::path& folder,
                           const std::function<std::filesystem::path(const std::string&)>& path_of) const;
};

// A point as a line of points.csv: index and parameters.
std::string points_header(const std::vector<std::string>& parameters);
void append_point_line(std::string& text, std::size_t index, const std::vector<double>& parameters);

} // namespace tribode
