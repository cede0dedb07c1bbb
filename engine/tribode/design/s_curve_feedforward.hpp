#pragma once
#include "tribode/design/feedforward.hpp"

namespace tribode {

// The path of fourth order from rest to rest: eight phases of equal length h = duration/8 with the snap
// + - - + - + + - times S = distance/(8 h^4). Peaks: jerk S h, acceleration S h^2, velocity 2 S h^3.
class SCurve {
  public:
    SCurve(double distance, double duration); // [m], [s] > 0

    double position(double t) const; // [m]; 0 before the path, the distance after it
    // Means over [t, t + span] of the path's derivatives, exact: what a hold should pass on.
    double mean_acceleration(double t, double span) const; // [m/s^2]
    double mean_snap(double t, double span) const;         // [m/s^4]

  private:
    double integral(int times, double t) const; // of the snap

    double distance_, duration_, snap_;
};

// Fourth-order S-curve with inverse dynamics [Lambrechts 2005]. Below its resonances the model's inverse is
//
//     u_ff = a/k0 - (sum_j k_j/w_j^2)/k0^2 s,     a acceleration and s snap of the path r*,
//
// without the damping terms (orders three and five). Throws InputError where the model has no rigid gain.
Feedforward s_curve_feedforward(const ModalModel& model, const MoveTask& task);

// Input shaping [Singer 1990]: u_ff = a/k0 of an S-curve, convolved for each shaped mode with impulses at 0, Td, ...
//
//     ZV   (derivatives = 0): 1, K             times 1/(1 + K)       K = exp(-pi zeta/sqrt(1 - zeta^2)), Td = 1/(2 f_d)
//     ZVD  (derivatives = 1): 1, 2 K, K^2      times 1/(1 + K)^2
//
// so that no vibration of these modes is left. The S-curve is shorter by the length of the shapers and ends in time. r* is
// what u_ff makes of the model. `modes`: how many are shaped, from the lowest; 0: all. Throws InputError where the
// shapers leave no time for the path, a mode is not underdamped, or the model has no rigid gain.
Feedforward shaped_feedforward(const ModalModel& model, const MoveTask& task, int derivatives, int modes);

} // namespace tribode
