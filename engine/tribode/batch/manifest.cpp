#include "tribode/batch/manifest.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/output_file.hpp"

#include <algorithm>
#include <chrono>
#include <ctime>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <set>

namespace tribode {

namespace fs = std::filesystem;

namespace {

constexpr const char* file_name = "manifest.json";

// What a result depends on.
Json content(const Manifest& m) {
    Json json{{"schema", Manifest::schema}, {"version", m.version},       {"name", m.name},   {"seed", m.seed},
              {"points", m.count},          {"parameters", m.parameters}, {"units", m.units}, {"files", Json::array()}};
    for (const auto& file : m.files) json["files"].push_back({{"file", file.name}, {"sha256", file.sha256}});
    json["defines"] = m.defines;
    json["quick"] = m.quick;
    json["points_sha256"] = m.points_sha256;
    return json;
}

} // namespace

std::string Manifest::identity() const { return sha256(content(*this).dump()); }

ShardRange Manifest::range(std::size_t shard) const {
    // count k / shards, without a product that could overflow.
    const auto end = [this](std::size_t k) { return count / shards * k + count % shards * k / shards; };
    return {end(shard - 1) + 1, end(shard)};
}

void Manifest::write(const fs::path& folder) const {
    Json json = content(*this);
    json["shards"] = shards;
    json["working_folder"] = working_folder;
    json["pilot"] = pilot;
    json["identity"] = identity();
    json["date"] = fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::time(nullptr)));
    write_json(folder / file_name, json);
}

Manifest Manifest::read(const fs::path& folder) {
    const fs::path path = folder / file_name;
    if (!fs::exists(path)) {
        throw InputError(fmt::format("{}: holds no planned batch (there is no {}); tribode batch plan makes one",
                                     folder.string(), file_name));
    }
    const Json json = read_json(path);
    Manifest m = from_json(json, path.string());
    if (json.value("identity", Json()) != m.identity()) {
        throw InputError(fmt::format("{}: was changed after the batch was planned by version {} (its content does "
                                     "not fit its identity); plan the batch anew in another folder",
                                     path.string(), m.version));
    }
    return m;
}

Manifest Manifest::from_json(const Json& json, const std::string& where) {
    Manifest m;
    try {
        const int found = json.at("schema").get<int>();
        if (found != schema) {
            throw InputError(fmt::format("{}: is of schema {}, this program (version {}) knows schema {}: use the "
                                         "version that planned it",
                                         where, found, tribode::version(), schema));
        }
        m.version = json.at("version").get<std::string>();
        m.name = json.at("name").get<std::string>();
        m.seed = json.at("seed").get<std::uint64_t>();
        m.count = json.at("points").get<std::size_t>();
        m.shards = json.at("shards").get<std::size_t>();
        m.parameters = json.at("parameters").get<std::vector<std::string>>();
        m.units = json.at("units").get<std::map<std::string, std::string>>();
        for (const auto& file : json.at("files")) {
            m.files.push_back({file.at("file").get<std::string>(), file.at("sha256").get<std::string>()});
        }
        m.defines = json.at("defines").get<std::map<std::string, std::string>>();
        m.quick = json.at("quick").get<bool>();
        m.working_folder = json.at("working_folder").get<std::string>();
        m.points_sha256 = json.at("points_sha256").get<std::string>();
        m.pilot = json.at("pilot");
        const std::set<std::string> names(m.parameters.begin(), m.parameters.end());
        const bool named =
            names.size() == m.parameters.size() && std::all_of(names.begin(), names.end(), is_column_name);
        if (m.files.empty() || m.count == 0 || m.shards == 0 || m.shards > m.count || !named) {
            throw InputError(fmt::format("{}: is not the manifest of a batch", where));
        }
        if (m.count > max_points || m.shards > max_shards) {
            throw InputError(fmt::format("{}: has {} points in {} shards, must be at most {} points in {} shards",
                                         where, m.count, m.shards, max_points, max_shards));
        }
    } catch (const Json::exception& problem) {
        throw InputError(fmt::format("{}: is not the manifest of a batch ({})", where, problem.what()));
    }
    return m;
}

void Manifest::require_unchanged(const fs::path& folder,
                                 const std::function<fs::path(const std::string&)>& path_of) const {
    if (version != tribode::version()) {
        throw InputError(fmt::format("{}: was planned by version {} of the program, this is {}; use that version, or "
                                     "plan the batch anew in another folder",
                                     (folder / file_name).string(), version, tribode::version()));
    }
    for (const auto& file : files) {
        const fs::path place = path_of(file.name);
        // The folder may come from a stranger, and a device has no end.
        if (fs::exists(place) && !fs::is_regular_file(place)) {
            throw InputError(fmt::format("{}: is among the files that the batch in {} was planned from, and is none",
                                         file.name, folder.string()));
        }
        if (sha256(read_file(place)) == file.sha256) continue;
        throw InputError(fmt::format("{}: has changed since the batch in {} was planned; restore it, or plan the batch "
                                     "anew in another folder",
                                     file.name, folder.string()));
    }
}

std::string points_header(const std::vector<std::string>& parameters) {
    std::string text = "index";
    for (const auto& name : parameters) text += "," + name;
    return text + "\n";
}

void append_point_line(std::string& text, std::size_t index, const std::vector<double>& parameters) {
    text += std::to_string(index);
    for (const double value : parameters) {
        text += ',';
        append_text(text, value);
    }
    text += '\n';
}

} // namespace tribode
