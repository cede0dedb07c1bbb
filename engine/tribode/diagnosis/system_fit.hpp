#pragma once
#include "tribode/experiment/input_samples.hpp"
#include "tribode/system/equations.hpp"

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// A measured record of a system of equations.
struct SystemRecord {
    std::string source;
    std::vector<double> t;                    // [s], ascending; of a system without states the number of the row
    std::vector<std::vector<double>> inputs;  // of each input of the equations; empty: the input has its own value
    std::vector<std::vector<double>> outputs; // of each measured output

    std::size_t size() const { return t.size(); }
    SystemRecord head(std::size_t samples) const { return part(0, samples); } // its first samples
    SystemRecord part(std::size_t from, std::size_t samples) const;           // at the instants that they have
};

// Equations of which some values may move: parameters, the same for all records, and start values, which each record has
// of its own.
struct SystemModel {
    struct Parameter {
        std::size_t place;                                     // among equations.parameters
        double low = -std::numeric_limits<double>::infinity(); // bounds, in the unit of the parameter
        double high = std::numeric_limits<double>::infinity();
        double scale = 1; // a typical size, where the value is zero or near it
    };
    Equations equations;
    std::vector<std::size_t> measured; // outputs of the equations, in the order of SystemRecord::outputs
    std::vector<Parameter> parameters;
    std::vector<std::size_t> starts; // states whose start values may move

    // The values as they are now: parameters, then the start values of each record.
    std::vector<double> values(std::size_t records) const;
    // Of all values those that concern one record.
    std::vector<double> values_of(const std::vector<double>& values, std::size_t record) const;
    // With these values as its own; of the start values those of the first record.
    SystemModel with(const std::vector<double>& values) const;
    std::size_t value_count(std::size_t records) const { return parameters.size() + records * starts.size(); }
};

// Orthonormal, of all that the columns can do; columns that others nearly make up count for nothing.
Eigen::MatrixXd basis_of(Eigen::MatrixXd columns);

// (columns^T columns)^-1, whatever the units of the columns. Zero for a column that is zero; directions that they hardly tell apart
// have large values.
Eigen::MatrixXd inverse_of_normal(const Eigen::MatrixXd& columns);

// A copy whose graph of expressions is its own, so that several threads may extend copies.
Equations deep_copy(const Equations& equations);

// What a simulation of a record gives: values of the measured outputs and, where asked for, of states and inputs.
struct SystemTrace {
    std::vector<std::vector<double>> outputs;
    std::vector<std::vector<double>> states;
};

// Fits values of models to records by full simulation: least squares of the outputs, each divided by `scale`, by
// Levenberg and Marquardt's method with difference quotients.
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
    // Empty where a run fails.
    std::vector<double> errors(const SystemModel& model, const std::vector<double>& values) const;
    static double sum_of_squares(const std::vector<double>& errors);

    // Columns: the change of simulated / scale by each value (rows: as errors), by the variational equations, or where these
    // have no derivative by difference quotients. A column is zero where it cannot be had. `steps`: by how much each value
    // moves for a difference; the next call begins with them.
    Eigen::MatrixXd jacobian(const SystemModel& model, const std::vector<double>& values,
                             const std::vector<double>& errors, std::vector<double>* steps = nullptr) const;

    struct Result {
        std::vector<double> values;
        std::vector<double> errors; // at the values; empty: no simulation succeeded
        double sum = std::numeric_limits<double>::infinity();
        int iterations = 0;
    };
    // Where `ended` says so the values are those reached by then.
    Result fit(const SystemModel& model, std::vector<double> start, int iterations,
               const std::function<bool()>& ended) const;
    // The same from a start far off: beginnings of the records are fitted first, each twice as long as the one before. Over a
    // long record the phase of an oscillation that is off by a turn or more makes local minima.
    Result fit_growing(const SystemModel& model, std::vector<double> start, int iterations,
                       const std::function<bool()>& ended) const;

    // Of the values, relative to one another, where the errors are white noise of this deviation. Directions that the errors do not
    // tell have large ones.
    Eigen::MatrixXd covariance(const SystemModel& model, const std::vector<double>& values,
                               const std::vector<double>& errors, double noise) const;
    // Of the values, all that the errors leave open: they are no white noise, so as many samples count as are independent of
    // one another. Infinite where the record does not tell. `errors`: at the values.
    std::vector<double> standard_errors(const SystemModel& model, const std::vector<double>& values,
                                        const std::vector<double>& errors) const;

  private:
    // By the variational equations; nothing where a record has no derivative.
    std::optional<Eigen::MatrixXd> exact_jacobian(const SystemModel& model, const std::vector<double>& values,
                                                  const std::vector<double>& errors) const;
    std::vector<std::size_t> rows_before() const; // each record

    // The derivatives by the values of record r, in their order, of the measured outputs.
    using Derivatives = std::vector<std::vector<std::vector<double>>>;
    std::optional<SystemTrace> run(const SystemModel& model, const std::vector<double>& values, std::size_t r,
                                   std::size_t samples, std::string* problem, Derivatives* derivatives) const;

    // Those of one record go behind `all`. False where the run fails.
    bool append_errors(const SystemModel& model, const std::vector<double>& values, std::size_t r,
                       std::vector<double>& all) const;

    const std::vector<SystemRecord>& records_;
    std::vector<double> scale_;
    Interpolation between_;
    std::vector<std::size_t> used_;
};

} // namespace tribode
