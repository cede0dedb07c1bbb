#include "messages.hpp"
#include "tribode/script/lua_state.hpp"
#include "tribode/script/value.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>

namespace tribode {
namespace {

class ValueTest : public ::testing::Test {
  protected:
    static ScriptLimits limits() { return {.memory_bytes = std::size_t{64} << 20, .instructions = 10'000'000}; }

    Json from_lua(const std::string& expression) {
        return state.run_text("local value = " + expression + "\nreturn value", "t");
    }
    Json through_lua(const Json& value) { return state.run_text("return ...", "t", value); }
    std::string problem(const std::string& program) {
        return problem_of([&] { state.run_text(program, "t"); });
    }

    LuaState state{limits(), {}, {}};
};

TEST_F(ValueTest, PlainValuesKeepTheirKind) {
    EXPECT_EQ(from_lua("nil"), Json());
    EXPECT_EQ(from_lua("true"), Json(true));
    EXPECT_EQ(from_lua("'text'"), Json("text"));
    EXPECT_TRUE(from_lua("3").is_number_integer());
    EXPECT_TRUE(from_lua("3.0").is_number_float());
    EXPECT_EQ(from_lua("math.mininteger"), Json(std::numeric_limits<std::int64_t>::min()));
}

TEST_F(ValueTest, NumbersOutsideTheRealLineSurvive) {
    const Json values = through_lua({std::nan(""), INFINITY, -INFINITY, -0.0});
    EXPECT_TRUE(std::isnan(values[0].get<double>()));
    EXPECT_EQ(values[1].get<double>(), INFINITY);
    EXPECT_EQ(values[2].get<double>(), -INFINITY);
    EXPECT_TRUE(std::signbit(values[3].get<double>()));
}

TEST_F(ValueTest, DataComesBackAsItWas) {
    const auto data = Json::parse(R"({"Ts": 0.0005, "closed_loop": true, "friction": {"elements": [
        {"D": 1.5, "F": 0.25, "K": 210000}, {"D": 0.1, "F": 1e-300, "K": 1.7976931348623157e308}]},
        "name": "Tisch \u00e4\u0000", "numbers": [1, 2.5, -3]})");
    EXPECT_EQ(through_lua(data).dump(), data.dump());
}

TEST_F(ValueTest, FieldsAreSortedByName) {
    EXPECT_EQ(from_lua("{zeta = 1, alpha = 2, Mode = 3, alpha2 = 4}").dump(),
              R"({"Mode":3,"alpha":2,"alpha2":4,"zeta":1})");
}

TEST_F(ValueTest, TheKeysOneToNMakeAList) {
    EXPECT_EQ(from_lua("{10, 20, {30}}").dump(), "[10,20,[30]]");
    EXPECT_EQ(from_lua("{[3] = 'c', [1] = 'a', [2] = 'b'}").dump(), R"(["a","b","c"])");
    EXPECT_EQ(from_lua("{}").dump(), "{}");
}

TEST_F(ValueTest, ANullIsAbsent) {
    EXPECT_EQ(through_lua({{"stribeck", nullptr}, {"viscous", 2.0}}).dump(), R"({"viscous":2.0})");
}

TEST_F(ValueTest, LargeUnsignedNumbersBecomeTheNearestDouble) {
    EXPECT_EQ(through_lua(std::uint64_t{1} << 63), Json(9223372036854775808.0));
}

TEST_F(ValueTest, AMillionNumbersArriveInOrder) {
    const Json numbers = state.run_text("local t = {} for i = 1, 1000000 do t[i] = i + 0.5 end return t", "t");
    ASSERT_EQ(numbers.size(), 1000000u);
    EXPECT_EQ(numbers.front(), Json(1.5));
    EXPECT_EQ(numbers.back(), Json(1000000.5));
    EXPECT_EQ(through_lua(numbers), numbers);
}

TEST_F(ValueTest, WhatIsNotDataIsRefusedWithItsPath) {
    EXPECT_EQ(problem("return {modes = {{}, {gain = print}}}"),
              "input: t: the returned value.modes[2].gain is a function, must be plain data: nil, a boolean, "
              "number, "
              "text or table");
    EXPECT_EQ(problem("return {1, 2, name = 3}"),
              "input: t: the returned value has both numbered entries and named fields, must have one kind");
    EXPECT_EQ(problem("return {a = {[true] = 1}}"),
              "input: t: the returned value.a has a key that is a boolean, must be a text or a whole number");
    EXPECT_EQ(problem("return {[1.5] = 1}"),
              "input: t: the returned value has a key that is a number, must be a text or a whole number");
    EXPECT_EQ(problem("return {x = {1, nil, 3}}"),
              "input: t: the returned value.x[2] is missing: a list has the entries 1 to n without a hole");
    EXPECT_EQ(problem("return {x = {[0] = 1, [1] = 2}}"),
              "input: t: the returned value.x[2] is missing: a list has the entries 1 to n without a hole");
    EXPECT_EQ(problem("return {name = 'a\\xff'}"), "input: t: the returned value.name is a text that is not UTF-8");
}

TEST_F(ValueTest, ATableThatContainsItselfIsRefused) {
    EXPECT_EQ(problem("local t = {list = {1}} t.list[2] = t return t"),
              "input: t: the returned value.list[2] is a table that contains itself");
}

TEST_F(ValueTest, ATableMayStandAtTwoPlaces) {
    EXPECT_EQ(from_lua("(function() local t = {1} return {t, t} end)()").dump(), "[[1],[1]]");
}

TEST_F(ValueTest, SixtyFourLevelsAreTheMost) {
    const std::string nest = "local t = {} for i = 2, N do t = {t} end return t";
    const auto nested = [&](const std::string& levels) { return problem("local N = " + levels + " " + nest); };
    EXPECT_EQ(nested("64"), "none: ");
    EXPECT_NE(nested("65").find("is nested deeper than 64 levels"), std::string::npos);

    Json deep = Json::array();
    for (int level = 2; level <= 64; ++level) deep = Json::array({deep});
    EXPECT_EQ(through_lua(deep).dump().size(), 2u * 64u); // the innermost comes back as {}
    EXPECT_THROW(through_lua(Json::array({deep})), InputError);
}

// Twenty-five tables in Lua, 2^25 values as data.
TEST_F(ValueTest, SharedTablesDoNotGrowBeyondTheMemoryLimit) {
    LuaState small({.memory_bytes = std::size_t{1} << 20}, {}, {});
    const std::string bomb = "local t = {0} for i = 1, 24 do t = {t, t} end return t";
    const std::string text = problem_of([&] { small.run_text(bomb, "t"); });
    EXPECT_NE(text.find("is part of a value larger than the memory limit of the script"), std::string::npos) << text;
}

TEST_F(ValueTest, MetatablesAreIgnored) {
    EXPECT_EQ(from_lua("setmetatable({1}, {__index = error, __len = error, __pairs = error})").dump(), "[1]");
}

} // namespace
} // namespace tribode
