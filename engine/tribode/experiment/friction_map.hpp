#pragma once
#include "tribode/analysis/modal_model.hpp"
#include "tribode/analysis/sine_fit.hpp"

#include <span>
#include <string>
#include <vector>

namespace tribode {

// The force on a machine that its linear motion does not explain: with the model P of the motion, in the spectrum,
//
//     friction = A u - Y/P,   residual = A u - fh - Y/P,   fh: the friction model
//
// without all above a limit, where Y/P is noise. The residual is zero where model and friction model are right.

// Over the record, or its mean period.
struct ForceResidual {
    std::string record;
    std::size_t first = 0; // sample of the record at which the lists begin
    // [m], [m/s], [N]; all but the position without what is above the limit.
    std::vector<double> position, velocity, force, friction;
    double rms = 0;          // of the force [N]
    double friction_rms = 0; // of the measured friction [N]
    double explained = 0;    // share of the mean square that is a function of position and velocity, beyond chance
};

// At the end of a sine.
struct MeasuredLoop {
    double frequency_hz = 0;
    std::vector<double> position, measured, modeled; // the first without its mean [m], [N]
};

// As samples of one record: A u and A u - fh at the instants of y.
struct ForceSignals {
    std::span<const double> position, driving, left;
    double sample_time = 0;
};

// period: of the excitation [samples], whose last whole periods but the first are averaged; 0: all of the record but its
// ends, over which it is faded in and out.
ForceResidual force_residual(const ForceSignals& signals, std::size_t period, const ModalModel& model, double limit_hz);

// The last periods of a window, as many as 100 samples and one period have; empty where the residual does not hold them.
MeasuredLoop measured_loop(const ForceResidual& residual, const Window& window, double frequency_hz,
                           double sample_time);

// Means of a quantity over cells of two others, as many cells each way, row by row from the lowest y; NaN where a cell has less
// than three samples.
struct CellMeans {
    std::vector<double> x_edges, y_edges, values;
};
CellMeans cell_means(std::span<const double> x, std::span<const double> y, std::span<const double> values,
                     std::size_t cells);

} // namespace tribode
