#pragma once
#include "contender.hpp"
#include "tribode/solver/integrator.hpp"

namespace tribode::bench {

// S3 as frequency_sweep runs it: the three analyses of each frequency and the three fits. It settles for 5 periods and
// measures 10; settling is judged over windows of 50 ms or more, so that above 40 Hz runs are longer than S3's 15
// periods, all in all by 6 %.
Run analysed_sweep(Method method);

// The sweep of scripts/fra_comparison.lua: 400 frequencies spaced linearly, each run until it repeats itself.
Run judged_sweep(unsigned workers);

} // namespace tribode::bench
