#include "commands/command.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/csv.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/script/conversions.hpp"

#include <cmath>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <optional>

namespace tribode {

namespace {

struct SimulateCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        what.add_to(app);
        app.add_option("-o,--out", output,
                       "file to write, .csv, .mat or .h5: t,r,u,y,x,v,f; - for CSV on standard output")
            ->required();
        app.add_option("--events", events, "CSV to write: t,element,kind; - for standard output");
        app.add_option("--solver", solver,
                       fmt::format("{} (default auto: exact where possible, else erk)",
                                   fmt::join(SolverOptions::method_names(), ", ")));
        app.add_option("--rtol", options.solver.relative_tolerance, "relative tolerance (default 1e-8)");
        app.add_option("--atol", options.solver.absolute_tolerance, "absolute tolerance in metres (default 1e-12)");
        app.add_option("--step", step, "step of the fixed-step solvers in seconds (default Ts/10)");
        app.add_option("--seed", options.seed, "seed of the noise (default 0)");
        common.add_quiet(app);
        common.add_json(app);
    }

    int run(const Common& common) override {
        const int on_output = int(output == standard_output) + int(events == standard_output) + int(common.json);
        if (on_output > 1) {
            throw InputError("only one of -o -, --events - and --json can have the standard output");
        }
        confine(what.machine, {what.input}, events.empty() ? std::vector{output} : std::vector{output, events});
        const MachineModel model = what.model(common);
        options.solver.method = method_named(solver);
        options.solver.fixed_step = step.value_or(model.sample_time / 10);
        for (const auto& [name, value] : {std::pair{"--rtol", options.solver.relative_tolerance},
                                          {"--atol", options.solver.absolute_tolerance},
                                          {"--step", options.solver.fixed_step}}) {
            if (!(value > 0) || !std::isfinite(value)) {
                throw InputError(fmt::format("{} {}: must be positive and finite", name, to_text(value)));
            }
        }
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
                fmt::format(
                    "{} samples with {}: {} events, {} steps ({} rejected), {} derivative evaluations, {} restarts, "
                    "{:.3g} s integrating, {:.3g} s in events and samples\n",
                    result.trace.t.size(), name_of(result.method), n.events, n.steps, n.rejected_steps,
                    n.derivative_evaluations, n.restarts, n.seconds_integrating, n.seconds_events),
                {{"file", output},
                 {"samples", result.trace.t.size()},
                 {"solver", name_of(result.method)},
                 {"statistics", to_json(n)}});
        }
        return done;
    }

    MachineAndRecord what;
    std::string output, events;
    std::string solver = name_of(SolverOptions{}.method);
    SimulationOptions options;
    std::optional<double> step; // none: Ts/10 [s]
};

} // namespace

std::unique_ptr<Command> simulate_command() { return std::make_unique<SimulateCommand>(); }

} // namespace tribode
