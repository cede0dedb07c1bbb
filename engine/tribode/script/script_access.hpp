#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace tribode {

// What a script has read, by names without links: the hash_of_content of each before it was read first.
using FilesRead = std::map<std::filesystem::path, std::string>;

// SHA-256 of the bytes of a file; of a folder, of the names in it. Empty where nothing can be relied on, as of a pipe.
std::string hash_of_content(const std::filesystem::path& path);

// Which files a script may touch. Names are relative to the working directory; they are compared after
// symbolic links and `..` are resolved. Anything that opens a file for a script asks here first.
struct ScriptAccess {
    bool allow_all = false;                          // no restriction, and the whole standard library
    std::filesystem::path run_folder;                // read and write; empty: none
    std::vector<std::filesystem::path> read_folders; // models, scripts: read, and searched by `require`
    std::vector<std::filesystem::path> named;        // files and folders named by the user on the command line: read

    // Where present: takes all files outside the run folder that the script was allowed to read.
    std::shared_ptr<FilesRead> files_read;

    // Throw InputError where the script may not do so. Whether the file exists is left to the one who opens
    // it.
    void check_read(const std::filesystem::path& name) const;
    void check_write(const std::filesystem::path& name) const;

    // The same, and the number of the open file, for who opens it by the name /proc/self/fd/NUMBER: no other file can take
    // its place behind the check. A file to be written is made where it is missing, if so wanted. -1 with errno: none.
    int open_to_read(const std::filesystem::path& name) const;
    int open_to_write(const std::filesystem::path& name, bool make) const;

    // For `require`: what lies beside the script that the user named is part of the program.
    void check_module(const std::filesystem::path& name, const std::filesystem::path& script_folder) const;

    // Takes a file among those that were read, where it is there and outside the run folder. A folder is read by who lists
    // the names in it.
    void note_read(const std::filesystem::path& name) const;
    void note_listed(const std::filesystem::path& folder) const;

  private:
    // `path` is the name after links were resolved.
    void check_read(const std::filesystem::path& path, const std::filesystem::path& name) const;
    void check_write(const std::filesystem::path& path, const std::filesystem::path& name) const;
    void note(const std::filesystem::path& path) const;
};

} // namespace tribode
