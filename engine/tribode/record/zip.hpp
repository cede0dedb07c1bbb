#pragma once
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// Whether the bytes begin like a gzip file (RFC 1952).
bool is_gzip(std::string_view bytes);

// How many bytes a file of so many packed ones may unpack to: 64 MiB and 256 times its size, 4 GiB at most. Files made to
// fill the memory unpack to a thousand times their size and more.
std::size_t max_unpacked_of(std::size_t packed);

// Unpacks a gzip file, also one of several members. `source` begins the messages.
// Throws InputError where the bytes are damaged, cut short or unpack to more than max_unpacked_of.
std::string gunzip(std::string_view bytes, const std::string& source);

// Unpacks a zlib stream (RFC 1950), as it stands inside MAT files, to `most` bytes; as above.
std::string inflate_zlib(std::string_view bytes, std::size_t most, const std::string& source);

// The bytes of a gzip file without name and date: the same text gives the same bytes.
std::string gzip(std::string_view bytes);

// A file in an archive.
struct ZipEntry {
    std::string name; // with its folders, divided by "/"
    std::string bytes;
};

// The bytes of a ZIP archive: without dates, so the same files give the same bytes. Files and the whole stay below 4 GiB.
std::string zip_archive(const std::vector<ZipEntry>& entries);

} // namespace tribode
