#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/batch/merge.hpp"
#include "tribode/batch/plan.hpp"
#include "tribode/batch/shard_file.hpp"
#include "tribode/batch/status.hpp"
#include "tribode/batch/workers.hpp"
#include "tribode/record/hdf5.hpp"
#include "tribode/record/output_file.hpp"
#include "unit/script/temporary_folder.hpp"

#include <csignal>
#include <fstream>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

namespace tribode {
namespace {

namespace fs = std::filesystem;

PointRow squared(std::size_t index) {
    const auto x = static_cast<double>(index);
    return {index, {x}, "", {{"list", true, std::vector<double>(index % 3, x)}, {"square", false, {x * x}}}};
}

class Workers : public ::testing::Test {
  protected:
    // A batch of `count` points in `shards` shards, each point run by `run`.
    void plan(std::size_t count, std::size_t shards, std::function<PointRow(std::size_t)> run = squared) {
        batch.name = "squares";
        batch.count = count;
        batch.parameters = {"x"};
        batch.point = [](std::size_t index) { return std::vector{static_cast<double>(index)}; };
        batch.run = squared; // for the pilot
        batch.files_read = [] { return std::vector<std::string>{"script"}; };
        manifest = plan_batch(place, batch, {.shards = shards}, {}, [](const std::string& name) {
            return SourceFile{name, sha256(name)};
        });
        batch.run = std::move(run);
    }

    bool run_missing(unsigned workers = 2) {
        RunControl control;
        control.workers = workers;
        return run_shards(place, manifest, batch, missing_shards(place, manifest), control);
    }

    std::vector<PointRow> rows() const {
        std::vector<PointRow> rows;
        for_each_point(place, manifest, [&](const PointRow& row) { rows.push_back(row); });
        return rows;
    }

    // The rows that `failed` names have a failure with this part, all others are as undisturbed.
    void expect_rows(const std::vector<std::size_t>& failed, const std::string& part) const {
        const auto found = rows();
        ASSERT_EQ(found.size(), batch.count);
        for (const PointRow& row : found) {
            if (std::find(failed.begin(), failed.end(), row.index) == failed.end()) {
                EXPECT_EQ(to_bytes(row), to_bytes(squared(row.index)));
            } else {
                EXPECT_NE(row.failure.find(part), std::string::npos) << row.failure;
                EXPECT_EQ(row.parameters.front(), static_cast<double>(row.index));
                EXPECT_TRUE(row.fields.empty());
            }
        }
    }

