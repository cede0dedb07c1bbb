#pragma once
#include "tribode/analysis/frequency_response.hpp"
#include "tribode/analysis/friction_loop.hpp"
#include "tribode/analysis/loop_gain.hpp"
#include "tribode/machine/machine_model.hpp"

#include <complex>
#include <optional>
#include <vector>

namespace tribode {

// Hold, lag and dead times of a machine as its loop has them.
LoopDelays loop_delays_of(const MachineModel& machine);

// C(z) at z = exp(j 2 pi f Ts), from y to thrust, the sign of the feedback left out [N/m].
std::complex<double> pid_response(const PidController& pid, double sample_time, double frequency_hz);

// The same of the machine's controller, PID or cascade (for r = 0, without the limit of its output).
std::complex<double> controller_response(const MachineModel& machine, double frequency_hz);

// The machine's loop with its rolling and viscous friction and its friction laws; dry friction is not in it. Throws
// InputError where the machine has no controller or a law whose friction grows with the load.
FrictionLoop friction_loop_of(const MachineModel& machine);

// The loop of a machine at one amplitude of the motion, with a share of the modeled friction fed back.
struct FrictionMargins {
    StabilityMargins margins; // from 0.05 Hz to the Nyquist frequency; of meaning where the loop is stable
    bool stable = false;
    std::optional<FrictionLoop::CriticalFeedback> critical;
};

// amplitude [m], 0: the elements stick. Throws InputError as friction_loop_of, and where the machine has neither elements
// nor viscous friction nor a law.
FrictionMargins friction_margins(const MachineModel& machine, double friction_feedback, double amplitude);

// L at each frequency, with the amplitude of the motion there; one amplitude alone holds for all. Throws InputError where
// the lists do not fit or a frequency is not below the Nyquist frequency.
FrequencyResponse friction_loop_gain(const MachineModel& machine, double friction_feedback,
                                     const std::vector<double>& amplitude, const std::vector<double>& frequency_hz);

} // namespace tribode
