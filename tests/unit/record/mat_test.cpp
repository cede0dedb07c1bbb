#include "tribode/record/mat.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/record_file.hpp"
#include "tribode/record/zip.hpp"
#include "unit/record/damage.hpp"
#include "unit/record/raw_bytes.hpp"
#include "unit/script/messages.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cmath>
#include <cstdint>
#include <gtest/gtest.h>
#include <limits>
#include <string>
#include <vector>
#include <zlib.h>

namespace tribode {
namespace {

constexpr std::size_t enough = 1 << 20; // bytes unpacked

// A MAT file put together byte by byte from the description of the format, independent of the writer.
class ByHand {
  public:
    explicit ByHand(bool big_endian = false) : big_endian_(big_endian), bytes_("MATLAB 5.0 MAT-file, by hand") {
        bytes_.resize(124, ' ');
        bytes_ += big_endian ? std::string("\1\0MI", 4) : std::string("\0\1IM", 4);
    }

    template <class Number>
    std::string raw(Number number) const {
        return raw_bytes(number, big_endian_);
    }

    template <class Number>
    std::string list(const std::vector<Number>& numbers) const {
        std::string text;
        for (const Number number : numbers) text += raw(number);
        return text;
    }

    std::string element(std::uint32_t type, const std::string& data) const {
        std::string text = raw(type) + raw(static_cast<std::uint32_t>(data.size())) + data;
        text.resize((text.size() + 7) / 8 * 8);
        return text;
    }

    // The form with up to four bytes of data in the tag.
    std::string short_element(std::uint32_t type, std::string data) const {
        const auto length = static_cast<std::uint32_t>(data.size());
        data.resize(4);
        return raw(length << 16 | type) + data;
    }

    // An array of this class and flags; `parts` are its data elements.
    std::string array(const std::string& name, std::uint32_t kind_and_flags, std::vector<std::int32_t> shape,
                      const std::string& parts) const {
        return element(14, element(6, raw(kind_and_flags) + raw(std::uint32_t{0})) + element(5, list(shape)) +
                               (name.size() <= 4 ? short_element(1, name) : element(1, name)) + parts);
    }

    ByHand& add(const std::string& element) {
        bytes_ += element;
        return *this;
    }

    ByHand& add_packed(const std::string& element) {
        std::string packed(compressBound(element.size()), '\0');
        uLongf length = packed.size();
        compress(reinterpret_cast<Bytef*>(packed.data()), &length, reinterpret_cast<const Bytef*>(element.data()),
                 element.size());
        // Packed elements are not filled up to eight bytes.
        bytes_ += raw(std::uint32_t{15}) + raw(static_cast<std::uint32_t>(length)) + packed.substr(0, length);
        return *this;
    }

    const std::string& bytes() const { return bytes_; }

