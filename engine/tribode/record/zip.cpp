#include "tribode/record/zip.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <cstdint>
#include <fmt/format.h>
#include <initializer_list>
#include <memory>
#include <new>
#include <utility>
#include <zlib.h>

namespace tribode {

namespace {

// A few kilobytes can unpack to gigabytes. Numbers of a measurement unpack to some ten times their packed size.
constexpr std::size_t always_unpacked = std::size_t{64} << 20, max_times = 256, max_unpacked = std::size_t{4} << 30;
constexpr int window_bits = 15, gzip_wrapper = 16;

// Feeds a zlib stream with input in pieces that fit its counters and collects what comes out.
class Stream {
  public:
    explicit Stream(std::string_view input) : rest_(input) {}

    // Runs `step` until it has no more to say; returns its last status. `out` grows up to `limit`.
    template <class Step>
    int run(z_stream& z, std::string& out, std::size_t limit, Step step) {
        int status = Z_OK;
        while (status == Z_OK) {
            if (z.avail_in == 0) {
                const std::size_t piece = std::min<std::size_t>(rest_.size(), 1u << 30);
                z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(rest_.data()));
                z.avail_in = static_cast<uInt>(piece);
                rest_.remove_prefix(piece);
            }
            const std::size_t length = out.size();
            if (length > limit) return Z_MEM_ERROR;
            const std::size_t room = std::min(std::clamp<std::size_t>(length, 4096, 1u << 28), limit - length + 1);
            out.resize(length + room);
            z.next_out = reinterpret_cast<Bytef*>(out.data() + length);
            z.avail_out = static_cast<uInt>(room);
            status = step(z, rest_.empty());
            out.resize(length + room - z.avail_out);
        }
        return status;
    }

    bool at_end(const z_stream& z) const { return rest_.empty() && z.avail_in == 0; }

  private:
    std::string_view rest_;
};

std::string unpack(std::string_view bytes, int bits, std::size_t most, const std::string& source) {
    z_stream z{};
    if (inflateInit2(&z, bits) != Z_OK) throw std::bad_alloc();
    const std::unique_ptr<z_stream, decltype(&inflateEnd)> owner(&z, inflateEnd);
    std::string out;
    Stream stream(bytes);
    int status = Z_OK;
    for (;;) {
        status = stream.run(z, out, most, [](z_stream& s, bool) { return inflate(&s, Z_NO_FLUSH); });
        // A gzip file may be several, one after the other.
        if (status != Z_STREAM_END || bits == window_bits || stream.at_end(z)) break;
        inflateReset(&z);
    }
    if (status == Z_MEM_ERROR || out.size() > most) {
        throw InputError(
            fmt::format("{}: unpacks to more than {} MiB, which is more than a file of this size may; it is "
                        "not read",
                        source, most >> 20));
    }
    if (status != Z_STREAM_END) {
        throw InputError(
            fmt::format("{}: the packed data are {}", source, status == Z_BUF_ERROR ? "cut short" : "damaged"));
    }
    return out;
}

} // namespace

bool is_gzip(std::string_view bytes) { return bytes.starts_with("\x1f\x8b\x08"); }

std::size_t max_unpacked_of(std::size_t packed) {
    return packed > max_unpacked / max_times ? max_unpacked
                                             : std::min(max_unpacked, always_unpacked + max_times * packed);
}

std::string gunzip(std::string_view bytes, const std::string& source) {
    return unpack(bytes, window_bits + gzip_wrapper, max_unpacked_of(bytes.size()), source);
}

std::string inflate_zlib(std::string_view bytes, std::size_t most, const std::string& source) {
    return unpack(bytes, window_bits, most, source);
}

namespace {

// `bits`: of the window, with the sign and the addition by which zlib tells its formats apart.
std::string deflated(std::string_view bytes, int bits) {
    z_stream z{};
    constexpr int default_memory = 8;
    if (deflateInit2(&z, Z_DEFAULT_COMPRESSION, Z_DEFLATED, bits, default_memory, Z_DEFAULT_STRATEGY) != Z_OK) {
        throw std::bad_alloc();
    }
    const std::unique_ptr<z_stream, decltype(&deflateEnd)> owner(&z, deflateEnd);
    std::string out;
    Stream(bytes).run(z, out, out.max_size(),
                      [](z_stream& s, bool last) { return deflate(&s, last ? Z_FINISH : Z_NO_FLUSH); });
    return out;
}

void append_little_endian(std::string& out, std::initializer_list<std::pair<int, std::uint64_t>> fields) {
    for (const auto& [bytes, value] : fields) {
        for (int i = 0; i < bytes; ++i) out += static_cast<char>(value >> (8 * i));
    }
}

} // namespace

std::string gzip(std::string_view bytes) { return deflated(bytes, window_bits + gzip_wrapper); }

std::string zip_archive(const std::vector<ZipEntry>& entries) {
    constexpr std::uint64_t version = 20, deflate_method = 8, utf8_names = 0x800;
    constexpr std::uint64_t first_date = 0x21;                   // 1980-01-01, the earliest there is
    constexpr std::uint64_t made_on_unix = 3u << 8 | version;    // so that the mode below counts
    constexpr std::uint64_t mode = std::uint64_t{0100644} << 16; // an ordinary file
    std::string out, directory;
    for (const auto& [name, bytes] : entries) {
        const std::string packed = deflated(bytes, -window_bits);
        const auto* data = reinterpret_cast<const Bytef*>(bytes.data());
        const std::uint64_t sum = crc32_z(0, data, bytes.size()), place = out.size();
        std::string both; // what the headers of the entry and of the directory have in common
        append_little_endian(both, {{2, version},
                                    {2, utf8_names},
                                    {2, deflate_method},
                                    {2, 0},
                                    {2, first_date},
                                    {4, sum},
                                    {4, packed.size()},
                                    {4, bytes.size()},
                                    {2, name.size()},
                                    {2, 0}});
        append_little_endian(out, {{4, 0x04034b50}});
        out += both + name + packed;
        append_little_endian(directory, {{4, 0x02014b50}, {2, made_on_unix}});
        directory += both;
        append_little_endian(directory, {{2, 0}, {2, 0}, {2, 0}, {4, mode}, {4, place}});
        directory += name;
    }
    const std::uint64_t begin = out.size(), count = entries.size();
    out += directory;
    append_little_endian(
        out, {{4, 0x06054b50}, {2, 0}, {2, 0}, {2, count}, {2, count}, {4, directory.size()}, {4, begin}, {2, 0}});
    return out;
}

} // namespace tribode
