#pragma once
#include "tribode/diagnosis/lasting_errors.hpp"
#include "tribode/diagnosis/system_model.hpp"

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// Orthonormal, of all that the columns can do; columns that others nearly make up count for nothing.
Eigen::MatrixXd basis_of(Eigen::MatrixXd columns);

// (columns^T columns)^-1, whatever the units of the columns. Zero for a column that is zero; directions that they hardly tell apart
// have large values.
Eigen::MatrixXd inverse_of_normal(const Eigen::MatrixXd& columns);

// What a simulation of a record gives: values of the measured outputs and, where asked for, of states and inputs.
struct SystemTrace {
    std::vector<std::vector<double>> outputs;
    std::vector<std::vector<double>> states;
};

class LaneFit;

// Where a fit has ended, and how the errors move about it.
struct FoundMinimum {
    std::vector<double> values;
    double sum = 0;            // of the squared errors
    std::size_t errors = 0;    // how many
    Eigen::MatrixXd curvature; // J^T J, of their Jacobian by the values; empty: not known

    // Whether the errors at these values are, to first order, nearly the same.
    bool is_near(const std::vector<double>& others) const;
};

// Fits values of models to records by full simulation: least squares of the outputs, each divided by `scale`, by
// Levenberg and Marquardt's method: many sets of values side by side in fixed steps (LaneFit) where the equations allow it.
class SystemFit {
  public:
    // `used`: of each record, how many of its samples count, from the first one. The records must outlive it.
    SystemFit(const std::vector<SystemRecord>& records, std::vector<double> scale, Interpolation between,
              std::vector<std::size_t> used);

    const std::vector<SystemRecord>& records() const { return records_; }
    const std::vector<double>& scale() const { return scale_; }
    Interpolation interpolation() const { return between_; }
    const std::vector<std::size_t>& used() const { return used_; }

    // Freely, from the start values of record r among `values` on. Nothing where the run fails or values are not finite;
    // `problem` says why.
    std::optional<SystemTrace> simulate(const SystemModel& model, const std::vector<double>& values, std::size_t r,
                                        std::size_t samples, std::string* problem = nullptr) const;

    // Measured minus simulated over scale, record after record, output after output, over the samples that count.
    // Empty where a run fails. In fixed steps where these are exact enough.
    std::vector<double> errors(const SystemModel& model, const std::vector<double>& values) const;
    static double sum_of_squares(const std::vector<double>& errors);

    // Columns: the change of simulated / scale by each value (rows: as errors). By differences in fixed steps, else by the
    // variational equations, else by differences of runs. A column is zero where it cannot be had.
    Eigen::MatrixXd jacobian(const SystemModel& model, const std::vector<double>& values,
                             const std::vector<double>& errors) const;

    double noise() const; // of the outputs over their scale, rms
    // White noise and rounding in what a model leaves of them, rms.
    double noise_in(const std::vector<double>& errors) const;

    // From here on there are no errors where fixed steps cannot follow the equations: a search has no time for slow runs. Not for a
    // model that has events itself.
    void keep_to_fixed_steps() { fixed_steps_only_ = true; }

    // From here on fits are those of a search, whose results are fitted once more: what fixed steps found is compared with halved ones
    // only, and not with a solver that controls its error, and errors may be off by a hundredth. `substeps`: so many of a sample
    // are enough to begin with, or to simulate; 0: not known. A fit ends where an iteration gains less than `least_gain` of the
    // squared errors.
    void begin_search(std::size_t substeps = 0, double least_gain = 1e-4) {
        is_search_ = true;
        substeps_ = substeps;
        least_gain_ = least_gain;
    }
    bool is_search() const { return is_search_; }
    std::size_t substeps() const { return substeps_; }

    // From here on a fit of this model gives up that comes near these values, as it would end there once more, or whose errors will not
    // become less than these. They must outlive it.
    void look_elsewhere(const FoundMinimum& found) { found_ = &found; }

