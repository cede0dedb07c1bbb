#include "tribode/batch/shard_file.hpp"
#include "tribode/base/error.hpp"

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

} // namespace

std::uint64_t record_checksum(std::string_view bytes) {
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

namespace {

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

// A record that no run of the batch writes.
struct Malformed {};

// Reads what `put` wrote. The checksum says that the bytes are whole, not who wrote them: no length is believed that the
// bytes do not have, before anything is made for it.
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
        const std::size_t count = this->count(sizeof(double));
        numbers.resize(count);
        if (count) std::memcpy(numbers.data(), some(count * sizeof(double)), count * sizeof(double));
    }
    // How many things follow, of which each takes at least so many bytes.
    std::size_t count(std::size_t min_bytes) {
        const std::size_t count = take<std::uint32_t>();
        if (count > (bytes_.size() - at_) / min_bytes) throw Malformed{};
        return count;
    }
    bool at_end() const { return at_ == bytes_.size(); }

  private:
    const char* some(std::size_t length) {
        if (length > bytes_.size() - at_) throw Malformed{};
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
    const RecordHead head{content.size(), record_checksum(content)};
    std::memcpy(out.data() + begin, &head, sizeof head);
}

// Throws Malformed.
void take_record(std::string_view bytes, std::size_t parameters, PointRow& row) {
    constexpr std::size_t min_of_a_field = 2 * sizeof(std::uint32_t) + sizeof(std::uint8_t);
    Taker taker(bytes);
    row.index = taker.take<std::uint64_t>();
    taker.numbers(row.parameters);
    row.failure = taker.text();
    row.fields.resize(taker.count(min_of_a_field));
    for (auto& field : row.fields) {
        field.name = taker.text();
        field.list = taker.take<std::uint8_t>() != 0;
        taker.numbers(field.values);
        if (!is_column_name(field.name) || (!field.list && field.values.size() != 1)) throw Malformed{};
    }
    const bool in_order = std::is_sorted(row.fields.begin(), row.fields.end(),
                                         [](const auto& a, const auto& b) { return a.name <= b.name; });
    if (!taker.at_end() || !in_order || row.parameters.size() != parameters) throw Malformed{};
    if (!row.failure.empty() && !row.fields.empty()) throw Malformed{};
}

// Apart from the complete ones, so that it is a short list.
fs::path parts_folder(const fs::path& folder) { return folder / "parts"; }

std::string host_name() {
    char name[256] = "";
    ::gethostname(name, sizeof name - 1);
    return name;
}

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

bool is_at_work(const fs::path& part) {
    constexpr std::chrono::seconds still_active{30};
    // 00012.<host>-<pid>-<n>.part, where the name of a host may have a dash, too.
    const std::string name = part.filename().string(), ours = fmt::format(".{}-", host_name());
    const std::size_t at = name.find(ours);
    if (at != std::string::npos &&
        std::count(name.begin() + static_cast<std::ptrdiff_t>(at + ours.size()), name.end(), '-') == 1) {
        const int file = ::open(part.c_str(), O_RDONLY | O_CLOEXEC);
        struct flock whole {};
        whole.l_type = F_WRLCK;
        whole.l_whence = SEEK_SET;
        const bool known = file >= 0 && ::fcntl(file, F_GETLK, &whole) == 0;
        if (file >= 0) ::close(file);
        if (known) return whole.l_type != F_UNLCK;
    }
    std::error_code problem;
    const auto written = fs::last_write_time(part, problem);
    return !problem && fs::file_time_type::clock::now() - written < still_active;
}

std::optional<ShardHeader> read_shard_header(const fs::path& path, const Manifest& manifest, std::size_t shard) {
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (file < 0 && errno == ENOENT) return std::nullopt;
    // What is there and cannot be read is not missing: it is not run again.
    if (file < 0) throw InputError(fmt::format("{}: cannot be read ({})", path.string(), std::strerror(errno)));
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
      file_(std::fopen(path.c_str(), "rbe")),
      parameters_(manifest.parameters.size()) {
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
    if (size_ - bytes_ < sizeof head || head.length > size_ - bytes_ - sizeof head) return false;
    record_.resize(head.length);
    if (std::fread(record_.data(), 1, record_.size(), file_.get()) != record_.size()) return false;
    if (record_checksum(record_) != head.checksum) return false;
    bytes_ += sizeof head + head.length;
    return true;
}

bool ShardReader::next(PointRow& row) {
    if (!read_record()) return false;
    try {
        take_record(record_, parameters_, row);
    } catch (const Malformed&) {
        throw InputError(fmt::format("{}: what it holds of point {} is no result of this batch; remove it, and tribode "
                                     "batch resume runs its points again",
                                     path_.string(), header_.first + points_));
    }
    if (row.index != header_.first + points_) {
        throw InputError(
            fmt::format("{}: holds point {} in place of {}", path_.string(), row.index, header_.first + points_));
    }
    ++points_;
    failed_ += !row.failure.empty();
    return true;
}

std::size_t ShardReader::count() {
    PointRow row;
    try {
        while (header_.first + points_ <= header_.last && next(row)) {
        }
    } catch (const InputError&) {
        // What follows is none of its points.
    }
    return points_;
}

// ---- writing -----------------------------------------------------------------------------------------------------

ShardWriter::ShardWriter(const fs::path& folder, const Manifest& manifest, std::size_t shard)
    : folder_(folder),
      shard_(shard),
      header_(header_of(manifest, shard)) {
    const auto parts = parts_of(folder, shard);
    // What has the name of a complete shard is taken over, too: it is damaged, or there would be no attempt.
    auto sources = parts;
    sources.push_back(rows_path(folder, shard));
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    path_ = parts_folder(folder) / fmt::format("{}.{}-{}-{:x}.part", stem_of(shard), host_name(), ::getpid(),
                                               std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
    std::error_code problem;
    fs::create_directories(path_.parent_path(), problem);
    fs::create_directories(folder / "shards", problem);
    file_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file_ < 0) fail();
    // For those who ask who is at work; where the file system has no locks, the time of the file says it.
    struct flock whole {};
    whole.l_type = F_WRLCK;
    whole.l_whence = SEEK_SET;
    ::fcntl(file_, F_SETLK, &whole);
    counted_ = written_ = synced_ = Clock::now();
    try {
        write(std::string_view(reinterpret_cast<const char*>(&header_), sizeof header_));
        fs::path longest;
        std::size_t most = 0;
        for (const auto& source : sources) {
            try {
                ShardReader reader(source, manifest, shard);
                const std::size_t whole_points = reader.count();
                if (whole_points <= most) continue;
                most = whole_points;
                longest = source;
            } catch (const InputError&) {
                // Not there, another's, or cut off at its head: not taken over.
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
        if (errno == ENOENT) {
            throw EndedEarly(
                fmt::format("{}: was taken over by another attempt at its shard, or removed", path_.string()));
        }
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
