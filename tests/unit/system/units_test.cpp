#include "tribode/base/error.hpp"
#include "tribode/system/units.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

TEST(Dimension, UnitsReadAsTheyAreWritten) {
    const auto expect_same = [](const char* a, const char* b) {
        EXPECT_EQ(dimension_of(a), dimension_of(b)) << a << " and " << b;
    };
    expect_same("N", "kg m/s2");
    expect_same("m/s^2", "m s^-2");
    expect_same("V/(A s)", "ohm/s");
    expect_same("N·m", "N m");
    expect_same("N*m", "J");
    expect_same("1/s", "Hz");
    expect_same("N m s/rad", "J s");
    expect_same("m/s/s", "m/s2");
    expect_same("(m/s)2", "m2/s2");
    expect_same("W", "V A");
    expect_same("Wb", "H A");
    expect_same("degC", "K");
    expect_same("°C", "K");
    expect_same("Ohm", "ohm");
    expect_same("kg m2/s2", "Ω A2 s");
    expect_same("S", "1/ohm");
    EXPECT_NE(dimension_of("mm"), dimension_of("m"));
    EXPECT_NE(dimension_of("m/s2"), dimension_of("m2/s"));
    EXPECT_EQ(to_text(dimension_of("N")), "kg m/s2");
    EXPECT_EQ(to_text(dimension_of("V/(A s)")), "kg m2/(A2 s4)");
    EXPECT_EQ(to_text(dimension_of("Hz")), "1/s");
    EXPECT_EQ(to_text(dimension_of("rad")), "1");
}

TEST(Dimension, ReadableUnitsAreThoseThatAreUsed) {
    for (const char* unit : {"N", "N m", "N/m", "N s/m", "V", "1/V", "1/V2", "V/s", "ohm", "ohm/s", "Pa", "m/s2",
                             "kg m2", "kg", "1/s", "mm/s", "1"}) {
        EXPECT_EQ(to_readable_text(dimension_of(unit)), unit);
    }
    EXPECT_EQ(to_readable_text(dimension_of("kg m2/(A s3)")), "V");
    EXPECT_EQ(to_readable_text(dimension_of("A s3/(kg m2)")), "1/V");
    EXPECT_EQ(to_readable_text(dimension_of("N m/rad")), "N m");
}

TEST(Dimension, WhatIsNoUnitIsNotKnown) {
    for (const char* text : {"", "  ", "m/", "(m", "m)", "3", "m^", "/s", "m (relative)!"}) {
        EXPECT_FALSE(dimension_of(text)) << text;
    }
}

class UnitsTest : public testing::Test {
  protected:
    Expressions graph;
    Units units{graph};
    Term x = variable("x", "m"), v = variable("v", "m/s"), m = variable("m", "kg"), F = variable("F", "N"),
         angle = variable("angle", "rad"), free = variable("free", "");

    Term variable(const char* name, const char* unit) {
        const Term term = graph.variable(name);
        units.set(term, unit);
        return term;
    }
    Term make(Op op, Term a, Term b = 0, Term c = 0) { return graph.make(op, a, b, c); }
    Term number(double value) { return graph.constant(value); }
    std::string refusal(Term term) {
        try {
            units.of(term);
        } catch (const InputError& error) {
            return error.what();
        }
        return "";
    }
};

TEST_F(UnitsTest, ProductsPowersAndRootsHaveTheirUnits) {
    EXPECT_EQ(units.of(make(Op::divide, F, m)), dimension_of("m/s2"));
    EXPECT_EQ(units.of(make(Op::multiply, v, v)), dimension_of("m2/s2"));
    EXPECT_EQ(units.of(make(Op::power, x, number(3))), dimension_of("m3"));
    EXPECT_EQ(units.of(make(Op::sqrt, make(Op::multiply, x, x))), dimension_of("m"));
    EXPECT_EQ(units.of(make(Op::sin, angle)), dimension_of("1"));
    EXPECT_EQ(units.of(make(Op::negate, v)), dimension_of("m/s"));
}

TEST_F(UnitsTest, NumbersAndVariablesWithoutAUnitFitEverywhere) {
    EXPECT_EQ(units.of(make(Op::add, x, number(1))), dimension_of("m"));
    EXPECT_EQ(units.of(make(Op::add, free, v)), dimension_of("m/s"));
    EXPECT_FALSE(units.of(make(Op::multiply, free, x)));
    EXPECT_FALSE(units.of(make(Op::sin, make(Op::multiply, free, x))));
}

TEST_F(UnitsTest, AFactorThatIsANumberHasNoUnit) {
    EXPECT_EQ(units.of(make(Op::multiply, number(2), x)), dimension_of("m"));
    EXPECT_EQ(units.of(make(Op::divide, number(2), x)), dimension_of("1/m"));
    EXPECT_EQ(refusal(make(Op::add, make(Op::multiply, number(2), x), v)),
              "v + x*2 adds m/s and m; the number 2 is a plain factor, a parameter can have a unit");
    EXPECT_EQ(
        refusal(make(Op::sin, make(Op::multiply, number(3), x))),
        "sin(x*3) needs a plain number, but x*3 is in m; the number 3 is a plain factor, a parameter can have a unit");
}

TEST_F(UnitsTest, WhatDoesNotFitIsRefusedWithBothUnits) {
    EXPECT_EQ(refusal(make(Op::add, x, v)), "x + v adds m and m/s");
    EXPECT_EQ(refusal(make(Op::subtract, F, m)), "F - m subtracts between kg m/s2 and kg");
    EXPECT_EQ(refusal(make(Op::less, x, v)), "x < v compares m and m/s");
    EXPECT_EQ(refusal(make(Op::select, make(Op::less, x, number(0)), x, v)),
              "where(x < 0, x, v) chooses between m and m/s");
    EXPECT_EQ(refusal(make(Op::sin, x)), "sin(x) needs a plain number, but x is in m");
    EXPECT_EQ(refusal(make(Op::power, number(2), x)), "2^x needs a plain number, but x is in m");
    EXPECT_EQ(refusal(make(Op::sin, make(Op::add, angle, make(Op::add, x, v)))), "x + v adds m and m/s");
}

} // namespace
} // namespace tribode
