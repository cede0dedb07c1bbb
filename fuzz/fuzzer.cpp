// The program of libFuzzer for one target, TRIBODE_FUZZ_TARGET; its options are libFuzzer's (-help=1).
#include "target.hpp"

#include <cstddef>
#include <cstdint>

// The HDF5 library asks malloc for lengths out of the file, and minds a refusal. `new` still reports what it cannot get.
extern "C" const char* __asan_default_options() { return "allocator_may_return_null=1:quarantine_size_mb=16"; }

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    tribode::fuzz::TRIBODE_FUZZ_TARGET({reinterpret_cast<const char*>(data), size});
    return 0;
}
