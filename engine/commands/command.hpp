#pragma once
#include "commands/progress_display.hpp"
#include "tribode/base/json.hpp"
#include "tribode/base/run_control.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/run_folder.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace tribode {

enum ExitCode { done = 0, anything_else = 1, wrong_input = 2, ended_early = 3, shard_interrupted = 75 };

extern std::atomic<bool> stop_requested; // by Ctrl-C
extern ProgressDisplay progress_display;

// Options of every command.
struct Common {
    bool quiet = false;
    bool json = false; // what the command reports is one JSON value on standard output
    unsigned workers = std::max(1u, std::thread::hardware_concurrency());

    RunControl control() const;
    void add_quiet(CLI::App& app);
    void add_json(CLI::App& app); // for a command that reports something
    void add_workers(CLI::App& app, const char* what = "threads (default: all cores); the results do not depend on it");

    // Prints a result, as text or as JSON.
    void print(std::string_view text, const Json& json) const;
    // The same of a message that --quiet leaves out.
    void note(std::string_view text, const Json& json) const;
};

// One command of the program, `tribode NAME`. It fills in a request of the engine, runs it and prints what came of it.
class Command {
  public:
    virtual ~Command() = default;
    virtual void add_to(CLI::App& app, Common& common) = 0; // its options
    virtual int run(const Common& common) = 0;              // returns the exit code
};

std::unique_ptr<Command> simulate_command();
std::unique_ptr<Command> compare_command();
std::unique_ptr<Command> diagnose_command();
std::unique_ptr<Command> fra_command();
std::unique_ptr<Command> identify_command();
std::unique_ptr<Command> run_command();
std::unique_ptr<Command> batch_command();
std::unique_ptr<Command> export_fmu_command();
std::unique_ptr<Command> effects_command();
std::unique_ptr<Command> solvers_command();
std::unique_ptr<Command> completion_command();
std::unique_ptr<Command> repl_command();

// ---- what several commands need ----------------------------------------------------------------------------------

// -D name=value, each once or more: the last counts.
void add_defines(CLI::App& app, std::vector<std::string>& defines, const char* help);
std::map<std::string, std::string> defines_of(const std::vector<std::string>& defines);

// How help shows an option that takes one of these words; completion offers them.
std::string choice_of(const std::vector<std::string>& words);

// Checks of options. CLI11's own take any size, read -1 as the largest number, and print limits with 300 digits.
CLI::Validator is_positive();
CLI::Validator is_whole(std::size_t least, std::size_t most);

// -o: a file or folder that the command writes.
template <class Name>
CLI::Option* add_output(CLI::App& app, Name& name, const char* help) {
    const auto is_name = [](const std::string& text) { return text.empty() ? "names nothing" : ""; };
    return app.add_option("-o,--out", name, help)->check(CLI::Validator(is_name, ""));
}

void add_machine(CLI::App& app, std::string& machine);
MachineModel read_machine(const std::string& file, const Common& common);

// Names and units of records.
struct ColumnOptions {
    std::string columns, scale;

    void add_to(CLI::App& app);
    RecordOptions options() const { return RecordOptions::parse(columns, scale); }
};

// A machine and the record that drives it.
struct MachineAndRecord {
    std::string machine, input;
    ColumnOptions columns;

    void add_to(CLI::App& app);
    MachineModel model(const Common& common) const { return read_machine(machine, common); }
    GivenRecord given() const { return {input, {}}; }
    DriveRecord record(const MachineModel& model) const { return DriveRecord::of(given(), columns.options(), model); }
};

// Throws InputError where a file is to be written twice, or is an input, too: the command would end well and one of the two
// would be lost. Empty names are none.
void refuse_overwriting(const std::vector<std::string>& read, const std::vector<std::string>& write);

// For commands that read files of others and write some of their own, none of them twice. A machine may be a program that
// requires what lies beside it.
void confine(const std::string& machine, const std::vector<std::string>& read, const std::vector<std::string>& write);

// Removes the images that an earlier run has listed in the manifest of the folder and this one has not written, as of other
// records: they would be taken for results of this run. Images that were changed since are kept.
void remove_earlier_images(const RunFolder& folder);

struct ScriptRequest;
void add_compile(CLI::App& app, ScriptRequest& request);

} // namespace tribode
