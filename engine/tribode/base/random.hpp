#pragma once
#include <cstdint>

namespace tribode {

// A standard normal number as a function of (seed, stream, index) alone: no state, so any sample of any run can be
// drawn by itself, in any order, on any thread. SplitMix64 finaliser [Steele 2014] and the Box-Muller transform.
double standard_normal(std::uint64_t seed, std::uint64_t stream, std::uint64_t index);

// A seed of its own for run `index` of a batch or sweep: runs of different seeds share none.
std::uint64_t derived_seed(std::uint64_t seed, std::uint64_t index);

// A number in (0, 1), as above.
double uniform(std::uint64_t seed, std::uint64_t stream, std::uint64_t index);

// 64 bits, as above.
std::uint64_t random_bits(std::uint64_t seed, std::uint64_t stream, std::uint64_t index);

// Where `index` goes in a random permutation of 0 .. count-1 named by `key`: each one is hit once, and no table is kept.
// A Feistel network on the next even number of bits, walked until it falls below count [Black 2002].
// index < count <= 2^62.
std::uint64_t permuted(std::uint64_t index, std::uint64_t count, std::uint64_t key);

} // namespace tribode
