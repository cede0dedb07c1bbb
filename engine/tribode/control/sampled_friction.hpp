#pragma once
#include "tribode/friction/rolling_friction.hpp"

#include <optional>
#include <vector>

namespace tribode {

// The friction model FM of the paper as a signal processor runs it: eqs. (11)-(17) driven by position samples,
//
//     z_i[k] = clip(z_i[k-1] + y[k] - y[k-1], -X_i, X_i),  v[k] = (y[k] - y[k-1])/Ts
//     f[k] = sum (K_i z_i[k] + D_i v[k] where not at its limit) + D_v v[k]
//
// A reversal between two samples is seen at the next sample, and v lags by half a sample. The first sample sets the
// reference: elements are relaxed there, f[0] = 0.
class SampledFriction {
  public:
    SampledFriction(const std::vector<MaxwellSlipElement>& elements, double viscous, double sample_time);

    double step(double position);
    void reset();

  private:
    std::vector<double> stiffness_, damping_, limit_; // K_i [N/m], D_i [N s/m], X_i [m]
    std::vector<std::size_t> damped_;                 // elements with D_i
    double viscous_;                                  // D_v [N s/m]
    double sample_time_;                              // [s]
    std::vector<double> z_;                           // [m]
    std::vector<double> own_;                         // the force of each element, of the last step [N]
    std::optional<double> previous_;
};

} // namespace tribode
