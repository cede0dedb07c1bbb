#include "tribode/base/error.hpp"
#include "tribode/experiment/system_run.hpp"
#include "tribode/fmu/fmu_export.hpp"
#include "tribode/fmu_import/unit_system.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/zip.hpp"
#include "tribode/system/system_builder.hpp"
#include "tribode/system/units.hpp"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>

namespace tribode {
namespace {

namespace fs = std::filesystem;

class Import : public testing::Test {
  protected:
    Import() {
        std::string name = (fs::temp_directory_path() / "tribode import XXXXXX").string();
        folder_ = ::mkdtemp(name.data());
    }
    ~Import() override { fs::remove_all(folder_); }

    std::shared_ptr<const UnitFile> file_of(const std::string& bytes) const {
        write_file(folder_ / "unit.fmu", bytes);
        return std::make_shared<const UnitFile>(folder_ / "unit.fmu");
    }
    std::string refusal(const std::string& bytes) const {
        try {
            equations_of_unit(file_of(bytes), 0.01);
        } catch (const InputError& problem) {
            return problem.what();
        }
        return "none";
    }
    // A unit with this description and an empty library.
    static std::string described(const std::string& text, const std::string& library = "") {
        return zip_archive({{"modelDescription.xml", text}, {"binaries/linux64/unit.so", library}});
    }

