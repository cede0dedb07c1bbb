#include "tribode/diagnosis/prediction_statistics.hpp"
#include "tribode/base/random.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>

namespace tribode {

// Calls f with the first row and the number of rows of each tenth of each record.
template <class F>
static void for_each_tenth(const std::vector<std::size_t>& rows, F f) {
    constexpr std::size_t parts = 10;
    std::size_t begin = 0;
    for (const std::size_t samples : rows) {
        for (std::size_t i = 0; i < parts; ++i) {
            const std::size_t from = begin + samples * i / parts, to = begin + samples * (i + 1) / parts;
            if (to > from) f(static_cast<Eigen::Index>(from), static_cast<Eigen::Index>(to - from));
        }
        begin += samples;
    }
}

double rms_of_errors(const std::vector<double>& errors) {
    if (errors.empty()) return std::numeric_limits<double>::infinity();
    double sum = 0;
    for (const double e : errors) sum += e * e;
    return std::sqrt(sum / static_cast<double>(errors.size()));
}

double white_noise(const std::vector<double>& values) {
    std::vector<double> differences;
    for (std::size_t k = 4; k < values.size(); ++k) {
        const double difference =
            std::abs(values[k] - 4 * values[k - 1] + 6 * values[k - 2] - 4 * values[k - 3] + values[k - 4]);
        if (std::isfinite(difference)) differences.push_back(difference);
    }
    if (differences.empty()) return 0;
    const auto middle = differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2);
    std::nth_element(differences.begin(), middle, differences.end());
    // The median of a normal distribution, and the sum of the squares of the coefficients 1, 4, 6, 4, 1.
    return 1.4826 * *middle / std::sqrt(70.0);
}

namespace {

// Whether at least half of the values are those before them.
bool holds(const std::vector<double>& values) {
    std::size_t held = 0;
    for (std::size_t k = 1; k < values.size(); ++k) held += values[k] == values[k - 1];
    return values.size() > 1 && 2 * held >= values.size();
}

// Of values that are all on an even grid, such as those of an encoder: from one to the next. Zero: they are not, or too few are
// different to tell.
double grid_step(std::vector<double> values) {
    constexpr std::size_t values_to_tell = 16;
    constexpr double rounding = 0.05, most_off = 0.02; // of a step, as written; the share that is off all the same
    std::erase_if(values, [](double value) { return !std::isfinite(value); });
    std::ranges::sort(values);
    if (values.empty()) return 0;
    const double least = 1e-9 * (values.back() - values.front());
    std::vector<double> steps;
    for (std::size_t k = 1; k < values.size(); ++k) {
        if (const double step = values[k] - values[k - 1]; step > least) steps.push_back(step);
    }
    if (steps.size() + 1 < values_to_tell) return 0;
    const double one = *std::ranges::min_element(steps);
    const auto off = std::ranges::count_if(
        steps, [&](double step) { return std::abs(step / one - std::round(step / one)) > rounding; });
    return static_cast<double>(off) <= most_off * static_cast<double>(steps.size()) ? one : 0;
}

} // namespace

double rounding_noise(const std::vector<double>& values, const std::vector<double>& errors) {
    if (!holds(values) || holds(errors)) return 0;
    constexpr std::size_t jumps_to_tell = 8; // a signal that rests now and then has a few
    std::vector<double> jumps;               // from a value that has repeated to one that will
    for (std::size_t k = 2; k + 1 < values.size(); ++k) {
        if (values[k] != values[k - 1] && values[k - 1] == values[k - 2] && values[k + 1] == values[k]) {
            jumps.push_back(std::abs(values[k] - values[k - 1]));
        }
    }
    if (jumps.size() < jumps_to_tell) return grid_step(values) / std::sqrt(12.0);
    const auto quarter = jumps.begin() + static_cast<std::ptrdiff_t>(jumps.size() / 4);
    std::nth_element(jumps.begin(), quarter, jumps.end());
    return *quarter / std::sqrt(12.0);
}

double correlation_length(const std::vector<double>& errors) {
    const std::size_t n = errors.size();
    if (n < 4) return 1;
    const double mean = std::accumulate(errors.begin(), errors.end(), 0.0) / static_cast<double>(n);
    double zero = 0, sum = 1;
    for (const double e : errors) zero += (e - mean) * (e - mean);
    if (!(zero > 0)) return 1;
    const std::size_t stride = std::max<std::size_t>(1, n / 20000);
    std::size_t step = 1;
    for (std::size_t lag = 1; lag < n / 4; lag += step) {
        step = std::max<std::size_t>(1, lag / 16);
        double product = 0;
        std::size_t count = 0;
        for (std::size_t k = lag; k < n; k += stride, ++count) product += (errors[k] - mean) * (errors[k - lag] - mean);
        const double correlation = product / static_cast<double>(count) / (zero / static_cast<double>(n));
        if (correlation < 0.05) break;
        sum += 2 * correlation * static_cast<double>(step);
    }
    return std::min(sum, static_cast<double>(n) / 4);
}

