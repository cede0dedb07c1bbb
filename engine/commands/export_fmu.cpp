#include "commands/command.hpp"
#include "tribode/script/fmu_file.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

struct ExportFmuCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        app.add_option("model", request.model,
                       "machine description, .json or .lua, or a Lua file that returns tb.system{...}")
            ->required();
        app.add_option("--fmi", fmi, "version of the standard: 2 or 3 (default 2)")->check(CLI::IsMember({2, 3}));
        app.add_option(
               "--kind", kind,
               "cs: co-simulation, with the solver inside; me: model exchange, for systems without sample clocks "
               "(default cs)")
            ->check(CLI::IsMember({"cs", "me"}));
        app.add_option("--solver", request.options.solver, "of co-simulation, see tribode solvers (default auto)")
            ->type_name(choice_of(SolverOptions::method_names()));
        add_output(app, request.output, "file to write, NAME.fmu")->required();
        app.add_flag("--quiet", common.quiet, "no message of what was written");
        common.add_json(app);
    }

    int run(const Common& common) override {
        request.options.version = fmi == 2 ? FmiVersion::fmi2 : FmiVersion::fmi3;
        request.options.model_exchange = kind == "me";
        export_fmu(request, common.control());
        const char* name = kind == "me" ? "model exchange" : "co-simulation";
        common.note(fmt::format("{}: FMI {}.0, {}\n", request.output.string(), fmi, name),
                    {{"file", request.output.string()}, {"fmi", fmi}, {"kind", name}});
        return done;
    }

    FmuRequest request;
    int fmi = 2;
    std::string kind = "cs";
};

} // namespace

std::unique_ptr<Command> export_fmu_command() { return std::make_unique<ExportFmuCommand>(); }

} // namespace tribode
