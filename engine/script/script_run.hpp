#pragma once
#include "base/json.hpp"
#include "base/run_control.hpp"
#include "record/run_folder.hpp"
#include "script/lua_state.hpp"

#include <filesystem>
#include <map>
#include <string>

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

    // A file a script names: as it stands, or in the folder in which models/ and scripts/ lie.
    std::filesystem::path find_file(const std::string& name) const;

    // Checked reading of a machine description.
    Json machine(const std::string& file, const Json& argument);

    // Adds a line to what the manifest says of the work done.
    void note_work(Json entry) { work_.push_back(std::move(entry)); }

    RunFolder& folder() { return folder_; }
    const RunControl& control() const { return control_; }
    bool quick() const { return request_.quick; }
    bool keeps_plots() const { return request_.keep_plots; }

  private:
    void write_manifest(const std::string& outcome);
    ScriptAccess access() const;

    ScriptRequest request_;
    RunControl control_;
    RunFolder folder_;
    LuaState lua_;
    bool options_asked_ = false;
    Json options_ = Json::object();
    Json machines_ = Json::object(); // file -> hash
    Json work_ = Json::array();
};

} // namespace tribode