    using Ended = std::function<bool()>; // whether the time is over

    struct Result {
        std::vector<double> values;
        std::vector<double> errors; // at the values; empty: no simulation succeeded
        double sum = std::numeric_limits<double>::infinity();
        int iterations = 0;
        std::size_t substeps = 0;  // of a sample, that were enough; 0: not known
        Eigen::MatrixXd curvature; // of a search in fixed steps, on the way to the values: see FoundMinimum
        bool gave_up = false;      // see look_elsewhere()
    };
    // Where `ended` says so the values are those reached by then.
    Result fit(const SystemModel& model, std::vector<double> start, int iterations, const Ended& ended) const;
    // The same from a start far off: beginnings of the records are fitted first, each twice as long as the one before. Over a
    // long record the phase of an oscillation that is off by a turn or more makes local minima.
    Result fit_growing(const SystemModel& model, std::vector<double> start, int iterations, const Ended& ended) const;

    // Of the values, relative to one another, where the errors are white noise of this deviation. Directions that the errors do not
    // tell have large ones.
    Eigen::MatrixXd covariance(const SystemModel& model, const std::vector<double>& values,
                               const std::vector<double>& errors, double noise) const;
    // From the least squares of a fit to generalized ones, whose errors may last as those of a random force do: with such a force the
    // values come nearer to the true ones. The same result where the errors are white, or where more is left than such a force explains.
    Result generalized(const SystemModel& model, Result least, const Ended& ended) const;
    // Of these values, all that the errors leave open: they are no white noise, so correlations count. Infinite where the record
    // does not tell. `errors`: at the values.
    std::vector<double> standard_errors(const SystemModel& model, const std::vector<double>& values,
                                        const std::vector<double>& errors) const;

  private:
    // The errors of all records, and their slopes where these are given.
    std::vector<OutputErrors> by_output(const std::vector<double>& errors, const Eigen::MatrixXd& slopes = {}) const;
    // Runs that `ended` ends have failed; here and below it may be empty.
    std::vector<double> errors_by_runs(const SystemModel& model, const std::vector<double>& values,
                                       const Ended& ended) const;
    Eigen::MatrixXd jacobian_by_runs(const SystemModel& model, const std::vector<double>& values,
                                     const std::vector<double>& errors, std::vector<double>* steps,
                                     const Ended& ended) const;
    // Levenberg and Marquardt's method. `lanes`: by which it runs the model; else one run after the other.
    Result descend(const SystemModel& model, std::vector<double> start, int iterations, const Ended& ended,
                   const LaneFit* lanes) const;

    // By the variational equations; nothing where a record has no derivative.
    std::optional<Eigen::MatrixXd> exact_jacobian(const SystemModel& model, const std::vector<double>& values,
                                                  const std::vector<double>& errors, const Ended& ended) const;
    std::vector<std::size_t> rows_before() const; // each record

    // The derivatives by the values of record r, in their order, of the measured outputs.
    using Derivatives = std::vector<std::vector<std::vector<double>>>;
    std::optional<SystemTrace> run(const SystemModel& model, const std::vector<double>& values, std::size_t r,
                                   std::size_t samples, std::string* problem, Derivatives* derivatives,
                                   const Ended& ended) const;

    // Those of one record go behind `all`. False where the run fails.
    bool append_errors(const SystemModel& model, const std::vector<double>& values, std::size_t r,
                       std::vector<double>& all, const Ended& ended) const;

    const std::vector<SystemRecord>& records_;
    std::vector<double> scale_;
    Interpolation between_;
    std::vector<std::size_t> used_;
    bool fixed_steps_only_ = false, is_search_ = false;
    std::size_t substeps_ = 0;
    double least_gain_ = 1e-6; // of the squared errors, by an iteration
    const FoundMinimum* found_ = nullptr;
    bool is_part_ = false; // the beginning of what will be fitted
};

} // namespace tribode
