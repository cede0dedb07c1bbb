#include "messages.hpp"
#include "temporary_folder.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/script/machine_file.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

class MachineFileTest : public ::testing::Test {
  protected:
    std::string problem(const std::filesystem::path& file) const {
        return problem_of([&] { read_description(file, {.instructions = 100'000}); });
    }
    TemporaryFolder folder;
};

TEST_F(MachineFileTest, LuaAndJsonGiveTheSameTable) {
    const auto lua = folder.write("m.lua", "return {Ts = 0.0005, modes = {{freq_hz = 33.32, gain = 0.01308}}}");
    const auto json = folder.write("m.json", R"({"Ts": 0.0005, "modes": [{"freq_hz": 33.32, "gain": 0.01308}]})");
    EXPECT_EQ(read_description(lua).dump(), read_description(json).dump());
    EXPECT_EQ(read_description(lua)["modes"][0]["freq_hz"], Json(33.32));
}

TEST_F(MachineFileTest, ALuaMachineMayTakeAnArgument) {
    const auto file = folder.write("m.lua", "local options = ... or {}\nreturn {table = options.table_ii or 'read'}");
    EXPECT_EQ(read_description(file)["table"], Json("read"));
    EXPECT_EQ(read_description(file, {}, {{"table_ii", "printed"}})["table"], Json("printed"));
}

TEST_F(MachineFileTest, ALuaMachineMayUseModulesOfItsFolder) {
    folder.write("common.lua", "return {Ts = 0.001}");
    EXPECT_EQ(read_description(folder.write("m.lua", "return require 'common'"))["Ts"], Json(0.001));
}

TEST_F(MachineFileTest, ALuaMachineMayNotTouchOtherFiles) {
    EXPECT_NE(problem(folder.write("a.lua", "io.open('/etc/passwd')")).find("a.lua:1: \"/etc/passwd\" is outside"),
              std::string::npos);
    const std::string own = (folder / "new.txt").string();
    EXPECT_NE(problem(folder.write("b.lua", "io.open('" + own + "', 'w')")).find("a script writes only there"),
              std::string::npos);
    EXPECT_FALSE(std::filesystem::exists(own));
}

TEST_F(MachineFileTest, AnEndlessMachineEnds) {
    EXPECT_NE(problem(folder.write("m.lua", "while true do end")).find("ran more than 100000 instructions"),
              std::string::npos);
}

TEST_F(MachineFileTest, WhatIsNoTableIsRefused) {
    EXPECT_NE(problem(folder.write("a.lua", "return 5")).find("a.lua: must return a table of named fields"),
              std::string::npos);
    EXPECT_NE(problem(folder.write("b.lua", "x = 1")).find("b.lua: must return a table"), std::string::npos);
    EXPECT_NE(problem(folder.write("c.json", "[1]")).find("c.json: must hold a table"), std::string::npos);
    EXPECT_NE(problem(folder.write("d.txt", "{}")).find("d.txt: a description is a .lua or a .json file"),
              std::string::npos);
}

TEST_F(MachineFileTest, ErrorsNameFileAndLine) {
    EXPECT_NE(problem(folder.write("a.lua", "return {\n  Ts = = 1}")).find("a.lua:2: unexpected symbol"),
              std::string::npos);
    EXPECT_NE(problem(folder.write("b.json", "{\n  \"Ts\": ,\n}")).find("b.json:2:"), std::string::npos);
}

TEST(ReadyMachines, AreWrittenAsTheyWereReadAndKeepTheirHashes) {
    std::size_t count = 0;
    const std::map<std::string, std::string> hashes = {
        {"linear_motor_table.lua", "05d7eaacc2e6d7e11f449f098b12cd6541bbae60f8752fffe0bb01712dc18cea"},
        {"bare_mass.lua", "f485d9fd89a1320260a5664c47a733c040170e55d2fb3b82bc02d9cff2e628b0"},
        {"ball_screw_axis.lua", "fb52b5cf5cadbd40e2c02fd7a611855920ae94b69d4a0d421e0cf53a7c859e67"}};
    for (const auto& file : std::filesystem::directory_iterator(std::string(TRIBODE_SOURCE_DIR) + "/models")) {
        if (!file.is_regular_file()) continue;
        ++count;
        const std::string name = file.path().filename().string();
        const MachineModel machine = MachineModel::from_description(read_description(file.path()), name);
        const MachineModel again = MachineModel::from_description(machine.description(), name);
        EXPECT_EQ(again.description().dump(), machine.description().dump()) << name;
        EXPECT_EQ(again.hash(), machine.hash()) << name;
        EXPECT_EQ(machine.warnings(name), std::vector<std::string>()) << name;
        // As in result files written before; a new machine has none there.
        if (hashes.contains(name)) {
            EXPECT_EQ(machine.hash(), hashes.at(name)) << name;
        }
    }
    EXPECT_GE(count, hashes.size());
}

} // namespace
} // namespace tribode