bool is_white(const std::vector<double>& errors) {
    constexpr std::size_t lags = 20;
    const std::size_t n = errors.size();
    if (n < 3 * lags) return false; // too few to tell
    const double mean = std::accumulate(errors.begin(), errors.end(), 0.0) / static_cast<double>(n);
    double zero = 0, sum = 0;
    for (const double e : errors) zero += (e - mean) * (e - mean);
    if (!(zero > 0)) return true;
    for (std::size_t lag = 1; lag <= lags; ++lag) {
        double product = 0;
        for (std::size_t k = lag; k < n; ++k) product += (errors[k] - mean) * (errors[k - lag] - mean);
        sum += product * product / (zero * zero) / static_cast<double>(n - lag);
    }
    // Of white noise chi square of as many degrees of freedom as lags: less than three standard deviations above its mean.
    const double chi_square = static_cast<double>(n) * static_cast<double>(n + 2) * sum;
    return chi_square < lags + 3 * std::sqrt(2.0 * lags);
}

bool is_nothing_left(const std::vector<double>& errors) {
    return is_white(errors) || rms_of_errors(errors) < solvers_errors;
}

double probability_of_gain(const std::vector<double>& first, const std::vector<double>& second) {
    const std::size_t n = std::min(first.size(), second.size());
    if (n == 0) return 0;
    const auto length = static_cast<std::size_t>(std::clamp(correlation_length(second), static_cast<double>(n) / 200,
                                                            static_cast<double>(n) / 12)) +
                        1;
    std::vector<double> gains; // of each block
    for (std::size_t begin = 0; begin < n; begin += length) {
        double gain = 0;
        for (std::size_t k = begin; k < std::min(n, begin + length); ++k) {
            gain += first[k] * first[k] - second[k] * second[k];
        }
        gains.push_back(gain);
    }
    constexpr std::size_t draws = 2000;
    std::size_t better = 0;
    for (std::size_t d = 0; d < draws; ++d) {
        double sum = 0;
        for (std::size_t b = 0; b < gains.size(); ++b) {
            const double u = uniform(1, d, b);
            sum += gains[std::min(static_cast<std::size_t>(u * static_cast<double>(gains.size())), gains.size() - 1)];
        }
        if (sum > 0) ++better;
    }
    return static_cast<double>(better) / draws;
}

// Minus twice the logarithm of the likelihood of the errors of one output, with the price of what was chosen to predict them, but for
// what is the same for all. Each error is predicted by a sum of Laguerre filters of those before it, whose pole says how far these
// reach: noise with a slow motion in it would take dozens of the errors themselves [Wahlberg 1991].
static double description_length(const std::vector<double>& errors, const std::vector<Stretch>& stretches,
                                 std::size_t output) {
    constexpr Eigen::Index most = 8;           // filters, and samples that a stretch begins with
    constexpr std::size_t errors_of_each = 20; // at least
    if (errors.empty()) return std::numeric_limits<double>::infinity(); // nothing was simulated
    std::size_t all = 0;
    for (const Stretch& one : stretches) all += one.output == output ? one.samples : 0;
    const auto samples = static_cast<double>(all);
    double least = std::numeric_limits<double>::infinity();
    for (const double pole : {0.0, 0.5, 0.75, 0.875, 0.9375}) {
        // Products of the outputs of the filters, and of the errors behind them.
        Eigen::MatrixXd products = Eigen::MatrixXd::Zero(most + 1, most + 1);
        double rows = 0;
        auto begin = errors.begin();
        for (const Stretch& one : stretches) {
            const auto end = begin + static_cast<std::ptrdiff_t>(one.samples);
            Eigen::VectorXd row = Eigen::VectorXd::Zero(most + 1);
            std::size_t k = 0;
            for (auto e = begin; e != end && one.output == output; ++e, ++k) {
                row[most] = *e;
                if (k >= std::min<std::size_t>(most, one.samples / 2)) {
                    products.selfadjointView<Eigen::Lower>().rankUpdate(row);
                    ++rows;
                }
                double in = *e, before = row[0]; // of each all-pass section, and what came out of it before
                row[0] = pole * row[0] + std::sqrt(1 - pole * pole) * in;
                for (Eigen::Index i = 1; i < most; ++i) {
                    in = before - pole * row[i - 1];
                    before = row[i];
                    row[i] = pole * row[i] + in;
                }
            }
            begin = end;
        }
        const Eigen::VectorXd with_now = products.row(most).head(most);
        for (Eigen::Index order = 0; order <= most && (order == 0 || all > errors_of_each * order); ++order) {
            double squares = products(most, most);
            if (order > 0) {
                const Eigen::MatrixXd past = products.topLeftCorner(order, order).selfadjointView<Eigen::Lower>();
                const Eigen::VectorXd now = with_now.head(order);
                squares -= now.dot(past.completeOrthogonalDecomposition().solve(now));
            }
            squares = std::max(squares, 1e-14 * products(most, most)); // they cancel down to this share
            least =
                std::min(least, samples * std::log(squares / rows) + static_cast<double>(order) * std::log(samples));
        }
    }
    return least;
}

