#include "batch/batch.hpp"
#include "base/random.hpp"

namespace tribode {

std::uint64_t point_seed(std::uint64_t batch_seed, std::size_t index) { return derived_seed(batch_seed, index) >> 11; }

} // namespace tribode
