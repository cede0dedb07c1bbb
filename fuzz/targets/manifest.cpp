#include "target.hpp"
#include "tribode/base/error.hpp"
#include "tribode/batch/merge.hpp"
#include "tribode/batch/shard_file.hpp"
#include "tribode/batch/slurm.hpp"
#include "tribode/batch/status.hpp"
#include "tribode/batch/workers.hpp"
#include "tribode/record/json_file.hpp"

namespace tribode::fuzz {

namespace {

void use(const std::filesystem::path& folder) {
    const Manifest manifest = Manifest::read(folder);
    std::size_t points = 0;
    for (const std::size_t shard : {std::size_t{1}, (manifest.shards + 1) / 2, manifest.shards}) {
        const ShardRange range = manifest.range(shard);
        require(range.first >= 1 && range.last <= manifest.count && range.first <= range.last, "points of the batch");
        points += range.size();
    }
    require(points <= 3 * manifest.count, "no more points than there are");
    require(manifest.range(manifest.shards).last == manifest.count, "the last shard ends with the last point");
    const BatchStatus status = read_status(folder, manifest);
    require(status.done == 0 && !status.json().dump(-1, ' ', false, Json::error_handler_t::replace).empty(), "nothing");
    require(!status.text().empty(), "a line");
    if (manifest.shards <= 1000) {
        const auto missing = missing_shards(folder, manifest);
        require(missing.size() == manifest.shards, "all are missing");
        SlurmOptions options;
        options.program = "/usr/bin/tribode";
        slurm_arrays(folder, manifest, missing, options, 100);
    }
    try {
        merge_batch(folder, manifest, folder / "merged.csv");
        require(false, "a refusal: nothing was run");
    } catch (const InputError&) {
    }
}

} // namespace

// As it stands, and with the identity that belongs to it.
void run_manifest(std::string_view bytes) {
    const auto folder = scratch_folder() / "planned";
    std::filesystem::create_directories(folder);
    const auto file = folder / "manifest.json";
    write_plainly(file, bytes);
    try {
        use(folder);
    } catch (const InputError&) {
    }
    try {
        Json json = parse_json(std::string(bytes), "manifest.json");
        if (!json.is_object()) return;
        json["identity"] = Manifest::from_json(json, "manifest.json").identity();
        write_plainly(file, to_json_text(json));
        use(folder);
    } catch (const InputError&) {
    }
}

} // namespace tribode::fuzz
