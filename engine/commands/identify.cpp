#include "commands/command.hpp"
#include "commands/option_flags.hpp"
#include "tribode/experiment/identification.hpp"
#include "tribode/record/run_folder.hpp"

namespace tribode {

namespace {

struct IdentifyCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        add_machine(app, machine);
        app.add_option("--data", data, "measured record: t,y and u, or in a closed loop r or exc; may be given again")
            ->required()
            ->take_all()
            ->allow_extra_args(false);
        add_output(app, output, "folder of the machine and its parameters (default results/identify)");
        flags.add(app, options,
                  {{"parameters", "--parameters", "rigid gain, modes, friction and input delay"},
                   {"f_min_hz", "--f-min", ""},
                   {"f_max_hz", "--f-max", ""},
                   {"band", "--band", ""},
                   {"observer_hz", "--observer", ""},
                   {"iterations", "--iterations", ""}});
        columns.add_to(app);
        common.add_workers(app);
        common.add_quiet(app);
        common.add_json(app);
    }

    int run(const Common& common) override {
        flags.read(options);
        confine(machine, data, {output});
        const MachineModel model = read_machine(machine, common);
        std::vector<GivenRecord> records;
        Json sources = Json::array();
        for (const auto& file : data) {
            records.push_back({file, {}});
            sources.push_back(records.back().json());
        }
        RunFolder folder(output); // first: a folder that cannot be made is said before the work
        const Identification found = identify(model, records, columns.options(), options, common.control());
        write_identification(found, folder, common.control());
        remove_earlier_images(folder);
        folder.write_manifest({{"program", "tribode identify"},
                               {"machine", model.hash()},
                               {"data", sources},
                               {"options", options_json(options)}});
        common.note(found.text(), found.json());
        return done;
    }

    std::string machine, output = "results/identify";
    std::vector<std::string> data;
    ColumnOptions columns;
    IdentifyOptions options;
    OptionFlags flags;
};

} // namespace

std::unique_ptr<Command> identify_command() { return std::make_unique<IdentifyCommand>(); }

} // namespace tribode
