#include "tribode/base/field_reader.hpp"
#include "unit/script/messages.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace tribode {
namespace {

constexpr long any = 1000;

// What `read` says about the fields in `text`, read from "m.lua"; "none: " where it accepts them.
std::string problem(const std::string& text, const std::function<void(FieldReader&)>& read) {
    const Json fields = Json::parse(text);
    return problem_of([&] {
        FieldReader reader(fields, "m.lua");
        read(reader);
        reader.finish();
    });
}

// The same for a number as only Lua can write it.
std::string problem_of_number(double value, Allowed allowed) {
    const Json fields = {{"x", value}};
    return problem_of([&] { FieldReader(fields, "m.lua").number("x", "m", allowed); });
}

TEST(FieldReader, ReadsEveryKindOfField) {
    const Json fields = Json::parse(R"({"a": 1.5, "b": -2, "c": true, "d": "text", "e": [1, 2.5], "f": ["x", "y"],
                                        "g": {"h": 3}, "i": [{"j": 4}, {"j": 5}], "k": "two", "l": [1, "any"]})");
    FieldReader reader(fields, "m.lua");
    EXPECT_EQ(reader.number("a", "N", Allowed::positive), 1.5);
    EXPECT_EQ(reader.optional_number("a", "N", Allowed::positive), 1.5);
    EXPECT_EQ(reader.integer("b", -2, any, 0), -2);
    EXPECT_TRUE(reader.boolean("c", false));
    EXPECT_EQ(reader.text("d"), "text");
    EXPECT_EQ(reader.numbers("e", "N", Allowed::finite, {}), (std::vector<double>{1, 2.5}));
    EXPECT_EQ(reader.texts("f", {}), (std::vector<std::string>{"x", "y"}));
    FieldReader inner = reader.table("g");
    EXPECT_EQ(inner.number("h", "", Allowed::finite), 3.0);
    std::vector<double> entries;
    reader.each("i", [&](FieldReader& entry) { entries.push_back(entry.number("j", "", Allowed::finite)); });
    EXPECT_EQ(entries, (std::vector<double>{4, 5}));
    EXPECT_EQ(reader.choice("k", {"one", "two"}, "one"), "two");
    EXPECT_EQ(reader.value("l").dump(), R"([1,"any"])");
    EXPECT_NO_THROW(reader.finish());
    EXPECT_NO_THROW(inner.finish());
}

TEST(FieldReader, AbsentAndNullFieldsGiveTheFallback) {
    for (const char* text :
         {"{}", "null", "[]", R"({"a": null, "c": null, "d": null, "e": null, "f": null, "g": null, "i": null})"}) {
        const Json fields = Json::parse(text);
        FieldReader reader(fields, "m.lua");
        EXPECT_FALSE(reader.has("a"));
        EXPECT_EQ(reader.number("a", "N", Allowed::positive, -7), -7.0); // the fallback is not checked
        EXPECT_EQ(reader.optional_number("a", "N", Allowed::positive), std::nullopt);
        EXPECT_EQ(reader.integer("a", 0, 1, 9), 9);
        EXPECT_TRUE(reader.boolean("c", true));
        EXPECT_EQ(reader.text("d", "other"), "other");
        EXPECT_EQ(reader.choice("d", {"one", "two"}, "two"), "two");
        EXPECT_EQ(reader.numbers("e", "", Allowed::finite, {3}), (std::vector<double>{3}));
        EXPECT_EQ(reader.texts("f", {"z"}), (std::vector<std::string>{"z"}));
        EXPECT_FALSE(reader.table("g").has("anything"));
        reader.each("i", [](FieldReader&) { FAIL() << "an absent list has no entry"; });
        EXPECT_TRUE(reader.value("a").is_null());
        EXPECT_NO_THROW(reader.finish()) << text;
    }
}

TEST(FieldReader, ZeroAndFalseAreNotAbsent) {
    const Json fields = {{"a", 0}, {"b", false}, {"c", ""}};
    FieldReader reader(fields, "m.lua");
    EXPECT_TRUE(reader.has("a"));
    EXPECT_EQ(reader.number("a", "", Allowed::finite, 5), 0.0);
    EXPECT_FALSE(reader.boolean("b", true));
    EXPECT_EQ(reader.text("c", "other"), "");
}

