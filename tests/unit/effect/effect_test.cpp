#include "tribode/base/error.hpp"
#include "tribode/effect/effect.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <iterator>
#include <set>

namespace tribode {
namespace {

Effect read(const std::string& text) {
    const Json json = Json::parse(text);
    FieldReader fields(json, "machine.json", "effects[1]");
    Effect effect = Effect::read(fields);
    fields.finish();
    return effect;
}

std::string refusal(const std::string& text) {
    try {
        read(text);
    } catch (const InputError& error) {
        return error.what();
    }
    return "";
}

TEST(Effect, kinds_have_names_of_their_own_and_say_all_of_themselves) {
    std::set<std::string> names;
    for (const auto* kind : effect_kinds()) {
        EXPECT_TRUE(names.insert(kind->name).second) << kind->name;
        EXPECT_FALSE(kind->equation.empty()) << kind->name;
        EXPECT_TRUE(kind->summary.ends_with('.')) << kind->name;
        EXPECT_FALSE(kind->lua.empty()) << kind->name;
        for (const auto& simpler : kind->simpler) EXPECT_NO_THROW(effect_kind(simpler)) << kind->name;
        EXPECT_EQ(&effect_kind(kind->name), kind);
        EXPECT_FALSE(kind->parameters.empty()) << kind->name;
        const auto check = [&](const EffectParameter& p) {
            EXPECT_FALSE(p.meaning.empty()) << kind->name << "." << p.name;
            if (p.type == EffectParameter::Type::number) {
                EXPECT_LT(p.plausible_min, p.plausible_max) << kind->name << "." << p.name;
            }
        };
        for (const auto& p : kind->parameters) {
            check(p);
            for (const auto& field : p.fields) check(field);
        }
    }
    // None is lost on the way from the files to the list.
    std::set<std::string> files;
    for (const auto& file : std::filesystem::directory_iterator(TRIBODE_SOURCE_DIR "/engine/tribode/effect/kinds")) {
        files.insert(file.path().stem().string());
    }
    EXPECT_EQ(names, files);
}

TEST(Effect, kinds_are_listed_in_their_order_and_tried_in_another) {
    std::set<int> orders, fit_orders;
    for (const auto* kind : effect_kinds()) {
        if (!orders.empty()) {
            EXPECT_GT(kind->order, *orders.rbegin()) << kind->name;
        }
        orders.insert(kind->order);
        if (kind->forms) {
            EXPECT_TRUE(fit_orders.insert(kind->fit_order).second) << kind->name;
        }
    }
}

TEST(Effect, examples_can_be_read_and_are_allowed) {
    for (const auto* kind : effect_kinds()) {
        const Effect effect = read(Json{{"name", kind->name}, {"parameters", Json::parse(kind->example)}}.dump());
        EXPECT_NO_THROW(effect.require_allowed()) << kind->name;
        EXPECT_EQ(effect.numbers().size(), effect.number_names().size());
    }
}

TEST(Effect, neutral_parameters_are_its_own) {
    for (const auto* kind : effect_kinds()) {
        const auto names = Effect(*kind).number_names();
        for (const auto& [name, value] : kind->neutral) {
            EXPECT_NE(std::find(names.begin(), names.end(), name), names.end()) << kind->name << "." << name;
        }
    }
}

TEST(Effect, what_is_left_out_is_what_the_kind_says) {
    const Effect effect = read(R"({"name": "encoder_periodic_error", "parameters": {"A": 1e-6, "period_m": 1e-4}})");
    EXPECT_EQ(effect.numbers(), (std::vector<double>{1e-6, 1e-4, 0, 0, 0}));
    EXPECT_EQ(read(R"({"name": "spring_force", "parameters": {"k": 5}})").number("y0"), 0);
}

TEST(Effect, what_it_writes_reads_back_as_the_same) {
    for (
        const std::string text :
        {R"({"name":"force_ripple","parameters":{"harmonics":[{"F":1.0,"period_m":0.02,"phase":0.5}]}})",
         R"({"name":"presliding_hysteresis","parameters":{"elements":[{"K":1000.0,"F":1.0,"D":0.0}],"replace_coulomb":true}})",
         R"({"name":"backlash","parameters":{"gap_m":1e-05,"load_fraction":0.5,"contact_hz":100.0,"contact_zeta":0.1,"sensor":"load"}})",
         R"({"name":"own_force","parameters":{"force":"return -k*y","states":["z"],"rates":"return v","constants":{"k":2.0}}})"}) {
        EXPECT_EQ(read(text).to_json().dump(), text);
    }
}

TEST(Effect, its_numbers_can_be_moved_all_together) {
    const Effect effect = read(R"({"name": "force_ripple", "parameters": {"harmonics": [{"F": 1, "period_m": 2}]}})");
    const Effect moved = effect.with_numbers({3, 4, 5});
    EXPECT_EQ(moved.records("harmonics"), (std::vector<std::vector<double>>{{3, 4, 5}}));
    EXPECT_EQ(effect.numbers(), (std::vector<double>{1, 2, 0}));
    EXPECT_EQ(effect.number_names(),
              (std::vector<std::string>{"harmonics[1].F", "harmonics[1].period_m", "harmonics[1].phase"}));
    EXPECT_EQ(effect.kind().unit_of("harmonics[1].period_m"), "m");
    EXPECT_THROW(effect.with_numbers({1, 0, 0}).require_allowed(), InputError);
    EXPECT_THROW(effect.with_numbers({NAN, 1, 0}).require_allowed(), InputError);
}

TEST(Effect, wrong_ones_are_refused_with_the_field_and_what_is_allowed) {
    EXPECT_EQ(refusal(R"({"name": "sprng_force", "parameters": {"k": 1}})"),
              "machine.json: effects[1].name = \"sprng_force\" is not a known effect (did you mean \"spring_force\"?)");
    EXPECT_EQ(refusal(R"({"name": "spring_force", "parameters": {"kk": 1, "k": 2}})"),
              "machine.json: effects[1].parameters.kk is not a known field (did you mean \"k\"?)");
    EXPECT_EQ(refusal(R"({"name": "spring_force"})"),
              "machine.json: effects[1].parameters.k is missing (a number in N/m)");
    EXPECT_EQ(refusal(R"({"name": "thrust_gain", "parameters": {"gain": 0}})"),
              "machine.json: effects[1].parameters.gain = 0, must be positive and finite");
    EXPECT_EQ(refusal(R"({"name": "time_varying_friction", "parameters": {"kind": "step", "a": 1, "T": 1}})"),
              "machine.json: effects[1].parameters.kind = \"step\", must be one of exp, ramp, sine");
    EXPECT_EQ(refusal(R"({"name": "force_ripple", "parameters": {}})"),
              "machine.json: effects[1].parameters.harmonics is missing or empty, must be a list of one table or more");
}

// The amplifier's order does not depend on the order of the effects: u = 12 N, saturated to 10, less 1, doubled.
TEST(Effect, saturation_dead_zone_and_gain_act_in_this_order) {
    ServoAxis axis;
    for (const std::string text : {R"({"name": "thrust_gain", "parameters": {"gain": 2}})",
                                   R"({"name": "dead_zone", "parameters": {"half_width": 1}})",
                                   R"({"name": "thrust_saturation", "parameters": {"limit": 10}})"}) {
        read(text).apply(axis);
    }
    EXPECT_EQ(axis.amplifier(12), 18);
    EXPECT_EQ(axis.amplifier(-12), -18);
    EXPECT_EQ(axis.amplifier(0.5), 0);
    EXPECT_EQ(axis.amplifier.slope(12), 0);
    EXPECT_EQ(axis.amplifier.slope(5), 2);
}

TEST(Effect, a_power_law_of_the_thrust_is_steep_as_it_says_and_there_once) {
    ServoAxis axis;
    const auto law = read(R"({"name": "thrust_power_law", "parameters": {"exponent": 2, "size": 10}})");
    law.apply(axis);
    EXPECT_DOUBLE_EQ(axis.amplifier(5), 2.5);
    EXPECT_DOUBLE_EQ(axis.amplifier(-20), -40);
    EXPECT_DOUBLE_EQ(axis.amplifier.slope(5), 1);
    EXPECT_DOUBLE_EQ(axis.amplifier.slope(-5), 1);
    EXPECT_THROW(law.apply(axis), InputError);
    // Between dead zone and gain.
    read(R"({"name": "thrust_gain", "parameters": {"gain": 3}})").apply(axis);
    read(R"({"name": "dead_zone", "parameters": {"half_width": 1}})").apply(axis);
    EXPECT_DOUBLE_EQ(axis.amplifier(6), 7.5);
    EXPECT_DOUBLE_EQ(axis.amplifier.slope(6), 3);
    EXPECT_EQ(axis.amplifier(0.5), 0);
}

// The page's tables stand between two lines of comments. The variable writes them anew.
TEST(Effect, the_tables_of_its_page_are_those_of_the_code) {
    const std::string page = TRIBODE_SOURCE_DIR "/docs/effects.md";
    std::ifstream file(page, std::ios::binary);
    std::string text{std::istreambuf_iterator<char>(file), {}};
    const std::string begin = "<!-- made from the code: begin -->\n\n", end = "\n<!-- made from the code: end -->";
    const std::size_t from = text.find(begin) + begin.size(), to = text.find(end);
    ASSERT_NE(to, std::string::npos);
    ASSERT_GE(from, begin.size()); // npos would have wrapped round
    if (std::getenv("TRIBODE_UPDATE_PAGES")) {
        std::ofstream(page, std::ios::binary) << text.substr(0, from) << effect_tables() << text.substr(to);
        return;
    }
    EXPECT_EQ(text.substr(from, to - from), effect_tables())
        << "docs/effects.md is not up to date: run TRIBODE_UPDATE_PAGES=1 build/release/test_effect";
}

} // namespace
} // namespace tribode