    fs::path folder_;
};

// A state that follows its input, with a rate that is a parameter.
Equations follower() {
    SystemBuilder builder("follower");
    const Expression x = builder.state("x", 0.25, "m");
    const auto graph = builder.time().graph();
    const Expression u(graph, graph->variable("u")), rate(graph, graph->variable("rate"));
    builder.rate(x, rate * (u - x));
    builder.output("y", 2 * x, "m");
    Equations made = builder.equations();
    made.inputs.push_back({"u", "m", 1, u.in(*made.graph)});
    made.parameters.push_back({"rate", "1/s", 3, rate.in(*made.graph)});
    return made;
}

const std::string& unit_of_follower(FmiVersion version) {
    const auto made = [](FmiVersion v) {
        return fmu_of_system(follower(), {.version = v, .model_exchange = false, .name = "unit"});
    };
    static const std::string of_2 = made(FmiVersion::fmi2), of_3 = made(FmiVersion::fmi3); // packing takes long
    return version == FmiVersion::fmi2 ? of_2 : of_3;
}

// With u = t, held over each interval: x by hand.
std::vector<double> by_hand(double rate, double period, int count) {
    std::vector<double> y;
    double x = 0.25;
    for (int k = 0; k < count; ++k) {
        y.push_back(2 * x);
        const double u = k * period;
        x = u + (x - u) * std::exp(-rate * period);
    }
    return y;
}

// The same as a block: its input connected to the time.
SystemRun run_of(Equations block, double end, double period) {
    const Equations::Input u = block.inputs.at(0);
    block.inputs.clear();
    block.replace({{u.symbol, block.time}});
    SystemRunOptions options;
    options.end = end;
    options.output_step = period;
    return run_system(EquationSystem(std::move(block)), options);
}

class ImportOf : public Import, public testing::WithParamInterface<FmiVersion> {};

TEST_P(ImportOf, AUnitIsASampledBlock) {
    const double period = 0.05;
    const Equations block = equations_of_unit(file_of(unit_of_follower(GetParam())), period);
    ASSERT_EQ(block.inputs.size(), 1u);
    EXPECT_EQ(block.inputs[0].name, "u");
    EXPECT_EQ(block.inputs[0].value, 1);
    EXPECT_EQ(dimension_of(block.inputs[0].unit), dimension_of("m"));
    const auto is_rate = [](const auto& p) { return p.name == "rate"; };
    ASSERT_EQ(std::count_if(block.parameters.begin(), block.parameters.end(), is_rate), 1);
    const SystemRun run = run_of(block, 1, period);
    ASSERT_TRUE(run.outcome.ok()) << run.outcome.message;
    const auto expected = by_hand(3, period, 21);
    const auto& y = run.table.find("y")->values;
    // Left limits: what the sample before has set.
    for (std::size_t k = 1; k < y.size(); ++k) EXPECT_NEAR(y[k], expected[k - 1], 1e-12) << k;
}

TEST_P(ImportOf, ParametersAreThoseOfTheRunAndEachRunHasItsOwnInstance) {
    Equations block = equations_of_unit(file_of(unit_of_follower(GetParam())), 0.05);
    const SystemRun first = run_of(block, 1, 0.05);
    for (auto& parameter : block.parameters) {
        if (parameter.name == "rate") parameter.value = 7;
    }
    const SystemRun fast = run_of(block, 1, 0.05);
    EXPECT_NEAR(fast.table.find("y")->values[20], by_hand(7, 0.05, 21)[19], 1e-12);
    EXPECT_NEAR(first.table.find("y")->values[20], by_hand(3, 0.05, 21)[19], 1e-12);
}

INSTANTIATE_TEST_SUITE_P(Versions, ImportOf, testing::Values(FmiVersion::fmi2, FmiVersion::fmi3));

TEST_F(Import, WhatHasMemoryIsNeitherLinearizedNorContinued) {
    const Equations block = equations_of_unit(file_of(unit_of_follower(FmiVersion::fmi2)), 0.05);
    const EquationSystem system(block);
    SystemRunOptions options;
    options.end = 0.1;
    const SystemRun run = run_system(system, options);
    EXPECT_THROW(system.restored(run.state.system), InputError);
}

TEST_F(Import, TheFolderGoesWithTheUnit) {
    fs::path folder;
    {
        const auto unit = file_of(unit_of_follower(FmiVersion::fmi3));
        folder = unit->folder();
        EXPECT_TRUE(fs::exists(unit->library()));
    }
    EXPECT_FALSE(fs::exists(folder));
}

TEST_F(Import, DamagedArchivesGiveOneSentence) {
    const std::string whole = unit_of_follower(FmiVersion::fmi2);
    EXPECT_NE(refusal("").find("is no functional mock-up unit"), std::string::npos);
    EXPECT_NE(refusal("PK").find("is no functional mock-up unit"), std::string::npos);
    for (const std::size_t kept : {whole.size() / 2, whole.size() - 10}) {
        EXPECT_NE(refusal(whole.substr(0, kept)).find("is no functional mock-up unit"), std::string::npos) << kept;
    }
    std::string flipped = whole;
    flipped[whole.size() / 2] = static_cast<char>(flipped[whole.size() / 2] ^ 0x10);
    EXPECT_NE(refusal(flipped), "none");
    EXPECT_NE(refusal(zip_archive({{"a", "b"}})).find("modelDescription.xml in it is missing"), std::string::npos);
}

TEST_F(Import, DescriptionsThatAreNoneGiveOneSentence) {
    const auto with = [&](const std::string& attributes, const std::string& children) {
        return refusal(described("<fmiModelDescription " + attributes + ">" + children + "</fmiModelDescription>"));
    };
    const std::string kind = "<CoSimulation modelIdentifier=\"unit\"/>", of_2 = "fmiVersion=\"2.0\"";
    EXPECT_NE(refusal(described("no XML")).find("is no XML"), std::string::npos);
    EXPECT_NE(refusal(described("<other/>")).find("has no element fmiModelDescription"), std::string::npos);
    EXPECT_NE(with("fmiVersion=\"1.0\"", kind).find("is of FMI 1.0"), std::string::npos);
    EXPECT_NE(with(of_2, "<ModelExchange modelIdentifier=\"unit\"/>").find("is no unit for co-simulation"),
              std::string::npos);
    EXPECT_NE(with(of_2, "<CoSimulation modelIdentifier=\"../x\"/>").find("must be the name of a library"),
              std::string::npos);
    EXPECT_NE(with(of_2, "<CoSimulation modelIdentifier=\"other\"/>").find("has no binaries/linux64/other.so"),
              std::string::npos);
    EXPECT_NE(
        with(of_2, "<CoSimulation modelIdentifier=\"unit\" needsExecutionTool=\"true\"/>").find("needs the program"),
        std::string::npos);
    EXPECT_NE(with(of_2, kind).find("its library cannot be loaded"), std::string::npos);
    EXPECT_NE(with(of_2, kind + "<ModelVariables><ScalarVariable name=\"u\" valueReference=\"1\" causality=\"input\">"
                                "<Real start=\"x\"/></ScalarVariable></ModelVariables>")
                  .find("variable u: start = \"x\", must be a finite number"),
              std::string::npos);
    EXPECT_NE(refusal(zip_archive({{"modelDescription.xml",
                                    "<fmiModelDescription fmiVersion=\"2.0\">" + kind + "</fmiModelDescription>"},
                                   {"binaries/linux64/unit.so", ""},
                                   {"resources/../../out", "x"}}))
                  .find("leads out of the unit"),
              std::string::npos);
}

TEST(UnitsOfFmi, AreThoseOfSystems) {
    EXPECT_EQ(dimension_of(unit_from_fmi("N.m")), dimension_of("N m"));
    EXPECT_EQ(dimension_of(unit_from_fmi("kg.m2/s2")), dimension_of("N m"));
    EXPECT_EQ(unit_from_fmi("..(/"), "");
}

} // namespace
} // namespace tribode
