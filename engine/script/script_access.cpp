#include "script/script_access.hpp"
#include "base/error.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace tribode {

namespace fs = std::filesystem;

namespace {

// Symbolic links and `..` resolved as the system does; empty where that is impossible.
fs::path resolved(const fs::path& name) {
    if (name.empty()) return {};
    std::error_code problem;
    fs::path path = fs::weakly_canonical(fs::absolute(name), problem);
    if (problem) return {};
    if (!path.has_filename()) path = path.parent_path();
    // A link without a target is left as it is, and writing through it would create the target.
    return fs::is_symlink(fs::symlink_status(path, problem)) ? fs::path() : path;
}

bool lies_in(const fs::path& path, const fs::path& folder) {
    if (path.empty() || folder.empty()) return false;
    const fs::path root = resolved(folder);
    return !root.empty() && std::mismatch(root.begin(), root.end(), path.begin(), path.end()).first == root.end();
}

void refuse_zero_byte(const fs::path& name) {
    // The system would read the name up to this byte only.
    if (name.native().find('\0') != std::string::npos) {
        throw InputError(fmt::format("the file name \"{}\" contains a zero byte", name.c_str()));
    }
}

// A file of the run folder that has another name elsewhere is not the run's alone.
void refuse_hard_link(const fs::path& path, const fs::path& name) {
    std::error_code problem;
    if (!fs::is_regular_file(path, problem) || fs::hard_link_count(path, problem) < 2 || problem) return;
    throw InputError(fmt::format(
        "\"{}\" is a hard link: the file has a second name, maybe outside the run folder; copy it", name.string()));
}

} // namespace

void ScriptAccess::check_read(const fs::path& name) const {
    refuse_zero_byte(name);
    const fs::path path = resolved(name);
    const auto holds_it = [&](const fs::path& folder) { return lies_in(path, folder); };
    const auto note = [&] {
        std::error_code problem;
        if (!files_read || path.empty() || holds_it(run_folder)) return;
        if (!fs::exists(path, problem) || fs::is_directory(path, problem)) return; // whether it is there, is asked, too
        files_read->insert(path);
    };
    if (allow_all) return note();
    if (holds_it(run_folder)) return refuse_hard_link(path, name);
    if (std::any_of(read_folders.begin(), read_folders.end(), holds_it)) return note();
    // A file holds itself alone, a folder all that lies in it. "/" is taken for a text that is no folder.
    const auto names_it = [&](const fs::path& one) { return holds_it(one) && resolved(one).has_relative_path(); };
    if (std::any_of(named.begin(), named.end(), names_it)) return note();
    throw InputError(fmt::format("\"{}\" is outside the run folder; name it with -D, --machine, --data or --input, "
                                 "or use --allow-all",
                                 name.string()));
}

void ScriptAccess::check_write(const fs::path& name) const {
    refuse_zero_byte(name);
    if (allow_all) return;
    if (const fs::path path = resolved(name); lies_in(path, run_folder)) return refuse_hard_link(path, name);
    throw InputError(fmt::format("\"{}\" is outside the run folder{}{}, and a script writes only there; choose the "
                                 "folder with -o, or use --allow-all",
                                 name.string(), run_folder.empty() ? "" : " ", run_folder.string()));
}

void ScriptAccess::check_module(const fs::path& name, const fs::path& script_folder) const {
    if (!lies_in(resolved(name), script_folder)) return check_read(name);
    if (files_read) files_read->insert(resolved(name));
}

} // namespace tribode
