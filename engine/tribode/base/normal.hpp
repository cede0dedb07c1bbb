#pragma once

namespace tribode {

// The distribution function of the standard normal distribution and its inverse, that of [Wichura 1988] to 1e-15 relative.
double normal_cumulative(double x);
double normal_quantile(double p); // 0 < p < 1

} // namespace tribode