double likelihood_gain(const std::vector<double>& first, const std::vector<double>& second,
                       const std::vector<Stretch>& stretches) {
    std::set<std::size_t> outputs;
    for (const Stretch& one : stretches) outputs.insert(one.output);
    double gain = 0;
    for (const std::size_t output : outputs) {
        const double before = description_length(first, stretches, output),
                     after = description_length(second, stretches, output);
        if (before != after) gain += before - after;
    }
    return gain;
}

Eigen::MatrixXd covariance_of_correlated_errors(const Eigen::MatrixXd& inverse_of_normal, const Eigen::MatrixXd& scores,
                                                const std::vector<std::size_t>& rows) {
    // The quantile of 95 % over that of a normal distribution, for a window of this share.
    constexpr double share = 0.1, enlarged = 1 + share * (2.1859 + share * (0.3142 - 0.3427 * share)) / 1.6449;
    const Eigen::Index n = scores.cols();
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(n, n);
    Eigen::Index row = 0;
    for (const std::size_t count : rows) {
        const auto samples = static_cast<Eigen::Index>(count);
        const auto width = std::max<Eigen::Index>(1, std::lround(share * static_cast<double>(count)));
        // Bartlett's window is the mean of the squares of all sums over so many samples, those at both ends in part outside.
        Eigen::VectorXd within = Eigen::VectorXd::Zero(n);
        Eigen::MatrixXd squares = Eigen::MatrixXd::Zero(n, n);
        for (Eigen::Index k = 0; k < samples + width - 1; ++k) {
            if (k < samples) within += scores.row(row + k).transpose();
            if (k >= width) within -= scores.row(row + k - width).transpose();
            squares.selfadjointView<Eigen::Lower>().rankUpdate(within);
        }
        sum +=
            enlarged * enlarged / static_cast<double>(width) * Eigen::MatrixXd(squares.selfadjointView<Eigen::Lower>());
        row += samples;
    }
    const auto rest = scores.bottomRows(scores.rows() - row);
    return inverse_of_normal * (sum + rest.transpose() * rest) * inverse_of_normal;
}

Eigen::VectorXd errors_of_left_out_parts(const Eigen::MatrixXd& slopes, const Eigen::VectorXd& errors,
                                         const std::vector<std::size_t>& rows) {
    // So much of all that is known about the parameters stays known, whatever is left out.
    constexpr double kept = 0.05;
    const Eigen::MatrixXd normal = slopes.transpose() * slopes;
    Eigen::VectorXd predicted = errors;
    for_each_tenth(rows, [&](Eigen::Index begin, Eigen::Index count) {
        const auto own = slopes.middleRows(begin, count);
        const Eigen::MatrixXd rest = (1 + kept) * normal - own.transpose() * own;
        const Eigen::VectorXd pull = own.transpose() * errors.segment(begin, count);
        predicted.segment(begin, count) += own * rest.completeOrthogonalDecomposition().solve(pull);
    });
    return predicted;
}

double gain_in_deviations(const Eigen::VectorXd& first, const Eigen::VectorXd& second,
                          const std::vector<std::size_t>& rows) {
    double gain = first.squaredNorm() - second.squaredNorm(), variance = 0;
    for_each_tenth(rows, [&](Eigen::Index begin, Eigen::Index count) {
        // What of the gain depends on the errors: it is 2 e d + d^2, where the first errors are the second ones e plus d.
        const auto left = second.segment(begin, count);
        const double product = 2 * left.dot(first.segment(begin, count) - left);
        variance += product * product;
    });
    return variance > 0 ? gain / std::sqrt(variance) : 0;
}

} // namespace tribode
