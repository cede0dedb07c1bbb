// Runs every file of the folders through a target once, without a fuzzer: `fuzz_replay TARGET FOLDER...`. A crash ends it
// behind the name of the file.
#include "target.hpp"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <vector>

namespace fs = std::filesystem;
using namespace tribode::fuzz;

namespace {

struct Target {
    std::string_view name; // of its folders in seeds/ and corpus/ and of its dictionary
    void (*run)(std::string_view bytes);
};

constexpr Target targets[] = {
    {"csv", run_csv},
    {"mat", run_mat},
    {"gzip", run_gzip},
    {"hdf5", run_hdf5},
    {"json_machine", run_json_machine},
    {"lua_machine", run_lua_machine},
    {"system", run_system},
    {"shard", run_shard},
    {"manifest", run_manifest},
    {"checkpoint", run_checkpoint},
};

const Target& target_named(std::string_view name) {
    std::string known;
    for (const auto& target : targets) {
        if (target.name == name) return target;
        known += " " + std::string(target.name);
    }
    throw std::runtime_error("there is no target \"" + std::string(name) + "\"; known:" + known);
}

} // namespace

int main(int count, char** arguments) {
    try {
        const auto& target = target_named(count > 1 ? arguments[1] : "");
        std::vector<fs::path> files;
        for (int i = 2; i < count; ++i) {
            if (!fs::is_directory(arguments[i])) continue;
            for (const auto& entry : fs::recursive_directory_iterator(arguments[i])) {
                if (entry.is_regular_file()) files.push_back(entry.path());
            }
        }
        if (files.empty()) {
            std::fprintf(stderr, "fuzz_replay: there are no files\n");
            return 1;
        }
        std::sort(files.begin(), files.end());
        for (const auto& file : files) {
            std::printf("%s\n", file.c_str());
            std::fflush(stdout);
            std::ifstream stream(file, std::ios::binary);
            target.run(std::string{std::istreambuf_iterator<char>(stream), {}});
        }
        std::printf("%zu files\n", files.size());
    } catch (const std::exception& problem) {
        std::fprintf(stderr, "fuzz_replay: %s\n", problem.what());
        return 1;
    }
}
