#include "tribode/base/random.hpp"
#include "tribode/record/csv.hpp"
#include "unit/script/messages.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

class Csv : public testing::Test {
  protected:
    Table read(std::string_view text) { return read_csv(folder_.write("x.csv", text)); }
    // The message less the folder.
    std::string refused(std::string_view text) {
        const std::string problem = problem_of([&] { read(text); });
        const std::string prefix = "input: " + (folder_ / "x.csv").string();
        EXPECT_TRUE(problem.starts_with(prefix)) << problem;
        return problem.size() > prefix.size() ? problem.substr(prefix.size()) : problem;
    }
    TemporaryFolder folder_;
};

TEST_F(Csv, ReadsWhatSpreadsheetsWrite) {
    const Table plain = read("t,u\n0,1\n0.5,-2e-3\n");
    EXPECT_EQ(plain["t"].values, (std::vector<double>{0, 0.5}));
    EXPECT_EQ(plain["u"].values, (std::vector<double>{1, -2e-3}));
    const Table same = read("\xEF\xBB\xBF# made by hand\n\"t\",u\r\n0,1\r\n0.5,-2e-3\r\n\r\n\n");
    EXPECT_EQ(same["t"].values, plain["t"].values);
    EXPECT_EQ(same["u"].values, plain["u"].values);
}

TEST_F(Csv, SaysFileLineAndWhatIsWrong) {
    EXPECT_NE(refused("").find("empty"), std::string::npos);
    EXPECT_NE(refused("t,u\n").find("no "), std::string::npos);
    EXPECT_EQ(refused("t,u\n0,1\n1,nan\n"), ":3: column u is nan, must be a finite number");
    EXPECT_EQ(refused("t,u\n0,inf\n"), ":2: column u is inf, must be a finite number");
    EXPECT_TRUE(refused("t,u\n0,1\n1,abc\n").starts_with(":3: column u"));
    EXPECT_TRUE(refused("t,u\n0,1\n1\n").starts_with(":3: "));
    EXPECT_TRUE(refused("t,u\n0,1\n1,2,3\n").starts_with(":3: "));
    EXPECT_TRUE(refused("t,t\n0,1\n").starts_with(":1: "));
    EXPECT_TRUE(refused("t,u\n0,1\n\n1,2\n").starts_with(":3: ")); // a blank line in the middle
    EXPECT_TRUE(problem_of([&] { read_csv(folder_ / "none.csv"); }).ends_with("(No such file or directory)"));
}

TEST_F(Csv, EveryDoubleReadsBack) {
    Table table;
    std::vector<double> values = {0.1, -0.0, 5e-324, 1.7976931348623157e308, 1.0 / 3};
    for (std::uint64_t i = 0; i < 1000; ++i) values.push_back(standard_normal(1, 0, i) * std::pow(10, i % 40) * 1e-20);
    table.add("x", "m", values);
    const Table back = read(to_csv(table));
    EXPECT_EQ(back["x"].values, values);
}

TEST_F(Csv, ATimeColumnMustBeUniform) {
    const auto uniform = [&](std::string_view text) {
        return problem_of([&] { require_uniform_time(read(text), 0.5); });
    };
    EXPECT_EQ(uniform("t\n0\n0.5\n1\n"), "none: ");
    EXPECT_EQ(uniform("t\n7\n7.5\n8.0004\n"), "none: "); // within a thousandth of a sample
    const std::string gap = uniform("t\n0\n0.5\n1.5\n");
    EXPECT_NE(gap.find("x.csv:4: t = 1.5 s, expected 1 s (sample time 0.5 s): the record has a gap in time"),
              std::string::npos)
        << gap;
    EXPECT_NE(uniform("t\n0\n0.5\n0.5\n").find(":4: "), std::string::npos);
    EXPECT_NE(uniform("u\n0\n").find("no column t"), std::string::npos);
}

TEST_F(Csv, AMissingColumnNamesTheNearest) {
    const std::string problem = problem_of([&] { read("time,u\n0,1\n")["tim"]; });
    EXPECT_NE(problem.find("did you mean \"time\"?"), std::string::npos) << problem;
}

} // namespace
} // namespace tribode
