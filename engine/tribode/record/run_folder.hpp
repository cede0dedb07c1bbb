#pragma once
#include "tribode/base/json.hpp"

#include <filesystem>
#include <map>
#include <mutex>
#include <string>
#include <string_view>

namespace tribode {

// The full path of a name inside a folder. Throws InputError where it would lie outside: an absolute path, `..`, a zero
// byte, or a symbolic link that leads out or nowhere. Whatever is written or read by a name that a script, a file or a
// table gives goes through here.
std::filesystem::path path_inside(const std::filesystem::path& folder, std::string_view name);

// The folder that a run writes to and the list of what it has written. Names are paths inside the folder. The
// functions may be called from any thread.
class RunFolder {
  public:
    // Makes the folder and its parents. Throws OutputError where that is not possible.
    explicit RunFolder(std::filesystem::path folder);

    const std::filesystem::path& folder() const { return folder_; }

    // path_inside this folder.
    std::filesystem::path path(std::string_view name) const;

    // Writes through write_file and notes the hash; a name written twice holds the last bytes. The manifest's name is
    // refused. Example: run.write("response.csv", to_csv(table)).
    void write(std::string_view name, std::string_view bytes);
    void write_json(std::string_view name, const Json& value);

    // Notes a file that was written by other means, e.g. by draw_plot.
    void add(std::string_view name);

    // name -> SHA-256 of the bytes, sorted by name.
    std::map<std::string, std::string> files() const;

    // Writes manifest.json: the fields, then `version`, `date` (UTC, the only date in the folder) and `files`.
    void write_manifest(Json fields) const;

  private:
    void note(std::string_view name, std::string_view bytes);

    std::filesystem::path folder_;
    mutable std::mutex mutex_;
    std::map<std::string, std::string> files_;
};

} // namespace tribode
