#include "target.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/batch/merge.hpp"
#include "tribode/batch/shard_file.hpp"
#include "tribode/script/batch_script.hpp"

#include <cstring>
#include <filesystem>

namespace tribode::fuzz {

namespace {

constexpr std::size_t head = 2 * sizeof(std::uint64_t);

Manifest small_batch() {
    Manifest m;
    m.version = version();
    m.name = "small";
    m.count = 4;
    m.shards = 1;
    m.parameters = {"a", "b"};
    m.units = {{"a", "m"}};
    m.files = {{"s.lua", ""}};
    m.working_folder = "..";
    m.pilot = Json::object();
    return m;
}

ShardHeader header_of(const Manifest& manifest) {
    ShardHeader header{};
    std::memcpy(header.magic, ShardHeader::magic_text, sizeof header.magic);
    std::memcpy(header.identity, manifest.identity().data(), sizeof header.identity);
    header.shard = header.first = 1;
    header.last = header.done = manifest.count;
    return header;
}

// The records with the checksums that belong to them, so that what is inside is read.
std::string signed_records(std::string_view bytes) {
    std::string records(bytes);
    for (std::size_t at = 0; at + head <= records.size();) {
        std::uint64_t length = 0;
        std::memcpy(&length, records.data() + at, sizeof length);
        length = std::min<std::uint64_t>(length, records.size() - at - head);
        const std::uint64_t checksum = record_checksum(std::string_view(records).substr(at + head, length));
        std::memcpy(records.data() + at, &length, sizeof length);
        std::memcpy(records.data() + at + sizeof length, &checksum, sizeof checksum);
        at += head + length;
    }
    return records;
}

std::string bytes_of(const ShardHeader& header) { return {reinterpret_cast<const char*>(&header), sizeof header}; }

// Of the points as they stand in the file: else nothing but the planned ones would be merged.
std::string hash_of_points(const std::filesystem::path& folder, const Manifest& manifest) {
    std::string text = points_header(manifest.parameters);
    for_each_point(folder, manifest, [&](const PointRow& row) {
        require(row.parameters.size() == manifest.parameters.size(), "a number per parameter");
        append_point_line(text, row.index, row.parameters);
    });
    return sha256(text);
}

} // namespace

// The first byte says what the others are: records without checksums (0), a whole file (odd), and what to merge to.
void run_shard(std::string_view bytes) {
    if (bytes.empty()) return;
    const int choice = static_cast<unsigned char>(bytes[0]);
    bytes.remove_prefix(1);
    const auto folder = scratch_folder() / "batch";
    const auto rows = rows_path(folder, 1);
    std::filesystem::create_directories(rows.parent_path());
    Manifest manifest = small_batch();
    try {
        if (choice & 1) {
            write_plainly(rows, bytes);
            hash_of_points(folder, manifest);
            return;
        }
        const std::string records = signed_records(bytes);
        write_plainly(rows, bytes_of(header_of(manifest)) + records);
        manifest.points_sha256 = hash_of_points(folder, manifest);
        write_plainly(rows, bytes_of(header_of(manifest)) + records);
        const char* const endings[] = {".csv", ".mat", ".h5"};
        const auto merged = folder / (std::string("merged") + endings[choice / 2 % 3]);
        const MergeSummary summary = merge_batch(folder, manifest, merged);
        require(summary.points == manifest.count && std::filesystem::exists(merged), "a merged file of all points");
        std::filesystem::remove(merged);
        manifest.write(folder);
        const Json read = merged_batch(folder);
        require(read.at("index").size() == manifest.count, "all points");
        for (const auto& [name, column] : read.at("results").items()) {
            require(column.size() == manifest.count, "a value per point");
        }
    } catch (const InputError&) {
    }
}

} // namespace tribode::fuzz
