#include "tribode/record/run_folder.hpp"
#include "tribode/base/commit.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/output_file.hpp"

#include <algorithm>
#include <ctime>
#include <fmt/chrono.h>
#include <fmt/format.h>

namespace tribode {

namespace fs = std::filesystem;

namespace {

constexpr std::string_view manifest_name = "manifest.json";

bool lies_inside(const fs::path& path, const fs::path& folder) {
    return std::mismatch(folder.begin(), folder.end(), path.begin(), path.end()).first == folder.end();
}

} // namespace

RunFolder::RunFolder(fs::path folder) : folder_(std::move(folder)) {
    std::error_code problem;
    fs::create_directories(folder_, problem);
    if (problem || !fs::is_directory(folder_)) {
        throw OutputError(fmt::format("{}: the folder cannot be made ({})", folder_.string(),
                                      problem ? problem.message() : "a file has this name"));
    }
}

fs::path path_inside(const fs::path& folder, std::string_view name) {
    const auto refuse = [&](std::string_view problem) {
        throw InputError(fmt::format("\"{}\" {}, must name a file inside the run folder {}",
                                     name.substr(0, name.find('\0')), problem, folder.string()));
    };
    // The system would read the name up to this byte only.
    if (name.find('\0') != std::string_view::npos) refuse("goes on behind a zero byte");
    const fs::path normal = fs::path(name).lexically_normal();
    if (normal.is_absolute()) refuse("is an absolute path");
    if (!normal.has_filename() || normal == "." || normal == "..") refuse("is not a file name");
    if (*normal.begin() == "..") refuse("leads out of it");

    std::error_code problem;
    fs::path full = folder / normal;
    const fs::path root = folder.empty() ? fs::path(".") : folder;
    const fs::path resolved = fs::weakly_canonical(root / normal, problem);
    // A link without a target is left as it is, and writing through it would make the target.
    const bool leads_out = problem || !lies_inside(resolved, fs::weakly_canonical(root)) ||
                           fs::is_symlink(fs::symlink_status(resolved, problem));
    if (leads_out) refuse("leads out of it through a link");
    return full;
}

fs::path RunFolder::path(std::string_view name) const { return path_inside(folder_, name); }

void RunFolder::note(std::string_view name, std::string_view bytes) {
    std::string hash = sha256(bytes);
    const std::lock_guard lock(mutex_);
    files_[fs::path(name).lexically_normal().generic_string()] = std::move(hash);
}

void RunFolder::write(std::string_view name, std::string_view bytes) {
    const fs::path full = path(name);
    if (full == folder_ / manifest_name) {
        throw InputError(fmt::format("\"{}\" is written by the run itself, another name must be taken", name));
    }
    write_file(full, bytes);
    note(name, bytes);
}

void RunFolder::write_json(std::string_view name, const Json& value) { write(name, to_json_text(value)); }

void RunFolder::add(std::string_view name) { note(name, read_file(path(name))); }

std::map<std::string, std::string> RunFolder::files() const {
    const std::lock_guard lock(mutex_);
    return files_;
}

void RunFolder::write_manifest(Json fields) const {
    fields["version"] = version();
    if (!commit().empty()) fields["commit"] = commit();
    fields["date"] = fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::time(nullptr)));
    fields["files"] = files();
    tribode::write_json(path(manifest_name), fields);
}

} // namespace tribode
