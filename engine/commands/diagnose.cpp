#include "commands/command.hpp"
#include "commands/option_flags.hpp"
#include "tribode/base/error.hpp"
#include "tribode/diagnosis/diagnosis_files.hpp"
#include "tribode/diagnosis/diagnosis_request.hpp"
#include "tribode/diagnosis/system_diagnosis_files.hpp"
#include "tribode/diagnosis/system_diagnosis_request.hpp"
#include "tribode/script/script_run.hpp"
#include "tribode/script/system_file.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

struct DiagnoseCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        app.add_option("--machine", machine, "machine description, .lua or .json");
        app.add_option("--system", system_file, "instead of a machine: a Lua file that returns tb.system{...}");
        const auto add_list = [&app](const char* name, std::vector<std::string>& list, const char* text) {
            return app.add_option(name, list, text)->take_all()->allow_extra_args(false);
        };
        add_list(
            "--data", data,
            "measured record; of a machine t,r,u,y (closed loop) or t,u,y, of a system t, its inputs and outputs; may "
            "be given again")
            ->required();
        add_list("--validate", validate,
                 "validation record, not used for the fit, of a system several (default: the last third of the first "
                 "record)");
        add_list("--input", inputs, "an input of the system and its column, u=u_V; may be given again");
        add_list(
            "--output", outputs,
            "a measured output or state of the system and its column, y=y_V; may be given again (default: those with "
            "a column of their name)");
        add_list(
            "--free", system.free,
            "a parameter of the system, or STATE.start, that is fitted; may be given again (default: what the system "
            "names in `free`, else all)");
        add_output(app, output, "folder of verdict, machine or system, report (default results/diagnose)");
        // Those of a system have the same keys.
        flags.add(app, DiagnosisOptions(),
                  {{"max_effects", "--max-effects", ""},
                   {"budget_s", "--budget", "300 for a system, no limit for a machine"}});
        columns.add_to(app);
        common.add_workers(app);
        common.add_quiet(app);
        common.add_json(app);
    }

    int run(const Common& common) override {
        if (system_file.empty() == machine.empty()) {
            throw InputError("diagnose needs one of --machine and --system");
        }
        return system_file.empty() ? run_machine(common) : run_system(common);
    }

  private:
    int run_machine(const Common& common) {
        for (const auto& [name, list] :
             {std::pair{"--input", &inputs}, {"--output", &outputs}, {"--free", &system.free}}) {
            if (!list->empty()) throw InputError(fmt::format("{} is for a --system, not for a --machine", name));
        }
        if (validate.size() > 1) throw InputError("--validate may be given once for a --machine");
        std::vector<std::string> records = data;
        records.insert(records.end(), validate.begin(), validate.end());
        confine(machine, records, {output});
        DiagnosisRequest request;
        request.machine = read_machine(machine, common);
        request.data.assign(data.begin(), data.end());
        if (!validate.empty()) request.validate = validate.front();
        request.columns = columns.options();
        flags.read(request.options);
        const DiagnosisResult result = diagnose_files(request, output, common.control());
        common.print(diagnosis_text(result.summary), result.summary);
        return done;
    }

    int run_system(const Common& common) {
        system.data.assign(data.begin(), data.end());
        system.validate.assign(validate.begin(), validate.end());
        system.columns = {pairs_of(inputs), pairs_of(outputs), columns.options()};
        flags.read(system.options);
        ScriptRequest script;
        script.script = system_file;
        script.folder = output;
        script.confine = true;
        for (const auto* files : {&system.data, &system.validate}) {
            script.named.insert(script.named.end(), files->begin(), files->end());
        }
        ScriptRun run(script, common.control());
        run.confine();
        const auto result = diagnose_system_files(system_of_file(run), system, run.folder(), common.control());
        common.print(system_diagnosis_text(result.diagnosis), result.summary);
        return done;
    }

    // "u=column" of each text; "u" alone is a column of that name.
    static std::map<std::string, std::string> pairs_of(const std::vector<std::string>& texts) {
        std::map<std::string, std::string> pairs;
        for (const auto& text : texts) {
            const auto sign = text.find('=');
            pairs[text.substr(0, sign)] = sign == std::string::npos ? text : text.substr(sign + 1);
        }
        return pairs;
    }

    SystemDiagnosisRequest system;
    std::string system_file;
    std::vector<std::string> inputs, outputs;
    std::string machine, output = "results/diagnose";
    std::vector<std::string> data, validate;
    ColumnOptions columns;
    OptionFlags flags;
};

} // namespace

std::unique_ptr<Command> diagnose_command() { return std::make_unique<DiagnoseCommand>(); }

} // namespace tribode
