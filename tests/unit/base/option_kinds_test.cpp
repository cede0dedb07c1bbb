#include "tribode/base/error.hpp"
#include "tribode/base/field_rows.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

struct Inner {
    double depth = 2;
    static void describe(auto& o, auto& fields) { fields.number("depth_m", o.depth, "m", Allowed::positive); }
};

struct Sample {
    enum class Kind { round, square };
    double length = 0.5, limit = 0; // 0: none
    int count = 3;
    std::size_t first = 0;
    bool fast = true;
    std::optional<double> mass;
    std::optional<int> legs;
    std::vector<std::string> colors = {"red"};
    Kind kind = Kind::square;
    std::vector<long> parts = {1, 2};
    std::vector<double> times = {0.25};
    std::optional<Inner> inner;

    static void describe(auto& o, auto& fields) {
        fields.number("length_m", o.length, "m", Allowed::non_negative, "how long");
        fields.number("limit", o.limit, "", Allowed::positive);
        fields.integer("count", o.count, 1, 9);
        fields.index("first", o.first, 1L << 53, "the first one");
        fields.flag("fast", o.fast);
        fields.number("mass_kg", o.mass, "kg", Allowed::positive);
        fields.integer("legs", o.legs, 0, 4);
        fields.choice("kind", o.kind, {"round", "square"}, About("its form").also({"quadratic", "square"}));
        fields.choices("colors", o.colors, {"red", "green"});
        fields.integers("parts", o.parts, 1, 5);
        fields.numbers("times_s", o.times, "s", Allowed::positive, 3);
        fields.table("inner", o.inner);
    }
    void check(const FieldReader& fields) const {
        if (count == 7) fields.fail("count", "must not be 7");
    }
};

Sample read(const Json& json) {
    FieldReader fields(json, "sample");
    Sample sample;
    read_options(sample, fields);
    fields.finish();
    return sample;
}

std::string problem(const Json& json) {
    try {
        read(json);
    } catch (const InputError& error) {
        return error.what();
    }
    return "";
}

TEST(OptionKinds, are_written_as_they_are_read) {
    const Json given = {{"length_m", 0.0}, {"limit", 3.0},     {"count", 4},
                        {"first", 5},      {"fast", false},    {"mass_kg", 2.0},
                        {"legs", 0},       {"kind", "round"},  {"colors", {"green", "red"}},
                        {"parts", {5, 1}}, {"times_s", {1.5}}, {"inner", {{"depth_m", 4.0}}}};
    const Sample sample = read(given);
    EXPECT_EQ(sample.first, 4u); // the user counts from 1
    EXPECT_EQ(options_json(sample), given);
    EXPECT_FALSE(read(Json::object()).mass);
    EXPECT_FALSE(read(Json::object()).legs);
    EXPECT_EQ(options_json(Sample())["legs"], Json());
}

TEST(OptionKinds, an_alias_is_its_name) {
    EXPECT_EQ(read({{"kind", "quadratic"}}).kind, Sample::Kind::square);
    EXPECT_EQ(problem({{"kind", "oval"}}), "sample: kind = \"oval\", must be one of round, square (also quadratic)");
}

TEST(OptionKinds, refuse_what_is_not_allowed) {
    EXPECT_EQ(problem({{"parts", {2, 1.5}}}), "sample: parts[2] = 1.5, must be a whole number from 1 to 5");
    EXPECT_EQ(problem({{"first", 0}}), "sample: first = 0, must be a whole number from 1 to 9007199254740992");
    EXPECT_EQ(problem({{"legs", 5}}), "sample: legs = 5, must be a whole number from 0 to 4");
    EXPECT_EQ(problem({{"mass_kg", 0}}), "sample: mass_kg = 0 kg, must be positive and finite");
    EXPECT_EQ(problem({{"colors", {"blue"}}}), "sample: colors has \"blue\", must have some of red, green");
    EXPECT_EQ(problem({{"colors", Json::array()}}), "sample: colors is empty, must have one of red, green or more");
    EXPECT_EQ(problem({{"count", 7}}), "sample: count must not be 7"); // check()
}

TEST(OptionKinds, have_rows_with_unit_range_default_and_meaning) {
    std::string all;
    for (const auto& row : field_rows<Sample>()) {
        all += fmt::format("{}|{}|{}|{}|{}\n", row.path, row.unit, row.values, row.fallback, row.about.meaning);
    }
    EXPECT_EQ(all, "length_m|m|≥ 0|0.5|how long\n"
                   "limit||> 0|none|\n"
                   "count||whole, 1 to 9|3|\n"
                   "first||whole, ≥ 1|1|the first one\n"
                   "fast||true or false|true|\n"
                   "mass_kg|kg|> 0|none|\n"
                   "legs||whole, 0 to 4|none|\n"
                   "kind||`\"round\"`, `\"square\"` (also `\"quadratic\"`)|`\"square\"`|its form\n"
                   "colors||list of `\"red\"`, `\"green\"`|{ \"red\" }|\n"
                   "parts||list of numbers, each whole, 1 to 5|{ 1, 2 }|\n"
                   "times_s|s|list of numbers, each > 0|{ 0.25 }|\n"
                   "inner||table|none|\n"
                   "inner.depth_m|m|> 0|2|\n");
}

} // namespace
} // namespace tribode
