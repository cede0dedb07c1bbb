#include "tribode/script/script_access.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/openat2.h>
#include <sys/syscall.h>
#include <unistd.h>

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

// Opens what the path names, following no link anywhere in it.
int open_without_links(const fs::path& path, int flags) {
    constexpr std::uint64_t read_and_write_as_umask_allows = 0666;
    open_how how{};
    how.flags = static_cast<std::uint64_t>(flags | O_CLOEXEC);
    how.mode = flags & O_CREAT ? read_and_write_as_umask_allows : 0;
    how.resolve = RESOLVE_NO_SYMLINKS;
    long file = ::syscall(SYS_openat2, AT_FDCWD, path.c_str(), &how, sizeof how);
    // Before Linux 5.6 only the last part of the path is looked at.
    if (file < 0 && errno == ENOSYS) file = ::open(path.c_str(), flags | O_NOFOLLOW | O_CLOEXEC, how.mode);
    return static_cast<int>(file);
}

} // namespace

void ScriptAccess::check_read(const fs::path& name) const { check_read(resolved(name), name); }

void ScriptAccess::check_write(const fs::path& name) const { check_write(resolved(name), name); }

int ScriptAccess::open_to_read(const fs::path& name) const {
    const fs::path path = resolved(name);
    check_read(path, name);
    return open_without_links(path, O_PATH);
}

int ScriptAccess::open_to_write(const fs::path& name, bool make) const {
    const fs::path path = resolved(name);
    check_write(path, name);
    return open_without_links(path, make ? O_WRONLY | O_CREAT : O_PATH);
}

void ScriptAccess::check_read(const fs::path& path, const fs::path& name) const {
    refuse_zero_byte(name);
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

void ScriptAccess::check_write(const fs::path& path, const fs::path& name) const {
    refuse_zero_byte(name);
    if (allow_all) return;
    if (lies_in(path, run_folder)) return refuse_hard_link(path, name);
    throw InputError(fmt::format("\"{}\" is outside the run folder{}{}, and a script writes only there; choose the "
                                 "folder with -o, or use --allow-all",
                                 name.string(), run_folder.empty() ? "" : " ", run_folder.string()));
}

void ScriptAccess::check_module(const fs::path& name, const fs::path& script_folder) const {
    if (!lies_in(resolved(name), script_folder)) return check_read(name);
    if (files_read) files_read->insert(resolved(name));
}

} // namespace tribode