  private:
    bool big_endian_;
    std::string bytes_;
};

constexpr std::uint32_t of_doubles = 6, logical = 0x0200, complex_ = 0x0800;

// t plain, u packed, y of small whole numbers stored in bytes, in this byte order.
ByHand three_columns(bool big_endian) {
    ByHand file(big_endian);
    file.add(file.array("t", of_doubles, {3, 1}, file.element(9, file.list<double>({0, 0.5, 1}))));
    file.add_packed(file.array("thrust", of_doubles, {1, 3}, file.element(9, file.list<double>({1e-7, -0.1, 1e300}))));
    file.add(file.array("y", of_doubles, {3, 1}, file.short_element(2, std::string("\x05\x00\xff", 3))));
    return file;
}

TEST(Mat, ReadsWhatTheFormatDescribesInBothByteOrders) {
    for (const bool big_endian : {false, true}) {
        const std::string bytes = three_columns(big_endian).bytes();
        ASSERT_TRUE(is_mat5(bytes));
        const auto variables = mat_variables(bytes, enough, "x.mat");
        ASSERT_EQ(variables.size(), 3u);
        EXPECT_EQ(variables[0].name, "t");
        EXPECT_EQ(variables[0].values, (std::vector<double>{0, 0.5, 1}));
        EXPECT_EQ(variables[1].name, "thrust");
        EXPECT_EQ(variables[1].values, (std::vector{1e-7, -0.1, 1e300}));
        EXPECT_EQ(variables[2].values, (std::vector<double>{5, 0, 255}));
    }
}

TEST(Mat, DoublesMayBeStoredAsAnyKindOfNumber) {
    const ByHand make;
    const auto values = [&](std::uint32_t type, const std::string& data) {
        const ByHand file = ByHand().add(make.array("x", of_doubles, {2, 1}, make.element(type, data)));
        return mat_variables(file.bytes(), enough, "x.mat").at(0).values;
    };
    EXPECT_EQ(values(1, make.list<std::int8_t>({-1, 2})), (std::vector<double>{-1, 2}));
    EXPECT_EQ(values(3, make.list<std::int16_t>({-300, 2})), (std::vector<double>{-300, 2}));
    EXPECT_EQ(values(4, make.list<std::uint16_t>({65535, 2})), (std::vector<double>{65535, 2}));
    EXPECT_EQ(values(5, make.list<std::int32_t>({-70000, 2})), (std::vector<double>{-70000, 2}));
    EXPECT_EQ(values(6, make.list<std::uint32_t>({4000000000u, 2})), (std::vector<double>{4e9, 2}));
    EXPECT_EQ(values(7, make.list<float>({0.5f, 2})), (std::vector<double>{0.5, 2}));
    EXPECT_EQ(values(12, make.list<std::int64_t>({-1, 2})), (std::vector<double>{-1, 2}));
    EXPECT_EQ(values(13, make.list<std::uint64_t>({1, 2})), (std::vector<double>{1, 2}));
}

TEST(Mat, WhatIsNoVectorOfDoublesHasItsReason) {
    const ByHand make;
    const std::string two = make.element(9, make.list<double>({1, 2}));
    const auto refusal = [&](std::uint32_t kind, std::vector<std::int32_t> shape, const std::string& parts) {
        return mat_variables(ByHand().add(make.array("x", kind, shape, parts)).bytes(), enough, "x.mat").at(0).refusal;
    };
    EXPECT_EQ(refusal(of_doubles | complex_, {2, 1}, two + two), "is complex, must be real");
    EXPECT_EQ(refusal(of_doubles, {2, 2}, two + two), "is a matrix (2 x 2), must be a vector");
    EXPECT_EQ(refusal(7, {2, 1}, two), "is an array of class single, must be one of doubles");
    EXPECT_EQ(refusal(10, {2, 1}, two), "is an array of class int16, must be one of doubles");
    EXPECT_EQ(refusal(9 | logical, {2, 1}, two), "is a logical, must be an array of doubles");
    EXPECT_EQ(refusal(1, {1, 1}, ""), "is a cell, must be an array of doubles");
    EXPECT_EQ(refusal(2, {1, 1}, ""), "is a struct, must be an array of doubles");
    EXPECT_EQ(refusal(4, {1, 2}, two), "is a char, must be an array of doubles");
    EXPECT_EQ(refusal(of_doubles, {2, 1, 1}, two), "");
}

TEST(Mat, AnEntryWithoutANameIsPassedOverAndOfTwoTheLastCounts) {
    ByHand file;
    file.add(file.array("", of_doubles, {1, 1}, file.element(9, file.raw(1.0))));
    file.add(file.element(14, ""));
    for (const double value : {1.0, 2.0}) {
        file.add(file.array("x", of_doubles, {1, 1}, file.element(9, file.raw(value))));
    }
    const auto variables = mat_variables(file.bytes(), enough, "x.mat");
    ASSERT_EQ(variables.size(), 1u);
    EXPECT_EQ(variables[0].values, std::vector{2.0});
}

Table numbers_of_every_kind() {
    Table table;
    table.add("t", "s", {0, 5e-4, 1e-3, 1.5e-3});
    table.add("position_of_the_axis", "m", {0.1, -0.0, 5e-324, std::numeric_limits<double>::max()});
    return table;
}

TEST(Mat, ReadsBackAndTheSameTableGivesTheSameBytes) {
    const TemporaryFolder folder;
    const Table table = numbers_of_every_kind();
    write_mat(folder / "x.mat", table);
    const std::string bytes = read_file(folder / "x.mat");
    EXPECT_EQ(bytes, to_mat(table));
    const auto variables = mat_variables(bytes, enough, "x.mat");
    ASSERT_EQ(variables.size(), 2u);
    for (std::size_t i = 0; i < 2; ++i) {
        EXPECT_EQ(variables[i].name, table.columns[i].name);
        EXPECT_EQ(variables[i].values, table.columns[i].values);
    }
    EXPECT_TRUE(std::signbit(variables[1].values[1]));
}

TEST(Mat, WritesWhatTheFormatDescribes) {
    Table table;
    table.add("u", "N", {1, 2});
    const ByHand make;
    const std::string head = to_mat(table).substr(0, 128);
    EXPECT_TRUE(head.starts_with("MATLAB 5.0 MAT-file, "));
    EXPECT_EQ(head.substr(116), std::string(8, '\0') + std::string("\0\1IM", 4));
    // The name in the long form, which every reader knows as well.
    const std::string content = make.element(6, make.list<std::uint32_t>({6, 0})) +
                                make.element(5, make.list<std::int32_t>({2, 1})) + make.element(1, "u") +
                                make.element(9, make.list<double>({1, 2}));
    EXPECT_EQ(to_mat(table).substr(128), make.element(14, content));
}

TEST(Mat, RefusesNamesThatMatlabDoesNotHave) {
    const auto problem = [](const std::string& name) {
        Table table;
        table.add(name, "", {1});
        return problem_of([&] { to_mat(table); });
    };
    const std::string too_long(64, 'a');
    for (const std::string& name : std::vector<std::string>{"", "1u", "_u", "u V", "u.v", "\xc3\xa4", too_long}) {
        EXPECT_TRUE(problem(name).starts_with("input: \"" + name + "\" is not a name that a MAT file")) << name;
    }
    EXPECT_EQ(problem(std::string(63, 'a')), "none: ");
}

TEST(Mat, DamagedFilesGiveOneSentence) {
    const std::string bytes = three_columns(false).bytes();
    const std::string sentence = "input: x.mat:";
    // Cut anywhere, and thousands of times with up to four bytes changed.
    for (std::size_t length = 0; length < bytes.size(); ++length) {
        const auto problem = problem_of([&] { mat_variables(bytes.substr(0, length), enough, "x.mat"); });
        EXPECT_TRUE(problem.starts_with(sentence) || problem == "none: ") << problem;
    }
    for (std::uint32_t seed = 0; seed < 20000; ++seed) {
        const auto problem = problem_of([&] { mat_variables(damaged(bytes, seed), enough, "x.mat"); });
        ASSERT_TRUE(problem.starts_with(sentence) || problem == "none: ") << problem << ", seed " << seed;
    }
    // The whole way, with packed files: gzip knows each of its bytes by a sum.
    const std::string packed = gzip(bytes);
    for (std::uint32_t seed = 0; seed < 3000; ++seed) {
        const auto problem = problem_of([&] { record_from_bytes(damaged(packed, seed), "x.mat"); });
        ASSERT_TRUE(problem.starts_with(sentence) || problem == "none: ") << problem << ", seed " << seed;
    }
}

TEST(Zip, ReadsBackAlsoSeveralPartsAndSaysWhatIsDamaged) {
    std::string text;
    for (int i = 0; i < 30000; ++i) text += std::to_string(i * 7919 % 10007) + ",";
    const std::string packed = gzip(text);
    EXPECT_EQ(packed, gzip(text));
    EXPECT_LT(packed.size(), text.size());
    EXPECT_EQ(gunzip(packed, "x.gz"), text);
    EXPECT_EQ(gunzip(packed + gzip("end"), "x.gz"), text + "end");
    EXPECT_EQ(gunzip(gzip(""), "x.gz"), "");
    EXPECT_EQ(problem_of([&] { gunzip(packed.substr(0, packed.size() / 2), "x.gz"); }),
              "input: x.gz: the packed data are cut short");
    EXPECT_EQ(problem_of([&] { gunzip(packed + "x", "x.gz"); }), "input: x.gz: the packed data are cut short");
    std::string wrong = packed;
    wrong[packed.size() - 5] ^= 1; // in the sum of all bytes
    EXPECT_EQ(problem_of([&] { gunzip(wrong, "x.gz"); }), "input: x.gz: the packed data are damaged");
}

} // namespace
} // namespace tribode
