#include "tribode/record/mat4.hpp"
#include "tribode/record/record_file.hpp"
#include "unit/record/raw_bytes.hpp"
#include "unit/script/messages.hpp"

#include <cmath>
#include <cstdint>
#include <gtest/gtest.h>

namespace tribode {
namespace {

using Values = std::vector<double>;

// A file of version 4, byte by byte.
class ByHand {
  public:
    explicit ByHand(bool big_endian = false) : big_endian_(big_endian) {}

    template <class Number>
    std::string raw(Number number) const {
        return raw_bytes(number, big_endian_);
    }

    // `data` column by column; `type` as the format numbers it.
    template <class Number>
    ByHand& matrix(const std::string& name, int type, int rows, int columns, const std::vector<Number>& data,
                   int imaginary = 0) {
        for (const int word : {(big_endian_ ? 1000 : 0) + type, rows, columns, imaginary, int(name.size()) + 1}) {
            bytes += raw(std::int32_t{word});
        }
        bytes += name + '\0';
        for (const Number number : data) bytes += raw(number);
        return *this;
    }

    // Texts of equal length, each a row or a column.
    ByHand& texts(const std::string& name, const std::vector<std::string>& texts, bool as_columns) {
        const int count = int(texts.size()), width = int(texts[0].size());
        std::vector<std::uint8_t> data;
        if (as_columns) {
            for (const auto& text : texts) data.insert(data.end(), text.begin(), text.end());
            return matrix(name, 51, width, count, data);
        }
        for (std::size_t place = 0; place < texts[0].size(); ++place) {
            for (const auto& text : texts) data.push_back(static_cast<std::uint8_t>(text[place]));
        }
        return matrix(name, 51, count, width, data);
    }

    std::string bytes;

