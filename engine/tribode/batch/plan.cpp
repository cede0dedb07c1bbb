#include "tribode/batch/plan.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/batch/shard_file.hpp"
#include "tribode/batch/workers.hpp"
#include "tribode/record/output_file.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fmt/format.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

namespace tribode {

namespace fs = std::filesystem;

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

// What `work` returns, from a copy of this process; empty where it died or took longer than `patience` [s].
std::string in_a_copy(const std::function<std::string()>& work, double patience) {
    int ends[2];
    if (::pipe(ends) != 0) throw Error(fmt::format("no pipe can be made ({})", std::strerror(errno)));
    std::fflush(nullptr);
    const pid_t process = ::fork();
    if (process < 0) throw Error(fmt::format("no process can be made ({})", std::strerror(errno)));
    if (process == 0) {
        ::close(ends[0]);
        std::string answer;
        try {
            answer = work();
        } catch (const std::exception&) {
            // An empty answer says enough.
        }
        std::fflush(nullptr);
        for (std::string_view rest = answer; !rest.empty();) {
            const ssize_t written = ::write(ends[1], rest.data(), rest.size());
            if (written < 0) break;
            rest.remove_prefix(static_cast<std::size_t>(written));
        }
        ::_exit(0);
    }
    ::close(ends[1]);
    std::string answer;
    const auto begin = Clock::now();
    for (;;) {
        const double left = patience - seconds_since(begin);
        pollfd wait{ends[0], POLLIN, 0};
        const int ready = left > 0 ? ::poll(&wait, 1, static_cast<int>(left * 1000) + 1) : 0;
        if (ready < 0 && errno == EINTR) continue;
        char bytes[4096];
        const ssize_t got = ready > 0 ? ::read(ends[0], bytes, sizeof bytes) : -1;
        if (got > 0) {
            answer.append(bytes, static_cast<std::size_t>(got));
            continue;
        }
        if (got < 0) answer.clear();
        break;
    }
    ::close(ends[0]);
    ::kill(process, SIGKILL);
    ::waitpid(process, nullptr, 0);
    return answer;
}

void require_names(const std::vector<std::string>& names) {
    for (const auto& name : names) {
        if (!is_column_name(name)) {
            throw InputError(fmt::format("the points have a field \"{}\"; index, failed and reason are taken, and "
                                         "a comma, a quote, a slash or a line break has no place in a name",
                                         name));
        }
    }
}

} // namespace

Pilot run_pilot(const Batch& batch) {
    constexpr double enough = 0.5, patience = 10; // [s]
    constexpr std::size_t most = 200;
    constexpr double golden = 0.6180339887498949; // spreads the points over the batch

    const std::string answer = in_a_copy(
        [&] {
            Json json{{"points", 0}, {"failed", 0}, {"failure", ""}};
            const auto begin = Clock::now();
            std::size_t done = 0, failed = 0, index = 1;
            for (; done < std::min(most, batch.count); ++done) {
                if (seconds_since(begin) > enough) break;
                const double place = std::fmod(static_cast<double>(done) * golden, 1.0);
                index = 1 + static_cast<std::size_t>(place * static_cast<double>(batch.count));
                const PointRow row = batch.run(index);
                json["last"] = sha256(to_bytes(row));
                if (!row.failure.empty() && failed++ == 0) json["failure"] = row.failure;
            }
            json["index"] = index;
            json["points"] = done;
            json["failed"] = failed;
            json["seconds"] = seconds_since(begin);
            json["files"] = batch.files_read();
            return json.dump(-1, ' ', false, Json::error_handler_t::replace);
        },
        patience);
    Pilot pilot;
    if (answer.empty()) {
        pilot.files = batch.files_read();
        return pilot;
    }
    const Json json = Json::parse(answer);
    pilot.points = json.at("points").get<std::size_t>();
    pilot.seconds_per_point = json.at("seconds").get<double>() / static_cast<double>(pilot.points);
    pilot.failed = json.at("failed").get<std::size_t>();
    pilot.failure = json.at("failure").get<std::string>();
    pilot.files = json.at("files").get<std::vector<std::string>>();
    if (pilot.points > 1) {
        const std::string again =
            in_a_copy([&] { return sha256(to_bytes(batch.run(json.at("index").get<std::size_t>()))); }, patience);
        pilot.repeatable = again.empty() || again == json.at("last").get<std::string>();
    }
    return pilot;
}

std::size_t shard_count(std::size_t points, double seconds_per_point, const PlanOptions& options) {
    constexpr double shortest = 0.5; // [s]; a shard costs a few milliseconds of its own
    constexpr double fine = 64;
    const std::size_t highest = std::min(points, Manifest::max_shards);
    const auto most = static_cast<double>(highest);
    if (options.shards) return std::clamp<std::size_t>(*options.shards, 1, highest);
    if (seconds_per_point <= 0) return std::min<std::size_t>(points, 1000); // long ones
    const double total = static_cast<double>(points) * seconds_per_point;
    const double wanted = std::max(total / options.shard_seconds, std::min(fine, total / shortest));
    return static_cast<std::size_t>(
        std::clamp(std::ceil(wanted), 1.0, std::min(most, static_cast<double>(Manifest::max_shards))));
}

Manifest plan_batch(const fs::path& folder, const Batch& batch, const PlanOptions& options, Manifest m,
                    const std::function<SourceFile(const std::string&)>& source) {
    require_names(batch.parameters);
    std::error_code problem;
    fs::create_directories(folder, problem);
    if (problem) throw OutputError(fmt::format("{}: cannot be made ({})", folder.string(), problem.message()));
    const FolderLock lock(folder);
    if (fs::exists(folder / "manifest.json")) {
        throw InputError(
            fmt::format("{}: holds a planned batch already; tribode batch resume goes on with it, or choose "
                        "another folder",
                        folder.string()));
    }

    Sha256 points;
    OutputFile file(folder / "points.csv");
    std::string text = points_header(batch.parameters);
    for (std::size_t index = 1; index <= batch.count; ++index) {
        append_point_line(text, index, batch.point(index));
        if (text.size() < (1 << 16) && index < batch.count) continue;
        points.add(text);
        file.write(text);
        text.clear();
    }
    file.commit();

    const Pilot pilot = run_pilot(batch);
    m.version = version();
    m.name = batch.name;
    m.seed = batch.seed;
    m.count = batch.count;
    m.parameters = batch.parameters;
    m.units = batch.units;
    for (const auto& name : pilot.files) m.files.push_back(source(name));
    m.points_sha256 = points.hex();
    m.shards = shard_count(batch.count, pilot.seconds_per_point, options);
    m.pilot = {{"points", pilot.points},
               {"seconds_per_point", pilot.seconds_per_point},
               {"failed", pilot.failed},
               {"failure", pilot.failure},
               {"repeatable", pilot.repeatable}};
    m.write(folder);
    return m;
}

} // namespace tribode
