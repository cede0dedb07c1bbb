#pragma once
#include "tribode/diagnosis/system_model.hpp"

namespace tribode {

// The records with every n-th of their samples, n the largest power of two such that what lies between follows from these, and enough
// are left: the outputs within their noise, or within `tolerance` of each, in its unit; the inputs nearly. For a search, whose time
// grows with the samples, of what was sampled faster than it moves. The same n for all; the records themselves where there is none.
std::vector<SystemRecord> thinned(const SystemModel& model, const std::vector<SystemRecord>& records,
                                  const std::vector<double>& tolerance);

} // namespace tribode
