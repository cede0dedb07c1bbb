#include "tribode/fmu_import/imported_unit.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/fmu_import/unit_library.hpp"

#include <algorithm>
#include <cstdlib>
#include <dlfcn.h>
#include <fmt/format.h>
#include <fstream>
#include <zip.h>

namespace tribode {

namespace fs = std::filesystem;

namespace {

constexpr std::uint64_t max_bytes = std::uint64_t{4} << 30; // unpacked, all files together

const char* binaries_of(int version) { return version == 2 ? "binaries/linux64/" : "binaries/x86_64-linux/"; }

struct CloseZip {
    void operator()(zip_t* archive) const { zip_discard(archive); }
    void operator()(zip_file_t* file) const { zip_fclose(file); }
};

class Archive {
  public:
    explicit Archive(const fs::path& file) : file_(file) {
        int problem = 0;
        archive_.reset(zip_open(file.c_str(), ZIP_RDONLY, &problem));
        if (archive_) return;
        zip_error_t error;
        zip_error_init_with_code(&error, problem);
        const std::string text = zip_error_strerror(&error);
        zip_error_fini(&error);
        throw InputError(fmt::format("{}: is no functional mock-up unit: {}", file.string(), text));
    }

    // Calls visit(name) for each file.
    template <class Visit>
    void each(Visit visit) const {
        const zip_int64_t count = zip_get_num_entries(archive_.get(), 0);
        for (zip_int64_t i = 0; i < count; ++i) {
            const char* name = zip_get_name(archive_.get(), static_cast<zip_uint64_t>(i), ZIP_FL_ENC_GUESS);
            if (name) visit(std::string(name));
        }
    }

    std::string read(const std::string& name) {
        zip_stat_t entry;
        zip_stat_init(&entry);
        if (zip_stat(archive_.get(), name.c_str(), 0, &entry) != 0) fail(name, "is missing");
        read_ += entry.size;
        if (read_ > max_bytes) fail(name, fmt::format("unpacks to more than {} bytes", max_bytes));
        const std::unique_ptr<zip_file_t, CloseZip> file(zip_fopen(archive_.get(), name.c_str(), 0));
        std::string bytes(entry.size, '\0');
        if (!file || zip_fread(file.get(), bytes.data(), bytes.size()) != static_cast<zip_int64_t>(bytes.size())) {
            fail(name, "is damaged");
        }
        // The checksum is compared as the end is read.
        char beyond = 0;
        if (zip_fread(file.get(), &beyond, 1) != 0) fail(name, "is damaged");
        return bytes;
    }

  private:
    [[noreturn]] void fail(const std::string& name, const std::string& what) const {
        throw InputError(fmt::format("{}: {} in it {}", file_.string(), printable(name), what));
    }

    fs::path file_;
    std::unique_ptr<zip_t, CloseZip> archive_;
    std::uint64_t read_ = 0;
};

// A name in an archive that leads out of the folder where it is unpacked.
bool leads_out(const fs::path& name) {
    return name.is_absolute() ||
           std::any_of(name.begin(), name.end(), [](const fs::path& part) { return part == ".."; });
}

fs::path temporary_folder() {
    std::string name = (fs::temp_directory_path() / "tribode-fmu-XXXXXX").string();
    if (!::mkdtemp(name.data())) throw OutputError(fmt::format("{}: cannot be made", name));
    return name;
}

} // namespace

UnitFile::UnitFile(const fs::path& file) : file_(file) {
    Archive archive(file);
    const std::string source = file.string();
    description_ = read_unit_description(archive.read("modelDescription.xml"), source + ": modelDescription.xml");
    if (description_.needs_tool) {
        throw InputError(fmt::format("{}: needs the program that made it to run, and is not imported", source));
    }
    const std::string binaries = binaries_of(description_.version);
    std::vector<std::string> wanted;
    bool has_library = false;
    archive.each([&](const std::string& name) {
        if (name.ends_with('/') || !(name.starts_with(binaries) || name.starts_with("resources/"))) return;
        if (leads_out(name)) throw InputError(fmt::format("{}: {} leads out of the unit", source, printable(name)));
        has_library = has_library || name == binaries + description_.identifier + ".so";
        wanted.push_back(name);
    });
    if (!has_library) {
        throw InputError(fmt::format("{}: has no {}{}.so, so it does not run on Linux on x86-64", source, binaries,
                                     description_.identifier));
    }
    folder_ = temporary_folder();
    try {
        fs::create_directories(folder_ / "resources");
        for (const auto& name : wanted) {
            fs::create_directories((folder_ / name).parent_path());
            const std::string bytes = archive.read(name);
            std::ofstream out(folder_ / name, std::ios::binary);
            out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
            out.close();
            if (!out) throw OutputError(fmt::format("{}: cannot be written", (folder_ / name).string()));
        }
    } catch (...) {
        std::error_code ignored;
        fs::remove_all(folder_, ignored);
        throw;
    }
}

UnitFile::~UnitFile() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
}

fs::path UnitFile::library() const {
    return folder_ / binaries_of(description_.version) / (description_.identifier + ".so");
}

UnitLibrary::UnitLibrary(std::shared_ptr<const UnitFile> unit) : unit_(std::move(unit)) {
    handle_ = ::dlopen(unit_->library().c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!handle_) {
        throw InputError(fmt::format("{}: its library cannot be loaded: {}", unit_->file().string(), ::dlerror()));
    }
}

UnitLibrary::~UnitLibrary() {
    if (handle_) ::dlclose(handle_);
}

void* UnitLibrary::symbol(const char* name) const {
    void* found = ::dlsym(handle_, name);
    if (!found) throw InputError(fmt::format("{}: its library has no function {}", unit_->file().string(), name));
    return found;
}

void UnitLibrary::fail(const std::string& call) const {
    throw InputError(fmt::format("{}: {} failed{}{}", unit_->file().string(), call, last_message_.empty() ? "" : ": ",
                                 printable(last_message_)));
}

void UnitRun::set(std::span<const UnitDescription::Variable> variables, std::span<const double> values) {
    for (std::size_t i = 0; i < variables.size(); ++i) set(variables[i], values[i]);
}

void UnitRun::get(std::span<const UnitDescription::Variable> variables, std::span<double> values) {
    for (std::size_t i = 0; i < variables.size(); ++i) values[i] = get(variables[i]);
}

std::unique_ptr<UnitRun> open_unit(const std::shared_ptr<const UnitFile>& unit) {
    return unit->description().version == 2 ? open_fmi2_unit(unit) : open_fmi3_unit(unit);
}

} // namespace tribode
