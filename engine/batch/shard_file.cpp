#include "batch/shard_file.hpp"
#include "base/error.hpp"

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <limits>
#include <optional>
#include <sys/stat.h>
#include <type_traits>
#include <unistd.h>
#include <utility>

namespace tribode {

namespace fs = std::filesystem;

namespace {

struct RecordHead {
    std::uint64_t length, checksum;
};

constexpr std::uint64_t longest_record = std::uint64_t{1} << 36; // longer ones are rubbish

// FNV-1a over words of eight bytes: tells a torn record from a whole one.
std::uint64_t checksum(std::string_view bytes) {
    std::uint64_t hash = 0xcbf29ce484222325ULL;
    const auto add = [&hash](std::uint64_t word) {
        hash = (hash ^ word) * 0x100000001b3ULL;
        hash ^= hash >> 29;
    };
    std::size_t at = 0;
    for (; at + 8 <= bytes.size(); at += 8) {
        std::uint64_t word;
        std::memcpy(&word, bytes.data() + at, 8);
        add(word);
    }
    for (; at < bytes.size(); ++at) add(static_cast<unsigned char>(bytes[at]));
    add(bytes.size());
    return hash;
}

template <class T>
void put(std::string& out, const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

void put_text(std::string& out, std::string_view text) {
    put(out, static_cast<std::uint32_t>(text.size()));
    out += text;
}

void put_numbers(std::string& out, const std::vector<double>& numbers) {
    put(out, static_cast<std::uint32_t>(numbers.size()));
    out.append(reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(double));
}

// Reads what `put` wrote. The checksum has said that the bytes are whole; a wrong length is still no way out of them.
class Taker {
  public:
    explicit Taker(std::string_view bytes) : bytes_(bytes) {}

    template <class T>
    T take() {
        T value;
        std::memcpy(&value, some(sizeof value), sizeof value);
        return value;
    }
    std::string text() {
        const auto length = take<std::uint32_t>();
        return {some(length), length};
    }
    void numbers(std::vector<double>& numbers) {
        numbers.resize(take<std::uint32_t>());
        const std::size_t length = numbers.size() * sizeof(double);
        if (length) std::memcpy(numbers.data(), some(length), length);
    }

  private:
    const char* some(std::size_t length) {
        if (length > bytes_.size() - at_) throw InputError("a record of a shard is damaged");
        at_ += length;
        return bytes_.data() + at_ - length;
    }

    std::string_view bytes_;
    std::size_t at_ = 0;
};

// Appends head and content.
void put_record(std::string& out, const PointRow& row) {
    const std::size_t begin = out.size();
    out.append(sizeof(RecordHead), '\0');
    put(out, static_cast<std::uint64_t>(row.index));
    put_numbers(out, row.parameters);
    put_text(out, row.failure);
    put(out, static_cast<std::uint32_t>(row.fields.size()));
    for (const auto& field : row.fields) {
        put_text(out, field.name);
        put(out, static_cast<std::uint8_t>(field.list));
        put_numbers(out, field.values);
    }
    const auto content = std::string_view(out).substr(begin + sizeof(RecordHead));
    const RecordHead head{content.size(), checksum(content)};
    std::memcpy(out.data() + begin, &head, sizeof head);
}

void take_record(std::string_view bytes, PointRow& row) {
    Taker taker(bytes);
    row.index = taker.take<std::uint64_t>();
    taker.numbers(row.parameters);
    row.failure = taker.text();
    row.fields.resize(taker.take<std::uint32_t>());
    for (auto& field : row.fields) {
        field.name = taker.text();
        field.list = taker.take<std::uint8_t>() != 0;
        taker.numbers(field.values);
    }
}

// Apart from the complete ones, so that it is a short list.
fs::path parts_folder(const fs::path& folder) { return folder / "parts"; }

std::string stem_of(std::size_t shard) { return fmt::format("{:05}", shard); }

ShardHeader header_of(const Manifest& manifest, std::size_t shard) {
    ShardHeader header{};
    std::memcpy(header.magic, ShardHeader::magic_text, sizeof header.magic);
    std::memcpy(header.identity, manifest.identity().data(), sizeof header.identity);
    header.shard = shard;
    header.first = manifest.range(shard).first;
    header.last = manifest.range(shard).last;
    return header;
}

bool belongs(const ShardHeader& found, const ShardHeader& wanted) {
    return std::memcmp(found.magic, wanted.magic, sizeof found.magic) == 0 &&
           std::memcmp(found.identity, wanted.identity, sizeof found.identity) == 0 && found.shard == wanted.shard &&
           found.first == wanted.first && found.last == wanted.last;
}

void require_belongs(const ShardHeader& found, const ShardHeader& wanted, const fs::path& path) {
    if (belongs(found, wanted)) return;
    throw InputError(fmt::format("{}: belongs to another batch or another plan of it; move it away", path.string()));
}

} // namespace

std::string to_bytes(const PointRow& row) {
    std::string bytes;
    put_record(bytes, row);
    return bytes;
}

fs::path rows_path(const fs::path& folder, std::size_t shard) { return folder / "shards" / (stem_of(shard) + ".rows"); }

std::vector<fs::path> parts_of(const fs::path& folder, std::size_t shard) {
    std::vector<fs::path> parts;
    std::error_code problem;
    const std::string beginning = stem_of(shard) + ".";
    for (fs::directory_iterator it(parts_folder(folder), problem), end; !problem && it != end; it.increment(problem)) {
        const std::string name = it->path().filename().string();
        if (name.starts_with(beginning) && name.ends_with(".part")) parts.push_back(it->path());
    }
    std::sort(parts.begin(), parts.end());
    return parts;
}

std::optional<ShardHeader> read_shard_header(const fs::path& path, const Manifest& manifest, std::size_t shard) {
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (file < 0) return std::nullopt;
    ShardHeader header{};
    const ssize_t got = ::pread(file, &header, sizeof header, 0);
    ::close(file);
    if (got != static_cast<ssize_t>(sizeof header)) return std::nullopt;
    require_belongs(header, header_of(manifest, shard), path);
    return header;
}

// ---- reading -----------------------------------------------------------------------------------------------------

ShardReader::ShardReader(const fs::path& path, const Manifest& manifest, std::size_t shard)
    : path_(path),
      file_(std::fopen(path.c_str(), "rbe")) {
    if (!file_) throw InputError(fmt::format("{}: cannot be read ({})", path.string(), std::strerror(errno)));
    struct stat about {};
    if (::fstat(fileno(file_.get()), &about) == 0) size_ = static_cast<std::uint64_t>(about.st_size);
    // One that was cut off within its header belongs nowhere.
    if (std::fread(&header_, sizeof header_, 1, file_.get()) != 1) header_ = {};
    require_belongs(header_, header_of(manifest, shard), path);
    bytes_ = sizeof header_;
}

bool ShardReader::read_record() {
    RecordHead head;
    if (std::fread(&head, sizeof head, 1, file_.get()) != 1) return false;
    if (head.length > longest_record || head.length > size_ - bytes_) return false;
    record_.resize(head.length);
    if (std::fread(record_.data(), 1, record_.size(), file_.get()) != record_.size()) return false;
    if (checksum(record_) != head.checksum) return false;
    bytes_ += sizeof head + head.length;
    ++points_;
    return true;
}

bool ShardReader::next(PointRow& row) {
    if (!read_record()) return false;
    take_record(record_, row);
    if (row.index != header_.first + points_ - 1) {
        throw InputError(
            fmt::format("{}: holds point {} in place of {}", path_.string(), row.index, header_.first + points_ - 1));
    }
    failed_ += !row.failure.empty();
    return true;
}

bool ShardReader::skip() {
    PointRow row;
    return next(row);
}

// ---- writing -----------------------------------------------------------------------------------------------------

ShardWriter::ShardWriter(const fs::path& folder, const Manifest& manifest, std::size_t shard)
    : folder_(folder),
      shard_(shard),
      header_(header_of(manifest, shard)) {
    char host[256] = "";
    ::gethostname(host, sizeof host - 1);
    const auto parts = parts_of(folder, shard);
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    path_ = parts_folder(folder) / fmt::format("{}.{}-{}-{:x}.part", stem_of(shard), host, ::getpid(),
                                               std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
    std::error_code problem;
    fs::create_directories(path_.parent_path(), problem);
    fs::create_directories(folder / "shards", problem);
    file_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file_ < 0) fail();
    counted_ = written_ = synced_ = Clock::now();
    try {
        write(std::string_view(reinterpret_cast<const char*>(&header_), sizeof header_));
        fs::path longest;
        std::size_t most = 0;
        for (const auto& part : parts) {
            try {
                ShardReader reader(part, manifest, shard);
                while (reader.skip()) {
                }
                if (reader.points() <= most) continue;
                most = reader.points();
                longest = part;
            } catch (const InputError&) {
                // Another's, or cut off at its head: not taken over.
            }
        }
        if (most > 0) {
            ShardReader reader(longest, manifest, shard);
            header_.seconds = reader.header().seconds;
            PointRow row;
            while (header_.done < most && reader.next(row)) {
                put_record(gathered_, row);
                ++header_.done;
                header_.failed += !row.failure.empty();
                if (gathered_.size() > (1 << 20)) flush();
            }
            flush();
            sync();
        }
        for (const auto& part : parts) fs::remove(part, problem);
    } catch (...) {
        // Nothing of its own is in it.
        ::close(std::exchange(file_, -1));
        fs::remove(path_, problem);
        throw;
    }
}

ShardWriter::~ShardWriter() {
    if (file_ < 0) return;
    try {
        flush();
    } catch (const OutputError&) {
        // The points that did not reach the file are run again.
    }
    if (file_ >= 0) ::close(file_);
}

void ShardWriter::add(const PointRow& row) {
    assert(row.index == next_index());
    put_record(gathered_, row);
    ++header_.done;
    header_.failed += !row.failure.empty();
    const auto now = Clock::now();
    header_.seconds += std::chrono::duration<double>(now - counted_).count();
    counted_ = now;
    if (now - written_ > std::chrono::milliseconds(50) || gathered_.size() > (1 << 20)) flush();
    if (now - synced_ > std::chrono::seconds(2)) sync();
}

void ShardWriter::flush() {
    if (gathered_.empty()) return;
    // What the disk refused once is not tried again.
    std::string bytes;
    bytes.swap(gathered_);
    write(bytes);
    // The counts in the header are for display; what the file holds is said by its records.
    write_header();
    written_ = Clock::now();
}

void ShardWriter::finish() {
    flush();
    sync();
    const fs::path rows = rows_path(folder_, shard_);
    ::close(std::exchange(file_, -1));
    if (::rename(path_.c_str(), rows.c_str()) != 0) {
        // Another attempt has taken this one over; where it has come to the end, its bytes are the same.
        if (errno == ENOENT && fs::exists(rows)) return;
        fail();
    }
    // The new name has to reach the disk, too.
    const int folder = ::open(rows.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder >= 0) {
        ::fsync(folder);
        ::close(folder);
    }
    std::error_code problem;
    for (const auto& part : parts_of(folder_, shard_)) fs::remove(part, problem);
}

void ShardWriter::write(std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t written = ::write(file_, bytes.data(), bytes.size());
        if (written < 0 && errno != EINTR) fail();
        if (written > 0) bytes.remove_prefix(static_cast<std::size_t>(written));
    }
}

void ShardWriter::write_header() {
    if (::pwrite(file_, &header_, sizeof header_, 0) != static_cast<ssize_t>(sizeof header_)) fail();
}

void ShardWriter::sync() {
    if (::fsync(file_) != 0) fail();
    synced_ = Clock::now();
}

void ShardWriter::fail() const {
    throw OutputError(
        fmt::format("{}: cannot be written ({}); what is done is kept", path_.string(), std::strerror(errno)));
}

} // namespace tribode
