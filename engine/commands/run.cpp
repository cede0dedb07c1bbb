#include "commands/command.hpp"
#include "tribode/base/kernel_sandbox.hpp"
#include "tribode/script/script_run.hpp"

namespace tribode {

namespace {

struct RunCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        app.add_option("script", request.script, "experiment script, .lua")->required();
        app.add_option("-o,--out", request.folder, "folder of the results (default results/<script>)");
        add_defines(app, defines, "name=value: sets an option of the script");
        app.add_option("--machine", machine, "the script's option machine: a file");
        app.add_option("--data", data, "the script's option data: a file");
        app.add_option("--input", input, "the script's option input: a file");
        app.add_option("--fmu", units, "a functional mock-up unit that the script may import: its machine code runs");
        common.add_workers(app);
        app.add_flag("--quick", request.quick, "a small version of the work, to try a script");
        app.add_flag("--allow-all", request.allow_all,
                     "let the script open any file and use the whole standard library of Lua");
        add_compile(app, request);
        app.add_option("--max-instructions", request.limits.instructions, "limit of the script's Lua instructions");
        memory = app.add_option("--max-memory", memory_mib, "limit of the script's memory in MiB");
        app.add_option("--max-cpu", cpu_seconds, "limit of the processor time of each process in seconds")
            ->check(CLI::PositiveNumber);
        common.add_quiet(app);
    }

    int run(const Common& common) override {
        request.defines = defines_of(defines);
        for (const auto& [name, file] : {std::pair{"machine", machine}, {"data", data}, {"input", input}}) {
            if (!file.empty()) request.defines[name] = file;
        }
        for (const auto& [name, value] : request.defines) request.named.emplace_back(value);
        for (const auto& unit : units) request.units.push_back(std::make_shared<const UnitFile>(unit));
        request.limits.memory_bytes = memory_mib << 20;
        request.confine = true;
        // The engine may hold more than the script, such as the data of a plot, but not without end.
        const std::size_t besides = std::size_t{1} << 30;
        limit_process(memory->count() > 0 ? 4 * request.limits.memory_bytes + besides : 0, cpu_seconds);
        ScriptRun run(request, common.control());
        run.confine();
        run.execute();
        return done;
    }

    ScriptRequest request;
    std::vector<std::string> defines;
    std::string machine, data, input;
    std::vector<std::string> units;
    std::size_t memory_mib = ScriptLimits{}.memory_bytes >> 20, cpu_seconds = 0; // 0: no limit
    CLI::Option* memory = nullptr;
};

} // namespace

std::unique_ptr<Command> run_command() { return std::make_unique<RunCommand>(); }

} // namespace tribode
