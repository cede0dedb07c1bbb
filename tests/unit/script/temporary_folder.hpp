#pragma once
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <string_view>

namespace tribode {

// A new empty folder, removed with all that is in it. Its path has no symbolic link.
class TemporaryFolder {
  public:
    TemporaryFolder() {
        std::random_device random;
        const std::string name = "tribode-script-" + std::to_string(random()) + std::to_string(random());
        path_ = std::filesystem::canonical(std::filesystem::temp_directory_path()) / name;
        std::filesystem::create_directory(path_);
    }
    ~TemporaryFolder() { std::filesystem::remove_all(path_); }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;

    const std::filesystem::path& path() const { return path_; }
    std::filesystem::path operator/(std::string_view name) const { return path_ / name; }

    // Writes a file, with its folders.
    std::filesystem::path write(std::string_view name, std::string_view text) const {
        const auto file = path_ / name;
        std::filesystem::create_directories(file.parent_path());
        std::ofstream(file, std::ios::binary) << text;
        return file;
    }

  private:
    std::filesystem::path path_;
};

} // namespace tribode
