#include "record/hdf5.hpp"
#include "base/error.hpp"
#include "record/record_file.hpp"
#include "target.hpp"

namespace tribode::fuzz {

// The library reads in a process of its own, as the program has it: what it does there is no finding.
void run_hdf5(std::string_view bytes) {
    if (!is_hdf5(bytes)) return;
    try {
        record_from_bytes(bytes, "a.h5");
    } catch (const InputError&) {
    }
}

} // namespace tribode::fuzz
