// The program of libFuzzer: `tribode_fuzz TARGET ...`; the rest is its own (-help=1).
#include "target.hpp"

#include <cstdint>
#include <cstdio>
#include <cstdlib>

using namespace tribode::fuzz;

static const Target* chosen = nullptr;

extern "C" int LLVMFuzzerInitialize(int* count, char*** arguments) {
    constexpr const char* variable = "TRIBODE_FUZZ_TARGET"; // for the processes that libFuzzer starts itself
    try {
        if (const char* name = std::getenv(variable)) {
            chosen = &target_named(name);
            return 0;
        }
        chosen = &target_named(*count > 1 ? (*arguments)[1] : "");
        ::setenv(variable, (*arguments)[1], 1);
        for (int i = 1; i < *count; ++i) (*arguments)[i] = (*arguments)[i + 1];
        --*count;
    } catch (const std::exception& problem) {
        std::fprintf(stderr, "tribode_fuzz: %s\n", problem.what());
        std::exit(2);
    }
    return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    chosen->run({reinterpret_cast<const char*>(data), size});
    return 0;
}
