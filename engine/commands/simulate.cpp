#include "commands/command.hpp"
#include "commands/option_flags.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/record/csv.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/script/conversions.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

struct SimulateCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        what.add_to(app);
        add_output(app, output, "file to write, .csv, .mat or .h5: t,r,u,y,x,v,f; - for CSV on standard output")
            ->required();
        app.add_option("--events", events, "CSV to write: t,element,kind; - for standard output");
        flags.add(app, options,
                  {{"solver", "--solver", "auto: exact where possible, else erk"},
                   {"relative_tolerance", "--rtol", ""},
                   {"absolute_tolerance_m", "--atol", ""},
                   {"fixed_step_s", "--step", "Ts/10"},
                   {"seed", "--seed", ""}});
        common.add_quiet(app);
        common.add_json(app);
    }

    int run(const Common& common) override {
        const int on_output = int(output == standard_output) + int(events == standard_output) + int(common.json);
        if (on_output > 1) {
            throw InputError("only one of -o -, --events - and --json can have the standard output");
        }
        flags.read(options);
        std::vector<std::string> files = {output};
        if (!events.empty()) files.push_back(events);
        confine(what.machine, {what.input}, files);
        const MachineModel model = what.model(common);
        if (!flags.given("fixed_step_s")) options.solver.fixed_step = model.sample_time / 10;
        const Simulation result = simulate(model, what.record(model), options, common.control());
        if (!result.outcome.ok()) {
            // What was reached is kept, but not under the name of a whole result.
            if (output == standard_output) {
                throw EndedEarly(fmt::format("{}; with -o FILE the {} samples reached are kept", result.outcome.message,
                                             result.trace.t.size()));
            }
            const std::string partial = output + ".partial.csv";
            write_csv(partial, to_table(result.trace));
            throw EndedEarly(fmt::format("{}; the {} samples reached are in {}", result.outcome.message,
                                         result.trace.t.size(), partial));
        }
        write_record(output, to_table(result.trace));
        if (!events.empty()) write_file(events, to_csv(result.events));
        if (on_output == 0 || common.json) {
            const RunStatistics& n = result.statistics;
            common.note(
                fmt::format("{} samples with {}: {} events, {} instants located, {} steps ({} rejected), {} derivative "
                            "evaluations, {} restarts, {} integrating, {} in events and samples\n",
                            result.trace.t.size(), name_of(result.method), result.events.size(), n.events, n.steps,
                            n.rejected_steps, n.derivative_evaluations, n.restarts,
                            format_quantity(n.seconds_integrating, "s", 3), format_quantity(n.seconds_events, "s", 3)),
                {{"file", output},
                 {"samples", result.trace.t.size()},
                 {"events", result.events.size()},
                 {"solver", name_of(result.method)},
                 {"statistics", to_json(n)}});
        }
        return done;
    }

    MachineAndRecord what;
    std::string output, events;
    SimulationOptions options;
    OptionFlags flags;
};

} // namespace

std::unique_ptr<Command> simulate_command() { return std::make_unique<SimulateCommand>(); }

} // namespace tribode
