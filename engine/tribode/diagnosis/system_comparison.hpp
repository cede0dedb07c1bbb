#pragma once
#include "tribode/diagnosis/gap.hpp"
#include "tribode/diagnosis/system_fit.hpp"

#include <functional>
#include <string>
#include <vector>

namespace tribode {

// One record, measured and simulated freely without and with what was missing.
struct SystemComparison {
    SystemRecord record;
    std::vector<std::vector<double>> before, after; // of each measured output
    std::size_t first = 0;                          // sample of the comparison
    Gap gap;

    std::size_t samples() const { return record.size() - first; }

    // Measured minus simulated over scale, output after output, from `first` on.
    std::vector<double> errors(const std::vector<std::vector<double>>& simulated,
                               const std::vector<double>& scale) const;
};

struct ModelWithValues {
    const SystemModel& model;
    std::vector<double> values; // of one record
};

SystemComparison compared(const ModelWithValues& before, const ModelWithValues& after, const SystemRecord& record,
                          std::size_t first, const std::vector<double>& scale, Interpolation between);

// The values with start values that are fitted to the beginning of the record, all others as they are.
std::vector<double> with_starts(const SystemModel& model, const std::vector<double>& values, const SystemRecord& record,
                                const std::vector<double>& scale, Interpolation between,
                                const std::function<bool()>& ended);

// One paragraph: how large the gap is without anything added, and where it is largest.
std::string where_the_gap_is(const SystemComparison& comparison, const SystemModel& model);

// By how much noise of this deviation, relative to the scale, lets a prediction of the record be off, rms, through the values that
// were fitted: parameters with this covariance, and start values fitted to the beginning of the record. In the unit of the gap.
double prediction_uncertainty(const SystemModel& model, const std::vector<double>& values, const SystemRecord& record,
                              std::size_t first, const std::vector<double>& scale, Interpolation between,
                              const Eigen::MatrixXd& covariance, double noise);

} // namespace tribode
