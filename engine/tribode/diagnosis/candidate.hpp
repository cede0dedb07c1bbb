#pragma once
#include "tribode/diagnosis/measurement.hpp"
#include "tribode/diagnosis/noise_floor.hpp"
#include "tribode/diagnosis/residual_force.hpp"
#include "tribode/machine/machine_model.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace tribode {

// One number that a fit may move.
struct FitParameter {
    std::string name;
    double low, high;         // bounds, in SI
    bool logarithmic = false; // moved by factors; low > 0 then
    double step = 0;          // of differences: a factor less one, or in SI
};

// An effect that may be what is missing, with the numbers that are open and where their search starts: from the residual
// force, read as this effect would make it. Some effects are here several times, in simpler and richer forms.
struct Candidate {
    std::string effect; // its name in the list of effects
    std::string form;   // "" or what tells it from the other forms
    std::vector<FitParameter> parameters;
    std::function<Json(std::span<const double>)> make; // parameters of the effect from the numbers
    std::vector<std::vector<double>> starts;           // likeliest first
    // Where the residual force does not tell a start: points to simulate, of which the best are taken. With `size`, the
    // number of that index is scaled to fit best by the response at the point.
    std::vector<std::vector<double>> probes;
    std::optional<std::size_t> size;
    std::size_t tried = 2; // of starts and probes, the best so many are fitted
    // A form of more numbers, with starts near these, for where they leave more than noise.
    std::function<std::shared_ptr<const Candidate>(std::span<const double>)> richer = {};
    bool ringing = false; // sought on beginnings too, which have fewer valleys
    bool rugged = false;  // chi square has many valleys over a whole record: fitted on beginnings that grow

    Effect at(std::span<const double> values) const;
};

// What the search knows of the gap so far.
struct Clues {
    const MachineModel& machine; // with the effects found so far
    const Measurement& measurement;
    const ResidualForce& residual;
    const std::vector<double>& whitened; // errors of y, white [m times 1/innovation]
    double innovation;                   // [m]
};

// All effects that this machine and record can show. Left out: those that would do nothing here.
std::vector<Candidate> candidates(const Clues& clues);

} // namespace tribode
