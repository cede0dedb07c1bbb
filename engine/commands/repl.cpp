#include "commands/command.hpp"
#include "commands/line_reader.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/script/dialogue.hpp"

#include <cstdio>
#include <cstdlib>
#include <fmt/format.h>
#include <signal.h>

namespace tribode {

namespace {

// Ctrl-C ends what runs, not the program; a second one, while what runs does not end, does.
void on_interrupt_of_a_call(int signal) {
    if (!stop_requested.exchange(true)) return;
    ::signal(signal, SIG_DFL);
    ::raise(signal);
}

// $XDG_STATE_HOME/tribode/history, by default below ~/.local/state; empty where there is no such place.
std::filesystem::path history_file() {
    const char *state = std::getenv("XDG_STATE_HOME"), *home = std::getenv("HOME");
    std::filesystem::path folder;
    if (state && *state == '/') {
        folder = state;
    } else if (home && *home == '/') {
        folder = std::filesystem::path(home) / ".local/state";
    } else {
        return {};
    }
    std::error_code problem;
    std::filesystem::create_directories(folder / "tribode", problem);
    return problem ? std::filesystem::path() : folder / "tribode/history";
}

struct ReplCommand final : Command {
    void add_to(CLI::App& app, Common& common) override {
        add_output(app, request.folder, "folder of the results (default results/repl)");
        add_defines(app, defines, "name=value: an option, for tb.options; a file may then be read");
        common.add_workers(app);
        app.add_flag("--allow-all", request.allow_all, "let Lua open any file and have its whole standard library");
        add_compile(app, request);
        app.add_option("--max-instructions", request.limits.instructions, "limit of the Lua instructions of one line")
            ->check(is_whole(1, std::size_t{1} << 62));
        common.add_quiet(app);
    }

    int run(const Common& common) override {
        request.script = "repl";
        request.text = "";
        request.confine = true;
        request.defines = defines_of(defines);
        for (const auto& [name, value] : request.defines) request.named.emplace_back(value);
        ScriptRun run(request, common.control());
        Dialogue dialogue(run);
        const auto history = history_file();
        LineReader reader([&](std::string_view text) { return dialogue.completions(text); }, history);
        run.confine(reader.is_terminal() ? history.parent_path() : std::filesystem::path());
        struct sigaction interrupt {};
        interrupt.sa_handler = on_interrupt_of_a_call; // without SA_RESTART: a line that is typed ends, too
        ::sigaction(SIGINT, &interrupt, nullptr);
        ::signal(SIGTERM, SIG_DFL);
        if (reader.is_terminal() && !common.quiet) {
            fmt::print("tribode {}: Lua with the module tb; tab completes, Ctrl-C interrupts, Ctrl-D ends\n",
                       version());
        }
        const bool failed = converse(reader, dialogue);
        run.finish();
        // A program that was piped in has failed as a script would have.
        return failed && !reader.is_terminal() ? wrong_input : done;
    }

  private:
    // Whether a line has failed.
    static bool converse(LineReader& reader, Dialogue& dialogue) {
        bool failed = false;
        const auto report = [&](const std::string& problem) {
            failed = true;
            std::fflush(stdout);
            progress_display.close_line();
            std::fprintf(stderr, "%s\n", printable(problem, "\n\t").c_str());
        };
        std::string text, line;
        for (;;) {
            stop_requested = false; // of the line before
            const auto result = reader.read(text.empty() ? "> " : ">> ", line);
            stop_requested = false;
            if (result == LineReader::Result::interrupted) {
                std::fputs("^C\n", stdout);
                text.clear();
                continue;
            }
            if (result == LineReader::Result::end) break;
            text += (text.empty() ? "" : "\n") + line;
            try {
                if (trim(text).empty() || dialogue.evaluate(text)) text.clear();
            } catch (const std::bad_alloc&) {
                report("there is not enough memory");
                text.clear();
            } catch (const std::exception& problem) {
                report(problem.what());
                text.clear();
            }
            std::fflush(stdout);
        }
        if (reader.is_terminal()) std::fputc('\n', stdout);
        if (!text.empty()) report("repl: the last statement has no end");
        return failed;
    }

    ScriptRequest request;
    std::vector<std::string> defines;
};

} // namespace

std::unique_ptr<Command> repl_command() { return std::make_unique<ReplCommand>(); }

} // namespace tribode
