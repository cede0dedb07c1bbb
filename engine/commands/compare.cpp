#include "commands/command.hpp"
#include "commands/option_flags.hpp"
#include "tribode/experiment/comparison.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

struct CompareCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        what.add_to(app);
        add_output(app, output, "folder of table and plots (default results/compare)");
        flags.add(app, options, {{"seed", "--seed", ""}});
        common.add_quiet(app);
        common.add_json(app);
    }

    int run(const Common& common) override {
        flags.read(options);
        confine(what.machine, {what.input}, {output});
        const MachineModel model = what.model(common);
        const DriveRecord record = what.record(model);
        RunFolder folder(output); // first: a folder that cannot be made is said before the work
        const Comparison comparison = compare(model, record, options, common.control());
        write_comparison(comparison, model, folder);
        common.print(comparison.text() + "\n", comparison.json());
        remove_earlier_images(folder);
        folder.write_manifest({{"program", "tribode compare"},
                               {"machine", model.hash()},
                               {"input", what.given().json()},
                               {"seed", options.seed},
                               {"options", options_json(options)}});
        return done;
    }

    MachineAndRecord what;
    std::string output = "results/compare";
    ComparisonOptions options;
    OptionFlags flags;
};

} // namespace

std::unique_ptr<Command> compare_command() { return std::make_unique<CompareCommand>(); }

} // namespace tribode
