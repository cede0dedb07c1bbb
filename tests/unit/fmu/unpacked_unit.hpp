#pragma once
#include "tribode/base/json.hpp"
#include "tribode/record/output_file.hpp"

#include <cstdlib>
#include <cstring>
#include <dlfcn.h>
#include <filesystem>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>
#include <zlib.h>

namespace tribode {

// The files of a ZIP archive, by its directory; their sums are checked.
inline std::map<std::string, std::string> unzipped(const std::string& bytes) {
    const auto number = [&](std::size_t place, int count) {
        std::size_t value = 0;
        for (int i = count; i-- > 0;) value = value << 8 | static_cast<unsigned char>(bytes.at(place + i));
        return value;
    };
    const std::size_t end = bytes.rfind("PK\5\6");
    std::map<std::string, std::string> files;
    std::size_t place = number(end + 16, 4);
    for (std::size_t i = 0; i < number(end + 10, 2); ++i) {
        const std::size_t packed = number(place + 20, 4), size = number(place + 24, 4), name = number(place + 28, 2);
        const std::size_t local = number(place + 42, 4);
        std::string& out = files[bytes.substr(place + 46, name)];
        out.resize(size);
        z_stream z{};
        inflateInit2(&z, -15);
        z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data() + local + 30 + number(local + 26, 2)));
        z.avail_in = static_cast<uInt>(packed);
        z.next_out = reinterpret_cast<Bytef*>(out.data());
        z.avail_out = static_cast<uInt>(size);
        const bool whole = inflate(&z, Z_FINISH) == Z_STREAM_END && z.avail_out == 0;
        inflateEnd(&z);
        if (!whole || crc32_z(0, reinterpret_cast<const Bytef*>(out.data()), size) != number(place + 16, 4)) {
            throw std::runtime_error("the archive is damaged");
        }
        place += 46 + name + number(place + 30, 2) + number(place + 32, 2);
    }
    return files;
}

// An exported unit in a folder of its own, its library loaded.
class UnpackedUnit {
  public:
    explicit UnpackedUnit(const std::string& archive) : files_(unzipped(archive)) {
        std::string name = (std::filesystem::temp_directory_path() / "tribode fmu XXXXXX").string();
        folder_ = mkdtemp(name.data());
        for (const auto& [file, bytes] : files_) {
            write_file(folder_ / file, bytes);
            if (!file.ends_with(".so")) continue;
            library_ = dlopen((folder_ / file).c_str(), RTLD_NOW | RTLD_LOCAL);
            if (!library_) throw std::runtime_error(dlerror());
        }
        model_ = Json::parse(files_.at("resources/model.json"));
    }
    ~UnpackedUnit() {
        if (library_) dlclose(library_);
        std::filesystem::remove_all(folder_);
    }
    UnpackedUnit(const UnpackedUnit&) = delete;
    UnpackedUnit& operator=(const UnpackedUnit&) = delete;

    const std::map<std::string, std::string>& files() const { return files_; }
    const std::string& description() const { return files_.at("modelDescription.xml"); }
    std::string token() const { return model_.at("token"); }
    std::string resources() const { return (folder_ / "resources").string(); }
    std::string resource_uri() const { // the folder has blanks
        std::string uri = "file://";
        for (const char c : resources()) uri += c == ' ' ? std::string("%20") : std::string(1, c);
        return uri;
    }

    // From the text of modelDescription.xml.
    unsigned reference(const std::string& name) const {
        const std::string start = "name=\"" + name + "\" valueReference=\"";
        const std::size_t place = description().find(start);
        if (place == std::string::npos) throw std::runtime_error(name + " is no variable of the unit");
        return static_cast<unsigned>(std::stoul(description().substr(place + start.size())));
    }

    template <class Type>
    Type* function(const char* name) const {
        void* found = dlsym(library_, name);
        if (!found) throw std::runtime_error(std::string(name) + " is missing");
        return reinterpret_cast<Type*>(found);
    }

  private:
    std::map<std::string, std::string> files_;
    std::filesystem::path folder_;
    Json model_;
    void* library_ = nullptr;
};

} // namespace tribode
