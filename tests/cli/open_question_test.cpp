#include "cli/program.hpp"
#include "tribode/base/json.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cmath>
#include <complex>
#include <gtest/gtest.h>
#include <numbers>

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

// At 15 N the proposed analysis errs by the gain of hold and current loop; with the causes off it finds the plant.
TEST(OpenQuestion, TheImprovedAnalysisRecoversAllParametersAndTheLargestCauseIsTheGain) {
    const TemporaryFolder folder;
    const auto script = fs::path(TRIBODE_SOURCE_DIR) / "scripts/open_question.lua";
    const auto ending = run({"run", script.string(), "--quick", "-D", "amplitudes=15", "-o", "out", "--quiet"},
                            {.folder = folder.path()});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const auto found = Json::parse(text_of(folder / "out/open_question.json"));
    // The claim: 0.5 %; 1 % for the small damping of the second mode, on which few frequencies lie.
    for (const auto& [name, error] : found.at("Improved").at("errors").items()) {
        EXPECT_LT(std::abs(error.get<double>()), name == "zeta2" ? 0.01 : 0.005) << name;
    }
    EXPECT_EQ(found.at("Improved").at("errors").size(), 7u);
    EXPECT_EQ(found.at("largest_cause"), "gain of hold and current loop");
    // sinc(f Ts)/sqrt(1 + (f/750 Hz)^2) falls with f^2 by 5.0 % at 200 Hz, on the mean over the band by 1.8 %; the
    // modes and the robust loss share that out a little differently.
    EXPECT_NEAR(found.at("Proposed").at("errors").at("k0").get<double>(), -0.018, 0.003);

    // The two parts of the error of FRA-1. That of the loop needs no simulation: hold, dead times and lag against the delay that
    // was read.
    const auto fra1 = found.at("amplitudes").at(0).at("FRA-1");
    const double read = fra1.at("delay_s").get<double>(), pi = std::numbers::pi;
    double squares = 0;
    constexpr int count = 40;
    for (int i = 0; i < count; ++i) {
        const double f = 20 + 180.0 * i / (count - 1), half_turn = pi * f * 500e-6;
        const auto loop = std::polar(std::sin(half_turn) / half_turn, -half_turn - 2 * pi * f * (918e-6 - read)) /
                          std::complex(1.0, f / 750);
        squares += std::norm(loop - 1.0) / count;
    }
    EXPECT_NEAR(fra1.at("loop_alone").get<double>(), std::sqrt(squares), 1e-6);
    EXPECT_GT(fra1.at("friction_alone").get<double>(), fra1.at("rms_distance").get<double>());
}

} // namespace
} // namespace tribode::cli
