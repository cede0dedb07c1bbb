#pragma once
#include <filesystem>
#include <string>
#include <string_view>

namespace tribode {

// Writes the bytes to `path`, all or nothing: they go to `<path>.part` in the same folder, which takes the final name
// once everything has reached the disk. Missing parent folders are made. A symbolic link is followed; a device or a
// pipe (/dev/stdout) is written to directly.
// Throws OutputError, e.g. `results/run.csv: cannot be written (No space left on device)`; then neither the .part nor
// a changed file is left behind. From the first call on the process ignores SIGXFSZ, so that a file above the size
// limit is such an error, too.
void write_file(const std::filesystem::path& path, std::string_view bytes);

// All bytes of a file. Throws InputError where it is missing, a folder or unreadable.
std::string read_file(const std::filesystem::path& path);

} // namespace tribode
