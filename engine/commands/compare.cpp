#include "commands/command.hpp"
#include "tribode/base/text.hpp"
#include "tribode/experiment/comparison.hpp"
#include "tribode/record/output_file.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

struct CompareCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        what.add_to(app);
        app.add_option("-o,--out", output, "folder of table and plots (default results/compare)");
        app.add_option("--seed", options.seed, "seed of the noise (default 0)");
        common.add_quiet(app);
        common.add_json(app);
    }

    int run(const Common& common) override {
        confine(what.machine, {what.input}, {output});
        const MachineModel model = what.model(common);
        const DriveRecord record = what.record(model);
        RunFolder folder(output); // first: a folder that cannot be made is said before the work
        const Comparison comparison = compare(model, record, options, common.control());
        write_comparison(comparison, model, folder);
        common.print(comparison.text() + "\n", comparison.json());
        folder.write_manifest({{"program", "tribode compare"},
                               {"machine", model.hash()},
                               {"input", {{"file", what.input}, {"sha256", sha256(read_file(what.input))}}},
                               {"seed", options.seed}});
        return done;
    }

    MachineAndRecord what;
    std::string output = "results/compare";
    ComparisonOptions options;
};

} // namespace

std::unique_ptr<Command> compare_command() { return std::make_unique<CompareCommand>(); }

} // namespace tribode
