// Runs every file of the folders through a target once, without a fuzzer: `fuzz_replay TARGET FOLDER...`. A crash ends it
// behind the name of the file.
#include "target.hpp"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <fstream>
#include <iterator>

namespace fs = std::filesystem;

int main(int count, char** arguments) {
    try {
        const auto& target = tribode::fuzz::target_named(count > 1 ? arguments[1] : "");
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