TEST(FieldReader, EachKindOfNumberHasItsBounds) {
    const auto accepts = [](Allowed allowed, double value) { return problem_of_number(value, allowed) == "none: "; };
    EXPECT_TRUE(accepts(Allowed::finite, -1));
    EXPECT_TRUE(accepts(Allowed::positive, 5e-324));
    EXPECT_FALSE(accepts(Allowed::positive, 0));
    EXPECT_TRUE(accepts(Allowed::non_negative, 0));
    EXPECT_FALSE(accepts(Allowed::non_negative, -5e-324));
    EXPECT_TRUE(accepts(Allowed::fraction, 0.5));
    EXPECT_FALSE(accepts(Allowed::fraction, 0));
    EXPECT_FALSE(accepts(Allowed::fraction, 1));
    for (const Allowed allowed : {Allowed::finite, Allowed::positive, Allowed::non_negative, Allowed::fraction}) {
        for (const double value : {HUGE_VAL, -HUGE_VAL, std::nan("")}) EXPECT_FALSE(accepts(allowed, value));
    }
}

TEST(FieldReader, AMessageSaysWhereWhatAndWhatIsAllowed) {
    EXPECT_EQ(problem_of_number(-2.5, Allowed::positive), "input: m.lua: x = -2.5 m, must be positive and finite");
    EXPECT_EQ(problem_of_number(-2.5, Allowed::non_negative),
              "input: m.lua: x = -2.5 m, must be zero or positive and finite");
    EXPECT_EQ(problem_of_number(INFINITY, Allowed::finite), "input: m.lua: x = inf m, must be finite");
    EXPECT_EQ(problem_of_number(1, Allowed::fraction), "input: m.lua: x = 1 m, must lie between 0 and 1");
    EXPECT_EQ(problem(R"({"n": -1})", [](FieldReader& r) { r.number("n", "", Allowed::positive); }),
              "input: m.lua: n = -1, must be positive and finite");
}

TEST(FieldReader, AMessageNamesTheWholePathCountedFromOne) {
    const auto read = [](FieldReader& reader) {
        FieldReader friction = reader.table("friction");
        friction.each("elements", [](FieldReader& e) { e.number("K", "N/m", Allowed::positive); });
        friction.finish();
    };
    EXPECT_EQ(problem(R"({"friction": {"elements": [{"K": 1}, {"K": 2}, {"K": -210000}]}})", read),
              "input: m.lua: friction.elements[3].K = -210000 N/m, must be positive and finite");
    EXPECT_EQ(problem(R"({"friction": {"elements": [{"K": 1}, {}]}})", read),
              "input: m.lua: friction.elements[2].K is missing (a number in N/m)");
    EXPECT_EQ(problem(R"({"friction": {"elements": [{"K": 1}, 7]}})", read),
              "input: m.lua: friction.elements[2] is 7, must be a table of named fields");
    EXPECT_EQ(problem(R"({"friction": {"elements": [{"K": 1, "k": 2}]}})", read),
              "input: m.lua: friction.elements[1].k is not a known field (known: K)");
}

TEST(FieldReader, AFieldOfAnotherKindIsShownAsItStands) {
    const auto number = [](FieldReader& r) { r.number("a", "N", Allowed::finite); };
    EXPECT_EQ(problem(R"({"a": "5"})", number), "input: m.lua: a = \"5\", must be a number");
    EXPECT_EQ(problem(R"({"a": true})", number), "input: m.lua: a = true, must be a number");
    EXPECT_EQ(problem(R"({"a": {"b": 1}})", number), "input: m.lua: a = a table, must be a number");
    EXPECT_EQ(problem(R"({"a": [1]})", number), "input: m.lua: a = a list, must be a number");
    EXPECT_EQ(problem("{}", number), "input: m.lua: a is missing (a number in N)");
    EXPECT_EQ(problem("{}", [](FieldReader& r) { r.number("a", "", Allowed::finite); }), "input: m.lua: a is missing");
    EXPECT_EQ(problem(R"({"a": 1})", [](FieldReader& r) { r.boolean("a", false); }),
              "input: m.lua: a = 1, must be true or false");
    EXPECT_EQ(problem(R"({"a": 1})", [](FieldReader& r) { r.text("a"); }), "input: m.lua: a = 1, must be a text");
    EXPECT_EQ(problem(R"({"a": 1})", [](FieldReader& r) { r.text("a", ""); }), "input: m.lua: a = 1, must be a text");
    EXPECT_EQ(problem("{}", [](FieldReader& r) { r.text("a"); }), "input: m.lua: a is missing (a text)");
    EXPECT_EQ(problem(R"({"a": "three"})",
                      [](FieldReader& r) {
                          r.choice("a", {"one", "two"}, "one");
                      }),
              "input: m.lua: a = \"three\", must be one of one, two");
    EXPECT_EQ(problem(R"({"a": 1})", [](FieldReader& r) { r.each("a", [](FieldReader&) {}); }),
              "input: m.lua: a = 1, must be a list of tables");
    EXPECT_EQ(problem(R"({"a": [1]})", [](FieldReader& r) { r.table("a"); }),
              "input: m.lua: a is a list, must be a table of named fields");
    EXPECT_EQ(problem("{}", [](FieldReader& r) { r.table("a", true); }), "input: m.lua: a is missing (a table)");
    EXPECT_EQ(problem("3", [](FieldReader&) {}), "input: m.lua is 3, must be a table of named fields");
}

