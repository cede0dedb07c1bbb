#pragma once
#include "tribode/diagnosis/prediction_statistics.hpp"
#include "tribode/experiment/input_samples.hpp"
#include "tribode/system/equations.hpp"

#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// A measured record of a system of equations. Where an output was not measured it is not a number, and counts nowhere.
struct SystemRecord {
    std::string source;
    std::vector<double> t;                    // [s], ascending; of a system without states the number of the row
    std::vector<std::vector<double>> inputs;  // of each input of the equations; empty: the input has its own value
    std::vector<std::vector<double>> outputs; // of each measured output
    // Where these are every n-th of the samples of another record: that one, for what inputs do in between.
    std::shared_ptr<const SystemRecord> whole = nullptr;
    std::size_t every = 1;

    std::size_t size() const { return t.size(); }
    SystemRecord head(std::size_t samples) const { return part(0, samples); } // its first samples
    SystemRecord part(std::size_t from, std::size_t samples) const;           // at the instants that they have
    std::size_t measured(std::size_t samples) const; // values of outputs among the first samples
    std::optional<double> first_measured(std::size_t output) const;
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
    struct InnerSignal {
        enum class Kind { difference, shared };
        std::size_t output; // its place among the outputs
        Term term;          // as the model was given
        Kind kind;
    };
    std::vector<InnerSignal> inner = {}; // see with_inner_signals()
    // A state whose start value follows from the record, unless it is among those that move: what shows an output late begins where that
    // was measured first, other memory at rest behind what it follows.
    struct Beginning {
        std::size_t state;
        Term at_rest;                        // of inputs, parameters and other states
        std::optional<std::size_t> measured; // which output, among the measured ones
    };
    std::vector<Beginning> beginnings = {};

    // The values as they are now: parameters, then the start values of each record.
    std::vector<double> values(std::size_t records) const;
    // Of all values those that concern one record.
    std::vector<double> values_of(const std::vector<double>& values, std::size_t record) const;
    // The equations with these values, where record r begins.
    Equations begun(const std::vector<double>& values, std::size_t r, const SystemRecord& record) const;
    // With these values as its own; of the start values those of the first record.
    SystemModel with(const std::vector<double>& values) const;
    std::size_t value_count(std::size_t records) const { return parameters.size() + records * starts.size(); }
};

// What is measured of the records, in the order of errors: record after record, output after output. Of a system without states no
// error follows from another one.
std::vector<Stretch> stretches_of(const SystemModel& model, const std::vector<SystemRecord>& records);

// A copy whose graph of expressions is its own, so that several threads may extend copies.
Equations deep_copy(const Equations& equations);

// An input of a record as it runs between its samples; at an even period, also where the instants of the record are uneven. Of every
// n-th sample: straight lines with the means and first moments of n pieces each.
InputSamples input_of(const SystemRecord& record, std::size_t input, Interpolation between);

// Straight lines over n pieces each with the same mean and first moment.
std::vector<std::array<double, 4>> straightened(const std::vector<std::array<double, 4>>& pieces, std::size_t n);

bool is_even(const std::vector<double>& t, double period); // but for a thousandth of a period

// Between samples [s]: the mean of the steps between instants, without gaps of more than 1.5 times the median step.
double sample_time(const std::vector<double>& t);

} // namespace tribode
