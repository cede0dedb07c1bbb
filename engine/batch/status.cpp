#include "batch/status.hpp"
#include "batch/shard_file.hpp"

#include <chrono>
#include <fmt/format.h>

namespace tribode {

namespace fs = std::filesystem;

Json BatchStatus::json() const {
    return {{"name", name},
            {"points", points},
            {"done", done},
            {"failed", failed},
            {"missing", points - done},
            {"shards", {{"total", shards}, {"complete", complete_shards}, {"active", active_shards}}},
            {"seconds_per_point", seconds_per_point},
            {"points_per_second", points_per_second},
            {"seconds_left", seconds_left},
            {"complete", complete()}};
}

static std::string duration_text(double seconds) {
    if (seconds < 100) return fmt::format("{:.0f} s", seconds);
    if (seconds < 6000) return fmt::format("{:.0f} min", seconds / 60);
    return fmt::format("{:.1f} h", seconds / 3600);
}

std::string BatchStatus::text() const {
    std::string line = fmt::format("{}: {} of {} points done, {} failed; {} of {} shards complete, {} at work", name,
                                   done, points, failed, complete_shards, shards, active_shards);
    if (points_per_second > 0) line += fmt::format("; {:.3g} points/s", points_per_second);
    if (seconds_left > 0) line += fmt::format(", {} left", duration_text(seconds_left));
    return line;
}

BatchStatus read_status(const fs::path& folder, const Manifest& manifest) {
    constexpr std::chrono::seconds still_active{30};
    BatchStatus status;
    status.name = manifest.name;
    status.points = manifest.count;
    status.shards = manifest.shards;
    double seconds = 0;
    const auto now = fs::file_time_type::clock::now();
    for (std::size_t shard = 1; shard <= manifest.shards; ++shard) {
        auto header = read_shard_header(rows_path(folder, shard), manifest, shard);
        if (header) {
            ++status.complete_shards;
        } else {
            for (const auto& part : parts_of(folder, shard)) {
                const auto attempt = read_shard_header(part, manifest, shard);
                if (!attempt) continue;
                std::error_code problem;
                const auto written = fs::last_write_time(part, problem);
                if (!problem && now - written < still_active) ++status.active_shards;
                if (!header || attempt->done > header->done) header = attempt;
            }
        }
        if (!header) continue;
        status.done += header->done;
        status.failed += header->failed;
        seconds += header->seconds;
    }
    if (status.done > 0) status.seconds_per_point = seconds / static_cast<double>(status.done);
    if (status.active_shards > 0 && seconds > 0) {
        status.points_per_second = static_cast<double>(status.active_shards) / status.seconds_per_point;
        status.seconds_left = static_cast<double>(status.points - status.done) / status.points_per_second;
    }
    return status;
}

} // namespace tribode
