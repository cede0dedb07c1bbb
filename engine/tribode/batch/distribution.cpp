#include "tribode/batch/distribution.hpp"
#include "tribode/base/normal.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tribode {

namespace {

const std::vector<std::string> distribution_names = {"uniform",   "log_uniform", "normal",
                                                     "lognormal", "triangular",  "choice"};

// The quantile of the standard normal distribution between two bounds. The side with the smaller tail is counted from
// its own end: far out, 1 - p has no digits left.
double truncated_quantile(double p, double low, double high) {
    if (low > 0) return -truncated_quantile(1 - p, -high, -low);
    const double from = normal_cumulative(low), to = normal_cumulative(high);
    const double inside = from + p * (to - from);
    // Rounding may reach the ends of (0, 1), where the quantile is infinite; the bounds hold in any case.
    if (inside <= 0) return low;
    if (inside >= 1) return high;
    return std::clamp(normal_quantile(inside), low, high);
}

} // namespace

Distribution Distribution::read(FieldReader& fields, std::size_t choices) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    Distribution result;
    const std::string name = fields.choice("distribution", distribution_names, choices > 0 ? "choice" : "uniform");
    result.kind_ = static_cast<Kind>(std::find(distribution_names.begin(), distribution_names.end(), name) -
                                     distribution_names.begin());

    const bool logarithmic = result.kind_ == Kind::log_uniform || result.kind_ == Kind::lognormal;
    const Allowed allowed = logarithmic ? Allowed::positive : Allowed::finite;
    const auto scaled = [&](double x) { return logarithmic ? std::log(x) : x; };
    const auto ordered = [&](double low, double high) {
        if (!(low < high)) fields.fail("low", "must be below high");
    };
    switch (result.kind_) {
    case Kind::uniform:
    case Kind::log_uniform:
    case Kind::triangular:
        result.low_ = scaled(fields.number("low", "", allowed));
        result.high_ = scaled(fields.number("high", "", allowed));
        ordered(result.low_, result.high_);
        if (result.kind_ == Kind::triangular) {
            result.mean_ = fields.number("mode", "", Allowed::finite);
            if (result.mean_ < result.low_ || result.mean_ > result.high_) {
                fields.fail("mode", "must lie between low and high");
            }
        }
        break;
    case Kind::normal:
    case Kind::lognormal: {
        result.mean_ = scaled(fields.number(logarithmic ? "median" : "mean", "", allowed));
        result.sd_ = fields.number(logarithmic ? "sd_log" : "sd", "", Allowed::positive);
        const auto low = fields.optional_number("low", "", allowed), high = fields.optional_number("high", "", allowed);
        result.low_ = low ? scaled(*low) : -infinity;
        result.high_ = high ? scaled(*high) : infinity;
        ordered(result.low_, result.high_);
        const double from = (result.low_ - result.mean_) / result.sd_, to = (result.high_ - result.mean_) / result.sd_;
        // On the side of the smaller tail, where the difference keeps its digits.
        const double inside = from > 0 ? normal_cumulative(-from) - normal_cumulative(-to)
                                       : normal_cumulative(to) - normal_cumulative(from);
        if (!(inside > 1e-12)) fields.fail("low", "and high leave less than 1e-12 of the distribution");
        break;
    }
    case Kind::choice: {
        if (choices == 0) fields.fail("values", "is missing (the list to choose from)");
        const auto weights = fields.numbers("weights", "", Allowed::non_negative, std::vector<double>(choices, 1.0));
        if (weights.size() != choices) fields.fail("weights", "must have one entry for each of values");
        double sum = 0;
        for (const double weight : weights) result.cumulated_.push_back(sum += weight);
        if (!(sum > 0)) fields.fail("weights", "must not all be zero");
        for (double& share : result.cumulated_) share /= sum;
        break;
    }
    }
    if (choices > 0 && result.kind_ != Kind::choice) fields.fail("values", "goes with distribution = \"choice\" only");
    return result;
}

double Distribution::quantile(double p) const {
    switch (kind_) {
    case Kind::uniform: return low_ + p * (high_ - low_);
    case Kind::log_uniform: return std::exp(low_ + p * (high_ - low_));
    case Kind::normal:
    case Kind::lognormal: {
        const double z = truncated_quantile(p, (low_ - mean_) / sd_, (high_ - mean_) / sd_);
        const double x = std::clamp(mean_ + sd_ * z, low_, high_);
        return kind_ == Kind::normal ? x : std::exp(x);
    }
    case Kind::triangular: {
        const double width = high_ - low_, left = mean_ - low_, right = high_ - mean_;
        if (p * width < left) return low_ + std::sqrt(p * width * left);
        return high_ - std::sqrt((1 - p) * width * right);
    }
    case Kind::choice: break;
    }
    // The first value whose share reaches p: one of weight zero is never met.
    const auto found = std::lower_bound(cumulated_.begin(), cumulated_.end(), p);
    return static_cast<double>(std::min(found, cumulated_.end() - 1) - cumulated_.begin());
}

double Distribution::cumulative(double x) const {
    switch (kind_) {
    case Kind::uniform: return std::clamp((x - low_) / (high_ - low_), 0.0, 1.0);
    case Kind::log_uniform: return x > 0 ? std::clamp((std::log(x) - low_) / (high_ - low_), 0.0, 1.0) : 0;
    case Kind::normal:
    case Kind::lognormal: {
        if (kind_ == Kind::lognormal && !(x > 0)) return 0;
        const double y = std::clamp(kind_ == Kind::normal ? x : std::log(x), low_, high_);
        const double from = normal_cumulative((low_ - mean_) / sd_), to = normal_cumulative((high_ - mean_) / sd_);
        return (normal_cumulative((y - mean_) / sd_) - from) / (to - from);
    }
    case Kind::triangular: {
        if (x <= low_) return 0;
        if (x >= high_) return 1;
        const double width = high_ - low_;
        if (x < mean_) return (x - low_) * (x - low_) / (width * (mean_ - low_));
        return 1 - (high_ - x) * (high_ - x) / (width * (high_ - mean_));
    }
    case Kind::choice: break;
    }
    if (x < 0) return 0;
    const auto k = std::min(static_cast<std::size_t>(x), cumulated_.size() - 1);
    return cumulated_[k];
}

} // namespace tribode
