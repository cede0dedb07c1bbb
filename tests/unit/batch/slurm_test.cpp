#include "tribode/batch/slurm.hpp"
#include "unit/script/messages.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

TEST(Slurm, IndicesAreWrittenAsRanges) {
    EXPECT_EQ(index_list({}), "");
    EXPECT_EQ(index_list({5}), "5");
    EXPECT_EQ(index_list({1, 2, 3, 4, 7, 9, 10}), "1-4,7,9-10");
}

TEST(Slurm, ShardsAboveTheLargestIndexGoToFurtherArrays) {
    Manifest manifest;
    manifest.name = "a b";
    manifest.count = manifest.shards = 30;
    const auto arrays = slurm_arrays("/it's/here", manifest, {1, 9, 10, 11, 30}, {.program = "/bin/tribode"}, 10);
    ASSERT_EQ(arrays.size(), 3u);
    EXPECT_EQ(arrays[0].offset, 0u);
    EXPECT_EQ(arrays[0].tasks, 3u);
    EXPECT_NE(arrays[0].script.find("#SBATCH --array=1,9-10\n"), std::string::npos);
    EXPECT_NE(arrays[0].script.find("#SBATCH --job-name=tribode-a-b\n"), std::string::npos);
    EXPECT_NE(arrays[0].script.find("batch shard '/it'\\''s/here' $((0 + SLURM_ARRAY_TASK_ID))"), std::string::npos);
    EXPECT_EQ(arrays[1].offset, 10u);
    EXPECT_NE(arrays[1].script.find("#SBATCH --array=1\n"), std::string::npos);
    EXPECT_EQ(arrays[2].offset, 20u);
    EXPECT_NE(arrays[2].script.find("#SBATCH --array=10\n"), std::string::npos);
}

// The name would end the comment line of sbatch, and what follows would be a command.
TEST(Slurm, NoNameBreaksALine) {
    Manifest manifest;
    manifest.count = manifest.shards = 1;
    const auto problem = [&](const std::string& folder, const SlurmOptions& options) {
        return problem_of([&] { slurm_arrays(folder, manifest, {1}, options, 10); });
    };
    EXPECT_EQ(problem("/a b/'c", {.program = "/bin/tribode"}), "none: ");
    const std::string end =
        " has a line break or another control character, which a script of Slurm cannot hold; choose "
        "another name";
    EXPECT_EQ(problem("/x\nid>y #", {.program = "/bin/tribode"}), "input: \"/x\\x0aid>y #/slurm/%A_%a.log\"" + end);
    EXPECT_EQ(problem("/x", {.program = "/bin\r/tribode"}), "input: \"/bin\\x0d/tribode\"" + end);
    EXPECT_EQ(problem("/x", {.sbatch = {"--a\nid"}, .program = "/bin/tribode"}), "input: \"--a\\x0aid\"" + end);
    manifest.name = "a\nid";
    EXPECT_EQ(problem("/x", {.program = "/bin/tribode"}), "none: "); // becomes tribode-a-id
}

} // namespace
} // namespace tribode
