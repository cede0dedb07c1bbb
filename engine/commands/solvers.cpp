#include "commands/command.hpp"
#include "commands/option_flags.hpp"
#include "tribode/solver/method.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

struct SolversCommand final : Command {
    void add_to(CLI::App& app, Common& common) override { common.add_json(app); }

    int run(const Common& common) override {
        Json list = Json::array();
        std::string text;
        for (const auto& entry : method_list()) {
            const std::string name = name_of(entry.method);
            const std::string method = without_marks(entry.what), suited_to = without_marks(entry.suited_to);
            const bool fixed_step = has_fixed_step(entry.method);
            text += fmt::format("{:<20} {}\n{:<20} for {}\n", name, method, "", suited_to);
            list.push_back({{"name", name}, {"method", method}, {"suited_to", suited_to}, {"fixed_step", fixed_step}});
        }
        common.print(text, list);
        return done;
    }
};

} // namespace

std::unique_ptr<Command> solvers_command() { return std::make_unique<SolversCommand>(); }

} // namespace tribode
