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
//     L(a) = G(a) (C - p N_h(a)),   N_h = N(a, (1 - z^-1)/Ts) + D_v (1 - z^-1)/Ts + N_l(a, f)
//     G(a) from P/(1 + P (N(a, s) + D_v s + N_l(a, f))) by sampled_response
//
// with N_l that of friction laws with states, whose velocity in the model is taken to be as good as the plant's.
// Rounding of the encoder, harmonics, and that friction reverses only at samples are left out.
struct FrictionLoop {
    ModalModel plant;
    LoopDelays delays;
    std::function<std::complex<double>(double frequency_hz)> controller; // C [N/m]
    std::vector<MaxwellSlipElement> elements;                            // relaxed before the first motion
    double viscous = 0;                                                  // D_v [N s/m]
    // N_l over the frequency at an amplitude [N/m], 0 too; empty: there are no laws.
    std::function<std::function<std::complex<double>(double frequency_hz)>(double amplitude)> laws = {};

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
    struct AtAmplitude {
        DescribingFunction elements;
        std::function<std::complex<double>(double frequency_hz)> laws;

        std::complex<double> operator()(std::complex<double> s, double frequency_hz) const {
            return laws ? elements(s) + laws(frequency_hz) : elements(s);
        }
    };
    AtAmplitude at(double amplitude) const;
    std::complex<double> plant_response(const AtAmplitude& n, double frequency_hz) const; // G
    std::complex<double> model_response(const AtAmplitude& n, double frequency_hz) const; // N_h
};

} // namespace tribode
