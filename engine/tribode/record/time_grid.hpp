#pragma once
#include "tribode/record/table.hpp"

#include <cstddef>
#include <string_view>
#include <vector>

namespace tribode {

// How even the instants of a record are: t_k = t_0 + n_k Ts + jitter, where n_k rises by one from row to row, and by
// more where samples are missing.
struct TimeGrid {
    struct Gap {
        std::size_t row;     // the first after it, from 0
        std::size_t missing; // samples
    };

    double sample_time = 0;  // Ts of the straight line nearest to the instants (least squares) [s]; 0 below two rows
    double jitter_rms = 0;   // of the instants about that line [s]
    double jitter_max = 0;   // largest, without its sign [s]
    std::size_t dropped = 0; // samples missing in all
    std::vector<Gap> gaps;
};

// Takes a step of more than 1.5 times the median step for a gap, so a jitter must stay below half a sample time.
// Throws InputError where time does not increase, e.g. `run.csv:17: t = 0.008 s after 0.008 s, time must increase from
// row to row`.
TimeGrid time_grid(const Table& table, std::string_view column = "t");

} // namespace tribode
