#include "commands/command_line.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sstream>
#include <utility>

namespace tribode {

namespace {

using Option = CommandLine::Option;

// CLI11 shows the words of a choice, and the author of an option may write them so: {a,b}.
std::vector<std::string> choices_in(const std::string& type) {
    std::vector<std::string> choices;
    const auto begin = type.find('{'), end = type.find('}', begin);
    if (begin == std::string::npos || end == std::string::npos) return choices;
    std::string word;
    for (const char c : type.substr(begin + 1, end - begin - 1) + ",") {
        if (c != ',') {
            word += c;
        } else if (!word.empty()) {
            choices.push_back(std::exchange(word, {}));
        }
    }
    return choices;
}

Option option_of(const CLI::Option& option) {
    Option result;
    for (const auto& name : option.get_snames()) result.names.push_back("-" + name);
    for (const auto& name : option.get_lnames()) result.names.push_back("--" + name);
    if (result.names.empty()) result.names.push_back(option.get_name());
    result.help = option.get_description();
    result.choices = choices_in(option.get_type_name());
    result.takes_value = option.get_items_expected_max() > 0;
    result.is_file = result.takes_value && result.choices.empty() && option.get_type_name().starts_with("TEXT");
    result.required = option.get_required();
    return result;
}

std::string joined(const std::vector<std::string>& words, const char* between = " ") {
    return fmt::format("{}", fmt::join(words, between));
}

// Every command with the words that lead to it: "batch plan".
void visit(const CommandLine& command, const std::string& path, auto&& use) {
    use(command, path);
    for (const auto& one : command.commands) visit(one, path.empty() ? one.name : path + " " + one.name, use);
}

std::string in_quotes(const std::string& text) {
    std::string quoted = "'";
    for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return quoted + "'";
}

// ---- bash ----------------------------------------------------------------------------------------------------------

std::string bash_script(const CommandLine& program) {
    std::string steps, values, words;
    visit(program, "", [&](const CommandLine& command, const std::string& path) {
        std::vector<std::string> options, others;
        bool files = false;
        for (const auto& option : command.options) {
            for (const auto& name : option.names) {
                options.push_back(name);
                if (!option.takes_value) continue;
                values += fmt::format("        '{}:{}') words={}; files={} ;;\n", path, name,
                                      in_quotes(joined(option.choices)), option.is_file ? "yes" : "");
            }
        }
        for (const auto& argument : command.arguments) {
            others.insert(others.end(), argument.choices.begin(), argument.choices.end());
            files = files || argument.is_file;
        }
        for (const auto& one : command.commands) {
            others.push_back(one.name);
            steps += fmt::format("            '{} {}') path='{}' ;;\n", path, one.name,
                                 path.empty() ? one.name : path + " " + one.name);
        }
        words += fmt::format("        '{}') options={}; words={}; files={} ;;\n", path, in_quotes(joined(options)),
                             in_quotes(joined(others)), files ? "yes" : "");
    });
    return fmt::format(R"(# Completion of tribode for bash, made by: tribode completion bash
_tribode() {{
    local current=${{COMP_WORDS[COMP_CWORD]}} previous=${{COMP_WORDS[COMP_CWORD-1]}} path= word options= words= files=
    for word in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
        case "$path $word" in
{}        esac
    done
    COMPREPLY=()
    case "$path:$previous" in
{}        *) previous= ;;
    esac
    if [ -z "$previous" ]; then
        case "$path" in
{}        esac
        case "$current" in -*) words=$options files= ;; esac
    fi
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current"; [ -z "$files" ] || compgen -f -- "$current")
}}
complete -o filenames -F _tribode tribode
)",
                       steps, values, words);
}

// ---- zsh -----------------------------------------------------------------------------------------------------------

// A text inside a specification of _arguments.
std::string zsh_text(const std::string& text) {
    std::string safe;
    for (const char c : text) {
        if (c == '[' || c == ']' || c == ':' || c == '\\') safe += '\\';
        safe += c;
    }
    return safe;
}

std::string zsh_action(const Option& option) {
    if (!option.choices.empty()) return ":value:(" + joined(option.choices) + ")";
    return option.is_file ? ":value:_files" : ":value: ";
}

std::string zsh_function(const std::string& path) {
    std::string name = "_tribode";
    if (!path.empty()) name += "_" + path;
    std::replace(name.begin(), name.end(), ' ', '_');
    std::replace(name.begin(), name.end(), '-', '_');
    return name;
}

std::string zsh_script(const CommandLine& program) {
    std::string text = "#compdef tribode\n# Completion of tribode for zsh, made by: tribode completion zsh\n";
    visit(program, "", [&](const CommandLine& command, const std::string& path) {
        text += fmt::format("\n{}() {{\n    local state line\n    _arguments -C", zsh_function(path));
        for (const auto& option : command.options) {
            for (const auto& name : option.names) {
                text += " \\\n        " + in_quotes(fmt::format("*{}[{}]{}", name, zsh_text(option.help),
                                                                option.takes_value ? zsh_action(option) : ""));
            }
        }
        if (!command.commands.empty()) {
            text +=
                " \\\n        '1: :->command' '*::argument:->rest'\n    case $state in\n    command)\n        _values "
                "command";
            for (const auto& one : command.commands) {
                text += " \\\n            " + in_quotes(fmt::format("{}[{}]", one.name, zsh_text(one.help)));
            }
            text += "\n        ;;\n    rest)\n        case $line[1] in\n";
            for (const auto& one : command.commands) {
                text += fmt::format("        {}) {} ;;\n", one.name,
                                    zsh_function(path.empty() ? one.name : path + " " + one.name));
            }
            text += "        esac\n        ;;\n    esac\n";
        } else {
            for (const auto& argument : command.arguments)
                text += " \\\n        " + in_quotes("*" + zsh_action(argument));
            text += "\n";
        }
        text += "}\n";
    });
    return text + "\n_tribode \"$@\"\n";
}

