#include "commands/command.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/kernel_sandbox.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/script/script_run.hpp"

#include <cstdio>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>
#include <utility>

namespace tribode {

namespace {

struct RunCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        app.add_option("script", script, "experiment script, .lua; - reads it from standard input");
        app.add_option("-e,--execute", code, "a line of Lua in place of a script, with tb at hand; may be given again")
            ->take_all()
            ->allow_extra_args(false);
        add_output(app, request.folder, "folder of the results (default results/<script>)");
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
        app.add_option("--max-instructions", request.limits.instructions, "limit of the script's Lua instructions")
            ->check(is_whole(1, std::size_t{1} << 62));
        memory = app.add_option("--max-memory", memory_mib, "limit of the script's memory in MiB")
                     ->check(is_whole(1, std::size_t{1} << 30)); // the bytes of the process are a multiple of it
        app.add_option("--max-cpu", cpu_seconds, "limit of the processor time of each process in seconds")
            ->check(is_whole(1, 1'000'000'000));
        common.add_quiet(app);
        common.add_json(app);
    }

    int run(const Common& common) override {
        name_program();
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
        // What the script prints goes out of the way of the report.
        OutputToErrors redirected(common.json);
        ScriptRun run(request, common.control());
        run.confine();
        if (!code.empty()) run.lua().run_text("tb = require 'tribode'", "tribode");
        run.execute();
        if (common.json) {
            redirected.restore();
            common.print("", read_json(run.folder().folder() / "manifest.json"));
        }
        return done;
    }

  private:
    // A script is a file that can be read more than once, or a text: of -e, or of a pipe.
    void name_program() {
        if (script.empty() == code.empty()) {
            throw InputError("tribode run: wants a script, - for standard input, or -e CODE");
        }
        request.script = script;
        if (!code.empty()) {
            request.script = "command_line";
            request.text = fmt::format("{}", fmt::join(code, "\n"));
            return;
        }
        std::error_code none;
        const auto kind = std::filesystem::status(script, none).type();
        if (script == "-") {
            request.script = "stdin";
            request.text = read_file("/dev/stdin");
        } else if (kind == std::filesystem::file_type::fifo || kind == std::filesystem::file_type::character) {
            request.text = read_file(script);
        }
    }

    // While it is there, what goes to standard output goes to standard error.
    class OutputToErrors {
      public:
        explicit OutputToErrors(bool wanted) : saved_(wanted ? ::dup(STDOUT_FILENO) : -1) {
            if (saved_ >= 0) ::dup2(STDERR_FILENO, STDOUT_FILENO);
        }
        OutputToErrors(const OutputToErrors&) = delete;
        OutputToErrors& operator=(const OutputToErrors&) = delete;
        ~OutputToErrors() { restore(); }

        void restore() {
            if (saved_ < 0) return;
            std::fflush(stdout);
            ::dup2(saved_, STDOUT_FILENO);
            ::close(std::exchange(saved_, -1));
        }

      private:
        int saved_;
    };

    ScriptRequest request;
    std::string script;
    std::vector<std::string> code, defines;
    std::string machine, data, input;
    std::vector<std::string> units;
    std::size_t memory_mib = ScriptLimits{}.memory_bytes >> 20, cpu_seconds = 0; // 0: no limit
    CLI::Option* memory = nullptr;
};

} // namespace

std::unique_ptr<Command> run_command() { return std::make_unique<RunCommand>(); }

} // namespace tribode
