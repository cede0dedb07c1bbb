#include "tribode/record/csv.hpp"
#include "tribode/record/given_record.hpp"
#include "unit/script/temporary_folder.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

TEST(GivenRecord, columns_without_t_begin_at_zero) {
    GivenRecord given;
    given.table.source = "lists";
    given.table.add("u", "", {1, 2, 3});
    const Table table = given.read({}, {"t", "u"}, 0.5);
    EXPECT_EQ(table["t"].values, (std::vector<double>{0, 0.5, 1}));
    EXPECT_EQ(table["u"].values, (std::vector<double>{1, 2, 3}));
    EXPECT_EQ(given.name(), "lists");
    given.table.add("t", "s", {4, 5, 6});
    EXPECT_EQ(given.read({}, {}, 0.5)["t"].values, (std::vector<double>{4, 5, 6}));
}

TEST(GivenRecord, a_file_is_read_by_the_options) {
    const TemporaryFolder folder;
    Table table;
    table.add("time", "s", {0, 1});
    table.add("u", "N", {3, 4});
    write_csv(folder.path() / "r.csv", table);
    const GivenRecord given{folder.path() / "r.csv", {}};
    const Table read = given.read({{{"t", "time"}}, {{"u", 2}}}, {"t", "u"}, 0.5);
    EXPECT_EQ(read["t"].values, (std::vector<double>{0, 1}));
    EXPECT_EQ(read["u"].values, (std::vector<double>{6, 8}));
    EXPECT_EQ(given.json()["file"], (folder.path() / "r.csv").string());
}

TEST(GivenRecord, the_hash_is_that_of_names_and_values) {
    const auto hash = [](const char* name, double value) {
        GivenRecord given;
        given.table.add(name, "", {value});
        return given.hash();
    };
    EXPECT_EQ(hash("u", 1), hash("u", 1));
    EXPECT_NE(hash("u", 1), hash("u", 2));
    EXPECT_NE(hash("u", 1), hash("y", 1));
}

} // namespace
} // namespace tribode
