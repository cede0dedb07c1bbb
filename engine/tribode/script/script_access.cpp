#include "tribode/script/script_access.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <fstream>
#include <linux/openat2.h>
#include <set>
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

std::string hash_of_names(const fs::path& folder) {
    std::error_code problem;
    std::set<std::string> names;
    for (fs::directory_iterator entry(folder, problem), end; !problem && entry != end; entry.increment(problem)) {
        names.insert(entry->path().filename());
    }
    return problem ? "" : sha256(fmt::format("{}", fmt::join(names, "/")));
}

} // namespace

std::string hash_of_content(const fs::path& path) {
    std::error_code problem;
    if (fs::is_directory(path, problem)) return hash_of_names(path);
    if (!fs::is_regular_file(path, problem)) return "";
    std::ifstream stream(path, std::ios::binary);
    if (!stream) return "";
    Sha256 hash;
    // In parts: a script may read a file line by line that no memory holds.
    for (std::string part(1 << 16, '\0'); stream;) {
        stream.read(part.data(), static_cast<std::streamsize>(part.size()));
        hash.add(std::string_view(part).substr(0, static_cast<std::size_t>(stream.gcount())));
    }
    return stream.eof() ? hash.hex() : "";
}

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
    if (allow_all) return note_read(path);
    if (holds_it(run_folder)) return refuse_hard_link(path, name);
    if (std::any_of(read_folders.begin(), read_folders.end(), holds_it)) return note_read(path);
    // A file holds itself alone, a folder all that lies in it. "/" is taken for a text that is no folder.
    const auto names_it = [&](const fs::path& one) { return holds_it(one) && resolved(one).has_relative_path(); };
    if (std::any_of(named.begin(), named.end(), names_it)) return note_read(path);
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
    note_read(name);
}

void ScriptAccess::note_read(const fs::path& name) const {
    std::error_code problem;
    if (!fs::is_directory(name, problem)) note(resolved(name)); // of folders is asked only whether they are there
}

void ScriptAccess::note_listed(const fs::path& folder) const { note(resolved(folder)); }

void ScriptAccess::note(const fs::path& path) const {
    std::error_code problem;
    if (!files_read || path.empty() || lies_in(path, run_folder) || files_read->contains(path)) return;
    if (fs::exists(path, problem)) files_read->emplace(path, hash_of_content(path));
}

} // namespace tribode
