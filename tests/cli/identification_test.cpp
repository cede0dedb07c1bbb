#include "cli/program.hpp"
#include "tribode/base/json.hpp"
#include "unit/script/temporary_folder.hpp"

#include <gtest/gtest.h>

// The claims of the scripts that identify friction and delay, on the reference machine.

namespace tribode::cli {
namespace {

namespace fs = std::filesystem;

// What the script wrote into `file`.
Json result_of(const std::string& script, const std::string& file, const std::vector<std::string>& options) {
    const TemporaryFolder folder;
    std::vector<std::string> arguments = {"run", (fs::path(TRIBODE_SOURCE_DIR) / "scripts" / script).string(), "-o",
                                          "out", "--quiet"};
    for (const auto& option : options) {
        arguments.push_back("-D");
        arguments.push_back(option);
    }
    const auto ending = run(arguments, {.folder = folder.path()});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    return Json::parse(text_of(folder / ("out/" + file)));
}

constexpr double coulomb_level = 15.39 / 2; // N: half of the sum of Table II
constexpr double true_viscous = 2.35;       // N s/m

TEST(FrictionIdentification, FindsLevelAndViscousFrictionAndPredictsARecordItHasNotSeen) {
    const auto found = result_of("friction_identification.lua", "friction.json", {"elements=8,20", "periods=2"});
    const auto held_out = [&](const char* n, const char* kind) {
        return found.at("held_out_rms").at(n).at(kind).get<double>() / coulomb_level;
    };
    // The claim: 1 % of the Coulomb level with twenty elements, 3 % with eight, wherever their break points are.
    for (const auto* kind : {"geometric_N", "optimised_N"}) {
        EXPECT_LT(held_out("20", kind), 0.01) << kind;
        EXPECT_LT(held_out("8", kind), 0.03) << kind;
        EXPECT_GT(held_out("8", kind), held_out("20", kind)) << kind;
    }
    EXPECT_LT(held_out("8", "optimised_N"), held_out("8", "geometric_N"));
    // The claim: 2 %; so near, too, is the level of the elements.
    EXPECT_NEAR(found.at("friction").at("viscous").get<double>() / true_viscous, 1, 0.02);
    EXPECT_NEAR(found.at("level_N").get<double>() / coulomb_level, 1, 0.02);
    double level = 0;
    for (const auto& element : found.at("friction").at("elements")) level += element.at("F").get<double>();
    EXPECT_NEAR(level / coulomb_level, 1, 0.02);
}

TEST(DelayIdentification, FrictionShortensTheReadingOfThePaperAndNotTheOtherOne) {
    const auto found =
        result_of("delay_identification.lua", "delay.json", {"amplitudes=15,50", "frequencies=96", "at_hz=120"});
    ASSERT_EQ(found.at("readings").size(), 2u);
    for (const auto& reading : found.at("readings")) {
        // Hold 0.25, computation 0.5, lag 0.2104 at 120 Hz, encoder and transfer 0.418 ms.
        EXPECT_NEAR(reading.at("true_s").get<double>(), 1.3784e-3, 1e-7); // the digits given
        // The claim: 10 us.
        EXPECT_NEAR(reading.at("with_friction_model_s").get<double>(), 1.3784e-3, 10e-6);
    }
    // An independent simulation found 1.25 and 1.31 ms.
    EXPECT_NEAR(found.at("readings").at(0).at("eq_18_s").get<double>(), 1.25e-3, 15e-6);
    EXPECT_NEAR(found.at("readings").at(1).at("eq_18_s").get<double>(), 1.31e-3, 15e-6);
    // Above 100 Hz the paper's Fig. 10 has 25 us; without the friction the amplitudes agree within a tenth of that.
    const auto& dispersion = found.at("mean_dispersion_above_100_hz_s");
    EXPECT_GT(dispersion.at("eq_18").get<double>(), 10e-6);
    EXPECT_LT(dispersion.at("with_friction_model").get<double>(), 2.5e-6);
}

TEST(AmplitudeFamily, SmallErrorsOfTheDelayDoLittleHarm) {
    const auto found = result_of("amplitude_family.lua", "summary.json", {"amplitudes=15,50", "frequencies=200"});
    const auto& wrong = found.at("wrong_delay");
    ASSERT_EQ(wrong.size(), 4u);
    for (std::size_t i = 0; i < 3; ++i) {
        // The claim: 0.5 dB, and 1 deg beyond the delay itself; near resonances beyond its share of the thrust.
        EXPECT_LT(wrong[i].at("outside_db").get<double>(), 0.5);
        EXPECT_LT(wrong[i].at("outside_excess_deg").get<double>(), 1);
        EXPECT_LT(wrong[i].at("inside_excess_deg").get<double>(), 1);
    }
    EXPECT_GT(wrong[3].at("outside_db").get<double>(), 0.5); // without any delay model it does harm
    // The amplitude shows in FRA-1 and not in the proposed analysis.
    for (const auto* band : {"below 20 Hz", "around 34 Hz", "around 82 Hz"}) {
        const auto& spread = found.at("spread_db").at(band);
        EXPECT_GT(spread.at("fra1").get<double>(), 0.5) << band;
        EXPECT_LT(spread.at("proposed").get<double>(), 0.1) << band;
    }
}

} // namespace
} // namespace tribode::cli
