#pragma once
#include "tribode/diagnosis/residual_force.hpp"

#include <optional>
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

// What is left over as a force, over one coordinate: means in bins with their standard errors, apart by direction of
// motion.
struct ForceCurve {
    std::vector<double> at;                            // bin centers
    std::vector<double> forward, backward;             // mean force [N], NaN where a bin is empty
    std::vector<double> forward_error, backward_error; // [N]; NaN where a bin has less than two independent values
};
enum class Coordinate { position, velocity, time, since_reversal, thrust };
ForceCurve force_curve(const ResidualForce& residual, Coordinate coordinate, std::size_t bins);

// What is left over as a force, over two coordinates, in cells.
struct ForceMap {
    std::vector<double> x_edges, y_edges;
    std::vector<double> values; // [N], row by row from the lowest y
};
// Mean over position [m] and velocity [m/s], whose sign tells the direction; NaN where the machine has not been.
ForceMap force_over_motion(const ResidualForce& residual);
// Amplitude over time [s] and frequency [Hz], from pieces of a twentieth of the record that overlap, 0.3 s long at least.
ForceMap force_over_time_and_frequency(const ResidualForce& residual);

// Where a record's drive (reference and excitation, or u) repeats itself: what the positions of one repetition have that the
// next one has not, as rms [m]. It is the noise floor from the data, with all else that keeps a time of its own.
struct Repetition {
    double period; // [s]
    double rms;    // of one repetition: that of differences over sqrt 2 [m]
};
// From the second quarter of the record on, where the start has died away; nothing where less than two periods fit in there.
std::optional<Repetition> repetition_of(const Measurement& measurement);

// What the records of a diagnosis cannot show, because it did not happen in them: a sentence each.
std::vector<std::string> untested(const Diagnosis& diagnosis);

// One paragraph on the validation record: in which times, positions, velocities, directions and frequencies they disagree.
std::string where_they_disagree(const Diagnosis& diagnosis);

} // namespace tribode
