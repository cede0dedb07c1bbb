#pragma once
#include <atomic>
#include <filesystem>
#include <string>
#include <string_view>

namespace tribode::fuzz {

// Each is for one reader of files, and hands it an input as if it were the file. A refusal (InputError) is an answer; a
// crash, what a sanitizer says, any other exception and a broken promise (`require`) are findings.
void run_csv(std::string_view bytes);
void run_mat(std::string_view bytes);
void run_gzip(std::string_view bytes);
void run_hdf5(std::string_view bytes);
void run_json_machine(std::string_view bytes);
void run_lua_machine(std::string_view bytes);
void run_system(std::string_view bytes);
void run_shard(std::string_view bytes);
void run_manifest(std::string_view bytes);
void run_checkpoint(std::string_view bytes);

// Ends the process with this text where the condition does not hold.
void require(bool condition, std::string_view text);

// A folder in memory that lives as long as the process.
const std::filesystem::path& scratch_folder();
// Without waiting for a disk.
void write_plainly(const std::filesystem::path& path, std::string_view bytes);

// True some time after the last call of `begin`: what an input may take before it is asked to stop, as by Ctrl-C.
class Patience {
  public:
    static void begin();
    static const std::atomic<bool>& over();
};

} // namespace tribode::fuzz