    TemporaryFolder folder;
    const fs::path place = folder / "b";
    Batch batch;
    Manifest manifest;
};

TEST_F(Workers, APointThatCrashesIsARowAndTheOthersAreKept) {
    plan(30, 3, [](std::size_t index) {
        // The default action, past any handler of a sanitizer.
        if (index == 7 || index == 30) {
            std::signal(SIGSEGV, SIG_DFL);
            std::raise(SIGSEGV);
        }
        return squared(index);
    });
    EXPECT_TRUE(run_missing());
    expect_rows({7, 30}, "crashed its process (signal 11");
}

TEST_F(Workers, APointThatEndsItsProcessIsARow) {
    plan(10, 1, [](std::size_t index) {
        if (index == 4) ::_exit(3);
        return squared(index);
    });
    EXPECT_TRUE(run_missing());
    expect_rows({4}, "ended its process with exit code 3");
}

// As the kernel does when memory runs out: tried again some times, because it may be another's fault.
TEST_F(Workers, APointDuringWhichTheProcessIsKilledAgainAndAgainIsARow) {
    plan(10, 2, [](std::size_t index) {
        if (index == 9) ::kill(::getpid(), SIGKILL);
        return squared(index);
    });
    EXPECT_TRUE(run_missing());
    expect_rows({9}, "killed 8 times while the point ran");
}

TEST_F(Workers, AProblemOfTheDiskEndsTheRunAndKeepsWhatIsDone) {
    plan(10, 1, [](std::size_t index) -> PointRow {
        if (index == 6) throw OutputError("no space");
        return squared(index);
    });
    EXPECT_THROW(run_missing(), OutputError);
    EXPECT_EQ(read_status(place, manifest).done, 5u);
    batch.run = squared;
    EXPECT_TRUE(run_missing());
    expect_rows({}, "");
}

TEST_F(Workers, AStopRequestEndsAtAPoint) {
    std::atomic<bool> stop{true};
    plan(10, 2);
    RunControl control;
    control.stop = &stop;
    EXPECT_FALSE(run_shards(place, manifest, batch, missing_shards(place, manifest), control));
    EXPECT_TRUE(run_missing());
    expect_rows({}, "");
}

// A file that ends anywhere, or has one wrong byte, is a file of the points before.
TEST_F(Workers, WhatACrashLeftHalfWrittenIsRunAgain) {
    plan(6, 1);
    EXPECT_TRUE(run_missing());
    const fs::path whole = rows_path(place, 1);
    const std::string bytes = read_file(whole);
    for (std::size_t length = 0; length <= bytes.size(); length += 7) {
        for (const bool cut : {true, false}) {
            std::string damaged = cut ? bytes.substr(0, length) : bytes;
            if (!cut && length < sizeof(ShardHeader)) continue; // it would belong to another batch
            if (!cut && length < bytes.size()) damaged[length] = static_cast<char>(damaged[length] ^ 0x10);
            fs::remove(whole);
            write_file(place / "parts/00001.host-1-1.part", damaged);
            ASSERT_TRUE(run_missing(1));
            ASSERT_TRUE(read_file(whole).substr(sizeof(ShardHeader)) == bytes.substr(sizeof(ShardHeader)))
                << "ended or damaged at byte " << length;
            ASSERT_TRUE(fs::is_empty(place / "parts"));
        }
    }
}

// The same under the name of a complete shard: it is not counted as one, and its whole points are not run again.
TEST_F(Workers, ADamagedResultIsRunAgainFromItsFirstLostPoint) {
    plan(6, 1);
    EXPECT_TRUE(run_missing());
    const fs::path whole = rows_path(place, 1), log = folder / "log";
    const std::string bytes = read_file(whole);
    batch.run = [&](std::size_t index) {
        std::ofstream(log, std::ios::app) << index;
        return squared(index);
    };
    for (std::size_t length = 0; length < bytes.size(); length += 7) {
        for (const bool cut : {true, false}) {
            if (!cut && length < sizeof(ShardHeader)) continue; // it would belong to another batch
            std::string damaged = cut ? bytes.substr(0, length) : bytes;
            if (!cut) damaged[length] = static_cast<char>(damaged[length] ^ 0x10);
            write_file(whole, damaged);
            const BatchStatus status = read_status(place, manifest);
            ASSERT_FALSE(status.complete()) << "ended or damaged at byte " << length;
            ASSERT_EQ(status.damaged, std::vector{whole});
            ASSERT_THROW(rows(), InputError);
            write_file(log, "");
            ASSERT_TRUE(run_missing(1));
            ASSERT_TRUE(read_file(whole).substr(sizeof(ShardHeader)) == bytes.substr(sizeof(ShardHeader)));
            ASSERT_EQ(read_file(log), std::string("123456").substr(status.done));
        }
    }
    EXPECT_TRUE(read_status(place, manifest).complete());
}

TEST_F(Workers, AnAttemptIsAtWorkAsLongAsItsProcessIs) {
    plan(6, 1);
    const pid_t process = ::fork();
    if (process == 0) {
        ShardWriter writer(place, manifest, 1);
        writer.add(squared(1));
        writer.flush();
        ::pause();
    }
    while (parts_of(place, 1).empty() || read_status(place, manifest).done == 0) ::usleep(1000);
    EXPECT_EQ(read_status(place, manifest).active_shards, 1u);
    ::kill(process, SIGKILL);
    ::waitpid(process, nullptr, 0);
    EXPECT_EQ(read_status(place, manifest).active_shards, 0u);
    EXPECT_EQ(read_status(place, manifest).done, 1u);
}

TEST_F(Workers, TheLongestAttemptIsTakenOver) {
    plan(6, 1);
    {
        ShardWriter writer(place, manifest, 1);
        for (std::size_t i = 1; i <= 4; ++i) writer.add(squared(i));
    }
    const std::string four = read_file(parts_of(place, 1).front());
    {
        ShardWriter writer(place, manifest, 1);
        EXPECT_EQ(writer.next_index(), 5u);
        writer.add(squared(5));
    }
    write_file(place / "parts/00001.zzz-1-1.part", four);
    ShardWriter writer(place, manifest, 1);
    EXPECT_EQ(writer.next_index(), 6u);
    EXPECT_EQ(parts_of(place, 1).size(), 1u);
}

// A node that was thought lost goes on beside the task that took its shard over.
TEST_F(Workers, TwoAttemptsAtOneShardDoNoHarm) {
    plan(6, 1);
    ShardWriter first(place, manifest, 1);
    for (std::size_t i = 1; i <= 3; ++i) first.add(squared(i));
    first.flush();
    ShardWriter second(place, manifest, 1);
    EXPECT_EQ(second.next_index(), 4u);
    for (std::size_t i = 4; i <= 6; ++i) {
        first.add(squared(i));
        second.add(squared(i));
    }
    second.finish();
    first.finish();
    expect_rows({}, "");
    EXPECT_TRUE(fs::is_empty(place / "parts"));
}

// The one that was taken over comes to its end first: it leaves the shard to the other.
TEST_F(Workers, AnAttemptThatWasTakenOverEndsEarly) {
    plan(6, 1);
    ShardWriter first(place, manifest, 1);
    for (std::size_t i = 1; i <= 6; ++i) first.add(squared(i));
    first.flush();
    ShardWriter second(place, manifest, 1);
    EXPECT_TRUE(second.complete());
    EXPECT_THROW(first.finish(), EndedEarly);
    second.finish();
    expect_rows({}, "");
}

TEST_F(Workers, AMergedListIsAMatrixFilledUpWithNaN) {
    plan(4, 2);
    EXPECT_TRUE(run_missing());
    const MergeSummary summary = merge_batch(place, manifest, folder / "m.h5");
    ASSERT_EQ(summary.columns.size(), 2u);
    EXPECT_EQ(summary.columns[0].width, 2u);
    const auto tables = read_hdf5(folder / "m.h5");
    EXPECT_EQ(tables.front().table.names(), (std::vector<std::string>{"index", "failed", "x", "square"}));
    EXPECT_EQ(tables.front().table["square"].values, (std::vector<double>{1, 4, 9, 16}));
}

TEST_F(Workers, PointsThatAreNotThePlannedOnesAreNotMerged) {
    plan(4, 2, [](std::size_t index) {
        PointRow row = squared(index);
        row.parameters = {0.5};
        return row;
    });
    EXPECT_TRUE(run_missing());
    EXPECT_THROW(merge_batch(place, manifest, folder / "m.h5"), InputError);
    EXPECT_FALSE(fs::exists(folder / "m.h5"));
}

TEST(Shards, CoverEveryPointOnce) {
    for (const std::size_t count : {1ul, 7ul, 1000ul, 1'000'003ul}) {
        for (const std::size_t shards : {1ul, 2ul, 64ul, 999ul}) {
            if (shards > count) continue;
            Manifest manifest;
            manifest.count = count;
            manifest.shards = shards;
            std::size_t next = 1;
            for (std::size_t k = 1; k <= shards; ++k) {
                EXPECT_EQ(manifest.range(k).first, next);
                EXPECT_GE(manifest.range(k).size(), count / shards);
                EXPECT_LE(manifest.range(k).size(), count / shards + 1);
                next = manifest.range(k).last + 1;
            }
            EXPECT_EQ(next, count + 1);
        }
    }
}

TEST(Shards, LastAsLongAsAskedForAndNoLessThanHalfASecond) {
    EXPECT_EQ(shard_count(1000, 1e-6, {}), 1u);
    EXPECT_EQ(shard_count(1000, 10e-3, {}), 20u);    // 10 s: half a second each
    EXPECT_EQ(shard_count(100'000, 10e-3, {}), 64u); // 1000 s
    EXPECT_EQ(shard_count(1'000'000, 1, {}), 8334u); // two minutes each
    EXPECT_EQ(shard_count(1'000'000, 1, {.shard_seconds = 600}), 1667u);
    EXPECT_EQ(shard_count(5, 1000, {}), 5u);
    EXPECT_EQ(shard_count(1000, 1, {.shards = 7}), 7u);
    EXPECT_EQ(shard_count(3, 1, {.shards = 7}), 3u);
}

TEST(PointSeed, IsAFunctionOfSeedAndIndexBelowTwoToThe53) {
    EXPECT_EQ(point_seed(7, 3), point_seed(7, 3));
    EXPECT_NE(point_seed(7, 3), point_seed(7, 4));
    EXPECT_NE(point_seed(7, 3), point_seed(8, 3));
    for (std::size_t i = 1; i < 1000; ++i) EXPECT_LT(point_seed(1, i), std::uint64_t{1} << 53);
}

} // namespace
} // namespace tribode
