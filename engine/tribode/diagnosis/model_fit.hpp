#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/diagnosis/measurement.hpp"
#include "tribode/diagnosis/noise_floor.hpp"
#include "tribode/effect/candidate.hpp"
#include "tribode/machine/machine_model.hpp"

#include <Eigen/Core>

#include <atomic>
#include <chrono>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace tribode {

// A measured record with what noise leaves of it: errors are judged in units of that.
struct Evidence {
    Measurement measurement;
    NoiseFloor floor = {};
    std::size_t first = 0;  // samples before this one only bring the machine to where it is
    std::size_t number = 0; // of the record: that of a beginning is that of the whole

    std::size_t samples() const { return measurement.size() - first; }
};

struct SimulatedRecords; // with the numbers for which they were simulated
struct Slopes;           // of the errors by the numbers of a hypothesis

// A machine with effects that may be there, and the numbers of both.
struct Hypothesis {
    std::vector<std::shared_ptr<const Candidate>> effects;
    std::vector<double> values;                                  // of the effects' parameters, one after another
    std::vector<double> nominal;                                 // of the uncertain fields, in standard deviations
    double chi_square = std::numeric_limits<double>::infinity(); // over the fitted records, fields included
    bool converged = false;
    // The numbers are those of a record's beginning, and a fit leaves them: later noise decides on the way.
    bool settled = false;
    std::vector<double> standard_errors; // of values, where they were asked for
    // Whitened errors of each part of the records where the numbers are those of the rest, then the fields, where they were
    // asked for.
    Eigen::VectorXd left_out_errors;

    // What a fit has found at these numbers, or near them, and the next one need not find anew.
    std::shared_ptr<const SimulatedRecords> simulated;
    std::vector<std::shared_ptr<const Slopes>> slopes; // newest first

    std::size_t parameter_count() const { return values.size(); }
    double sum_of_squares() const; // sum of squares of the fields' standard deviations
    // Whether the fields lie as such tolerances let them, but once in a thousand machines: beyond, an effect is missing.
    bool within_tolerance() const;
    void hold_within_tolerance(); // moves the fields towards what was described, until they do
    std::span<const double> values_of(std::size_t effect) const;
    void remove(std::size_t effect); // with its numbers
};

// Fits hypotheses to records by full simulation: least squares of whitened errors by Levenberg and Marquardt's method,
// within the bounds of each number. Derivatives are differences; those that a fit has found go on to the next one by
// Broyden's secants, from records to their beginnings and from a hypothesis to one with another effect, and are found anew
// where they lead no further.
class ModelFit {
  public:
    // The machine and the evidence must outlive it.
    ModelFit(const MachineModel& machine, const std::vector<Evidence>& evidence);

    // The fields of which the machine's user is not sure: its tolerance. A fit moves them by standard deviations, and each
    // counts against the fit as an error of its own.
    const std::vector<MachineModel::UncertainField>& fields() const { return fields_; }
    std::size_t sample_count() const;

    // The machine with the fields moved and the effects added.
    MachineModel machine(const Hypothesis& h) const;

    // Chi square at the hypothesis' numbers: infinite where the machine cannot follow the record.
    double chi_square(const Hypothesis& h) const;
    // The same without the part of the fields, for each sample: 1 where only noise is left.
    double chi_square_per_sample(const Hypothesis& h) const {
        return (chi_square(h) - h.sum_of_squares()) / static_cast<double>(sample_count());
    }
    void evaluate(Hypothesis& h) const; // finds its chi square, and keeps what was simulated
    // Whitened errors, record after record, then the fields; empty where the machine cannot follow.
    std::vector<double> errors(const Hypothesis& h) const;

    struct Options {
        int iterations = 30;
        bool move_fields = true;      // the uncertain fields too
        bool standard_errors = false; // at the end
        bool left_out_errors = false;
        double tolerance = 1e-5; // relative fall of chi square at which it has converged; more, far from the noise
        unsigned workers = 1;    // for the differences
        const std::atomic<bool>* stop = nullptr;
        std::chrono::steady_clock::time_point deadline = std::chrono::steady_clock::time_point::max(); // it ends there
    };
    // Of a settled hypothesis chi square alone is found. Throws EndedEarly on a stop request.
    void fit(Hypothesis& h, const Options& options) const;

  private:
    double factor(const Hypothesis& h, std::size_t field) const;
    struct Coordinate; // one number as the fit moves it
    std::vector<Coordinate> coordinates(const Hypothesis& h, bool fields) const;
    using Position = std::shared_ptr<const std::vector<double>>;
    // Simulated, of each record; empty where the machine cannot follow.
    std::vector<Position> positions(const Hypothesis& h) const;
    std::vector<double> errors(const Hypothesis& h, const std::vector<Position>& positions) const;
    void remember(Hypothesis& h, const std::vector<Position>& positions) const;

    const MachineModel& machine_;
    const std::vector<Evidence>& evidence_;
    std::vector<MachineModel::UncertainField> fields_;
};

} // namespace tribode
