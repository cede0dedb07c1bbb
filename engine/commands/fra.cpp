#include "commands/command.hpp"
#include "commands/option_flags.hpp"
#include "tribode/experiment/measured_fra.hpp"

namespace tribode {

namespace {

struct FraCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        add_machine(app, machine);
        app.add_option("--data", data, "measured record: t,u,y and, in a closed loop, r or exc; may be given again")
            ->required()
            ->take_all()
            ->allow_extra_args(false);
        add_output(app, output, "folder of responses, fits and report (default results/fra)");
        flags.add(app, request.options,
                  {{"methods", "--methods", ""},
                   {"modes", "--fit", "as many as the machine has"},
                   {"fit_min_hz", "--fit-min", "0.01 of the sampling rate"},
                   {"fit_max_hz", "--fit-max", "0.1 of the sampling rate"},
                   {"delay_s", "--delay", "from the machine"},
                   {"periods", "--periods", ""},
                   {"keep_transients", "--keep-transients", ""}});
        columns.add_to(app);
        common.add_quiet(app);
        common.add_json(app);
    }

    int run(const Common& common) override {
        flags.read(request.options);
        confine(machine, data, {output});
        request.machine = read_machine(machine, common);
        request.columns = columns.options();
        Json sources = Json::array();
        for (const auto& file : data) {
            request.records.push_back({file, {}});
            sources.push_back(request.records.back().json());
        }
        const MeasuredFra fra = measure_fra(request);
        RunFolder folder(output);
        write_measured_fra(fra, folder, common.control());
        remove_earlier_images(folder);
        folder.write_manifest({{"program", "tribode fra"},
                               {"machine", request.machine.hash()},
                               {"data", sources},
                               {"options", options_json(request.options)}});
        common.note(fra.text(),
                    {{"folder", output}, {"records", fra.records}, {"fits", fra.fits()}, {"notes", fra.notes}});
        return done;
    }

    std::string machine, output = "results/fra";
    std::vector<std::string> data;
    ColumnOptions columns;
    FraRequest request;
    OptionFlags flags;
};

} // namespace

std::unique_ptr<Command> fra_command() { return std::make_unique<FraCommand>(); }

} // namespace tribode
