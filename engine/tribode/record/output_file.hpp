#pragma once
#include <filesystem>
#include <string>
#include <string_view>

namespace tribode {

// The name that stands for standard output, as of many programs. A file of this name is ./-.
inline constexpr std::string_view standard_output = "-";

// Writes the bytes to `path`, all or nothing: they go to `<path>.part` in the same folder, which takes the final name
// once everything has reached the disk. Missing parent folders are made. A symbolic link is followed; a device or a
// pipe (/dev/stdout) is written to directly.
// Throws OutputError, e.g. `results/run.csv: cannot be written (No space left on device)`; then neither the .part nor
// a changed file is left behind. From the first call on the process ignores SIGXFSZ, so that a file above the size
// limit is such an error, too.
void write_file(const std::filesystem::path& path, std::string_view bytes);

// The same for a file that is too large to be held in memory: it is written in parts and takes its name at the end.
class OutputFile {
  public:
    explicit OutputFile(std::filesystem::path path); // a regular file or none yet
    ~OutputFile();                                   // without `commit`: nothing is left behind
    OutputFile(const OutputFile&) = delete;
    OutputFile& operator=(const OutputFile&) = delete;

    void write(std::string_view bytes);
    void commit();

  private:
    [[noreturn]] void fail();
    void flush();

    std::filesystem::path path_, part_;
    std::string buffer_;
    int file_ = -1;
};

// Gives a file that another library has written as `part` its final name, once it is on the disk. Throws OutputError;
// then the part is removed.
void commit_file(const std::filesystem::path& part, const std::filesystem::path& path);

// All bytes of a file. Throws InputError where it is missing, a folder or unreadable.
std::string read_file(const std::filesystem::path& path);

} // namespace tribode
