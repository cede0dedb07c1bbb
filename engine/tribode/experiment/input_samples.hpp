#pragma once
#include "tribode/system/equations.hpp"

#include <array>
#include <cstddef>
#include <vector>

namespace tribode {

// How an input runs between its samples.
enum class Interpolation { hold, linear, band_limited };

// What the samples of an input are, as cubics in (t - t_k)/period.
struct InputSamples {
    double period = 0, offset = 0; // [s]
    std::vector<std::array<double, 4>> pieces;
    std::size_t degree = 0; // beyond which all coefficients are zero
};

// values: one per sample, not empty. Beyond the last one the value holds.
InputSamples input_samples(const std::vector<double>& values, double period, double offset, Interpolation between);

// Connects the input: the coefficients become discrete variables, whose clock comes before all others; before the first
// sample the input has its own value. Where it moves between its samples the input becomes an output. `start`: of the
// run [s].
void connect_samples(Equations& equations, const Equations::Input& input, InputSamples samples, double start);

} // namespace tribode
