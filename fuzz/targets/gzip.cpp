#include "target.hpp"
#include "tribode/base/error.hpp"
#include "tribode/record/zip.hpp"

namespace tribode::fuzz {

void run_gzip(std::string_view bytes) {
    try {
        const std::string text = gunzip(bytes, "a.gz");
        if (text.size() < 65536) require(gunzip(gzip(text), "again.gz") == text, "the same after packing again");
    } catch (const InputError&) {
    }
    try {
        inflate_zlib(bytes, max_unpacked_of(bytes.size()), "a.mat");
    } catch (const InputError&) {
    }
    require(gunzip(gzip(bytes), "packed.gz") == bytes, "the same after packing");
}

} // namespace tribode::fuzz
