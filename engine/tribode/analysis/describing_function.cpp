#include "tribode/analysis/describing_function.hpp"

#include <cmath>
#include <numbers>

namespace tribode {

namespace {

// n(a/X)
std::complex<double> share_in_stick(double amplitude, double limit) {
    if (amplitude <= limit) return 1;
    const double cosine = 1 - 2 * limit / amplitude, angle = std::acos(cosine), sine = std::sin(angle);
    return std::complex(angle - sine * cosine, sine * sine) / std::numbers::pi;
}

} // namespace

DescribingFunction describing_function(const std::vector<MaxwellSlipElement>& elements, double amplitude) {
    DescribingFunction sum;
    for (const auto& element : elements) {
        const std::complex<double> n = share_in_stick(amplitude, element.limit());
        sum.stiffness += element.stiffness * n;
        sum.damping += element.damping * n;
    }
    return sum;
}

} // namespace tribode
