#include "tribode/base/field_path.hpp"
#include "tribode/base/field_rows.hpp"
#include "tribode/base/options.hpp"
#include "unit/script/messages.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

enum class Shape { round, square };

struct Leg {
    double length = 0;
    double paint = 1;

    static void describe(auto& l, auto& fields) {
        fields.required("length_m", l.length, "m", Allowed::positive, About("of one leg").usually(0.1, 2, "in meters"));
        fields.number("paint", l.paint, "", Allowed::non_negative);
    }
};

struct Drawer {
    double depth = 0;
    static void describe(auto& d, auto& fields) { fields.required("depth_m", d.depth, "m", Allowed::positive); }
};

struct Shelf {
    long boards = 2;
    static void describe(auto& s, auto& fields) { fields.integer("boards", s.boards, 1, 9); }
};

// One field of every sort.
struct Desk {
    double height = 0.7, lamp = 0, width = 1;
    Shape shape = Shape::round;
    bool wood = true;
    std::optional<bool> folds;
    std::vector<double> holes;
    std::vector<Leg> legs;
    std::optional<Leg> spare;
    std::variant<std::monostate, Drawer, Shelf> below;
    std::map<std::string, double> prices;

    static void describe(auto& d, auto& fields) {
        fields.number("height_m", d.height, "m", Allowed::positive, "of the top");
        fields.optional("lamp_W", d.lamp, 0.0, "W", Allowed::positive);
        fields.group("top", [&](auto& top) {
            top.number("width_m", d.width, "m", Allowed::positive);
            top.choice("shape", d.shape, {"round", "square"});
        });
        fields.flag("wood", d.wood);
        fields.flag("folds", d.folds);
        fields.numbers("holes_m", d.holes, "m", Allowed::positive, 3);
        fields.list("legs", d.legs);
        fields.table("spare", d.spare);
        fields.variant("below", d.below, "kind", {"drawer", "shelf"});
        fields.group("prices", [&](auto& prices) {
            for (const char* key : {"oak", "pine"}) prices.entry(key, d.prices, "", Allowed::positive);
        });
    }
};

struct Read {
    Desk desk;
    std::set<std::string> left_out;
};

Read read_desk(const std::string& text) {
    const Json json = Json::parse(text);
    FieldReader fields(json, "desk");
    Read read;
    OptionReader reader(fields, &read.left_out);
    Desk::describe(read.desk, reader);
    fields.finish();
    return read;
}

Json written(const Read& read) {
    OptionWriter writer(read.left_out, options_json(Desk()));
    Desk::describe(read.desk, writer);
    return writer.json;
}

TEST(Fields, WhatIsReadIsWrittenAgainAndNothingElse) {
    for (const char* text :
         {R"({})", R"({"height_m":0.7})", R"({"top":{}})", R"({"top":{"shape":"round"},"wood":true,"folds":false})",
          R"({"lamp_W":5.0,"top":{"width_m":2.0,"shape":"square"},"wood":false,"holes_m":[0.1,0.2]})", R"({"legs":[]})",
          R"({"legs":[{"length_m":1.0},{"length_m":2.0,"paint":1.0}],"spare":{"length_m":3.0}})",
          R"({"below":{"depth_m":0.5}})", R"({"below":{"kind":"drawer","depth_m":0.5}})",
          R"({"below":{"kind":"shelf"}})", R"({"below":{"kind":"shelf","boards":2},"prices":{"pine":3.0}})"}) {
        EXPECT_EQ(written(read_desk(text)).dump(), text);
    }
}

TEST(Fields, AFieldThatLeftItsDefaultIsWritten) {
    Read read = read_desk(R"({"legs":[{"length_m":1}]})");
    read.desk.height = 0.8;
    read.desk.legs[0].paint = 0;
    read.desk.shape = Shape::square;
    EXPECT_EQ(written(read).dump(),
              R"({"height_m":0.8,"top":{"shape":"square"},"legs":[{"length_m":1.0,"paint":0.0}]})");
}

TEST(Fields, AKindThatIsAbsentOrUnknownIsSaid) {
    EXPECT_EQ(problem_of([] { read_desk(R"({"below":{"kind":"cat"}})"); }),
              "input: desk: below.kind = \"cat\", must be one of drawer, shelf");
    EXPECT_EQ(problem_of([] { read_desk(R"({"below":{"kind":"shelf","depth_m":1}})"); }),
              "input: desk: below.depth_m is not a known field (known: kind, boards)");
    EXPECT_TRUE(std::holds_alternative<std::monostate>(read_desk(R"({"below":null})").desk.below));
}

