#pragma once
#include <cstdint>
#include <random>
#include <string>

namespace tribode {

// The bytes with one to four of them changed, and sometimes cut short: for each seed in another way.
inline std::string damaged(std::string bytes, std::uint32_t seed) {
    std::mt19937 random(seed);
    const auto below = [&](std::size_t limit) { return static_cast<std::size_t>(random() % limit); };
    for (std::size_t changes = 1 + below(4); changes > 0; --changes) {
        // Lengths and counts show their limits at all ones.
        bytes[below(bytes.size())] = below(3) == 0 ? '\xff' : static_cast<char>(random());
    }
    if (below(6) == 0) bytes.resize(below(bytes.size()));
    return bytes;
}

} // namespace tribode
