#include "commands/command.hpp"
#include "tribode/base/text.hpp"
#include "tribode/experiment/measured_fra.hpp"
#include "tribode/record/output_file.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

struct FraCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        app.add_option("--machine", machine, "machine description, .lua or .json")->required();
        app.add_option("--data", data, "measured record: t,u,y and, in a closed loop, r or exc; may be given again")
            ->required()
            ->take_all()
            ->allow_extra_args(false);
        app.add_option("-o,--out", output, "folder of responses, fits and report (default results/fra)");
        app.add_option("--methods", options.methods,
                       fmt::format("{} (default fra1,fra2,proposed)", fmt::join(fra_methods, ",")))
            ->delimiter(',');
        app.add_option("--fit", options.modes, "modes of the fitted model (default: as many as the machine has)")
            ->check(CLI::Range(0, 20));
        app.add_option("--fit-min", options.fit_min_hz,
                       "lowest frequency of the fit in Hz (default: 0.01 of the sampling rate)");
        app.add_option("--fit-max", options.fit_max_hz,
                       "highest frequency of the fit in Hz (default: 0.1 of the sampling rate)");
        app.add_option("--delay", options.delay, "of the delay model in seconds (default: from the machine)")
            ->check(CLI::NonNegativeNumber);
        app.add_option("--periods", options.sine.periods,
                       "the last periods of each single sine that are used (default: all that have settled)")
            ->check(CLI::PositiveNumber);
        app.add_flag("--keep-transients", keep_transients, "do not take transients out of single sines");
        columns.add_to(app);
        common.add_quiet(app);
        common.add_json(app);
    }

    int run(const Common& common) override {
        options.check();
        options.sine.remove_transients = !keep_transients;
        confine(machine, data, {output});
        const MachineModel model = read_machine(machine, common);
        std::vector<Table> records;
        Json sources = Json::array();
        for (const auto& file : data) {
            records.push_back(read_record(file, columns.options(), fra_columns()).table);
            sources.push_back({{"file", file}, {"sha256", sha256(read_file(file))}});
        }
        const MeasuredFra fra = measure_fra(model, records, options);
        RunFolder folder(output);
        write_measured_fra(fra, folder, common.control());
        folder.write_manifest({{"program", "tribode fra"}, {"machine", model.hash()}, {"data", sources}});
        common.note(fra.text(),
                    {{"folder", output}, {"records", fra.records}, {"fits", fra.fits()}, {"notes", fra.notes}});
        return done;
    }

    std::string machine, output = "results/fra";
    std::vector<std::string> data;
    ColumnOptions columns;
    MeasuredFraOptions options;
    bool keep_transients = false;
};

} // namespace

std::unique_ptr<Command> fra_command() { return std::make_unique<FraCommand>(); }

} // namespace tribode
