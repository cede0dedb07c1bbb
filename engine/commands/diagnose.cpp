#include "commands/command.hpp"
#include "tribode/diagnosis/diagnosis_files.hpp"
#include "tribode/diagnosis/diagnosis_request.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

struct DiagnoseCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        add_machine(app, machine);
        app.add_option("--data", data, "measured record: t,r,u,y (closed loop) or t,u,y; may be given again")
            ->required()
            ->take_all()
            ->allow_extra_args(false);
        app.add_option("--validate", validate,
                       "validation record, not used for the fit (default: the last third of the first record)");
        app.add_option("-o,--out", output, "folder of verdict, machine, report (default results/diagnose)");
        app.add_option("--max-effects", options.max_effects, "how many effects may be missing together (default 3)")
            ->check(CLI::Range(1u, 6u));
        columns.add_to(app);
        common.add_workers(app);
        common.add_quiet(app);
        common.add_json(app);
    }

    int run(const Common& common) override {
        std::vector<std::string> records = data;
        if (!validate.empty()) records.push_back(validate);
        confine(machine, records, {output});
        DiagnosisRequest request;
        request.machine = read_machine(machine, common);
        request.data.assign(data.begin(), data.end());
        if (!validate.empty()) request.validate = validate;
        request.columns = columns.options();
        request.options = options;
        const DiagnosisResult result = diagnose_files(request, output, common.control());
        common.print(diagnosis_text(result.summary), result.summary);
        return done;
    }

    std::string machine, validate, output = "results/diagnose";
    std::vector<std::string> data;
    ColumnOptions columns;
    DiagnosisOptions options;
};

} // namespace

std::unique_ptr<Command> diagnose_command() { return std::make_unique<DiagnoseCommand>(); }

} // namespace tribode
