#include "tribode/analysis/statistics.hpp"
#include "tribode/base/normal.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace tribode {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

std::vector<double> finite(std::span<const double> values) {
    std::vector<double> result;
    std::copy_if(values.begin(), values.end(), std::back_inserter(result), [](double x) { return std::isfinite(x); });
    return result;
}

// The probability that Student's variable lies within +-t: finite sums, one for odd and one for even degrees
// [Abramowitz 1964, 26.7.3 and 26.7.4].
double student_within(double t, std::size_t degrees) {
    const double angle = std::atan(t / std::sqrt(static_cast<double>(degrees)));
    const double cosine = std::cos(angle), sine = std::sin(angle);
    const bool odd = degrees % 2 == 1;
    double term = odd ? cosine : 1, sum = 0;
    for (std::size_t k = odd ? 3 : 2; k <= degrees && term > 1e-17; k += 2) {
        sum += term;
        term *= cosine * cosine * static_cast<double>(k - 1) / static_cast<double>(k);
    }
    if (!odd) return sine * sum;
    return 2 / std::numbers::pi * (angle + sine * sum);
}

} // namespace

double student_quantile(double p, std::size_t degrees) {
    if (p < 0.5) return -student_quantile(1 - p, degrees);
    if (degrees > 1000) { // the expansion about the normal quantile; good to 1e-10 for z up to 4
        const double z = normal_quantile(p), square = z * z, n = static_cast<double>(degrees);
        const double first = z * (square + 1) / 4, second = z * ((5 * square + 16) * square + 3) / 96;
        const double third = z * (((3 * square + 19) * square + 17) * square - 15) / 384;
        return z + (first + (second + third / n) / n) / n;
    }
    const double within = 2 * p - 1;
    double low = 0, high = 1;
    while (student_within(high, degrees) < within && high < 1e300) high *= 2;
    for (int i = 0; i < 200 && high - low > 1e-15 * high; ++i) {
        const double middle = 0.5 * (low + high);
        (student_within(middle, degrees) < within ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

double sorted_quantile(std::span<const double> sorted, double probability) {
    const double place = probability * static_cast<double>(sorted.size() - 1);
    const auto below = static_cast<std::size_t>(place);
    if (below + 1 >= sorted.size()) return sorted.back();
    const double part = place - static_cast<double>(below), step = sorted[below + 1] - sorted[below];
    if (std::isinf(step)) return (1 - part) * sorted[below] + part * sorted[below + 1]; // farther apart than any number
    return sorted[below] + part * step;
}

double lower_quantile(std::vector<double> values, double probability) {
    if (values.empty()) return 0;
    const auto place = static_cast<std::ptrdiff_t>(probability * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), values.begin() + place, values.end());
    return values[static_cast<std::size_t>(place)];
}

Summary summarize(std::span<const double> values, std::span<const double> probabilities, double confidence) {
    std::vector<double> x = finite(values);
    std::sort(x.begin(), x.end());
    Summary s;
    s.count = x.size();
    s.missing = values.size() - x.size();
    s.mean = s.standard_deviation = s.standard_error = s.mean_low = s.mean_high = s.least = s.greatest = nan;
    const double n = static_cast<double>(x.size());
    if (!x.empty()) {
        s.least = x.front();
        s.greatest = x.back();
        s.mean = std::accumulate(x.begin(), x.end(), 0.0) / n;
    }
    if (x.size() > 1) {
        double squares = 0;
        for (const double value : x) squares += (value - s.mean) * (value - s.mean);
        s.standard_deviation = std::sqrt(squares / (n - 1));
        s.standard_error = s.standard_deviation / std::sqrt(n);
        const double t = student_quantile(0.5 * (1 + confidence), x.size() - 1);
        s.mean_low = s.mean - t * s.standard_error;
        s.mean_high = s.mean + t * s.standard_error;
    }
    const double z = normal_quantile(0.5 * (1 + confidence));
    for (const double p : probabilities) {
        Quantile quantile{p, nan, nan, nan};
        if (!x.empty()) quantile.value = sorted_quantile(x, p);
        // The number of values below the true quantile is binomial; places from 1.
        const double spread = z * std::sqrt(n * p * (1 - p));
        const double from = std::floor(n * p - spread), to = std::ceil(n * p + spread) + 1;
        if (from >= 1) quantile.low = x[static_cast<std::size_t>(from) - 1];
        if (to <= n) quantile.high = x[static_cast<std::size_t>(to) - 1];
        s.quantiles.push_back(quantile);
    }
    return s;
}

Histogram histogram(std::span<const double> values, std::size_t bins) {
    std::vector<double> x = finite(values);
    std::sort(x.begin(), x.end());
    Histogram result;
    result.missing = values.size() - x.size();
    if (x.empty()) return result;
    double low = x.front(), high = x.back();
    if (!(high > low)) { // one value: a bin around it
        const double half = std::max(std::abs(low), 1.0) / 2;
        low -= half;
        high += half;
        bins = bins == 0 ? 1 : bins;
    }
    const double scale = std::isinf(high - low) ? 0.5 : 1; // no number is as large as the range may be
    const auto range = [scale](double from, double to) { return scale * to - scale * from; };
    if (bins == 0) {
        const double width =
            2 * range(sorted_quantile(x, 0.25), sorted_quantile(x, 0.75)) / std::cbrt(static_cast<double>(x.size()));
        bins = width > 0 ? static_cast<std::size_t>(std::clamp(std::ceil(range(low, high) / width), 1.0, 200.0)) : 200;
    }
    result.counts.assign(bins, 0);
    for (std::size_t k = 0; k <= bins; ++k) {
        const double part = static_cast<double>(k) / static_cast<double>(bins);
        result.edges.push_back(k == bins ? high : (scale * low + part * range(low, high)) / scale);
    }
    for (const double value : x) {
        const double place = range(low, value) / range(low, high) * static_cast<double>(bins);
        ++result.counts[std::min(static_cast<std::size_t>(place), bins - 1)]; // the greatest value is in the last bin
    }
    return result;
}

std::vector<std::size_t> worst_cases(std::span<const double> values, std::size_t count, bool greatest) {
    std::vector<std::size_t> places;
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (std::isfinite(values[i])) places.push_back(i);
    }
    std::stable_sort(places.begin(), places.end(), [&](std::size_t a, std::size_t b) {
        return greatest ? values[a] > values[b] : values[a] < values[b];
    });
    places.resize(std::min(count, places.size()));
    return places;
}

} // namespace tribode
