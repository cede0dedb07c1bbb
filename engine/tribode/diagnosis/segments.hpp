#pragma once
#include "tribode/diagnosis/system_fit.hpp"

#include <functional>
#include <optional>
#include <vector>

namespace tribode {

// Records cut into short segments, each with start values of its own, as in multiple shooting [Bock 1983]. A model that lacks a
// force leaves what was measured after a while, and a force over a position where the axis never was says nothing about the one
// where it is. Within a segment the model stays near the measurement, so that what it lacks shows to first order.
struct Segments {
    std::vector<SystemRecord> records;
    SystemModel model;          // its start values may move, all of them
    std::vector<double> values; // fitted: parameters, then the start values of each segment
    std::vector<double> errors; // at the values, relative to the scale of the outputs

    std::size_t substeps = 0; // of a sample, that were enough; 0: not known

    // `of_sample`: so many steps of a sample are enough; 0: not known.
    SystemFit fit(const std::vector<double>& scale, Interpolation between, std::size_t of_sample) const;

    std::vector<std::size_t> first_of; // of each record its first segment

    // Of all values of the segments, with parameters of terms or without, those of whole records that begin as their first segments.
    // `of`: which of them may move.
    std::vector<double> whole(const SystemModel& of, const std::vector<double>& all) const;
};

// The longest segments over which the model comes near the measurement: errors of one and a half times the noise, or of one percent of
// the outputs; of each record, over the samples that `fit` counts. Nothing for systems whose state is more than numbers that move
// continuously, and where no simulation succeeds.
std::optional<Segments> segmented(const SystemModel& model, const std::vector<double>& values, const SystemFit& fit,
                                  const std::function<bool()>& ended);

} // namespace tribode