TEST(FieldReader, AWholeNumberIsOneWithinItsRange) {
    const auto read = [](FieldReader& r) { r.integer("n", 1, 10, 5); };
    EXPECT_EQ(problem(R"({"n": 1})", read), "none: ");
    EXPECT_EQ(problem(R"({"n": 10.0})", read), "none: ");
    for (const std::string text : {"0", "11", "2.5", "1e+300", "\"3\""}) {
        EXPECT_EQ(problem("{\"n\": " + text + "}", read),
                  "input: m.lua: n = " + text + ", must be a whole number from 1 to 10");
    }
}

TEST(FieldReader, AListIsCheckedEntryByEntry) {
    const auto read = [](FieldReader& r) { r.numbers("a", "Hz", Allowed::positive, {}); };
    EXPECT_EQ(problem(R"({"a": [1, 0]})", read), "input: m.lua: a[2] = 0 Hz, must be positive and finite");
    EXPECT_EQ(problem(R"({"a": [1, null]})", read), "input: m.lua: a[2] = null, must be a number");
    EXPECT_EQ(problem(R"({"a": 1})", read), "input: m.lua: a = 1, must be a list of numbers");
    EXPECT_EQ(problem(R"({"a": [-1]})", [](FieldReader& r) { r.numbers("a", "", Allowed::positive, {}); }),
              "input: m.lua: a[1] = -1, must be positive and finite");
    const auto read_texts = [](FieldReader& r) { r.texts("a", {}); };
    EXPECT_EQ(problem(R"({"a": ["x", 1]})", read_texts), "input: m.lua: a[2] = 1, must be a text");
    EXPECT_EQ(problem(R"({"a": "x"})", read_texts), "input: m.lua: a = \"x\", must be a list of texts");
}

// An empty table of Lua is both an empty list and a table without fields.
TEST(FieldReader, AnEmptyTableIsAnEmptyList) {
    for (const char* text : {R"({"a": []})", R"({"a": {}})"}) {
        EXPECT_EQ(problem(text,
                          [](FieldReader& r) {
                              EXPECT_TRUE(r.numbers("a", "", Allowed::finite, {1}).empty());
                              EXPECT_TRUE(r.texts("a", {"x"}).empty());
                              r.each("a", [](FieldReader&) { FAIL() << "no entry"; });
                              EXPECT_FALSE(r.table("a").has("b"));
                          }),
                  "none: ");
    }
}

TEST(FieldReader, AnUnknownFieldIsRefusedWithTheNearestKnownOne) {
    const auto read = [](FieldReader& r) {
        r.number("amplitude", "N", Allowed::positive, 1);
        r.integer("periods", 1, any, 1);
    };
    EXPECT_EQ(problem(R"({"amplitud": 1})", read),
              "input: m.lua: amplitud is not a known field (did you mean \"amplitude\"?)");
    EXPECT_EQ(problem(R"({"speed": 1})", read), "input: m.lua: speed is not a known field (known: amplitude, periods)");
    EXPECT_EQ(problem(R"({"speed": null})", read),
              "input: m.lua: speed is not a known field (known: amplitude, periods)");
}

TEST(FieldReader, NotesAreAllowedAtEveryLevel) {
    const std::string notes = R"("comment": "c", "units": {"K": "N/m"}, "conventions": [1], "records": 3,
                                 "equations": null)";
    EXPECT_EQ(problem("{" + notes + R"(, "a": {)" + notes + R"(}, "b": [{)" + notes + "}]}",
                      [](FieldReader& r) {
                          r.table("a").finish();
                          r.each("b", [](FieldReader&) {});
                      }),
              "none: ");
}

TEST(FieldReader, NamesAFieldFromTheTopOfItsFile) {
    const Json none;
    EXPECT_EQ(FieldReader(none, "m.lua").name_of("Ts"), "m.lua: Ts");
    EXPECT_EQ(FieldReader(none, "m.lua", "friction").name_of("viscous"), "m.lua: friction.viscous");
    EXPECT_EQ(problem_of([&] { FieldReader(none, "m.lua", "modes[2]").fail("zeta", "is odd"); }),
              "input: m.lua: modes[2].zeta is odd");
}

} // namespace
} // namespace tribode
