#include "tribode/batch/batch.hpp"
#include "tribode/base/random.hpp"

#include <algorithm>

namespace tribode {

bool is_column_name(std::string_view name) {
    const auto is_odd = [](unsigned char c) { return c < 0x20 || c == 0x7f || c == ',' || c == '"' || c == '/'; };
    return !name.empty() && name != "index" && name != "failed" && name != "reason" &&
           std::none_of(name.begin(), name.end(), is_odd);
}

std::uint64_t point_seed(std::uint64_t batch_seed, std::size_t index) { return derived_seed(batch_seed, index) >> 11; }

} // namespace tribode
