#include "cli/program.hpp"
#include "tribode/base/json.hpp"
#include "unit/script/temporary_folder.hpp"

#include <gtest/gtest.h>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

// Table IV: the proposed model first and settled by 50 ms, with the paper's models and with those identified here. A second
// run that is given the identified models comes to the same numbers.
TEST(Positioning, TheProposedModelComesFirstAndTheModelsMayBeGiven) {
    const TemporaryFolder folder;
    const auto script = (fs::path(TRIBODE_SOURCE_DIR) / "scripts/positioning.lua").string();
    auto ending = run({"run", script, "--quick", "--quiet", "-o", "out"}, {.folder = folder.path()});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const auto text = text_of(folder / "out/summary.json");
    const auto summary = Json::parse(text);
    ASSERT_EQ(summary.size(), 2u);
    for (const auto* models : {"paper", "identified"}) {
        const auto& group = summary.at(models);
        ASSERT_EQ(group.size(), 3u);
        for (const auto* name : {"FRA-1", "FRA-2", "Proposed"}) {
            const auto& entry = group.at(name);
            EXPECT_EQ(entry.size(), 3u) << name;
            EXPECT_GT(entry.at("max_error_um").get<double>(), entry.at("rmse_um").get<double>()) << name;
        }
        const auto rmse = [&](const char* name) { return group.at(name).at("rmse_um").get<double>(); };
        EXPECT_LT(rmse("Proposed"), rmse("FRA-1")) << models;
        EXPECT_LT(rmse("Proposed"), rmse("FRA-2")) << models;
        EXPECT_LE(group.at("Proposed").at("settling_ms").get<double>(), 50) << models;
    }

    ending = run({"run", script, "--quick", "--quiet", "-D", "identified=out/identified.json", "-o", "again"},
                 {.folder = folder.path()});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    EXPECT_EQ(text_of(folder / "again/summary.json"), text);
}

} // namespace
} // namespace tribode::cli
