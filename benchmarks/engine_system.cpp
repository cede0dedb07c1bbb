// The machine of a scenario as a system of equations (models/servo), by the same simulator as the built-in one.
#include "contender.hpp"

#include "tribode/base/error.hpp"
#include "tribode/script/script_run.hpp"
#include "tribode/script/system_reader.hpp"
#include "tribode/solver/simulator.hpp"
#include "tribode/system/equation_system.hpp"

#include <fmt/format.h>
#include <map>

namespace tribode::bench {

namespace {

Json description_of(const Scenario& scenario) {
    const problems::ServoProblem& table = scenario.table;
    Json machine{{"Ts", table.sample_time}, {"rigid_gain_per_kg", table.rigid_gain}};
    for (const auto& mode : table.modes) {
        machine["modes"].push_back({{"gain", mode.gain}, {"freq_hz", mode.freq_hz}, {"zeta", mode.zeta}});
    }
    machine["friction"]["viscous"] = table.viscous;
    for (const auto& element : table.elements) {
        machine["friction"]["elements"].push_back({{"K", element.K}, {"F", element.F}, {"D", element.D}});
    }
    if (table.lag_hz > 0) machine["current_loop_hz"] = table.lag_hz;
    if (const auto& loop = scenario.loop) {
        machine["controller"] = {{"type", "pid"}, {"kp", loop->kp}, {"ki", loop->ki}, {"kd", loop->kd}};
        machine["input_delay_s"] = loop->input_delay;
        machine["output_delay_s"] = loop->output_delay;
        machine["encoder_resolution_m"] = loop->encoder_resolution;
    }
    return machine;
}

Equations recorded(const Scenario& scenario) {
    // A run must have a script; what it knows of the language is all that is wanted here.
    ScriptRun run({.script = ScriptRun::home() / "models/systems/paper_table.lua",
                   .folder = std::filesystem::temp_directory_path() / "tribode_benchmarks"},
                  {});
    Equations equations;
    run.lua().add_stack_function("take", [&](lua_State* lua) {
        equations = *system_at(lua, 1);
        return 0;
    });
    run.lua().run_text(R"(
        local servo = require "servo"
        require("tribode").take(servo.wire(servo.parts(...)))
    )",
                       "=scenario", description_of(scenario));
    return equations;
}

// The input as a sampled function, as tb.run_system has it for a list.
void excite(Equations& equations, const Scenario& scenario) {
    const std::string name = scenario.loop ? "exc" : "u";
    const auto input = std::find_if(equations.inputs.begin(), equations.inputs.end(),
                                    [&](const auto& candidate) { return candidate.name == name; });
    const Term held = equations.graph->variable(name);
    Equations::Function function;
    function.writes = {held};
    function.call = [scenario](long k, std::span<const double>, std::span<double> written) {
        written[0] = scenario.excitation(static_cast<std::size_t>(k));
    };
    Equations::Clock clock{.name = name, .period = scenario.table.sample_time, .function = std::move(function)};
    equations.clocks.insert(equations.clocks.begin(), std::move(clock));
    equations.discrete.push_back({name, input->unit, scenario.excitation(0), held, {}});
    equations.replace({{input->symbol, held}});
    equations.inputs.erase(input);
}

class Positions final : public Observer {
  public:
    Positions(const EquationSystem& system, std::size_t count) {
        x.reserve(count);
        while (system.states()[place_].name != "plant.position") ++place_;
    }
    void sampled(ClockId clock, long, const SystemState& state) override {
        if (clock == 0) x.push_back(state.x[place_]);
    }
    std::vector<double> x;

  private:
    std::size_t place_ = 0;
};

// Recorded and differentiated once: what is measured is the run.
const EquationSystem& system_of(const Scenario& scenario) {
    static std::map<std::string, std::unique_ptr<const EquationSystem>> made;
    auto& system = made[scenario.name];
    if (!system) {
        Equations equations = recorded(scenario);
        excite(equations, scenario);
        system = std::make_unique<const EquationSystem>(std::move(equations));
    }
    return *system;
}

} // namespace

std::vector<Contender> machine_as_system() {
    std::vector<Contender> all;
    for (const SolverOptions& solver :
         {SolverOptions{.method = Method::exact},
          SolverOptions{.method = Method::erk, .relative_tolerance = 1e-6, .absolute_tolerance = 1e-9}}) {
        const std::string name = solver.method == Method::exact ? "exact" : "erk 1e-06";
        all.push_back({"system of equations " + name, [solver](const Scenario& scenario) {
                           const EquationSystem& system = system_of(scenario);
                           Simulator simulator(system, solver);
                           Positions positions(system, scenario.samples + 1);
                           simulator.observe(&positions);
                           const RunOutcome outcome =
                               simulator.advance_to(static_cast<double>(scenario.samples) * scenario.table.sample_time);
                           if (!outcome.ok()) throw Error(outcome.message);
                           const RunStatistics statistics = simulator.statistics();
                           return Run{std::move(positions.x), static_cast<long>(scenario.samples), statistics.steps,
                                      statistics.events};
                       }});
    }
    return all;
}

} // namespace tribode::bench
