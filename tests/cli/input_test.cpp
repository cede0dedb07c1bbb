#include "cli/program.hpp"
#include "unit/script/temporary_folder.hpp"

#include <gtest/gtest.h>

namespace tribode::cli {
namespace {

// What `tribode simulate` says of machines and records that are wrong: one sentence, exit code 2, no file.
class Input : public ::testing::Test {
  protected:
    Input() {
        folder.write("mass.json", R"({"rigid_gain_per_kg": 0.1})");
        folder.write("in.csv", "t,u\n0,0\n0.0005,1\n0.001,1\n");
    }

    void expect_refused(const std::string& machine, const std::string& input, const std::vector<std::string>& parts,
                        const std::vector<std::string>& more = {}) {
        std::vector<std::string> arguments = {"simulate", "--machine", machine,    "--input",   input,
                                              "-o",       "out.csv",   "--events", "events.csv"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        const auto before = files_in(folder.path());
        expect_sentence(run(arguments, {.folder = folder.path()}), 2, parts);
        EXPECT_EQ(files_in(folder.path()), before);
    }

    void expect_machine_refused(const std::string& name, const std::string& text,
                                const std::vector<std::string>& parts) {
        folder.write(name, text);
        expect_refused(name, "in.csv", parts);
    }

    void expect_record_refused(const std::string& text, const std::vector<std::string>& parts) {
        folder.write("wrong.csv", text);
        expect_refused("mass.json", "wrong.csv", parts);
    }

    TemporaryFolder folder;
};

TEST_F(Input, AMissingFileIsNamed) {
    expect_refused("missing.lua", "in.csv", {"missing.lua", "No such file"});
    expect_refused("missing.json", "in.csv", {"missing.json", "No such file"});
    expect_refused("mass.json", "missing.csv", {"missing.csv", "No such file"});
}

TEST_F(Input, AMisspeltFieldIsRefusedWithTheNearestOne) {
    expect_machine_refused("m.lua", "return { rigid_gain_per_kg = 0.1, fricton = {} }",
                           {"m.lua: fricton", "did you mean \"friction\"?"});
    expect_machine_refused("m.json", R"({"rigid_gain_per_kg": 0.1, "friction": {"viscos": 2}})",
                           {"m.json: friction.viscos", "did you mean \"viscous\"?"});
}

TEST_F(Input, ANegativeStiffnessIsRefusedWithItsField) {
    const std::string elements = "{ elements = { { K = 1e5, F = 1 }, { K = -2.1e5, F = 1 } } }";
    expect_machine_refused("m.lua", "return { rigid_gain_per_kg = 0.1, friction = " + elements + " }",
                           {"m.lua: friction.elements[2].K", "-210000 N/m", "must be positive and finite"});
}

TEST_F(Input, TextWhereANumberMustBeIsRefused) {
    expect_machine_refused("m.lua", "return { rigid_gain_per_kg = 'heavy' }",
                           {"m.lua: rigid_gain_per_kg", "\"heavy\"", "must be a number"});
}

TEST_F(Input, AMachineFileWithAnErrorIsRefusedWithItsLine) {
    expect_machine_refused("m.lua", "return {\n  rigid_gain_per_kg = = 0.1,\n}", {"m.lua:2:", "'='"});
    expect_machine_refused("n.lua", "local a\nreturn { rigid_gain_per_kg = a.b }", {"n.lua:2:", "'a'"});
    expect_machine_refused("m.json", "{\n \"rigid_gain_per_kg\": 0.1,,\n}", {"m.json:2:", "','"});
    expect_machine_refused("m.yaml", "rigid_gain_per_kg: 0.1", {"m.yaml", ".lua", ".json"});
}

TEST_F(Input, AMachineFileReadsInItsOwnFolderOnly) {
    expect_machine_refused("m.lua", "io.open('/etc/passwd')\nreturn { rigid_gain_per_kg = 0.1 }",
                           {"m.lua:1:", "/etc/passwd", "outside"});
}

TEST_F(Input, ANumberThatIsNotFiniteIsRefusedWithItsLine) {
    expect_record_refused("t,u\n0,0\n0.0005,nan\n", {"wrong.csv:3", "column u", "nan", "finite"});
    expect_record_refused("t,u\n0,0\n0.0005,-inf\n", {"wrong.csv:3", "column u", "-inf", "finite"});
}

TEST_F(Input, TextInARecordIsRefusedWithItsLine) {
    expect_record_refused("t,u\n0,0\n0.0005,one\n", {"wrong.csv:3", "column u", "\"one\"", "must be a number"});
    expect_record_refused("t,u\n0,0\n0.0005\n", {"wrong.csv:3", "1 value", "2"});
}

TEST_F(Input, AGapInTimeIsRefusedWithItsLine) {
    expect_record_refused("t,u\n0,0\n0.0005,1\n0.0015,1\n",
                          {"wrong.csv:4", "t = 0.0015 s", "expected 0.001 s", "gap in time"});
}

TEST_F(Input, TimeThatDoesNotIncreaseIsRefused) {
    expect_record_refused("t,u\n0,0\n0.0005,1\n0.0005,1\n", {"wrong.csv:4", "must increase"});
}

TEST_F(Input, AnotherSampleTimeIsRefused) {
    expect_record_refused("t,u\n0,0\n0.0004,1\n0.0008,1\n",
                          {"wrong.csv:3", "t = 4e-04 s", "expected 0.0005 s", "another sample time"});
}

TEST_F(Input, ARecordWithoutInputIsRefused) {
    expect_record_refused("t,y\n0,0\n0.0005,1\n", {"wrong.csv", "u (open loop)", "r or exc (closed loop)"});
    expect_record_refused("t,r\n0,0\n0.0005,1\n", {"wrong.csv", "controller"});
    expect_record_refused("t,u\n", {"wrong.csv", "no rows"});
    expect_record_refused("", {"wrong.csv"});
}

TEST_F(Input, AnUnknownColumnIsRefused) {
    expect_record_refused("t,u,excc\n0,0,0\n0.0005,1,0\n", {"wrong.csv", "\"excc\"", "did you mean \"exc\"?"});
}

TEST_F(Input, AnUnknownSolverIsRefusedWithThoseThereAre) {
    expect_refused("mass.json", "in.csv", {"\"rk45\"", "exact", "erk", "adams", "cvode", "fixed"},
                   {"--solver", "rk45"});
}

TEST_F(Input, TolerancesAndStepMustBePositive) {
    expect_refused("mass.json", "in.csv", {"--rtol", "-1", "positive"}, {"--rtol", "-1"});
    expect_refused("mass.json", "in.csv", {"--atol", "0", "positive"}, {"--atol", "0"});
    expect_refused("mass.json", "in.csv", {"--step", "-0.001", "positive"}, {"--solver", "fixed", "--step", "-1e-3"});
    expect_refused("mass.json", "in.csv", {"--step", "0", "positive"}, {"--solver", "fixed", "--step", "0"});
}

TEST_F(Input, ColumnsAndScalesMustFitTheRecord) {
    expect_refused("mass.json", "in.csv", {"in.csv", "u_V"}, {"--columns", "t=t,u=u_V"});
    expect_refused("mass.json", "in.csv", {"--columns", "\"u_V\"", "name=value"}, {"--columns", "u_V"});
    expect_refused("mass.json", "in.csv", {"--scale u=big", "must be a number"}, {"--scale", "u=big"});
    expect_refused("mass.json", "in.csv", {"no column r"}, {"--scale", "r=2"});
    expect_refused("mass.json", "in.csv", {"--columns", "t stands twice"}, {"--columns", "t=t,t=u"});
}

TEST_F(Input, ARecordInAFormatThatIsNotReadOrIsCutShortIsRefused) {
    folder.write("picture.png", std::string("\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16));
    expect_refused("mass.json", "picture.png", {"picture.png", "CSV, MAT", "HDF5"});
    folder.write("cut.h5", "\x89HDF\r\n\x1a\n");
    expect_refused("mass.json", "cut.h5", {"cut.h5", "HDF5"});
    folder.write("cut.csv.gz", std::string("\x1f\x8b\x08\0\0\0\0\0\0\0", 10));
    expect_refused("mass.json", "cut.csv.gz", {"cut.csv.gz", "cut short"});
    std::string head(128, ' ');
    head.replace(124, 4, std::string("\0\1IM", 4));
    folder.write("cut.mat", head + "\x0e");
    expect_refused("mass.json", "cut.mat", {"cut.mat", "cut short"});
}

} // namespace
} // namespace tribode::cli
