#pragma once
#include <filesystem>
#include <memory>
#include <set>
#include <vector>

namespace tribode {

// Which files a script may touch. Names are relative to the working directory; they are compared after
// symbolic links and `..` are resolved. Anything that opens a file for a script asks here first.
struct ScriptAccess {
    bool allow_all = false;                          // no restriction, and the whole standard library
    std::filesystem::path run_folder;                // read and write; empty: none
    std::vector<std::filesystem::path> read_folders; // models, scripts: read, and searched by `require`
    std::vector<std::filesystem::path> named;        // files and folders named by the user on the command line: read

    // Where present: takes the names of all files outside the run folder that the script was allowed to read.
    std::shared_ptr<std::set<std::filesystem::path>> files_read;

    // Throw InputError where the script may not do so. Whether the file exists is left to the one who opens
    // it.
    void check_read(const std::filesystem::path& name) const;
    void check_write(const std::filesystem::path& name) const;

    // For `require`: what lies beside the script that the user named is part of the program.
    void check_module(const std::filesystem::path& name, const std::filesystem::path& script_folder) const;
};

} // namespace tribode
