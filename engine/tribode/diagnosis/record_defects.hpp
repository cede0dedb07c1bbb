#pragma once
#include "tribode/diagnosis/system_model.hpp"

#include <string>
#include <vector>

namespace tribode {

// Samples that stand apart from both neighbours alone, as an error of a logger or a sensor does, and a motion does not: by many times what
// a cubic through two samples on either side leaves elsewhere, and where all around is as elsewhere once the cubic takes their place.
// Nothing where there are more than one in a hundred: then they belong to the signal. `t`: instants, which must be even around a sample.
std::vector<std::size_t> isolated_samples(const std::vector<double>& t, const std::vector<double>& values);

// A record as a simulation needs it: isolated samples of its outputs are replaced by the cubics through their neighbours, and what comes
// behind a gap is a record of its own, as nobody knows what the inputs were within. Where a start value is not free there is no such
// record. `remarks`: what was done, a sentence each. Rows without a time are left as they are.
std::vector<SystemRecord> without_defects(SystemRecord record, const SystemModel& model,
                                          std::vector<std::string>& remarks);

} // namespace tribode
