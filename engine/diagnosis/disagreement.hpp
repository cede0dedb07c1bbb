#pragma once
#include "diagnosis/residual_force.hpp"

#include <string>
#include <vector>

namespace tribode {

struct Diagnosis;
struct Compared;

// Where in a record model and measurement disagree: the share of the squared error that falls into each part of the
// record, beside the share of the time that the part takes.
struct GapShare {
    std::string axis; // "direction", "velocity", "time", ...
    std::string part; // "forward", "the fastest third", "0 to 2 s"
    double error, time;
    double lift() const { return time > 0 ? error / time : 0; }
};
std::vector<GapShare> gap_shares(const Compared& record);

// What is left over as a force, over one coordinate: mean and spread in bins, apart by direction of motion.
struct ForceCurve {
    std::vector<double> at, forward, backward; // bin centres; mean force [N], NaN where a bin is empty
};
enum class Coordinate { position, velocity, time, since_reversal, thrust };
ForceCurve force_curve(const ResidualForce& residual, Coordinate coordinate, std::size_t bins);

// What the records of a diagnosis cannot show, because it did not happen in them: a sentence each.
std::vector<std::string> untested(const Diagnosis& diagnosis);

// One paragraph on the record kept out: in which times, positions, velocities, directions and frequencies they disagree.
std::string where_they_disagree(const Diagnosis& diagnosis);

} // namespace tribode
