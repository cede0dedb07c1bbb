#pragma once
#include "tribode/base/json.hpp"
#include "tribode/base/run_control.hpp"
#include "tribode/batch/batch.hpp"
#include "tribode/fmu_import/imported_unit.hpp"
#include "tribode/record/run_folder.hpp"
#include "tribode/script/lua_state.hpp"

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace tribode {

// What `tribode run` asks for.
struct ScriptRequest {
    std::filesystem::path script;
    std::optional<std::string> text;            // the program itself, where it lies in no file; script is then its name
    std::filesystem::path folder;               // of the results; empty: results/<script>
    std::map<std::string, std::string> defines; // -D name=value
    bool quick = false;                         // scripts make their work small
    bool keep_plots = false;                    // tb.plot leaves its table beside the image, for a report
    bool allow_all = false;
    bool compile = false;    // equations of systems through the system's C compiler
    bool confine = false;    // the process, for good: what the script may not do, the kernel refuses, too
    bool beside = true;      // the engine's readers open data files that lie beside the script
    bool only_batch = false; // it is read for the batch it describes: no manifest, no log of work, no checkpoints
    ScriptLimits limits;
    std::vector<std::filesystem::path> read_folders; // besides models/ and scripts/
    std::vector<std::filesystem::path> named;        // files and folders the user gave: the script may read them
    // Functional mock-up units whose machine code may run, unpacked.
    std::vector<std::shared_ptr<const UnitFile>> units;
    int depth = 0; // of nested runs
};

// What became of a nested run.
struct NestedRun {
    std::filesystem::path folder;
    bool repeated = true; // false: it was complete already
};

// What tb.batch was given: the points, and what is done with them once all are there.
struct ScriptBatch {
    Batch batch;
    std::function<void(const Json& merged)> finish; // empty: nothing
};

// One run of an experiment script: its options, its folder and what goes into the manifest. The functions of the
// module `tribode` (bindings.hpp) work on it.
class ScriptRun {
  public:
    ScriptRun(const ScriptRequest& request, const RunControl& control);

    // As KernelSandbox::enter, where the request asks for it: the files of the script's access, its folder and `writable`.
    void confine(const std::filesystem::path& writable = {}) const;

    // Runs the script and writes the manifest, also where the script ends early or fails. Throws what the script does.
    void execute();

    // Of a program that is written while it runs: adds a line, and ends it.
    void add_text(const std::string& line) { request_.text = request_.text.value_or("") + line + "\n"; }
    void finish() { write_manifest("done"); }

    // Runs the script, for the batch that it describes. Throws InputError where it describes none.
    ScriptBatch& read_batch();
    ScriptBatch& batch() { return *batch_; } // once it was read
    // tb.batch.
    void set_batch(ScriptBatch batch);
    // Whether what runs now is a point of a batch, beside others: it keeps no checkpoint and no log of its work.
    bool in_batch() const { return request_.only_batch || in_points_; }
    std::vector<std::string> files_read() const; // the script first, absolute names
    LuaState& lua() { return lua_; }

    // tb.options: the defaults, with those the user has set by -D in their place. A default is a value or
    // {default=, unit=, help=, choices=}; a value is read as its default's type, a list of numbers from "1,2,3".
    Json options(const Json& defaults);

    // A file a script names: as it stands, in the folder of the run, beside the script, or where models/ and scripts/ lie.
    std::filesystem::path find_file(const std::string& name) const;
    // Throws InputError where the script may not have a data file read: a record, a machine, JSON. Besides what
    // ScriptAccess allows, these are the files in the folder of the script, but for those whose name begins with a dot.
    void check_data(const std::filesystem::path& file) const;
    // The same without the folder of the run.
    static std::filesystem::path ready_file(const std::string& name);
    // The name of a file for a manifest, which ready_file finds again from the same working folder: relative where the file
    // lies below it, so that a folder can be moved with all that it needs; a ready file by its name below models/ or
    // scripts/, which may lie elsewhere on another machine.
    static std::string name_in_manifest(const std::filesystem::path& file, const std::filesystem::path& working_folder);
    // Where models/ and scripts/ lie: beside an installed program, else the source tree it was built from, else where it
    // was to be installed.
    static std::filesystem::path home();

    // A functional mock-up unit that the user has named, or any where the script may do all. Throws InputError.
    std::shared_ptr<const UnitFile> unit(const std::string& file);

    // Checked reading of a machine description.
    Json machine(const std::string& file, const Json& argument);
    // The same of a description, under this name: checked, with warnings, mass_kg replaced by rigid_gain_per_kg.
    Json checked_machine(Json description, const std::string& name);

    // tb.run: another script in a folder of this run, with no more rights than this one. Options are texts as with -D.
    // Where this run goes on after an interruption, a nested run that was complete is not repeated as long as script,
    // options, the files it read, with its modules, and the version are the same and its results are there. Its results become part of
    // this run's. Throws what ScriptRun and execute throw.
    NestedRun run_nested(const std::string& script, const std::string& folder, const Json& options,
                         std::optional<bool> quick);

    // Counts the files that the user named among those that the script reads: see run_script_batch.
    void note_named();

    // Adds a line to what the manifest says of the work done.
    void note_work(Json entry) {
        if (!in_batch()) work_.push_back(std::move(entry));
    }

    // A line on standard error for what the user should know and no result depends on; each text once.
    void remark(const std::string& text);

    RunFolder& folder() { return folder_; }
    const RunControl& control() const { return control_; }
    bool quick() const { return request_.quick; }
    const ScriptRequest& request() const { return request_; }
    bool keeps_plots() const { return request_.keep_plots; }

  private:
    void run_script();
    void run_batch();
    void write_manifest(const std::string& outcome);
    Json files_in_manifest() const; // that were read outside the run folder, with their hashes
    bool is_complete(const ScriptRequest& request) const;
    void check_nested_read(const std::filesystem::path& file, const ScriptRequest& request) const;
    ScriptAccess access() const;
    std::filesystem::path script_folder() const;

    ScriptRequest request_;
    RunControl control_;
    RunFolder folder_;
    std::shared_ptr<FilesRead> files_read_;
    LuaState lua_;
    std::optional<ScriptBatch> batch_;
    bool in_points_ = false;
    bool goes_on_; // after an interruption, at an earlier time
    bool options_asked_ = false;
    std::set<std::string> remarks_;
    Json options_ = Json::object();
    Json machines_ = Json::object(); // file -> hash
    Json work_ = Json::array();
};

} // namespace tribode