  private:
    bool big_endian_;
};

// time, x = 1 2 3, v = 10 20 30 (single or double), an alias of -x, and a constant m = 2.5.
std::string trajectory(bool transposed, bool big_endian = false) {
    ByHand file(big_endian);
    file.texts("Aclass", {"Atrajectory", "1.1        ", "           ", transposed ? "binTrans   " : "binNormal  "},
               false);
    file.texts("name", {"time  ", "a.x   ", "a.v   ", "minus ", "a.m   "}, transposed);
    file.texts("description", {"Time [s]  ", "x [m|mm]  ", "v         ", "]         ", "Mass [kg] "}, transposed);
    if (transposed) {
        file.matrix<std::int32_t>("dataInfo", 20, 4, 5,
                                  {0, 1, 0, -1, 2, 2, 0, -1, 2, 3, 0, -1, 2, -2, 0, -1, 1, 2, 0, 0});
        file.matrix<double>("data_1", 0, 2, 2, {0, 2.5, 0.5, 2.5});
        file.matrix<float>("data_2", 10, 3, 3, {0, 1, 10, 0.25, 2, 20, 0.5, 3, 30});
    } else {
        file.matrix<std::int32_t>("dataInfo", 20, 5, 4,
                                  {0, 2, 2, 2, 1, 1, 2, 3, -2, 2, 0, 0, 0, 0, 0, -1, -1, -1, -1, 0});
        file.matrix<double>("data_1", 0, 2, 2, {0, 0.5, 2.5, 2.5});
        file.matrix<double>("data_2", 0, 3, 3, {0, 0.25, 0.5, 1, 2, 3, 10, 20, 30});
    }
    return file.bytes;
}

TEST(Mat4, ReadsResultsOfDymolaInBothLayouts) {
    for (const auto& bytes : {trajectory(true), trajectory(false), trajectory(true, true), trajectory(false, true)}) {
        const Table all = record_from_bytes(bytes, "r.mat").table;
        EXPECT_EQ(all.names(), (std::vector<std::string>{"time", "a.x", "a.v", "minus"}));
        EXPECT_EQ(all["a.x"].values, (Values{1, 2, 3}));
        EXPECT_EQ(all["a.x"].unit, "m");
        EXPECT_EQ(all["a.v"].unit, "");
        EXPECT_EQ(all["minus"].values, (Values{-1, -2, -3}));
        const Table some =
            record_from_bytes(bytes, "r.mat", RecordOptions::parse("t=time,m=a.m,v=a.v", "v=2"), {"t"}).table;
        EXPECT_EQ(some["t"].values, (Values{0, 0.25, 0.5}));
        EXPECT_EQ(some["m"].values, (Values{2.5, 2.5, 2.5}));
        EXPECT_EQ(some["m"].unit, "kg");
        EXPECT_EQ(some["v"].values, (Values{20, 40, 60}));
    }
}

TEST(Mat4, WritesResultsOfDymola) {
    Table table;
    table.add("t", "s", {0, 0.25, 0.25});
    table.add("motor.i", "A", {1, 2, -3});
    table.add("x", "", {10, 20, std::nan("")});
    ByHand file;
    file.texts("Aclass", {"Atrajectory", "1.1        ", "           ", "binTrans   "}, false);
    file.texts("name", {"Time   ", "motor.i", "x      "}, true).texts("description", {"[s]", "[A]", "   "}, true);
    file.matrix<std::int32_t>("dataInfo", 20, 4, 3, {0, 1, 0, -1, 2, 2, 0, -1, 2, 3, 0, -1});
    file.matrix<double>("data_1", 0, 1, 2, {0, 0.25});
    file.matrix<double>("data_2", 0, 3, 3, {0, 1, 10, 0.25, 2, 20, 0.25, -3, std::nan("")});
    EXPECT_EQ(to_trajectory(table), file.bytes);

    EXPECT_EQ(problem_of([] { to_trajectory(Table{}); }),
              "input: there are no rows, a result of Dymola must have one at least");
    table.columns[0].values[2] = 0.1;
    EXPECT_EQ(problem_of([&] { to_trajectory(table); }),
              "input: column t is the time of a result of Dymola and must not decrease; row 3 is 0.1");
    table.columns[0].values[2] = std::nan("");
    EXPECT_EQ(problem_of([&] { to_trajectory(table); }),
              "input: column t is the time of a result of Dymola and must not decrease; row 3 is nan");
}

TEST(Mat4, ReadsVectorsOfEachType) {
    for (const bool big_endian : {false, true}) {
        ByHand file(big_endian);
        file.matrix<double>("d", 0, 3, 1, {1, 2.5, -3}).matrix<float>("f", 10, 1, 3, {1, 2.5, -3});
        file.matrix<std::int32_t>("i", 20, 3, 1, {1, -2, 3}).matrix<std::int16_t>("s", 30, 3, 1, {1, -2, 3});
        file.matrix<std::uint16_t>("w", 40, 3, 1, {1, 2, 65535}).matrix<std::uint8_t>("b", 50, 3, 1, {1, 2, 255});
        const Table table = record_from_bytes(file.bytes, "v.mat").table;
        EXPECT_EQ(table["d"].values, (Values{1, 2.5, -3}));
        EXPECT_EQ(table["f"].values, (Values{1, 2.5, -3}));
        EXPECT_EQ(table["i"].values, (Values{1, -2, 3}));
        EXPECT_EQ(table["s"].values, (Values{1, -2, 3}));
        EXPECT_EQ(table["w"].values, (Values{1, 2, 65535}));
        EXPECT_EQ(table["b"].values, (Values{1, 2, 255}));
    }
}

TEST(Mat4, SaysWhatIsNoColumn) {
    ByHand file;
    file.matrix<double>("t", 0, 2, 1, {0, 1}).matrix<double>("A", 0, 2, 2, {1, 2, 3, 4});
    file.texts("s", {"ab"}, false)
        .matrix<double>("c", 0, 2, 1, {1, 2, 3, 4}, 1)
        .matrix<double>("p", 2, 1, 3, {1, 1, 5});
    const auto problem = [&](const std::string& name) {
        return problem_of([&] { record_from_bytes(file.bytes, "v.mat", RecordOptions::parse("u=" + name, "")); });
    };
    EXPECT_EQ(problem("A"), "input: v.mat: A is a matrix (2 x 2), must be a vector; vectors in the file: t");
    EXPECT_NE(problem("s").find("is a text"), std::string::npos);
    EXPECT_NE(problem("c").find("is complex"), std::string::npos);
    EXPECT_NE(problem("p").find("is a sparse matrix"), std::string::npos);
    const std::string result = trajectory(true);
    EXPECT_NE(problem_of([&] { mat4_variables(result, {}, 50, "r.mat"); }).find("--columns"), std::string::npos);
    EXPECT_NE(problem_of([&] {
                  record_from_bytes(result, "r.mat", RecordOptions::parse("t=tiem", ""));
              }).find("did you mean \"time\"?"),
              std::string::npos);
}

TEST(Mat4, DamageIsRefusedOrChangesNumbersOnly) {
    for (const auto& bytes : {trajectory(true), trajectory(false)}) {
        for (std::size_t length = 0; length < bytes.size(); ++length) {
            EXPECT_TRUE(problem_of([&] { record_from_bytes(bytes.substr(0, length), "r.mat"); }).starts_with("input: "))
                << length;
        }
        for (std::size_t place = 0; place < bytes.size(); ++place) {
            for (const int mask : {1, 0x40, 0xff}) {
                std::string damaged = bytes;
                damaged[place] = static_cast<char>(damaged[place] ^ mask);
                problem_of([&] { record_from_bytes(damaged, "r.mat"); }); // no crash, no endless work
            }
        }
    }
    EXPECT_FALSE(is_mat4("t,u\n0,1\n0.0005,2\n"));
    EXPECT_FALSE(is_mat4(std::string(64, '\0')));
}

} // namespace
} // namespace tribode
