#include "tribode/batch/status.hpp"

#include <fmt/format.h>

namespace tribode {

namespace fs = std::filesystem;

Json BatchStatus::json() const {
    return {
        {"name", name},
        {"points", points},
        {"done", done},
        {"failed", failed},
        {"missing", points - done},
        {"shards",
         {{"total", shards}, {"complete", complete_shards}, {"active", active_shards}, {"damaged", damaged.size()}}},
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
    if (!damaged.empty()) {
        line += fmt::format("; {} is damaged{}, tribode batch resume runs again what it has lost", damaged[0].string(),
                            damaged.size() > 1 ? fmt::format(", and {} more", damaged.size() - 1) : "");
    }
    if (points_per_second > 0) line += fmt::format("; {:.3g} points/s", points_per_second);
    if (seconds_left > 0) line += fmt::format(", {} left", duration_text(seconds_left));
    return line;
}

BatchStatus read_status(BatchFiles& files, const Manifest& manifest, const RunControl& control) {
    BatchStatus status;
    status.name = manifest.name;
    status.points = manifest.count;
    status.shards = manifest.shards;
    double seconds = 0;
    for (const auto& [number, shard] : files.look(control)) {
        status.complete_shards += shard.complete;
        status.active_shards += shard.active;
        status.done += shard.done;
        status.failed += shard.failed;
        seconds += shard.seconds;
        if (!shard.complete && !shard.damaged.empty()) status.damaged.push_back(shard.damaged);
    }
    if (status.done > 0) status.seconds_per_point = seconds / static_cast<double>(status.done);
    if (status.active_shards > 0 && seconds > 0) {
        status.points_per_second = static_cast<double>(status.active_shards) / status.seconds_per_point;
        status.seconds_left = static_cast<double>(status.points - status.done) / status.points_per_second;
    }
    return status;
}

BatchStatus read_status(const fs::path& folder, const Manifest& manifest, const RunControl& control) {
    BatchFiles files(folder, manifest);
    return read_status(files, manifest, control);
}

} // namespace tribode
