#include "tribode/base/text.hpp"
#include "tribode/machine/machine_model.hpp"
#include "unit/script/messages.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fmt/format.h>
#include <fstream>
#include <sstream>

namespace tribode {
namespace {

const Json axis = Json::parse(R"({
    "Ts": 0.0005,
    "rigid_gain_per_kg": 0.09428,
    "modes": [{"gain": 0.01308, "freq_hz": 33.0, "zeta": 0.0248}, {"gain": 0.00527, "freq_hz": 82.0, "zeta": 0.01}],
    "friction": {
        "coulomb": 1.5,
        "stribeck": {"static": 2.5, "velocity": 0.01, "exponent": 0.8},
        "viscous": 2.35,
        "elements": [{"K": 210000.0, "F": 0.5, "D": 1.25}, {"K": 3600.0, "F": 0.36}]
    },
    "input_delay_s": 0.0005,
    "output_delay_s": 0.000418,
    "current_loop_hz": 750.0,
    "encoder_resolution_m": 1e-7,
    "noise_rms_m": 2e-8,
    "process_noise_rms_N": 0.3,
    "controller": {"type": "pid", "kp": 20500.0, "ki": 180000.0, "kd": 653.0, "derivative_filter_hz": 400.0},
    "closed_loop": true,
    "input": "hold",
    "initial": "fitted",
    "tolerance": {"rigid_gain_per_kg": 0.01, "modes.gain": 0.02, "modes.freq_hz": 0.03, "modes.zeta": 0.04,
                  "friction.coulomb": 0.05, "friction.viscous": 0.06, "friction.elements": 0.07,
                  "input_delay_s": 0.08, "current_loop_hz": 0.09},
    "effects": [
        {"name": "force_ripple", "parameters": {"harmonics": [{"F": 2.0, "period_m": 0.03, "phase": 0.0},
                                                              {"F": 1.0, "period_m": 0.01}]}},
        {"name": "position_dependent_friction", "parameters": {"mode": "gradient", "a": 0.1, "period_m": 0.2}}
    ]
})");

MachineModel model(const Json& description) { return MachineModel::from_description(description, "x.json"); }

TEST(MachineFields, ADescriptionIsWrittenAsItWasRead) {
    EXPECT_EQ(model(axis).description().dump(1), axis.dump(1));
    for (
        const char* text :
        {R"({"rigid_gain_per_kg":1.0})", R"({"rigid_gain_per_kg":1.0,"friction":{},"effects":[]})",
         R"({"rigid_gain_per_kg":1.0,"friction":{"coulomb":0.0},"tolerance":{}})",
         R"({"modes":[{"gain":1.0,"freq_hz":5.0,"zeta":0.0}],"friction":{"stribeck":{"static":1.0,"velocity":0.1}}})",
         R"({"rigid_gain_per_kg":1.0,"controller":{"kp":5.0},"closed_loop":false,"input":"hold"})",
         R"({"rigid_gain_per_kg":1.0,"controller":{"type":"cascade","kp":5.0,"kv":1.0,"limit":9.0,"delay_samples":1}})"}) {
        EXPECT_EQ(model(Json::parse(text)).description().dump(), text);
    }
}

// As they are in result files written before.
TEST(MachineFields, TheHashStaysThatOfTheFieldsThatWereWritten) {
    EXPECT_EQ(model(Json::parse(R"({"rigid_gain_per_kg": 1})")).hash(),
              "7a47f4758b3424bd1882a4eccf4f90f1d3a0f36a1434c5d18d413ea6bfb7d5e8");
    EXPECT_EQ(
        model(Json::parse(R"({"comment": "a note", "friction": {}, "rigid_gain_per_kg": 1.0, "controller": null})"))
            .hash(),
        "1de6d6014ccf0d1d18694140510ddd6d2e5cd74ddca56cfad2035155e10ecbfa");
    EXPECT_EQ(model(axis).hash(), "ded65c505ee77036e708de29a7f089c0dd2adece04e3ee899891492c992a28f6");
}

TEST(MachineFields, EveryNumberIsHashedWrittenAndRead) {
    const MachineModel original = model(axis);
    const std::size_t count = MachineModel(original).numbers().size();
    EXPECT_EQ(count, 47u);
    for (std::size_t i = 0; i < count; ++i) {
        MachineModel scaled = original;
        double& number = *scaled.numbers()[i];
        number = number == 0 ? 0.5 : number * 1.25;
        EXPECT_NE(scaled.hash(), original.hash()) << i;
        MachineModel again = model(scaled.description());
        ASSERT_EQ(again.numbers().size(), count) << i;
        EXPECT_EQ(*again.numbers()[i], number) << i;
        EXPECT_EQ(again.hash(), scaled.hash()) << i;
    }
}

TEST(MachineFields, AreReadByPath) {
    const MachineModel m = model(axis);
    EXPECT_EQ(m.field("modes[2].freq_hz"), 82.0);
    EXPECT_EQ(m.field("friction.elements[1].K"), 210000.0);
    EXPECT_EQ(m.field("friction.stribeck.exponent"), 0.8);
    EXPECT_EQ(m.field("controller.kp"), 20500.0);
    EXPECT_EQ(m.field("effects[1].parameters.harmonics[2].period_m"), 0.01);
    EXPECT_EQ(m.field("effects[2].parameters.mode"), "gradient");
    EXPECT_EQ(m.field("input"), "hold");
}

std::string refusal(const Json& replaced, const Json& scaled = nullptr) {
    return problem_of([&] { model(axis).with_fields(replaced, scaled, "test"); });
}

TEST(MachineFields, AreReplacedAndScaledByPath) {
    const MachineModel m = model(axis).with_fields({{"friction.viscous", 3},
                                                    {"modes[2].freq_hz", 80},
                                                    {"controller.kp", -5},
                                                    {"effects[2].parameters.a", 0.3},
                                                    {"effects[1].parameters.harmonics[*].F", 7},
                                                    {"closed_loop", false},
                                                    {"input", "band_limited"}},
                                                   {{"modes[*].gain", 2}, {"modes[2].freq_hz", 0.5}}, "test");
    EXPECT_EQ(m.viscous, 3);
    EXPECT_EQ(m.modes[1].freq_hz, 40); // replaced, then scaled
    EXPECT_EQ(m.modes[0].freq_hz, 33);
    EXPECT_EQ(m.modes[0].gain, 2 * 0.01308);
    EXPECT_EQ(m.modes[1].gain, 2 * 0.00527);
    EXPECT_EQ(std::get<PidController>(m.controller).kp, -5);
    EXPECT_EQ(std::get<PidController>(m.controller).ki, 180000);
    EXPECT_EQ(m.effects[1].number("a"), 0.3);
    EXPECT_EQ(m.effects[0].records("harmonics")[0][0], 7);
    EXPECT_EQ(m.effects[0].records("harmonics")[1][0], 7);
    EXPECT_FALSE(m.in_closed_loop());
    EXPECT_EQ(m.input, InputKind::band_limited);
    EXPECT_NE(m.hash(), model(axis).hash());
    EXPECT_EQ(model(m.description()).hash(), m.hash());
}

TEST(MachineFields, WholeTablesAndListsAreReplaced) {
    const MachineModel m = model(axis).with_fields(
        {{"friction", {{"viscous", 9}}},
         {"modes", {{{"gain", 0.5}, {"freq_hz", 7}, {"zeta", 0.1}}}},
         {"controller", {{"type", "cascade"}, {"kp", 1}, {"kv", 2}}},
         {"tolerance", {{"modes.gain", 0.5}}},
         {"effects[2].parameters", {{"mode", "sine"}, {"a", 0.2}, {"period_m", 0.1}, {"phase", 1}}}},
        nullptr, "test");
    // What the new table does not have is gone.
    EXPECT_EQ(m.description()["friction"].dump(), R"({"viscous":9.0})");
    EXPECT_FALSE(m.dry.present());
    EXPECT_TRUE(m.elements.empty());
    EXPECT_EQ(m.modes.size(), 1u);
    EXPECT_EQ(std::get<CascadeController>(m.controller).kv, 2);
    EXPECT_EQ(m.tolerance, (std::map<std::string, double>{{"modes.gain", 0.5}}));
    EXPECT_EQ(m.effects[1].choice("mode"), "sine");
    EXPECT_EQ(m.effects[1].number("phase"), 1);
    EXPECT_EQ(m.effects.size(), 2u);
    const MachineModel one =
        m.with_fields({{"modes[1]", {{"gain", 0.1}, {"freq_hz", 8}, {"zeta", 0}}}}, nullptr, "test");
    EXPECT_EQ(one.modes[0].freq_hz, 8);
}

TEST(MachineFields, TheCoulombLevelTakesTheStaticOneAlongWithoutAStribeckEffect) {
    const MachineModel plain = model({{"rigid_gain_per_kg", 1}, {"friction", {{"coulomb", 2}}}});
    EXPECT_EQ(plain.with_fields({{"friction.coulomb", 3}}, nullptr, "test").axis().plant.dry.static_level(), 3);
    EXPECT_EQ(plain.with_fields(nullptr, {{"friction.coulomb", 2}}, "test").axis().plant.dry.static_level(), 4);
    const MachineModel stribeck = model(axis).with_fields({{"friction.coulomb", 2}}, nullptr, "test");
    EXPECT_EQ(stribeck.axis().plant.dry.static_level(), 2.5);
}

TEST(MachineFields, PathsAndValuesThatCannotBeAreRefused) {
    EXPECT_EQ(refusal({{"modes[3].gain", 1}}), "input: test: modes[3].gain: modes has 2 entries");
    EXPECT_EQ(refusal({{"frction.viscous", 1}}),
              "input: test: frction.viscous: there is no frction (did you mean \"friction\"?)");
    EXPECT_EQ(refusal({{"Ts.x", 1}}), "input: test: Ts.x: Ts is no table of fields");
    EXPECT_EQ(refusal({{"friction[1].viscous", 1}}), "input: test: friction[1].viscous: friction is no list");
    EXPECT_EQ(refusal({{"friction.viscous", -1}}),
              "input: test: friction.viscous = -1 N s/m, must be zero or positive and finite");
    EXPECT_EQ(refusal({{"friction.viscous", nullptr}}), "input: test: friction.viscous = null, must be a value");
    EXPECT_EQ(refusal({{"friction.elements[2].K", "stiff"}}),
              "input: test: friction.elements[2].K = \"stiff\", must be a number");
    EXPECT_EQ(refusal({{"controller.type", "cascade"}}),
              "input: test: controller.type = \"pid\" cannot be replaced on its own, only the whole table around it");
    EXPECT_EQ(refusal({{"effects[1].name", "backlash"}}), "input: test: effects[1].name = \"force_ripple\" cannot be "
                                                          "replaced on its own, only the whole table around it");
    EXPECT_EQ(refusal({{"controller.type", "pid"}}), "none: ");
    EXPECT_EQ(refusal({{"input_delay_s", 60}}),
              "input: test: input_delay_s = 60 s, must be 100000 sample times at most");
    EXPECT_EQ(refusal({{"input_delay_s", 60}, {"Ts", 1}}), "none: "); // checked when all are replaced
    EXPECT_EQ(refusal(nullptr, {{"modes", 2}}), "input: test: modes is no number, so it cannot be multiplied");
    EXPECT_EQ(refusal(nullptr, {{"input", 2}}), "input: test: input is no number, so it cannot be multiplied");
    EXPECT_EQ(refusal(nullptr, {{"friction.elements[2].D", 2}}),
              "input: test: friction.elements[2].D is no number, so it cannot be multiplied");
    EXPECT_EQ(refusal(nullptr, {{"friction.viscous", -2}}),
              "input: test: friction.viscous = -4.7 N s/m, must be zero or positive and finite");
    EXPECT_EQ(refusal(nullptr, {{"Ts", "x"}}), "input: test: Ts: the factor must be a number");
    for (const char* path :
         {"", ".", "a..b", "modes[0].gain", "modes[1.gain", "modes[x].gain", "modes[1]x.gain", "[1]"}) {
        EXPECT_NE(refusal({{path, 1}}).find("is no path of a field"), std::string::npos) << path;
    }
}

TEST(MachineFields, UncertainFieldsAreThoseOfTheTolerance) {
    MachineModel m = model(axis);
    std::string all;
    for (const auto& field : m.uncertain_fields()) {
        all += fmt::format("{} {}:", field.name, field.deviation);
        for (const auto place : field.places) all += fmt::format(" {}", *m.numbers()[place]);
        all += "\n";
    }
    EXPECT_EQ(all, "rigid_gain_per_kg 0.01: 0.09428\n"
                   "modes[1].gain 0.02: 0.01308\nmodes[1].freq_hz 0.03: 33\nmodes[1].zeta 0.04: 0.0248\n"
                   "modes[2].gain 0.02: 0.00527\nmodes[2].freq_hz 0.03: 82\nmodes[2].zeta 0.04: 0.01\n"
                   "friction.coulomb 0.05: 1.5 2.5\nfriction.viscous 0.06: 2.35\n"
                   "friction.elements 0.07: 210000 0.5 3600 0.36\n"
                   "input_delay_s 0.08: 0.0005\ncurrent_loop_hz 0.09: 750\n");
    m.viscous = 0; // no factor moves it
    m.tolerance.erase("modes.gain");
    m.tolerance["input_delay_s"] = 0;
    for (const auto& field : m.uncertain_fields()) {
        EXPECT_NE(field.name, "friction.viscous");
        EXPECT_NE(field.name, "modes[1].gain");
        EXPECT_NE(field.name, "input_delay_s");
    }
}

TEST(MachineFields, ImplausibleValuesAreWarnedOf) {
    EXPECT_EQ(model(axis).warnings("x.json"), std::vector<std::string>());
    const auto warnings = [](const Json& replaced) {
        const auto all = model(axis).with_fields(replaced, nullptr, "test").warnings("x.json");
        return fmt::format("{}", fmt::join(all, "\n"));
    };
    EXPECT_EQ(warnings({{"encoder_resolution_m", 1}}),
              "x.json: encoder_resolution_m = 1 m is implausible, 1e-14 to 0.001 is usual; it is in meters");
    EXPECT_EQ(warnings({{"encoder_resolution_m", 0}}), "");
    EXPECT_EQ(warnings({{"rigid_gain_per_kg", 12}}),
              "x.json: rigid_gain_per_kg = 12 m/(N s^2) is implausible, 1e-06 to 10 is usual; it is the inverse of the "
              "moving mass, not the mass");
    EXPECT_EQ(warnings({{"modes[2].zeta", 3}}), "x.json: modes[2].zeta = 3 is implausible, 1e-06 to 1 is usual");
    EXPECT_EQ(warnings({{"tolerance", {{"modes.gain", 5}}}}),
              "x.json: tolerance.modes.gain = 5 is implausible, 1e-06 to 1 is usual; it is relative: 0.05 means 5 %");
    const MachineModel gear = model({{"rigid_gain_per_kg", 1},
                                     {"effects",
                                      {{{"name", "backlash"},
                                        {"parameters",
                                         {{"gap_m", 40},
                                          {"load_fraction", 0.5},
                                          {"contact_hz", 100},
                                          {"contact_zeta", 0.1},
                                          {"sensor", "motor"}}}}}}});
    EXPECT_EQ(
        gear.warnings("x.json"),
        std::vector<std::string>{"x.json: effects[1].parameters.gap_m = 40 m is implausible, 1e-08 to 0.1 is usual"});
}

// The page holds the table between two lines that mark it.
TEST(MachineFields, TheTableInTheDocumentationIsThatOfTheCode) {
    const std::string path = std::string(TRIBODE_SOURCE_DIR) + "/docs/machine-description.md";
    std::stringstream read;
    read << std::ifstream(path).rdbuf();
    std::string page = read.str();
    const std::string begin = "<!-- fields: begin -->\n", end = "<!-- fields: end -->\n";
    const auto from = page.find(begin), to = page.find(end);
    ASSERT_NE(from, std::string::npos);
    ASSERT_NE(to, std::string::npos);
    const auto start = from + begin.size();
    const std::string table = fmt::format("\n{}\n", MachineModel::field_table());
    if (std::getenv("TRIBODE_UPDATE_DOCS")) {
        page.replace(start, to - start, table);
        std::ofstream(path) << page;
        return;
    }
    EXPECT_EQ(page.substr(start, to - start), table)
        << "docs/machine-description.md is not what describe() of MachineModel says. To update the page:\n"
           "    TRIBODE_UPDATE_DOCS=1 build/release/tests/test_machine --gtest_filter='MachineFields.TheTable*'";
}

} // namespace
} // namespace tribode
