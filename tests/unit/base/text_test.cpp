#include "tribode/base/text.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>

namespace tribode {
namespace {

TEST(ToText, IsTheShortestTextOfTheNumber) {
    EXPECT_EQ(to_text(0.1), "0.1");
    EXPECT_EQ(to_text(5e-7), "5e-07");
    EXPECT_EQ(to_text(-210000.0), "-210000");
    EXPECT_EQ(to_text(1.0), "1");
    EXPECT_EQ(to_text(-0.0), "-0");
    EXPECT_EQ(to_text(1.0 / 3.0), "0.3333333333333333");
    EXPECT_EQ(to_text(std::nan("")), "nan");
    EXPECT_EQ(to_text(INFINITY), "inf");
    EXPECT_EQ(to_text(-INFINITY), "-inf");
}

TEST(ToText, ReadsBackToTheSameBits) {
    using Limits = std::numeric_limits<double>;
    std::vector<double> values = {0.0,      -0.0,     Limits::max(),        Limits::lowest(), Limits::min(),
                                  0.418e-3, INFINITY, Limits::denorm_min(), -INFINITY,        1 + 0x1p-52};
    std::mt19937_64 bits(1);
    while (values.size() < 20000) {
        const auto value = std::bit_cast<double>(bits());
        if (std::isfinite(value)) values.push_back(value);
    }
    for (const double value : values) {
        const auto back = parse_number(to_text(value));
        ASSERT_TRUE(back.has_value()) << to_text(value);
        EXPECT_EQ(std::bit_cast<std::uint64_t>(*back), std::bit_cast<std::uint64_t>(value)) << to_text(value);
    }
    EXPECT_TRUE(std::isnan(parse_number(to_text(std::nan(""))).value_or(0)));
}

TEST(AppendText, KeepsWhatTheBufferHolds) {
    std::string row = "0.5,";
    append_text(row, -2.25);
    EXPECT_EQ(row, "0.5,-2.25");
}

TEST(ParseNumber, AllowsBlanksAroundAndASignInFront) {
    EXPECT_EQ(parse_number(" \t1.5\r\n"), 1.5);
    EXPECT_EQ(parse_number("+2"), 2.0);
    EXPECT_EQ(parse_number("-3e-2"), -0.03);
    EXPECT_EQ(parse_number("1E3"), 1000.0);
    EXPECT_EQ(parse_number("-inf"), -INFINITY);
}

TEST(ParseNumber, RefusesWhatIsNotOneNumber) {
    for (const char* text : {"", "  ", "+", "-", "e5", "1,5", "1.5x", "1 2", "0x10", "--1", "++1", "+-1", "-+1", "+ 1",
                             "1e", "1e400", "one"}) {
        EXPECT_EQ(parse_number(text), std::nullopt) << '"' << text << '"';
    }
}

TEST(Trim, TakesBlanksFromBothEndsOnly) {
    EXPECT_EQ(trim("\t a b \r\n"), "a b");
    EXPECT_EQ(trim("ab"), "ab");
    EXPECT_EQ(trim(" \r\n"), "");
    EXPECT_EQ(trim(""), "");
}

TEST(NearestName, IsTheOneOfLeastEditDistance) {
    const std::vector<std::string> names = {"gain", "freq_hz", "zeta"};
    EXPECT_EQ(nearest_name("frq_hz", names), "freq_hz");
    EXPECT_EQ(nearest_name("zetta", names), "zeta");
    EXPECT_EQ(nearest_name("gian", names), "gain"); // distance 2, half of four
}

TEST(NearestName, IsEmptyWhereNoneIsNear) {
    EXPECT_EQ(nearest_name("mass", {"gain", "freq_hz", "zeta"}), "");
    EXPECT_EQ(nearest_name("gani", {"spring"}), "");
    EXPECT_EQ(nearest_name("gain", {}), "");
    EXPECT_EQ(nearest_name("", {"gain", "k"}), "");
}

TEST(NearestName, FindsTheLongNameThatBeginsWithIt) {
    EXPECT_EQ(nearest_name("rigid_gain", {"Ts", "rigid_gain_per_kg", "modes"}), "rigid_gain_per_kg");
}

// The distance to the long name is large; it must not let in a name that is neither near nor begins like it.
TEST(NearestName, ALongNameDoesNotOpenTheDoorForOthers) {
    EXPECT_EQ(nearest_name("in", {"input_delay_s", "modes"}), "input_delay_s");
    EXPECT_EQ(nearest_name("in", {"modes", "input_delay_s"}), "input_delay_s");
}

TEST(NearestName, ANearNameComesBeforeALongOne) {
    EXPECT_EQ(nearest_name("mode", {"modes", "mode_shape_file"}), "modes");
    EXPECT_EQ(nearest_name("mode", {"mode_shape_file", "modes"}), "modes");
}

TEST(Suggestion, EndsTheSentenceOnAnUnknownName) {
    EXPECT_EQ(suggestion("frequency", {"freq_hz", "gain"}), " (known: freq_hz, gain)");
    EXPECT_EQ(suggestion("freq_hs", {"freq_hz", "gain"}), " (did you mean \"freq_hz\"?)");
}

// The vectors of FIPS 180-4's examples.
TEST(Sha256, GivesThePublishedVectors) {
    EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    EXPECT_EQ(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
              "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
}

TEST(Version, IsThreeNumbers) {
    const std::string text = version();
    EXPECT_EQ(std::count(text.begin(), text.end(), '.'), 2) << text;
    EXPECT_EQ(text.find_first_not_of(".0123456789"), std::string::npos) << text;
}

TEST(Printable, HasNothingThatATerminalObeys) {
    EXPECT_EQ(printable("a \"b\" µ ü 数"), "a \"b\" µ ü 数");
    EXPECT_EQ(printable("\x1b]0;title\a"), "\\x1b]0;title\\x07");
    EXPECT_EQ(printable("a\nb\tc\x7f"), "a\\x0ab\\x09c\\x7f");
    EXPECT_EQ(printable("a\nb\r", "\n"), "a\nb\\x0d");
    EXPECT_EQ(printable("\xc2\x9b"
                        "31m\xc2\xa0"),
              "\\xc2\\x9b31m\xc2\xa0"); // U+009B begins a sequence, U+00A0 is a blank
    EXPECT_EQ(printable("\xc2"), "\xc2");
}

} // namespace
} // namespace tribode
