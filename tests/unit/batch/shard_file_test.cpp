#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/batch/shard_file.hpp"
#include "unit/script/messages.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cstring>
#include <gtest/gtest.h>

namespace tribode {
namespace {

// Shards that nobody's run has written: their checksums are good, and what they hold fits no batch.
class ForgedShard : public ::testing::Test {
  protected:
    ForgedShard() {
        manifest.version = version();
        manifest.name = "forged";
        manifest.count = 2;
        manifest.shards = 1;
        manifest.parameters = {"alpha"};
    }

    // What reading the two rows gives; "none: " where all is well.
    std::string problem(const PointRow& first, const PointRow& second) {
        ShardHeader header{};
        std::memcpy(header.magic, ShardHeader::magic_text, sizeof header.magic);
        std::memcpy(header.identity, manifest.identity().data(), sizeof header.identity);
        header.shard = header.first = 1;
        header.last = header.done = 2;
        const std::string head(reinterpret_cast<const char*>(&header), sizeof header);
        return problem_of_bytes(head + to_bytes(first) + to_bytes(second));
    }
    std::string problem_of_bytes(const std::string& bytes) {
        const auto file = folder.write("1.rows", bytes);
        std::string text = problem_of([&] {
            ShardReader reader(file, manifest, 1);
            PointRow row;
            while (reader.next(row)) {
            }
            if (reader.points() < 2) throw InputError("cut short");
        });
        if (const auto at = text.find("1.rows: "); at != std::string::npos) text.erase(0, at + 8);
        return text;
    }

    TemporaryFolder folder;
    Manifest manifest;
    const PointRow good{1, {1}, "", {{"x", false, {2}}, {"y", true, {}}}};
};

TEST_F(ForgedShard, OnlyRowsOfTheBatchAreRead) {
    const std::string refusal =
        " is no result of this batch; remove it, and tribode batch resume runs its points again";
    const auto second = [&](PointRow row) {
        row.index = 2;
        return problem(good, row);
    };
    EXPECT_EQ(second(good), "none: ");
    EXPECT_EQ(second({2, {1}, "went wrong", {}}), "none: ");
    for (const PointRow& row :
         std::vector<PointRow>{{2, {}, "", {}},                                      // too few parameters
                               {2, std::vector<double>(60), "", {}},                 // far too many
                               {2, {1}, "", {{"x", false, {}}}},                     // a number that is none
                               {2, {1}, "", {{"x", false, {1, 2}}}},                 // or two
                               {2, {1}, "", {{"y", false, {1}}, {"x", false, {1}}}}, // out of order
                               {2, {1}, "", {{"x", false, {1}}, {"x", false, {1}}}}, // twice
                               {2, {1}, "", {{"", false, {1}}}},                     // names that no table holds
                               {2, {1}, "", {{"a,b", false, {1}}}},
                               {2, {1}, "", {{"a\nb", false, {1}}}},
                               {2, {1}, "", {{"reason", false, {1}}}},
                               {2, {1}, "failed", {{"x", false, {1}}}}}) { // failed, with a result
        EXPECT_EQ(second(row), "what it holds of point 2" + refusal);
    }
    PointRow other = good;
    other.index = 7;
    EXPECT_EQ(problem(good, other), "holds point 7 in place of 2");
}

// Lengths that the bytes do not have: nothing is made for them first.
TEST_F(ForgedShard, NoLengthIsBelieved) {
    ShardHeader header{};
    std::memcpy(header.magic, ShardHeader::magic_text, sizeof header.magic);
    std::memcpy(header.identity, manifest.identity().data(), sizeof header.identity);
    header.shard = header.first = 1;
    header.last = 2;
    const std::string head(reinterpret_cast<const char*>(&header), sizeof header);
    for (const std::uint64_t length : {std::uint64_t{1} << 35, ~std::uint64_t{0}, ~std::uint64_t{0} - 15}) {
        std::string bytes = head + to_bytes(good);
        std::memcpy(bytes.data() + head.size(), &length, sizeof length);
        EXPECT_EQ(problem_of_bytes(bytes), "input: cut short");
    }
}

} // namespace
} // namespace tribode
