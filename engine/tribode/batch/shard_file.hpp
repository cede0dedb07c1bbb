#pragma once
#include "tribode/batch/manifest.hpp"

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// The results of one shard, in the folder of a batch.
//
//   shards/00012.rows                   complete: the points first..last in order. It takes this name once all is on the
//                                       disk
//   parts/00012.<host>-<pid>-<n>.part   an attempt: the points from first on, as far as they got. Each attempt has a file
//                                       of its own, so that two at work on one shard (a node that was only thought lost)
//                                       do no harm
//
// A file is a header and then one record per point, each with its length and a checksum; what a crash has left
// half-written at the end is not read. Numbers are in the byte order of the machine.
struct ShardHeader {
    static constexpr char magic_text[9] = "TRBSHRD1";

    char magic[8];
    char identity[64];          // of the manifest
    std::uint64_t shard;        // from 1
    std::uint64_t first, last;  // points
    std::uint64_t done, failed; // points in the file, and those of them without a result
    double seconds;             // spent on them
};

// What precedes each record, behind its length (8 bytes each): FNV-1a over words of eight bytes. Tells a torn
// record from a whole one.
std::uint64_t record_checksum(std::string_view record);

// A point as it is in such a file: the same row gives the same bytes.
std::string to_bytes(const PointRow& row);

std::filesystem::path rows_path(const std::filesystem::path& folder, std::size_t shard);
// The attempts at a shard that are left, of any batch.
std::vector<std::filesystem::path> parts_of(const std::filesystem::path& folder, std::size_t shard);

// Whether a process is at work on the attempt: by its lock where it is one of this computer, else by the last half minute.
bool is_at_work(const std::filesystem::path& part);

// What the header of a file says; nothing where there is none. Throws InputError where the file is no shard of the batch.
std::optional<ShardHeader> read_shard_header(const std::filesystem::path& path, const Manifest& manifest,
                                             std::size_t shard);

// Reads one file from its beginning.
class ShardReader {
  public:
    // Throws InputError where the file cannot be read or is no shard of the batch.
    ShardReader(const std::filesystem::path& path, const Manifest& manifest, std::size_t shard);

    // The next point; false at the end of what is whole.
    bool next(PointRow& row);
    // Reads on to the last of the points, or of those that are whole; returns how many there are.
    std::size_t count();

    std::size_t points() const { return points_; } // read so far
    std::size_t failed() const { return failed_; }
    std::uint64_t bytes() const { return bytes_; } // read so far, header included
    const ShardHeader& header() const { return header_; }

  private:
    struct Closer {
        void operator()(std::FILE* file) const { std::fclose(file); }
    };
    bool read_record();

    std::filesystem::path path_;
    std::unique_ptr<std::FILE, Closer> file_;
    std::size_t parameters_; // of a point
    ShardHeader header_{};
    std::string record_;
    std::size_t points_ = 0, failed_ = 0;
    std::uint64_t bytes_ = 0, size_ = 0;
};

// Writes one attempt. What other attempts have left is taken over: the one with the most points is copied, and all are
// removed. Functions throw OutputError where the disk does not take it; what was written stays.
class ShardWriter {
  public:
    ShardWriter(const std::filesystem::path& folder, const Manifest& manifest, std::size_t shard);
    ~ShardWriter();
    ShardWriter(const ShardWriter&) = delete;
    ShardWriter& operator=(const ShardWriter&) = delete;

    std::size_t next_index() const { return static_cast<std::size_t>(header_.first + header_.done); }
    bool complete() const { return next_index() > header_.last; }

    // Keeps the next point. Points of a few microseconds are gathered: the file follows within a twentieth of a
    // second, the disk within two seconds.
    void add(const PointRow& row);
    // Writes what was gathered. Called before a point that may take long.
    void flush();
    // Gives the complete file its name. All attempts at this shard are then removed. Throws EndedEarly where another
    // attempt has taken this one over and is still at work.
    void finish();

  private:
    using Clock = std::chrono::steady_clock;
    void write(std::string_view bytes);
    void write_header();
    void sync();
    [[noreturn]] void fail() const;

    std::filesystem::path folder_, path_;
    std::size_t shard_;
    ShardHeader header_{};
    std::string gathered_;
    int file_ = -1;
    Clock::time_point counted_, written_, synced_;
};

} // namespace tribode
