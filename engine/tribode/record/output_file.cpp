#include "tribode/record/output_file.hpp"
#include "tribode/base/error.hpp"

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace tribode {

namespace fs = std::filesystem;

namespace {

// An open file, closed at the latest when it goes out of scope.
class Descriptor {
  public:
    explicit Descriptor(int number) : number_(number) {}
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    ~Descriptor() { close(); }

    int number() const { return number_; }
    bool close() { return number_ < 0 || ::close(std::exchange(number_, -1)) == 0; }

  private:
    int number_;
};

// Each returns false with the reason in errno.
bool write_all(int file, std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t written = ::write(file, bytes.data(), bytes.size());
        if (written < 0 && errno != EINTR) return false;
        if (written > 0) bytes.remove_prefix(static_cast<std::size_t>(written));
    }
    return true;
}

// A new file of this name, whatever was there: neither a symbolic nor a hard link is written through.
int open_new(const fs::path& path) {
    constexpr mode_t read_and_write_as_umask_allows = 0666;
    ::unlink(path.c_str());
    return ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, read_and_write_as_umask_allows);
}

bool write_whole_file(const fs::path& path, std::string_view bytes) {
    Descriptor file(open_new(path));
    return file.number() >= 0 && write_all(file.number(), bytes) && ::fsync(file.number()) == 0 && file.close();
}

bool write_to_device(const fs::path& path, std::string_view bytes) {
    Descriptor file(::open(path.c_str(), O_WRONLY | O_CLOEXEC));
    return file.number() >= 0 && write_all(file.number(), bytes) && file.close();
}

[[noreturn]] void fail_to_write(const fs::path& path, const std::string& reason) {
    throw OutputError(fmt::format("{}: cannot be written ({})", path.string(), reason));
}

} // namespace

void write_file(const fs::path& path, std::string_view bytes) {
    if (path == standard_output) {
        if (std::fwrite(bytes.data(), 1, bytes.size(), stdout) != bytes.size() || std::fflush(stdout) != 0) {
            fail_to_write("standard output", std::strerror(errno));
        }
        return;
    }
    [[maybe_unused]] static const auto size_limit_is_an_error = std::signal(SIGXFSZ, SIG_IGN);

    std::error_code problem;
    const auto status = fs::status(path, problem);
    if (fs::is_directory(status)) fail_to_write(path, "it is a folder");
    if (fs::is_other(status)) {
        if (!write_to_device(path, bytes)) fail_to_write(path, std::strerror(errno));
        return;
    }

    // Through a link, so that the link itself stays.
    const fs::path target = fs::is_regular_file(status) ? fs::canonical(path, problem) : path;
    if (target.has_parent_path()) fs::create_directories(target.parent_path(), problem);
    if (problem && problem != std::errc::no_such_file_or_directory) fail_to_write(path, problem.message());

    fs::path part = target;
    part += ".part";
    if (!write_whole_file(part, bytes) || ::rename(part.c_str(), target.c_str()) != 0) {
        const std::string reason = std::strerror(errno);
        // A folder of that name is not ours to remove.
        ::unlink(part.c_str());
        fail_to_write(path, reason);
    }
}

OutputFile::OutputFile(fs::path path) : path_(std::move(path)), part_(path_) {
    if (path_ == standard_output) return;
    part_ += ".part";
    std::error_code problem;
    if (fs::is_directory(path_)) fail_to_write(path_, "it is a folder");
    if (path_.has_parent_path()) fs::create_directories(path_.parent_path(), problem);
    if (problem) fail_to_write(path_, problem.message());
    file_ = open_new(part_);
    if (file_ < 0) fail();
}

OutputFile::~OutputFile() {
    if (file_ < 0) return;
    ::close(file_);
    ::unlink(part_.c_str());
}

void OutputFile::write(std::string_view bytes) {
    constexpr std::size_t worth_a_call = 1 << 16;
    buffer_ += bytes;
    if (buffer_.size() >= worth_a_call) flush();
}

void OutputFile::flush() {
    if (path_ == standard_output) {
        write_file(path_, std::exchange(buffer_, {}));
        return;
    }
    if (!write_all(file_, buffer_)) fail();
    buffer_.clear();
}

void OutputFile::commit() {
    flush();
    if (path_ == standard_output) return;
    if (::fsync(file_) != 0 || ::close(std::exchange(file_, -1)) != 0 || ::rename(part_.c_str(), path_.c_str()) != 0) {
        fail();
    }
}

void OutputFile::fail() {
    const std::string reason = std::strerror(errno);
    if (file_ >= 0) ::close(std::exchange(file_, -1));
    ::unlink(part_.c_str());
    fail_to_write(path_, reason);
}

void commit_file(const fs::path& part, const fs::path& path) {
    Descriptor file(::open(part.c_str(), O_RDONLY | O_CLOEXEC));
    if (file.number() >= 0 && ::fsync(file.number()) == 0 && ::rename(part.c_str(), path.c_str()) == 0) return;
    const std::string reason = std::strerror(errno);
    ::unlink(part.c_str());
    fail_to_write(path, reason);
}

std::string read_file(const fs::path& path) {
    const auto fail = [&](std::string_view reason) {
        throw InputError(fmt::format("{}: cannot be read ({})", path.string(), reason));
    };
    Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
    if (file.number() < 0) fail(std::strerror(errno));
    struct stat about {};
    if (::fstat(file.number(), &about) != 0) fail(std::strerror(errno));
    if (S_ISDIR(about.st_mode)) fail("it is a folder");

    constexpr std::size_t max_without_file = std::size_t{1} << 30; // of a pipe or a device
    // One byte more than the file has, so that its end is seen without growing; pipes tell no size and grow.
    std::string bytes(static_cast<std::size_t>(about.st_size) + 1, '\0');
    std::size_t length = 0;
    for (;;) {
        const ssize_t got = ::read(file.number(), bytes.data() + length, bytes.size() - length);
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) fail(std::strerror(errno));
        if (got == 0) break;
        length += static_cast<std::size_t>(got);
        if (length > max_without_file && !S_ISREG(about.st_mode)) fail("it is no file and has no end");
        if (length == bytes.size()) bytes.resize(2 * bytes.size() + 65536);
    }
    bytes.resize(length);
    return bytes;
}

} // namespace tribode
