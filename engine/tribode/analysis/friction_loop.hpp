#pragma once
#include "tribode/analysis/describing_function.hpp"
#include "tribode/analysis/loop_gain.hpp"
#include "tribode/friction/rolling_friction.hpp"

#include <complex>
#include <functional>
#include <optional>
#include <vector>

namespace tribode {

// The loop of a servo system whose modeled friction is fed back (docs/friction-compensation.md), made linear at one
// amplitude a of a sinusoidal motion: rolling friction is its describing function N(a), a spring of stiffness sum K_i at
// a = 0. With the thrust u opened, C the controller, G(a) the sampled response of plant and friction together, p the share
// that is fed back, and N_h(a) the friction model with the velocity (1 - z^-1)/Ts,
//
//     L(a) = G(a) (C - p N_h(a)),   N_h = N(a, (1 - z^-1)/Ts) + D_v (1 - z^-1)/Ts
//     G(a) from P/(1 + P (N(a, s) + D_v s)) by sampled_response
//
// Rounding of the encoder, harmonics, and that friction reverses only at samples are left out.
struct FrictionLoop {
    ModalModel plant;
    LoopDelays delays;
    std::function<std::complex<double>(double frequency_hz)> controller; // C [N/m]
    std::vector<MaxwellSlipElement> elements;                            // relaxed before the first motion
    double viscous = 0;                                                  // D_v [N s/m]

    // L at amplitude a [m] as a function of the frequency, 0 < frequency_hz < 1/(2 Ts). The loop must outlive it.
    std::function<std::complex<double>(double frequency_hz)> loop_gain(double friction_feedback,
                                                                       double amplitude) const;

    // Where the loop, stable at smaller shares p, becomes unstable.
    struct CriticalFeedback {
        double share = 0;        // p
        double frequency_hz = 0; // of the oscillation that begins there; 0: the loop drifts off
    };

    struct Stability {
        bool stable = false; // at the share asked for
        std::optional<CriticalFeedback> critical;
    };

    // By Nyquist's criterion over a band that begins below all crossovers and ends at the Nyquist frequency: the angle of
    // 1 + L, begun between -300 and 60 deg, must end at 0. It counts on a controller without unstable poles, of which no
    // more than the integrator lies on the stability limit, and on passive friction.
    //
    // L = -1 where p = (C + 1/G(a))/N_h(a), so the critical share is among the real positive values of the right side:
    // the least one with a stable loop just below and an unstable one just above; none where there is none. Over the
    // amplitude it gives limit cycles: one of amplitude a where the critical share is p, stable where that share rises
    // with a.
    Stability stability(double friction_feedback, double amplitude, double f_min_hz, double f_max_hz) const;

  private:
    std::complex<double> plant_response(const DescribingFunction& n, double frequency_hz) const; // G
    std::complex<double> model_response(const DescribingFunction& n, double frequency_hz) const; // N_h
};

} // namespace tribode
