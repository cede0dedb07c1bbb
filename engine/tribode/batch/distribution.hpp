#pragma once
#include "tribode/base/field_reader.hpp"

#include <vector>

namespace tribode {

// How a quantity varies, as the inverse of its distribution function: a number in (0, 1), from whatever design, becomes
// a value. All in the unit of the quantity.
class Distribution {
  public:
    // Reads {distribution=, ...}; default uniform.
    //   uniform      low, high
    //   log_uniform  low, high: the logarithm is uniform; both positive
    //   normal       mean, sd; with low or high, or both, the truncated distribution
    //   lognormal    median, sd_log: the natural logarithm is normal about log(median); with low, high as above
    //   triangular   low, mode, high
    //   choice       count of values (given from outside), weights: value k (from 0) has the share weights[k]
    // Throws InputError with the path of the field. Where the bounds of a normal distribution hold less than 1e-12 of
    // it, it is refused: nothing would be left of its shape.
    static Distribution read(FieldReader& fields, std::size_t choices);

    double quantile(double p) const; // 0 < p < 1
    double cumulative(double x) const;

  private:
    enum class Kind { uniform, log_uniform, normal, lognormal, triangular, choice };

    Kind kind_ = Kind::uniform;
    double low_ = 0, high_ = 1;     // of lognormal and log_uniform: of the logarithm
    double mean_ = 0, sd_ = 1;      // of the normal variable; the mode of triangular is mean_
    std::vector<double> cumulated_; // of choice: shares up to and with value k, the last is 1
};

} // namespace tribode