// ---- fish ----------------------------------------------------------------------------------------------------------

std::string fish_script(const CommandLine& program) {
    std::string text = "# Completion of tribode for fish, made by: tribode completion fish\ncomplete -c tribode -f\n";
    visit(program, "", [&](const CommandLine& command, const std::string& path) {
        std::vector<std::string> below;
        for (const auto& one : command.commands) below.push_back(one.name);
        std::string when = "true";
        std::istringstream steps(path);
        for (std::string step; steps >> step;) when += "; and __fish_seen_subcommand_from " + step;
        const std::string here = below.empty() ? when : when + "; and not __fish_seen_subcommand_from " + joined(below);
        for (const auto& one : command.commands) {
            text +=
                fmt::format("complete -c tribode -n {} -a {} -d {}\n", in_quotes(here), one.name, in_quotes(one.help));
        }
        for (const auto& option : command.options) {
            std::string line = "complete -c tribode -n " + in_quotes(here);
            for (const auto& name : option.names) {
                line += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
            }
            if (option.takes_value) line += option.is_file ? " -rF" : " -x";
            if (!option.choices.empty()) line += " -a " + in_quotes(joined(option.choices));
            text += line + " -d " + in_quotes(option.help) + "\n";
        }
        for (const auto& argument : command.arguments) {
            const std::string what = argument.is_file           ? "-F"
                                     : argument.choices.empty() ? ""
                                                                : "-a " + in_quotes(joined(argument.choices));
            if (!what.empty()) text += fmt::format("complete -c tribode -n {} {}\n", in_quotes(here), what);
        }
    });
    return text;
}

// ---- manual --------------------------------------------------------------------------------------------------------

std::string troff(const std::string& text) {
    std::string safe;
    for (const char c : text) {
        if (c == '\\') {
            safe += "\\e";
        } else if (c == '-') {
            safe += "\\-";
        } else {
            safe += c;
        }
    }
    return safe.starts_with('.') || safe.starts_with('\'') ? "\\&" + safe : safe;
}

std::string in_bold(const std::vector<std::string>& names) {
    std::string text;
    for (const auto& name : names) text += (text.empty() ? "\\fB" : ", \\fB") + troff(name) + "\\fR";
    return text;
}

} // namespace

CommandLine command_line(const CLI::App& app) {
    CommandLine command{app.get_name(), app.get_description(), {}, {}, {}};
    for (const auto* option : app.get_options()) {
        (option->get_positional() ? command.arguments : command.options).push_back(option_of(*option));
    }
    for (const auto* one : app.get_subcommands(nullptr)) command.commands.push_back(command_line(*one));
    return command;
}

std::string completion_script(const CommandLine& program, const std::string& shell) {
    return shell == "bash" ? bash_script(program) : shell == "zsh" ? zsh_script(program) : fish_script(program);
}

std::string manual_page(const CommandLine& program) {
    std::string text =
        fmt::format(".\\\" Made by: tribode help --man\n.TH TRIBODE 1 \"\" \"tribode {}\" \"Tribode\"\n"
                    ".SH NAME\ntribode \\- {}\n.SH SYNOPSIS\n.B tribode\n\\fICOMMAND\\fR [\\fIOPTION\\fR...]\n",
                    version(), troff(program.help.substr(program.help.find(": ") + 2)));
    text += ".SH COMMANDS\n";
    visit(program, "", [&](const CommandLine& command, const std::string& path) {
        if (path.empty()) return;
        std::string usage = "tribode " + path;
        for (const auto& argument : command.arguments) {
            usage += argument.required ? " " + argument.names[0] : " [" + argument.names[0] + "]";
        }
        text += fmt::format(".SS {}\n{}\n", troff(usage), troff(command.help));
        for (const auto& argument : command.arguments) {
            text += fmt::format(".TP\n\\fI{}\\fR\n{}\n", troff(argument.names[0]), troff(argument.help));
        }
        for (const auto& option : command.options) {
            text += fmt::format(".TP\n{}{}\n{}\n", in_bold(option.names), option.takes_value ? " \\fIVALUE\\fR" : "",
                                troff(option.help));
            if (!option.choices.empty()) text += troff("One of " + joined(option.choices, ", ") + ".") + "\n";
        }
    });
    return text +
           ".SH EXIT STATUS\n.TP\n0\ndone\n.TP\n2\nwrong usage or input\n.TP\n3\nthe run ended early\n.TP\n75\na shard "
           "was interrupted\n.TP\n1\nanything else\n"
           ".SH ENVIRONMENT\n.TP\n\\fBXDG_STATE_HOME\\fR\nthe history of \\fBtribode repl\\fR is in its folder tribode "
           "(default ~/.local/state)\n"
           ".SH EXAMPLES\n.nf\ntribode run \\-e \\(aqprint(tb.version)\\(aq\n"
           "tribode simulate \\-\\-machine models/bare_mass.lua \\-\\-input record.csv \\-o \\-\n.fi\n";
}

} // namespace tribode
