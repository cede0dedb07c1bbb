#pragma once
#include "tribode/analysis/frequency_response.hpp"
#include "tribode/machine/friction_model.hpp"

#include <complex>
#include <functional>
#include <vector>

namespace tribode {

// Describing function of friction laws: the fundamental of their force over that of a sinusoidal motion, x = a sin wt, in the
// steady state [N/m], found by running them until it no longer changes. amplitude > 0 [m]. load: magnitude of the motor force
// that laws see which grow with it [N].
std::complex<double> law_describing_function(const std::vector<Effect>& laws, double amplitude, double frequency_hz,
                                             double load);

// The same over the frequency at one amplitude, from a table made at once: 16 frequencies a decade, joined by lines.
std::function<std::complex<double>(double frequency_hz)>
law_describing_table(const std::vector<Effect>& laws, double amplitude, double f_min_hz, double f_max_hz);

// Of a whole friction model: elements in closed form, viscous, dry friction by quadrature, laws as above. amplitude has one
// entry or one for each frequency. Throws InputError where the lists do not fit.
FrequencyResponse friction_describing_function(const FrictionModel& model, const std::vector<double>& amplitude,
                                               const std::vector<double>& frequency_hz, double load);

} // namespace tribode
