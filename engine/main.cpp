#include "commands/command.hpp"
#include "commands/command_line.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/script/lua_force.hpp"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fmt/format.h>
#include <new>
#include <unistd.h>

using namespace tribode;

namespace {

// The first Ctrl-C asks the work to end where it can go on later; the second ends the program at once.
void on_interrupt(int signal) {
    stop_requested = true;
    std::signal(signal, SIG_DFL);
}

// At the limit of the processor's time the system sends a signal each second, five in all, and then kills. The first asks
// the work to end; what does not listen, such as a slow pattern of Lua, is ended with a sentence by the last.
void on_time_limit(int) {
    static int heard = 0;
    stop_requested = true;
    if (++heard < 5) return;
    constexpr std::string_view sentence =
        "tribode: ended at the limit of the processor's time, in work that cannot be interrupted\n";
    if (::write(STDERR_FILENO, sentence.data(), sentence.size()) < 0) ::_exit(anything_else);
    ::_exit(ended_early);
}

int report(const std::string& problem, ExitCode code) {
    std::fflush(stdout);
    progress_display.close_line();
    std::fprintf(stderr, "tribode: %s\n", printable(problem, "\n\t").c_str());
    return code;
}

std::vector<std::string> option_names(const CLI::App& command) {
    std::vector<std::string> names;
    for (const auto* option : command.get_options()) {
        for (const auto& name : option->get_lnames()) names.push_back("--" + name);
    }
    return names;
}

std::vector<std::string> command_names(const CLI::App& app) {
    std::vector<std::string> names;
    for (const auto* command : app.get_subcommands(nullptr)) names.push_back(command->get_name());
    return names;
}

// What is wrong with the command line. A word that nobody knows comes first: it is often why something else is missing.
std::string usage_problem(const CLI::App& app, const CLI::ParseError& problem) {
    const CLI::App* found = &app;
    std::string name = "tribode";
    while (!found->get_subcommands().empty()) {
        found = found->get_subcommands().front();
        name += " " + found->get_name();
    }
    const CLI::App& command = *found;
    const bool is_group = !command_names(command).empty(); // a command is still to come
    if (const auto unknown = app.remaining(true); !unknown.empty()) {
        const std::string word = unknown.front().substr(0, unknown.front().find('='));
        if (word.starts_with('-')) {
            return fmt::format("{} is not an option of {}{}", word, name, suggestion(word, option_names(command)));
        }
        if (!is_group) return fmt::format("{} takes no further argument \"{}\"", name, word);
        return fmt::format("\"{}\" is not a command{}{}", word, &command == &app ? "" : " of " + name,
                           suggestion(word, command_names(command)));
    }
    if (is_group)
        return fmt::format("{}a command is missing{}", &command == &app ? "" : name + ": ",
                           suggestion("", command_names(command)));
    return fmt::format("{}: {}; {} --help tells what is allowed", name, problem.what(), name);
}

// The same as COMMAND --help.
int show_help(CLI::App& app, const std::vector<std::string>& about) {
    CLI::App* command = &app;
    std::string name = "tribode";
    for (const auto& word : about) {
        const auto commands = command->get_subcommands(nullptr);
        const auto found =
            std::find_if(commands.begin(), commands.end(), [&](const auto* one) { return one->get_name() == word; });
        if (found == commands.end()) {
            const auto known = command_names(*command);
            if (known.empty()) return report(fmt::format("{} has no commands of its own", name), wrong_input);
            return report(fmt::format("\"{}\" is not a command{}{}", word, command == &app ? "" : " of " + name,
                                      suggestion(word, known)),
                          wrong_input);
        }
        command = *found;
        name += " " + word;
    }
    fmt::print("{}", command->get_formatter()->make_help(command, name, CLI::AppFormatMode::Normal));
    return done;
}

int run_program(int argc, char** argv) {
    tribode::enable_lua_forces();
    std::signal(SIGINT, on_interrupt);
    std::signal(SIGTERM, on_interrupt);
    std::signal(SIGXCPU, on_time_limit);
    std::signal(SIGXFSZ, SIG_IGN); // a file above the size limit is an error of the write, also in a script
    CLI::App app("Tribode: simulation and frequency-response analysis of servo systems with friction", "tribode");
    app.set_version_flag("--version", "tribode " + version());
    app.require_subcommand(1);
    Common common;
    struct Entry {
        const char *name, *what;
        std::unique_ptr<Command> command;
        CLI::App* app = nullptr;
    };
    Entry commands[] = {
        {"simulate", "one machine under a recorded input", simulate_command()},
        {"compare", "one machine and one input through every method", compare_command()},
        {"diagnose", "the effect that a machine lacks, from measured records", diagnose_command()},
        {"fra", "frequency responses with their uncertainty, from measured records", fra_command()},
        {"identify", "all parameters of a machine at once, from measured records", identify_command()},
        {"run", "an experiment script in Lua", run_command()},
        {"batch", "many independent points, that survive what may happen", batch_command()},
        {"export-fmu", "a model as a functional mock-up unit, for other programs", export_fmu_command()},
        {"effects", "what a machine may have besides its basic parts, and the parameters of each", effects_command()},
        {"solvers", "the methods of integration", solvers_command()},
        {"repl", "Lua line by line, with the module tb at hand", repl_command()},
        {"completion", "completion of these commands for a shell, or of Lua for an editor", completion_command()}};
    for (auto& entry : commands) {
        entry.app = app.add_subcommand(entry.name, entry.what);
        entry.command->add_to(*entry.app, common);
        entry.app->set_version_flag("--version", "tribode " + version());
    }
    auto* help = app.add_subcommand("help", "what a command does and its options");
    std::vector<std::string> about;
    help->add_option("command", about, "e.g. batch plan (default: all commands)");
    bool manual = false;
    help->add_flag("--man", manual, "all of it as a page for man");
    try {
        app.parse(argc, argv);
        if (manual) {
            fmt::print("{}", manual_page(command_line(app)));
            return done;
        }
        if (help->parsed()) return show_help(app, about);
    } catch (const CLI::Success& help_or_version) {
        return app.exit(help_or_version);
    } catch (const CLI::ParseError& problem) {
        return report(usage_problem(app, problem), wrong_input);
    }
    try {
        for (const auto& entry : commands) {
            if (entry.app->parsed()) return entry.command->run(common);
        }
        return anything_else; // one command is required
    } catch (const InputError& problem) {
        return report(problem.what(), wrong_input);
    } catch (const EndedEarly& problem) {
        return report(problem.what(), ended_early);
    } catch (const std::bad_alloc&) {
        return report("there is not enough memory, or less than --max-memory leaves", anything_else);
    } catch (const std::exception& problem) {
        return report(problem.what(), anything_else);
    }
}

} // namespace

int main(int argc, char** argv) {
    const int code = run_program(argc, argv);
    // What was printed may still wait in a buffer, and a device that is full shows only now.
    const bool flushed = std::fflush(stdout) == 0;
    if ((flushed && !std::ferror(stdout)) || code != done) return code;
    return report(fmt::format("standard output: cannot be written ({})",
                              flushed ? "an earlier write failed" : std::strerror(errno)),
                  anything_else);
}
