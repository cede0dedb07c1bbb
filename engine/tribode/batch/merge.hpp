#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/batch/manifest.hpp"

#include <string>
#include <vector>

namespace tribode {

// What was kept of the points, over all of them.
struct KeptColumn {
    std::string name;
    std::size_t width = 1; // the longest list; shorter ones are filled up with NaN
    bool list = false;
};

struct MergeSummary {
    std::size_t points = 0, failed = 0;
    std::vector<KeptColumn> columns;   // sorted by name
    std::vector<std::string> left_out; // lists that a table of text has no room for
};

// Calls `use` for every point, in the order of the index, with one point in memory at a time.
// Throws InputError where points are missing (it lists them), a file is damaged or belongs to another batch, or the points
// are not the planned ones, EndedEarly on a stop request.
void for_each_point(const std::filesystem::path& folder, const Manifest& manifest,
                    const std::function<void(const PointRow&)>& use, const RunControl& control = {});

// Writes all points to one file, .h5, .csv or .mat by its name: a row per index, failed ones with NaN and their reason.
// The bytes depend on the points alone, not on shards, workers or attempts.
//
//   HDF5   a vector per parameter and kept number, with its unit; a matrix (points x longest) per kept list; `index`,
//          `failed` (0 or 1); in the group `failures` the index and the reason of each
//   CSV    the same columns; a list becomes name_1, name_2, ..., up to 1000 columns in all; `reason` is the last column
//   MAT    as CSV without the reason; other characters than letters and digits in a name become _; made in memory
MergeSummary merge_batch(const std::filesystem::path& folder, const Manifest& manifest,
                         const std::filesystem::path& output, const RunControl& control = {});

} // namespace tribode
