#include "tribode/solver/series_integrator.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace tribode {

SeriesIntegrator::SeriesIntegrator(const HybridSystem& system, std::size_t max_regular)
    : system_(system),
      affine_(*system.piecewise_affine()),
      size_(system.states().size()),
      height_(padded(size_)),
      guard_count_(system.guard_count()),
      terms_((max_terms + 3) * height_),
      guard_terms_((max_terms + 1) * guard_count_),
      recurring_(max_regular) {}

Integrator::Progress SeriesIntegrator::cross(double s, double h, double whole, double t_stop) {
    const double span = s * h - lag_;
    state_->t = s == 1 && h == whole ? t_stop : t0_ + std::max(span, 0.0);
    behind_ = std::max(-span, 0.0);
    return Progress::crossing;
}

void SeriesIntegrator::find_guard_terms() {
    for (int n = 1; n <= order_; ++n) {
        affine_.guard_coefficient(n, t0_, h_, {term(n), size_}, *state_->discrete,
                                  {guard_term(static_cast<std::size_t>(n)), guard_count_});
    }
}

Integrator::Progress SeriesIntegrator::fail(std::optional<NotFinite> not_finite) {
    failure_ = {RunEnd::non_finite, t0_,
                fmt::format("the state is not finite near t = {:.9g} s: the loop may be unstable", t0_), not_finite};
    return Progress::failed;
}

} // namespace tribode
