#include "tribode/base/quantity.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

TEST(Quantity, HasOneToThreeDigitsBeforeThePoint) {
    EXPECT_EQ(format_quantity(0.0000123, "m"), "12.3 um");
    EXPECT_EQ(format_quantity(-0.012345678901234567, "m/s"), "-12.35 mm/s");
    EXPECT_EQ(format_quantity(250000, "N/m"), "250 kN/m");
    EXPECT_EQ(format_quantity(999.96e-6, "N"), "1 mN");
    EXPECT_EQ(format_quantity(999.94e-6, "N"), "999.9 uN");
    EXPECT_EQ(format_quantity(1, "rad/s^2"), "1 rad/s^2");
    EXPECT_EQ(format_quantity(0.1 + 0.2, "V"), "300 mV");
    EXPECT_EQ(format_quantity(123.4, "N", 2), "120 N");
    EXPECT_EQ(format_quantity(3600, "s"), "3600 s");
}

TEST(Quantity, LeavesOtherUnitsAsTheyAre) {
    EXPECT_EQ(format_quantity(0.00123456, "kg"), "0.001235 kg");
    EXPECT_EQ(format_quantity(12345.678, ""), "12350");
    EXPECT_EQ(format_quantity(1.23e-5, "m^2"), "1.23e-05 m^2");
    EXPECT_EQ(format_quantity(0.5, "1/kg"), "0.5 1/kg");
    EXPECT_EQ(format_quantity(0, "m"), "0 m");
    EXPECT_EQ(format_quantity(INFINITY, "m"), "inf m");
    EXPECT_EQ(format_quantity(NAN, ""), "nan");
    EXPECT_EQ(format_quantity(1e-30, "m"), "1e-30 m"); // beyond the prefixes
}

TEST(Quantity, AUnitWithItsPrefixIsTheSameQuantity) {
    for (const double value : {3e-15, 4.4e-8, 0.02, 7.0, 123456.0, 9.9e10}) {
        const PrefixedUnit prefixed = prefixed_unit(value, "N m");
        EXPECT_GE(value * prefixed.factor, 1 - 1e-12) << value;
        EXPECT_LT(value * prefixed.factor, 1000) << value;
        EXPECT_TRUE(prefixed.unit.ends_with("N m")) << prefixed.unit;
    }
}

} // namespace
} // namespace tribode
