#include "tribode/base/error.hpp"
#include "tribode/record/csv.hpp"
#include "tribode/record/file_units.hpp"
#include "tribode/record/record_file.hpp"
#include "unit/script/messages.hpp"

#include <gtest/gtest.h>
#include <numbers>

namespace tribode {
namespace {

using Values = std::vector<double>;

Record read(std::string_view text, const RecordOptions& options = {}, const std::vector<std::string>& wanted = {}) {
    return record_from_bytes(text, "x.csv", options, wanted);
}

std::string refused(std::string_view text, const RecordOptions& options = {},
                    const std::vector<std::string>& wanted = {}) {
    return problem_of([&] { read(text, options, wanted); });
}

void expect_part(const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
}

TEST(CsvDialect, SemicolonsTabsAndQuotesGiveTheSameNumbers) {
    const Values t = {0, 0.0005}, u = {1.5, -0.25};
    for (const char* text :
         {"t,u\n0,1.5\n0.0005,-0.25\n", "t;u\n0;1.5\n0.0005;-0.25\n", "t\tu\n0\t1.5\n0.0005\t-0.25\n",
          "t;u\r\n0;1,5\r\n0,0005;-0,25\r\n", "t\tu\n0\t1,5\n5e-4\t-,25\n", "sep=;\nt;u\n0;1,5\n0,0005;-0,25\n",
          "\"t\",\"u\"\n\"0\",\"1,5\"\n\"0,0005\",\"-0,25\"\n",
          "# a, comment; with all\tof them\nt;u\n0;1,5\n5,0e-4;-2,5e-1\n"}) {
        const Table table = read(text).table;
        EXPECT_EQ(table["t"].values, t) << text;
        EXPECT_EQ(table["u"].values, u) << text;
    }
}

// A name with a comma does not make columns: the rows tell.
TEST(CsvDialect, TheRowsDecideWhereTheHeaderHasSeveralMarks) {
    EXPECT_EQ(read("t;force, N\n0;1,5\n1;2,5\n").table["force, N"].values, (Values{1.5, 2.5}));
    EXPECT_EQ(read("t,\"force; raw\"\n0,1.5\n1,2.5\n").table["force; raw"].values, (Values{1.5, 2.5}));
    EXPECT_EQ(read("a;b,c;d\n1;2,3;4\n").table["b,c"].values, Values{2.3});
    EXPECT_EQ(read("a;b,c\n1,3\n").table["a;b"].values, Values{1});
}

TEST(CsvDialect, WhatIsWrittenIsReadAsItWas) {
    Table table;
    for (const char* name : {"a;b", "c\td", "e f", "y [mm] [mm]"}) table.add(name, "", {1, 2.5});
    const Table again = parse_csv(to_csv(table), "x.csv");
    EXPECT_EQ(again.names(), table.names());
    EXPECT_EQ(again["a;b"].values, table["a;b"].values);
}

TEST(CsvDialect, WhatCouldMeanTwoThingsIsRefused) {
    expect_part(refused("t;u\n0;1,5\n1;2.5\n"), "x.csv:3: there are numbers with a decimal point (line 3) and with a "
                                                "comma (line 2)");
    expect_part(refused("t;u\n0;1.5\n1;1,500\n"), "(line 2) and with a comma (line 3)");
    expect_part(refused("t;u\n0;1,500\n1;12,250\n"), "thousands");
    EXPECT_EQ(read("t;u\n0;1,500\n1;0,250\n").table["u"].values, (Values{1.5, 0.25})) << "no thousands begin with 0";
    for (const char* cell : {"1.234,5", "1,234.5", "1,234,567", "1,5,", ",", "1, 5", "--1,5"}) {
        expect_part(refused("t;u\n0;" + std::string(cell) + "\n"), "column u is \"");
    }
    // Separated by commas, a decimal comma makes two cells: never a number.
    expect_part(refused("t,u\n0,0,1,5\n"), "decimal commas need semicolons");
    expect_part(refused("u\n1,5\n"), "has 2 values, must have 1");
    expect_part(refused("t u\n0 1\n"), "column t u is \"0 1\"");
    expect_part(refused("sep=|\nt|u\n0|1\n"), "separator");
}

TEST(CsvDialect, ARowOfUnitsBringsTheColumnsToSi) {
    const Table table = read("t,u,y,v,n\nms,kN,um,mm/s,-\n0,1,2.5,3,4\n0.5,-1,7,1,5\n").table;
    EXPECT_EQ(table["t"].values, (Values{0, 0.0005}));
    EXPECT_EQ(table["u"].values, (Values{1000, -1000}));
    EXPECT_EQ(table["y"].values, (Values{2.5e-6, 7e-6}));
    EXPECT_EQ(table["v"].values, (Values{0.003, 0.001}));
    EXPECT_EQ(table["n"].values, (Values{4, 5}));
    EXPECT_EQ(table["t"].unit, "s");
    EXPECT_EQ(table["v"].unit, "m/s");
    EXPECT_EQ(table["n"].unit, "");
    EXPECT_EQ(table.place(0), "x.csv:3");
    // In brackets, behind the names, with decimal commas.
    const Table same = read("t;y\n[ms];(µm)\n0;2,5\n0,5;7\n").table;
    EXPECT_EQ(same["y"].values, table["y"].values);
    const Table behind = read("t [ms],Position (um)\n0,2.5\n0.5,7\n").table;
    EXPECT_EQ(behind["t"].values, table["t"].values);
    EXPECT_EQ(behind["Position"].values, table["y"].values);
    // Brackets that hold no unit belong to the name; names that differ only by the unit keep it.
    EXPECT_TRUE(read("t,y (raw)\n0,1\n").table.find("y (raw)"));
    EXPECT_TRUE(read("y [mm],y [um]\n0,1\n").table.find("y [um]"));
}

TEST(CsvDialect, AFactorOfTheUserTakesThePlaceOfTheUnit) {
    const RecordOptions options = RecordOptions::parse("y=Position [mm]", "y=2");
    EXPECT_EQ(read("t,Position [mm]\n0,1.5\n", options, {"t", "y"}).table["y"].values, Values{3});
    EXPECT_EQ(read("t,Position\ns,inc\n0,1.5\n", RecordOptions::parse("y=Position", "y=2")).table["y"].values,
              Values{3});
}

TEST(CsvDialect, AColumnComesInTheUnitInWhichItIsWanted) {
    const std::vector<std::string> wanted = {"t", "u", "y"};
    RecordOptions options;
    options.units = {{"u", "V"}, {"y", "mm"}};
    EXPECT_EQ(read("t,u,y\nms,mV,mm\n0,500,2\n", options, wanted).table["u"].values, Values{0.5});
    EXPECT_EQ(read("t,u,y\nms,mV,mm\n0,500,2\n", options, wanted).table["y"].values, Values{2});
    EXPECT_EQ(read("t,u,y\nms,mV,m\n0,500,2\n", options, wanted).table["y"].values, Values{2000});
    EXPECT_EQ(read("t,u,y\n0,500,2\n", options, wanted).table["u"].values, Values{500});
    EXPECT_EQ(refused("t,u,y\ns,N,mm\n0,1,2\n", options, wanted),
              "input: x.csv: column u is in N, must be in V; give its factor: --scale u=FACTOR");
    // No factor leads from one to the other.
    options.units = {{"u", "V"}, {"y", "K"}};
    EXPECT_EQ(
        refused("t,u,y\ns,V,degC\n0,1,2\n", options, wanted),
        "input: x.csv: column y is in degC, must be in K, whose zero is another: add or subtract 273.15 in the file, "
        "or give y the unit degC");
    // What has no unit there is brought to SI, whatever machines would want.
    options.units = {{"t", "s"}, {"y", "%"}};
    EXPECT_EQ(read("t [s],u [mV],y [%]\n0,500,2\n", options, wanted).table["u"].values, Values{0.5});
    EXPECT_EQ(read("t [s],u [mV],y [%]\n0,500,2\n", options, wanted).table["y"].values, Values{2});
    EXPECT_EQ(read("t [s],u [N],y [%]\n0,500,2\n").table["y"].values, Values{0.02});
}

TEST(CsvDialect, AUnitThatDoesNotFitIsRefusedWithTheLineToWrite) {
    const std::vector<std::string> wanted = {"t", "u", "y"};
    EXPECT_EQ(refused("t,u,y\ns,V,m\n0,1,2\n", {}, wanted),
              "input: x.csv: column u is in V, must be in N; give its factor: --scale u=FACTOR");
    EXPECT_EQ(
        refused("t,u,y\ns,N,inc\n0,1,2\n"),
        "input: x.csv: column y has the unit \"inc\", which is not known; give its factor to SI: --scale y=FACTOR");
    EXPECT_EQ(read("t,u,y\ns,V,m\n0,1,2\n", RecordOptions::parse("", "u=35"), wanted).table["u"].values, Values{35});
    expect_part(refused("Time,Force,Pos\nms,N,mm\n0,1,2\n", {}, wanted), "--columns t=Time,u=NAME,y=NAME");
    expect_part(refused("t,u\nfoo,bar\n0,1\n"), "x.csv:2: column t is \"foo\"");
}

TEST(CsvDialect, UnitsOfFiles) {
    const auto in_si = [](std::string_view unit, double value) {
        const auto known = file_unit(unit);
        return known ? std::pair(known->si, known->to_si(value)) : std::pair(std::string("unknown"), 0.0);
    };
    using Pair = std::pair<std::string, double>;
    EXPECT_EQ(in_si("mm/s^2", 1), Pair("m/s2", 1e-3));
    EXPECT_EQ(in_si("mm²", 1), Pair("m2", 1e-6));
    EXPECT_EQ(in_si("deg", 180), Pair("rad", std::numbers::pi));
    EXPECT_EQ(in_si("rpm", 60).first, "rad/s");
    EXPECT_EQ(in_si("min", 2), Pair("s", 120)); // no thousandth of an inch
    EXPECT_EQ(in_si("1/ms", 1), Pair("1/s", 1e3));
    EXPECT_EQ(in_si("N m", 2), Pair("N m", 2));
    EXPECT_EQ(in_si("N/(A s)", 2), Pair("N/(A s)", 2));
    for (const char* text : {"", "inc", "g", "m/", "/s", "m//s", "a/b/c", "m2x", "x", "[", "[]", "()", "mkg"}) {
        EXPECT_EQ(in_si(text, 1).first, "unknown") << text;
    }
}

} // namespace
} // namespace tribode
