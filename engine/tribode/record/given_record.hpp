#pragma once
#include "tribode/base/json.hpp"
#include "tribode/record/record_file.hpp"
#include "tribode/record/table.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace tribode {

// A record as the command line, Lua or Python gives it: a file, or the columns themselves.
struct GivenRecord {
    std::filesystem::path file; // empty: the table
    Table table;                // its source begins messages

    std::string name() const { return file.empty() ? table.source : file.string(); }

    // Of a file the columns that read_record() finds. A table is complete, but for t, which then begins at 0.
    Table read(const RecordOptions& options, const std::vector<std::string>& wanted, double sample_time) const&;
    // The same without a copy: the table is taken out.
    Table read(const RecordOptions& options, const std::vector<std::string>& wanted, double sample_time) &&;

    // SHA-256 of the file, or of the names and values of the columns.
    std::string hash() const;

    // {"file", "sha256"}, for a manifest.
    Json json() const { return {{"file", name()}, {"sha256", hash()}}; }
};

// Throws InputError where the positions of two records are the same, sample by sample: it is one record given twice. Taken for a
// repetition, it would show no noise.
void refuse_repeated_record(const std::string& name, const std::vector<double>& position,
                            const std::string& earlier_name, const std::vector<double>& earlier_position);

} // namespace tribode
