#include "commands/command.hpp"
#include "commands/command_line.hpp"
#include "tribode/effect/effect.hpp"
#include "tribode/script/lua_stub.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

struct CompletionCommand final : Command {
    void add_to(CLI::App& app, Common&) override {
        app.add_option(
               "shell", shell,
               "which one, e.g. source <(tribode completion bash); lua: the module tribode as a stub for editors")
            ->required()
            ->check(CLI::IsMember({"bash", "zsh", "fish", "lua"}));
        own = &app;
    }

    int run(const Common&) override {
        if (shell == "lua") {
            fmt::print("{}", lua_stub());
            return done;
        }
        CommandLine program = command_line(*own->get_parent());
        for (auto& command : program.commands) {
            if (command.name == "effects") {
                for (const auto* kind : effect_kinds()) command.arguments[0].choices.push_back(kind->name);
            }
            if (command.name == "help") {
                for (const auto& one : program.commands) command.arguments[0].choices.push_back(one.name);
            }
            if (command.name == "effects" || command.name == "help") command.arguments[0].is_file = false;
        }
        fmt::print("{}", completion_script(program, shell));
        return done;
    }

    std::string shell;
    CLI::App* own = nullptr;
};

} // namespace

std::unique_ptr<Command> completion_command() { return std::make_unique<CompletionCommand>(); }

} // namespace tribode
