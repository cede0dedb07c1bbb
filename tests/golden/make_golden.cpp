// Writes the golden files anew into the folder named by the only argument.
#include "problems/golden_runs.hpp"

#include <cstdio>
#include <fstream>

namespace {

bool write(const std::string& path, const std::string& text) {
    std::ofstream file(path, std::ios::binary);
    file << text;
    file.close();
    if (!file) std::fprintf(stderr, "make_golden: %s could not be written\n", path.c_str());
    return static_cast<bool>(file);
}

} // namespace

int main(int count, char** arguments) {
    if (count != 2) {
        std::fprintf(stderr, "usage: make_golden FOLDER\n");
        return 2;
    }
    const std::string folder = arguments[1];
    for (const auto& run : tribode::problems::golden_runs()) {
        if (!write(folder + "/" + run.name + ".csv", trace_csv(run))) return 1;
        if (!write(folder + "/" + run.name + "_events.csv", events_csv(run))) return 1;
    }
}
