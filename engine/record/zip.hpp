#pragma once
#include <string>
#include <string_view>

namespace tribode {

// Whether the bytes begin like a gzip file (RFC 1952).
bool is_gzip(std::string_view bytes);

// Unpacks a gzip file, also one of several members. `source` begins the messages.
// Throws InputError where the bytes are damaged, cut short or more than 4 GiB when unpacked.
std::string gunzip(std::string_view bytes, const std::string& source);

// Unpacks a zlib stream (RFC 1950), as it stands inside MAT files; as above.
std::string inflate_zlib(std::string_view bytes, const std::string& source);

// The bytes of a gzip file without name and date: the same text gives the same bytes.
std::string gzip(std::string_view bytes);

} // namespace tribode
