#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// Whether a parameter or a result may have this name in a table of points: index, failed and reason are taken, and a comma, a
// quote, a slash or a control character such as a line break has no place in it.
bool is_column_name(std::string_view name);

// One quantity that is kept of a point: a number, or a list of numbers.
struct KeptField {
    std::string name;
    bool list = false;
    std::vector<double> values; // one where it is a number
};

// What is kept of one point of a batch. It is a function of the index alone: not of the worker, of the points before it,
// or of the time.
struct PointRow {
    std::size_t index = 0;          // from 1
    std::vector<double> parameters; // in the order of Batch::parameters
    std::string failure;            // why there is no result; empty: there is one
    std::vector<KeptField> fields;  // sorted by name; empty where it failed
};

// A batch of independent points. Nothing here knows how a point is described or run.
struct Batch {
    std::string name;
    std::uint64_t seed = 0;
    std::size_t count = 0;
    std::vector<std::string> parameters;                         // names of the numbers that make a point
    std::map<std::string, std::string> units;                    // of parameters and kept quantities, where known
    std::function<std::vector<double>(std::size_t index)> point; // the numbers of a point, index from 1
    // Runs a point. What goes wrong with it is its `failure`; EndedEarly is thrown where a stop was requested.
    std::function<PointRow(std::size_t index)> run;
    std::function<std::vector<std::string>()> files_read; // so far, other than the results
};

// The seed of a point, a function of the batch's seed and the index alone; below 2^53, so that it is a whole number also
// where numbers are doubles.
std::uint64_t point_seed(std::uint64_t batch_seed, std::size_t index);

} // namespace tribode
