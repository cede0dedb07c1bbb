#include "cli/program.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/output_file.hpp"
#include "unit/script/temporary_folder.hpp"

#include <filesystem>
#include <gtest/gtest.h>
#include <regex>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

struct Shown {
    std::string command;
    int exit_code;
};

// The commands of the page, in the cells of its tables behind the feature: all before the packages, which take minutes.
std::vector<Shown> commands() {
    const std::string page = read_file(fs::path(TRIBODE_SOURCE_DIR) / "docs/features.md");
    std::istringstream lines(page.substr(0, page.find("## Packages")));
    std::vector<Shown> list;
    for (std::string line; std::getline(lines, line);) {
        if (!line.starts_with("| ") || line.starts_with("| feature |")) continue;
        static const std::regex code("`([^`]+)`"), exit_code("exit code ([0-9])"), bar(R"(\\\|)");
        std::smatch found;
        const int wanted = std::regex_search(line, found, exit_code) ? std::stoi(found[1]) : 0;
        const std::string cell = line.substr(0, line.rfind(" | "));
        for (std::sregex_iterator it(cell.begin(), cell.end(), code), end; it != end; ++it) {
            list.push_back({std::regex_replace((*it)[1].str(), bar, "|"), wanted});
        }
    }
    return list;
}

// In a folder that has what the repository has, where results do not go into it.
TEST(Features, EveryCommandOfThePageDoesWhatItSays) {
    const TemporaryFolder folder;
    for (const char* part : {"docs", "models", "scripts"}) {
        fs::create_directory_symlink(fs::path(TRIBODE_SOURCE_DIR) / part, folder / part);
    }
    fs::create_symlink(TRIBODE_PROGRAM, folder / "tribode");
    fs::create_directory(folder / "results");
    const std::string enter = "cd '" + folder.path().string() + "' && PATH=\"$PWD:$PATH\" && ";
    const std::vector<Shown> all = commands();
    EXPECT_GT(all.size(), 40U);
    for (const auto& [command, exit_code] : all) {
        const std::string output = " > said.txt 2>&1 < /dev/null";
        const int status = std::system((enter + "(" + command + ")" + output).c_str());
        EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == exit_code) << command << "\n"
                                                                           << read_file(folder / "said.txt");
    }
    // What the page says is there.
    for (const char* file : {"systems/bouncing_ball.png",
                             "simulate/friction.png",
                             "method_comparison/work_precision.png",
                             "fra_comparison/bode.png",
                             "fra/response.csv",
                             "fra/fit.json",
                             "fra/report.html",
                             "sensitivity/tornado.png",
                             "batch.h5",
                             "run.csv",
                             "events.csv",
                             "run.h5",
                             "run.mat",
                             "mat/v73.mat",
                             "mat/dymola.mat",
                             "systems/stick_slip.svg",
                             "completion.bash",
                             "tribode.lua",
                             "diagnosis/report.html",
                             "axis.fmu"}) {
        EXPECT_TRUE(fs::exists(folder / "results" / file)) << file;
    }
    EXPECT_NE(read_file(folder / "results/fra/response.csv").find("coherence"), std::string::npos);
    EXPECT_NE(read_file(folder / "results/fra/fit.json").find("standard_errors"), std::string::npos);
    EXPECT_NE(read_file(folder / "results/diagnosis/diagnosis.json").find("force_ripple"), std::string::npos);
}

} // namespace
} // namespace tribode::cli
