#include "tribode/batch/batch_files.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/batch/shard_file.hpp"

#include <charconv>
#include <fmt/format.h>

namespace tribode {

namespace fs = std::filesystem;

namespace {

// The number in front of a name such as 00012.rows; 0 where there is none.
std::size_t shard_in(const std::string& name) {
    std::size_t shard = 0;
    const auto [end, problem] = std::from_chars(name.data(), name.data() + name.size(), shard);
    return problem == std::errc() && end != name.data() + name.size() && *end == '.' ? shard : 0;
}

// Calls use(file, shard) for the files of a folder with this ending.
template <class Use>
void for_each_file(const fs::path& folder, std::string_view ending, Use use) {
    std::error_code problem;
    for (fs::directory_iterator it(folder, problem), end; !problem && it != end; it.increment(problem)) {
        const std::string name = it->path().filename().string();
        if (const std::size_t shard = shard_in(name); shard > 0 && name.ends_with(ending)) use(it->path(), shard);
    }
    if (problem && problem != std::errc::no_such_file_or_directory) {
        throw InputError(fmt::format("{}: cannot be read ({})", folder.string(), problem.message()));
    }
}

// The whole points of a file. Throws InputError where it is no shard of the batch.
ShardState count(const fs::path& file, const Manifest& manifest, std::size_t shard) {
    ShardReader reader(file, manifest, shard);
    const std::size_t wanted = manifest.range(shard).size();
    ShardState state;
    state.done = reader.count();
    state.failed = reader.failed();
    state.seconds = reader.header().seconds;
    state.complete = state.done == wanted;
    return state;
}

// A result that another batch has left is refused; one that was cut off within its header is damaged.
ShardState count_result(const fs::path& file, const Manifest& manifest, std::size_t shard) {
    ShardState state;
    if (read_shard_header(file, manifest, shard)) state = count(file, manifest, shard);
    if (!state.complete) state.damaged = file;
    return state;
}

ShardState count_attempt(const fs::path& file, const Manifest& manifest, std::size_t shard) {
    ShardState state;
    try {
        const auto header = read_shard_header(file, manifest, shard);
        if (!header) return state;
        if (is_at_work(file)) {
            // It grows; its own count is at most a twentieth of a second old.
            state.done = std::min<std::size_t>(header->done, manifest.range(shard).size());
            state.failed = std::min<std::size_t>(header->failed, state.done);
            state.seconds = header->seconds;
            state.active = 1;
            return state;
        }
        state = count(file, manifest, shard);
    } catch (const InputError&) {
        // Another's: nothing of this batch is in it.
    }
    state.complete = false; // before it has its name
    return state;
}

void take(ShardState& shard, const ShardState& file) {
    const std::size_t active = shard.active + file.active;
    const fs::path damaged = shard.damaged.empty() ? file.damaged : shard.damaged;
    if (!shard.complete && (file.complete || file.done > shard.done)) shard = file;
    shard.active = active;
    shard.damaged = damaged;
}

} // namespace

BatchFiles::BatchFiles(fs::path folder, const Manifest& manifest) : folder_(std::move(folder)), manifest_(manifest) {}

const ShardState& BatchFiles::read(const fs::path& file, std::size_t shard) {
    std::error_code problem;
    Known now{fs::file_size(file, problem), fs::last_write_time(file, problem), {}};
    const auto before = known_.find(file);
    if (before != known_.end() && before->second.size == now.size && before->second.time == now.time) {
        return before->second.state;
    }
    now.state = count_result(file, manifest_, shard);
    return known_.insert_or_assign(file, std::move(now)).first->second.state;
}

std::map<std::size_t, ShardState> BatchFiles::look(const RunControl& control) {
    std::map<std::size_t, ShardState> shards;
    const auto is_ours = [&](std::size_t shard) {
        if (control.stop_requested()) throw EndedEarly("interrupted while the files of the batch were read");
        return shard <= manifest_.shards;
    };
    for_each_file(folder_ / "shards", ".rows", [&](const fs::path& file, std::size_t shard) {
        if (is_ours(shard)) take(shards[shard], read(file, shard));
    });
    for_each_file(folder_ / "parts", ".part", [&](const fs::path& file, std::size_t shard) {
        if (is_ours(shard) && !shards[shard].complete) take(shards[shard], count_attempt(file, manifest_, shard));
    });
    return shards;
}

ShardState shard_state(const fs::path& folder, const Manifest& manifest, std::size_t shard) {
    ShardState state;
    const fs::path rows = rows_path(folder, shard);
    std::error_code problem;
    // One that may not be asked for is said when it is read.
    if (fs::exists(rows, problem) || problem) take(state, count_result(rows, manifest, shard));
    if (state.complete) return state;
    for (const auto& part : parts_of(folder, shard)) take(state, count_attempt(part, manifest, shard));
    return state;
}

std::vector<std::size_t> missing_shards(const fs::path& folder, const Manifest& manifest, const RunControl& control) {
    const auto there = BatchFiles(folder, manifest).look(control);
    std::vector<std::size_t> missing;
    for (std::size_t shard = 1; shard <= manifest.shards; ++shard) {
        const auto found = there.find(shard);
        if (found == there.end() || !found->second.complete) missing.push_back(shard);
    }
    return missing;
}

} // namespace tribode
