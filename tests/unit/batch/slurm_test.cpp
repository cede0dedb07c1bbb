#include "batch/slurm.hpp"

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

} // namespace
} // namespace tribode
