#pragma once
#include "tribode/analysis/frequency_response.hpp"

namespace tribode {

// The delay of a loop from one sweep, with the friction model taken into account.
//
// Of a sweep with the phasors U (thrust reference), Fh (friction model) and Y (detected position) the analyses FRA-1 and
// FRA-2 keep Y/U and Y/(U - Fh), and these hold all that is needed: per unit of position U = 1/fra1 and
// Fh = 1/fra1 - 1/fra2. The functions below take both responses, of one sweep and so at the same frequencies; they throw
// InputError where those differ.

// The proposed analysis with a pure dead time as delay model, Y/(U exp(-j 2 pi f L) - Fh), for any L [s]. It needs no
// other sweep, and has no error of a Pade approximant.
FrequencyResponse proposed_response(const FrequencyResponse& fra1, const FrequencyResponse& fra2, double delay);

struct DelayEstimate {
    double delay = 0;                 // median over the band [s]
    double spread = 0;                // 1.48 times the median deviation from it, as large as a standard deviation [s]
    std::vector<double> frequency_hz; // of the band
    std::vector<double> delays;       // read at each [s]; NaN where abs(Fh) >= abs(U)
};

// The L for which the proposed response has the phase -180 deg, of a mass: at each frequency
//
//     U exp(-j 2 pi f L) = Fh - s Y    with a real s > 0,    so    abs(Fh - s Y) = abs(U)
//
// gives s, and L is the angle between Fh - s Y and U. With Fh = 0 that is eq. (18). There friction is part of the phase:
// the area of its loop is a force in phase with velocity, which turns the phase forward and is read as too little delay.
//
// Frequencies within f_min_hz .. f_max_hz, both included. A delay is known up to periods of f; the answer is the one
// nearest `expected`. The band should lie away from resonances and antiresonances; the median bears a few frequencies
// that do not. What remains is the error of the friction model, and damping of the plant, whose phase is read as delay as
// well. Throws InputError where the band holds no frequency that can be read.
DelayEstimate estimate_delay(const FrequencyResponse& fra1, const FrequencyResponse& fra2, double f_min_hz,
                             double f_max_hz, double expected = 0);

} // namespace tribode
