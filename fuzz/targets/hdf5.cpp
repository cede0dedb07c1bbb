#include "tribode/record/hdf5.hpp"
#include "target.hpp"
#include "tribode/base/error.hpp"
#include "tribode/record/record_file.hpp"

#include <pthread.h>

extern "C" __attribute__((weak)) void __sanitizer_set_death_callback(void (*callback)());

namespace tribode::fuzz {

namespace {

// In the process of its own a sanitizer would have libFuzzer keep the input as a finding.
void keep_quiet() {
    if (__sanitizer_set_death_callback) __sanitizer_set_death_callback(nullptr);
}

} // namespace

// The library reads in a process of its own, as the program has it: what it does there is no finding.
void run_hdf5(std::string_view bytes) {
    if (!is_hdf5(bytes)) return;
    [[maybe_unused]] static const int prepared = ::pthread_atfork(nullptr, nullptr, keep_quiet);
    try {
        record_from_bytes(bytes, "a.h5");
    } catch (const InputError&) {
    }
}

} // namespace tribode::fuzz