// The fields of a path as they are written, by their paths.
std::string found(const std::string& path) {
    const Read read = read_desk(R"({"legs":[{"length_m":1},{"length_m":2}],"below":{"kind":"shelf"},
                                    "top":{"shape":"square"},"prices":{"oak":7}})");
    std::string all;
    find_fields(read.desk, path, "desk", [&](const std::string& around, std::string_view key, auto visit) {
        OptionWriter writer;
        visit(writer);
        all += fmt::format("{}{}={} ", around, key, writer.json[std::string(key)].dump());
    });
    return all;
}

TEST(Fields, AreFoundByPath) {
    EXPECT_EQ(found("height_m"), "height_m=0.7 ");
    EXPECT_EQ(found("top.shape"), "top.shape=\"square\" ");
    EXPECT_EQ(found("legs[2].length_m"), "legs[2].length_m=2.0 ");
    EXPECT_EQ(found("legs[*].length_m"), "legs[1].length_m=1.0 legs[2].length_m=2.0 ");
    EXPECT_EQ(found("legs[1]"), "legs[1]={\"length_m\":1.0,\"paint\":1.0} ");
    EXPECT_EQ(found("below.boards"), "below.boards=2 ");
    EXPECT_EQ(found("below.kind"), "below.kind=\"shelf\" ");
    EXPECT_EQ(found("prices.oak"), "prices.oak=7.0 ");
    EXPECT_EQ(found("lamp_W"), "lamp_W=null ");
}

TEST(Fields, PathsThatLeadNowhereAreRefused) {
    const auto problem = [](const std::string& path) { return problem_of([&] { found(path); }); };
    EXPECT_EQ(problem("hight_m"), "input: desk: hight_m: there is no hight_m (did you mean \"height_m\"?)");
    EXPECT_EQ(problem("legs[3].paint"), "input: desk: legs[3].paint: legs has 2 entries");
    EXPECT_EQ(problem("legs.paint"), "input: desk: legs.paint: legs is no table of fields");
    EXPECT_EQ(problem("height_m.x"), "input: desk: height_m.x: height_m is no table of fields");
    EXPECT_EQ(problem("top[1].shape"), "input: desk: top[1].shape: top is no list");
    EXPECT_EQ(problem("spare.paint"), "input: desk: spare.paint: there is no spare");
    EXPECT_EQ(problem("below.depth_m"), "input: desk: below.depth_m: there is no depth_m (known: kind, boards)");
}

TEST(Fields, NumbersAreThoseThatAreThere) {
    Read read = read_desk(R"({"legs":[{"length_m":1}],"below":{"depth_m":0.5},"prices":{"pine":3},"holes_m":[9]})");
    std::string all;
    each_number(read.desk, [&](double& value, const auto& path, std::string_view unit, Allowed, const About& about) {
        all += fmt::format("{}={}{}{} ", path(), value, unit, about.plausible(value) ? "" : "!");
        value = 0;
    });
    EXPECT_EQ(all, "height_m=0.7m top.width_m=1m holes_m[1]=9m legs[1].length_m=1m legs[1].paint=1 below.depth_m=0.5m "
                   "prices.pine=3 ");
    EXPECT_EQ(read.desk.legs[0].length, 0);
    EXPECT_EQ(read.desk.prices["pine"], 0);
}

TEST(Fields, RowsHoldWhatAListAndEachKindMayHave) {
    FieldLister lister;
    Desk::describe(static_cast<const Desk&>(Desk()), lister);
    std::string all;
    for (const auto& row : lister.rows)
        all += fmt::format("{}|{}|{}|{}\n", row.path, row.unit, row.values, row.fallback);
    EXPECT_NE(all.find("height_m|m|> 0|0.7\n"), std::string::npos) << all;
    EXPECT_NE(all.find("lamp_W|W|> 0|none\n"), std::string::npos) << all;
    EXPECT_NE(all.find("legs[].length_m|m|> 0|required\n"), std::string::npos) << all;
    EXPECT_NE(all.find("spare.paint||≥ 0|1\n"), std::string::npos) << all;
    EXPECT_NE(all.find("below.depth_m (drawer)|m|> 0|required\n"), std::string::npos) << all;
    EXPECT_NE(all.find("below.boards (shelf)||whole, 1 to 9|2\n"), std::string::npos) << all;
    EXPECT_NE(all.find("prices.pine||> 0|none\n"), std::string::npos) << all;
}

TEST(About, PlausibleIsTheMagnitudeUnlessTheRangeBeginsBelowZero) {
    const About step = About("").usually(1e-9, 1e-3);
    EXPECT_TRUE(step.plausible(0));
    EXPECT_TRUE(step.plausible(-1e-3));
    EXPECT_FALSE(step.plausible(1));
    EXPECT_FALSE(step.plausible(1e-12));
    const About shift = About("").usually(-1, 2);
    EXPECT_TRUE(shift.plausible(-1));
    EXPECT_FALSE(shift.plausible(-1.5));
    EXPECT_TRUE(About("nothing is known").plausible(1e300));
}

} // namespace
} // namespace tribode
