#pragma once
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace tribode {

// The commands and their options as data, for what is made from them: completions of shells, the manual page.
struct CommandLine {
    struct Option {
        std::vector<std::string> names; // "-o", "--out"; of a positional argument its own
        std::string help;
        std::vector<std::string> choices; // where only some words are allowed
        bool takes_value = false;
        bool is_file = false; // the value may be one: a text that is no choice
        bool required = false;
    };

    std::string name, help;
    std::vector<Option> options, arguments;
    std::vector<CommandLine> commands;
};

CommandLine command_line(const CLI::App& app);

// The texts that a shell reads: "bash", "zsh" or "fish".
std::string completion_script(const CommandLine& program, const std::string& shell);
// The page of man(1), in troff.
std::string manual_page(const CommandLine& program);

} // namespace tribode
