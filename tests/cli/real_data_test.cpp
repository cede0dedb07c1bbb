#include "cli/program.hpp"
#include "tribode/base/json.hpp"
#include "unit/script/temporary_folder.hpp"

#include <gtest/gtest.h>

namespace tribode::cli {
namespace {

std::string script(const std::string& name) {
    return (std::filesystem::path(TRIBODE_SOURCE_DIR) / "scripts" / name).string();
}

TEST(RealData, WithoutTheFolderAScriptSaysWhereTheDataComeFrom) {
    const TemporaryFolder folder;
    for (const auto& [name, file, source] :
         {std::tuple{"emps.lua", "emps_train.csv", "A. Janot"},
          {"silverbox.lua", "silverbox.csv", "T. Wigren"},
          {"cascaded_tanks.lua", "est.csv", "nonlinearbenchmark.org"},
          {"pendulum.lua", "swing_A.csv", "dynamicslab/MultiArm-Pendulum"},
          {"cogging.lua", "map_a_16.csv", "gchenfc/ODrive"},
          {"seal.lua", "oring_a_1bar.csv", "EvaZillen/3D-printed-pneumatic-actuator"}}) {
        expect_sentence(run({"run", script(name), "-o", "out"}, {.folder = folder.path()}), 2,
                        {"-D data= is missing", file, source});
        folder.write("empty/note.txt", "");
        expect_sentence(run({"run", script(name), "-D", "data=empty", "-o", "out"}, {.folder = folder.path()}), 2,
                        {file, "No such file"});
    }
}

// Records of a rig with known numbers, in the form of the benchmark: they must come back.
TEST(RealData, InverseDynamicsAndTheClosedLoopGiveBackTheNumbersOfTheRig) {
    const TemporaryFolder folder;
    folder.write("rig.lua", R"(
        local tb = require "tribode"
        local volt = 35.15065188248547
        local machine = tb.machine "models/ball_screw_axis.lua"
        machine.rigid_gain_per_kg, machine.friction = 1 / 90, { coulomb = 18, viscous = 230 }
        machine.controller.delay_samples = 0
        machine.effects = { { name = "constant_force", parameters = { F = 4 } } }
        local r, pulses, nothing = {}, {}, {}
        for k = 1, 4000 do
            local t = (k - 1) * 1e-3
            r[k] = 0.06 * math.sin(2 * math.pi * 0.8 * t) * math.min(t, 1) + 0.001 * math.sin(2 * math.pi * 5 * t) * math.min(t, 1)
            nothing[k], pulses[k] = 0, k % 1000 < 50 and 20 or 0
        end
        for name, exc in pairs { train = nothing, test_pulses = pulses } do
            local run = tb.simulate { machine = machine, r = r, exc = exc }
            for k = 1, #r do run.u[k], exc[k] = run.u[k] / volt, exc[k] / volt end
            tb.write_csv { file = "emps_" .. name .. ".csv", columns = { { name = "t_s", values = run.t },
                { name = "u_V", values = run.u }, { name = "q_m", values = run.y }, { name = "qref_m", values = r },
                { name = "pulse_V", values = exc } } }
        end)");
    auto ending = run({"run", "rig.lua", "-o", "rig", "--quiet"}, {.folder = folder.path()});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    ending = run({"run", script("emps.lua"), "--quick", "-D", "data=rig", "-o", "out", "--quiet"},
                 {.folder = folder.path()});
    ASSERT_EQ(ending.exit_code, 0) << ending.err;
    const Json models = Json::parse(text_of(folder / "out/emps.json"))["models"];
    const Json& whole = models[3];
    for (const auto& [name, truth] : {std::pair{"M", 90.0}, {"Fv", 230.0}, {"Fc", 18.0}, {"offset", -4.0}}) {
        // Hold and differences cost inverse dynamics something; the simulation knows of both.
        EXPECT_NEAR(whole["values"][name].get<double>() / truth, 1, 0.08) << name;
        EXPECT_NEAR(whole["loop"]["values"][name].get<double>() / truth, 1, 1e-3) << name;
    }
    EXPECT_GT(models[0]["train"].get<double>(), 1.5 * whole["train"].get<double>());
    // What is on both sides alike is no friction by direction.
    const Json& sides = models[4]["loop"]["values"];
    EXPECT_NEAR(sides["Fv+"].get<double>() / sides["Fv-"].get<double>(), 1, 0.02);
    EXPECT_NEAR(sides["Fc+"].get<double>() - sides["Fc-"].get<double>(), -8, 0.2); // the offset on both
}

} // namespace
} // namespace tribode::cli
