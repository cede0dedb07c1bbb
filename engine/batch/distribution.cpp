#include "batch/distribution.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace tribode {

namespace {

const std::vector<std::string> kind_names = {"uniform", "log_uniform", "normal", "lognormal", "triangular", "choice"};

using Coefficients = std::array<double, 8>; // from the constant term up

double ratio(const Coefficients& above, const Coefficients& below, double x) {
    double a = 0, b = 0;
    for (std::size_t k = above.size(); k-- > 0;) {
        a = a * x + above[k];
        b = b * x + below[k];
    }
    return a / b;
}

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

double normal_cumulative(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

double normal_quantile(double p) {
    static constexpr Coefficients a = {3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3,
                                       1.3731693765509461125e4, 4.5921953931549871457e4, 6.7265770927008700853e4,
                                       3.3430575583588128105e4, 2.5090809287301226727e3};
    static constexpr Coefficients b = {1.0,
                                       4.2313330701600911252e1,
                                       6.8718700749205790830e2,
                                       5.3941960214247511077e3,
                                       2.1213794301586595867e4,
                                       3.9307895800092710610e4,
                                       2.8729085735721942674e4,
                                       5.2264952788528545610e3};
    static constexpr Coefficients c = {1.42343711074968357734e0, 4.63033784615654529590e0,  5.76949722146069140550e0,
                                       3.64784832476320460504e0, 1.27045825245236838258e0,  2.41780725177450611770e-1,
                                       2.27238449892691845833e-2, 7.74545014278341407640e-4};
    static constexpr Coefficients d = {1.0,
                                       2.05319162663775882187e0,
                                       1.67638483018380384940e0,
                                       6.89767334985100004550e-1,
                                       1.48103976427480074590e-1,
                                       1.51986665636164571966e-2,
                                       5.47593808499534494600e-4,
                                       1.05075007164441684324e-9};
    static constexpr Coefficients e = {6.65790464350110377720e0, 5.46378491116411436990e0,  1.78482653991729133580e0,
                                       2.96560571828504891230e-1, 2.65321895265761230930e-2, 1.24266094738807843860e-3,
                                       2.71155556874348757815e-5, 2.01033439929228813265e-7};
    static constexpr Coefficients f = {1.0,
                                       5.99832206555887937690e-1,
                                       1.36929880922735805310e-1,
                                       1.48753612908506148525e-2,
                                       7.86869131145613259100e-4,
                                       1.84631831751005468180e-5,
                                       1.42151175831644588870e-7,
                                       2.04426310338993978564e-15};
    const double q = p - 0.5;
    if (std::abs(q) <= 0.425) return q * ratio(a, b, 0.180625 - q * q);
    const double r = std::sqrt(-std::log(q < 0 ? p : 1 - p));
    const double x = r <= 5 ? ratio(c, d, r - 1.6) : ratio(e, f, r - 5);
    return q < 0 ? -x : x;
}

Distribution Distribution::read(FieldReader& fields, std::size_t choices) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    Distribution result;
    const std::string name = fields.choice("distribution", kind_names, choices > 0 ? "choice" : "uniform");
    result.kind_ =
        static_cast<Kind>(std::find(kind_names.begin(), kind_names.end(), name) - kind_names.begin());

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
