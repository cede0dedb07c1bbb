#include "tribode/diagnosis/gap.hpp"

namespace tribode {

Json Gap::json() const {
    const auto finite = [](double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); };
    return {{"before", finite(before)}, {"after", finite(after)}, {"floor", finite(floor)}};
}

} // namespace tribode
