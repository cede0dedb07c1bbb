#pragma once
#include "base/json.hpp"
#include "base/run_control.hpp"
#include "record/run_folder.hpp"
#include "script/lua_state.hpp"

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// What `tribode run` asks for.
struct ScriptRequest {
    std::filesystem::path script;
    std::filesystem::path folder;               // of the results; empty: results/<script>
    std::map<std::string, std::string> defines; // -D name=value
    bool quick = false;                         // scripts make their work small
    bool keep_plots = false;                    // tb.plot leaves its table beside the image, for a report
    bool allow_all = false;
    ScriptLimits limits;
    std::vector<std::filesystem::path> read_folders; // besides models/ and scripts/
    std::vector<std::filesystem::path> read_files;
    int depth = 0; // of nested runs
};

// What became of a nested run.
struct NestedRun {
    std::filesystem::path folder;
    bool repeated = true; // false: it was complete already
};

// One run of an experiment script: its options, its folder and what goes into the manifest. The functions of the
// module `tribode` (bindings.hpp) work on it.
class ScriptRun {
  public:
    ScriptRun(const ScriptRequest& request, const RunControl& control);

    // Runs the script and writes the manifest, also where the script ends early or fails. Throws what the script does.
    void execute();

    // tb.options: the defaults, with those the user has set by -D in their place. A default is a value or
    // {default=, unit=, help=, choices=}; a value is read as its default's type, a list of numbers from "1,2,3".
    Json options(const Json& defaults);

    // A file a script names: as it stands, in the folder of the run, or where models/ and scripts/ lie.
    std::filesystem::path find_file(const std::string& name) const;

    // Checked reading of a machine description.
    Json machine(const std::string& file, const Json& argument);

    // tb.run: another script in a folder of this run, with no more rights than this one. Options are texts as with -D.
    // Where this run goes on after an interruption, a nested run that was complete is not repeated as long as script,
    // options, the files it read and the version are the same and its results are there. Its results become part of
    // this run's. Throws what ScriptRun and execute throw.
    NestedRun run_nested(const std::string& script, const std::string& folder, const Json& options,
                         std::optional<bool> quick);

    // Notes a file whose contents decide what the run does.
    void note_read(const std::filesystem::path& file);

    // Adds a line to what the manifest says of the work done.
    void note_work(Json entry) { work_.push_back(std::move(entry)); }

    RunFolder& folder() { return folder_; }
    const RunControl& control() const { return control_; }
    bool quick() const { return request_.quick; }
    bool keeps_plots() const { return request_.keep_plots; }

  private:
    void write_manifest(const std::string& outcome);
    bool is_complete(const ScriptRequest& request) const;
    ScriptAccess access() const;

    ScriptRequest request_;
    RunControl control_;
    RunFolder folder_;
    LuaState lua_;
    bool goes_on_; // after an interruption, at an earlier time
    bool options_asked_ = false;
    Json options_ = Json::object();
    Json machines_ = Json::object(); // file -> hash
    Json read_ = Json::object();     // file -> hash of its bytes
    Json work_ = Json::array();
};

} // namespace tribode
