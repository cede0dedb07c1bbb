#include "tribode/diagnosis/disagreement.hpp"
#include "tribode/analysis/spectrum.hpp"
#include "tribode/analysis/statistics.hpp"
#include "tribode/diagnosis/diagnosis.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numeric>

namespace tribode {

namespace {

struct GapOverTime {
    std::vector<double> gap;      // y_measured - y_before [m]
    std::vector<double> velocity; // of the simulated machine: free of rounding [m/s]
};

GapOverTime gap_of(const Compared& c, double sample_time) {
    GapOverTime e;
    const auto& y = c.measurement.position();
    e.gap.resize(y.size());
    e.velocity.resize(y.size());
    for (std::size_t k = 0; k < y.size(); ++k) {
        e.gap[k] = y[k] - c.y_before[k];
        const std::size_t a = k > 0 ? k - 1 : 0, b = std::min(k + 1, y.size() - 1);
        e.velocity[k] = (c.y_before[b] - c.y_before[a]) / (static_cast<double>(b - a) * sample_time);
    }
    return e;
}

double sample_time_of(const Compared& c) {
    const auto& t = c.measurement.drive.t;
    return t.size() > 1 ? (t.back() - t.front()) / static_cast<double>(t.size() - 1) : 1;
}

template <class Contains>
GapShare share(const std::string& axis, const std::string& part, const GapOverTime& e, std::size_t first,
               const Contains& contains) {
    double inside = 0, all = 0;
    std::size_t count = 0;
    for (std::size_t k = first; k < e.gap.size(); ++k) {
        const double square = e.gap[k] * e.gap[k];
        all += square;
        if (!contains(k)) continue;
        inside += square;
        ++count;
    }
    return {axis, part, all > 0 ? inside / all : 0,
            static_cast<double>(count) / static_cast<double>(e.gap.size() - first)};
}

} // namespace

std::vector<GapShare> gap_shares(const Compared& c) {
    const double Ts = sample_time_of(c);
    const GapOverTime e = gap_of(c, Ts);
    const auto& y = c.measurement.position();
    std::vector<double> speeds;
    for (const double v : e.velocity) speeds.push_back(std::abs(v));
    const double fastest = *std::max_element(speeds.begin(), speeds.end());
    const double still = 1e-3 * fastest;
    std::vector<GapShare> list;
    const auto add = [&](const std::string& axis, const std::string& part, const auto& contains) {
        list.push_back(share(axis, part, e, c.first, contains));
    };
    add("direction", "at rest", [&](std::size_t k) { return speeds[k] <= still; });
    add("direction", "forward", [&](std::size_t k) { return e.velocity[k] > still; });
    add("direction", "backward", [&](std::size_t k) { return e.velocity[k] < -still; });
    std::vector<double> moving;
    for (const double speed : speeds) {
        if (speed > still) moving.push_back(speed);
    }
    const double slow = lower_quantile(moving, 1.0 / 3), fast = lower_quantile(moving, 2.0 / 3);
    add("velocity", fmt::format("below {:.3g} m/s", slow),
        [&](std::size_t k) { return speeds[k] > still && speeds[k] < slow; });
    add("velocity", fmt::format("{:.3g} to {:.3g} m/s", slow, fast),
        [&](std::size_t k) { return speeds[k] >= slow && speeds[k] < fast; });
    add("velocity", fmt::format("above {:.3g} m/s", fast),
        [&](std::size_t k) { return speeds[k] >= fast && speeds[k] > still; });
    const auto [low, high] = std::minmax_element(y.begin(), y.end());
    for (int i = 0; i < 4; ++i) {
        const double from = *low + (*high - *low) * i / 4, to = *low + (*high - *low) * (i + 1) / 4;
        add("position", fmt::format("{:.3g} to {:.3g} mm", 1e3 * from, 1e3 * to),
            [&](std::size_t k) { return y[k] >= from && (y[k] < to || i == 3); });
    }
    const double duration = static_cast<double>(y.size()) * Ts;
    for (int i = 0; i < 5; ++i) {
        const double from = duration * i / 5, to = duration * (i + 1) / 5;
        add("time", fmt::format("{:.3g} to {:.3g} s", from, to), [&](std::size_t k) {
            const double t = static_cast<double>(k) * Ts;
            return t >= from && t < to;
        });
    }
    // Just after a reversal: within a hundredth of the stroke of it.
    std::vector<bool> near(y.size());
    double turned_at = c.y_before.front(), sign = 0;
    for (std::size_t k = 0; k < y.size(); ++k) {
        const double now = e.velocity[k] > still ? 1 : e.velocity[k] < -still ? -1 : sign;
        if (now != sign) turned_at = c.y_before[k];
        sign = now;
        near[k] = std::abs(c.y_before[k] - turned_at) < 0.01 * (*high - *low);
    }
    add("since reversal", "less than a hundredth of the stroke", [&](std::size_t k) { return near[k]; });
    return list;
}

ForceCurve force_curve(const ResidualForce& r, Coordinate coordinate, std::size_t bins) {
    std::vector<double> x;
    switch (coordinate) {
    case Coordinate::position: x = r.position; break;
    case Coordinate::velocity: x = r.velocity; break;
    case Coordinate::time: x = r.time; break;
    case Coordinate::thrust: x = r.thrust; break;
    case Coordinate::since_reversal: {
        double turn = r.position.empty() ? 0 : r.position.front(), sign = 0;
        for (std::size_t k = 0; k < r.position.size(); ++k) {
            const double now = r.velocity[k] > 0 ? 1 : -1;
            if (now != sign) turn = r.position[k];
            sign = now;
            x.push_back(std::abs(r.position[k] - turn));
        }
    }
    }
    ForceCurve curve;
    if (x.empty()) return curve;
    const auto [low, high] = std::minmax_element(x.begin(), x.end());
    const double width = (*high - *low) / static_cast<double>(bins);
    if (!(width > 0)) return curve;
    // A signal within a band has two independent values per period of its highest frequency.
    const double independent_share = std::min(1.0, 2 * r.bandwidth * r.sample_time);
    constexpr double none = std::numeric_limits<double>::quiet_NaN();
    struct Bin {
        double sum = 0, squares = 0, count = 0;
        double mean() const { return count > 0 ? sum / count : none; }
        double standard_error(double share) const {
            const double independent = share * count;
            return independent < 2 ? none
                                   : std::sqrt(std::max(squares / count - mean() * mean(), 0.0) / (independent - 1));
        }
    };
    std::vector<Bin> forward(bins), backward(bins);
    const double still =
        1e-3 * std::abs(*std::max_element(r.velocity.begin(), r.velocity.end(),
                                          [](double a, double b) { return std::abs(a) < std::abs(b); }));
    for (std::size_t k = 0; k < x.size(); ++k) {
        const auto bin = std::min(static_cast<std::size_t>((x[k] - *low) / width), bins - 1);
        if (std::abs(r.velocity[k]) <= still) continue;
        Bin& here = (r.velocity[k] > 0 ? forward : backward)[bin];
        here.sum += r.force[k];
        here.squares += r.force[k] * r.force[k];
        ++here.count;
    }
    for (std::size_t i = 0; i < bins; ++i) {
        curve.at.push_back(*low + width * (static_cast<double>(i) + 0.5));
        curve.forward.push_back(forward[i].mean());
        curve.backward.push_back(backward[i].mean());
        curve.forward_error.push_back(forward[i].standard_error(independent_share));
        curve.backward_error.push_back(backward[i].standard_error(independent_share));
    }
    return curve;
}

ForceMap force_over_motion(const ResidualForce& r) {
    constexpr std::size_t columns = 60, rows = 40;
    ForceMap map;
    if (r.force.empty()) return map;
    const auto [low, high] = std::minmax_element(r.position.begin(), r.position.end());
    double fastest = 0;
    for (const double v : r.velocity) fastest = std::max(fastest, std::abs(v));
    if (!(*high > *low && fastest > 0)) return map;
    const auto edges = [](double from, double to, std::size_t cells) {
        std::vector<double> list;
        for (std::size_t i = 0; i <= cells; ++i)
            list.push_back(from + (to - from) * static_cast<double>(i) / static_cast<double>(cells));
        return list;
    };
    map.x_edges = edges(*low, *high, columns);
    map.y_edges = edges(-fastest, fastest, rows);
    std::vector<double> sum(columns * rows);
    std::vector<std::size_t> count(columns * rows);
    const auto cell = [](double part, std::size_t cells) {
        return std::min(static_cast<std::size_t>(part * static_cast<double>(cells)), cells - 1);
    };
    for (std::size_t k = 0; k < r.force.size(); ++k) {
        const std::size_t column = cell((r.position[k] - *low) / (*high - *low), columns);
        const std::size_t row = cell((r.velocity[k] + fastest) / (2 * fastest), rows);
        sum[row * columns + column] += r.force[k];
        ++count[row * columns + column];
    }
    for (std::size_t i = 0; i < sum.size(); ++i) {
        map.values.push_back(count[i] ? sum[i] / static_cast<double>(count[i])
                                      : std::numeric_limits<double>::quiet_NaN());
    }
    return map;
}

ForceMap force_over_time_and_frequency(const ResidualForce& r) {
    constexpr std::size_t rows = 40;
    ForceMap map;
    const auto length = std::max(r.force.size() / 20, static_cast<std::size_t>(std::ceil(0.3 / r.sample_time)));
    if (r.force.size() < 2 * length) return map;
    // Below the first row a piece has not one period. Each row is looked at in steps that no line of a piece falls between.
    const double lowest = 1 / (static_cast<double>(length) * r.sample_time);
    for (std::size_t i = 0; i <= rows; ++i) {
        map.y_edges.push_back(lowest *
                              std::pow(r.bandwidth / lowest, static_cast<double>(i) / static_cast<double>(rows)));
    }
    std::vector<double> frequency;
    std::vector<std::size_t> row_of;
    for (std::size_t row = 0; row < rows; ++row) {
        const double from = map.y_edges[row], width = map.y_edges[row + 1] - from;
        const auto steps = static_cast<std::size_t>(std::ceil(2 * width / lowest));
        for (std::size_t i = 0; i < steps; ++i) {
            frequency.push_back(from + width * (static_cast<double>(i) + 0.5) / static_cast<double>(steps));
            row_of.push_back(row);
        }
    }
    const std::size_t pieces = 2 * r.force.size() / length - 1;
    std::vector<std::vector<double>> columns;
    for (std::size_t p = 0; p < pieces; ++p) {
        const std::size_t begin = p * length / 2;
        const auto amplitude = amplitude_spectrum({r.force.begin() + static_cast<std::ptrdiff_t>(begin),
                                                   r.force.begin() + static_cast<std::ptrdiff_t>(begin + length)},
                                                  r.sample_time, frequency);
        columns.emplace_back(rows, 0.0);
        for (std::size_t i = 0; i < frequency.size(); ++i) {
            double& here = columns.back()[row_of[i]];
            here = std::max(here, amplitude[i]);
        }
        // The half in its middle.
        map.x_edges.push_back(r.time[begin + length / 4]);
    }
    map.x_edges.push_back(map.x_edges.back() + static_cast<double>(length) / 2 * r.sample_time);
    for (std::size_t row = 0; row < rows; ++row) {
        for (const auto& column : columns) map.values.push_back(column[row]);
    }
    return map;
}

std::optional<Repetition> repetition_of(const Measurement& m) {
    constexpr std::size_t shortest = 50;
    const std::size_t n = m.size(), begin = n / 4;
    std::vector<const std::vector<double>*> signals;
    if (m.drive.closed_loop()) {
        signals = {&m.drive.reference, &m.drive.excitation};
    } else {
        signals = {&m.drive.u};
    }
    std::vector<double> tolerance;
    bool moves = false;
    for (const auto* signal : signals) {
        const auto [low, high] =
            std::minmax_element(signal->begin() + static_cast<std::ptrdiff_t>(begin), signal->end());
        tolerance.push_back(1e-6 * (*high - *low));
        moves = moves || *high > *low;
    }
    if (!moves) return std::nullopt;
    for (std::size_t period = shortest; begin + 2 * period <= n; ++period) {
        const auto repeats = [&](std::size_t s) {
            for (std::size_t k = begin; k + period < n; ++k) {
                if (std::abs((*signals[s])[k + period] - (*signals[s])[k]) > tolerance[s]) return false;
            }
            return true;
        };
        if (!repeats(0) || (signals.size() > 1 && !repeats(1))) continue;
        double sum = 0;
        for (std::size_t k = begin; k + period < n; ++k) {
            const double difference = m.position()[k + period] - m.position()[k];
            sum += difference * difference;
        }
        const double step = (m.drive.t.back() - m.drive.t.front()) / static_cast<double>(n - 1);
        return Repetition{static_cast<double>(period) * step,
                          std::sqrt(sum / static_cast<double>(2 * (n - begin - period)))};
    }
    return std::nullopt;
}

std::vector<std::string> untested(const Diagnosis& d) {
    constexpr double inf = std::numeric_limits<double>::infinity();
    double thrust = 0, low = inf, high = -inf, fastest = 0, longest = 0, highest = 0;
    std::size_t forward = 0, backward = 0, reversals = 0;
    for (const auto* list : {&d.fitted, &d.validation}) {
        for (const auto& c : *list) {
            const double Ts = sample_time_of(c);
            const auto& y = c.measurement.position();
            const auto [least, most] = std::minmax_element(y.begin(), y.end());
            low = std::min(low, *least);
            high = std::max(high, *most);
            for (const double u : c.measurement.thrust) thrust = std::max(thrust, std::abs(u));
            longest = std::max(longest, static_cast<double>(y.size()) * Ts);
            const GapOverTime e = gap_of(c, Ts);
            double peak = 0;
            for (const double v : e.velocity) peak = std::max(peak, std::abs(v));
            fastest = std::max(fastest, peak);
            double sign = 0;
            for (const double v : e.velocity) {
                if (std::abs(v) < 0.02 * peak) continue;
                ++(v > 0 ? forward : backward);
                if (v * sign < 0) ++reversals;
                sign = v > 0 ? 1 : -1;
            }
            // Up to which frequency the motion stands out of white noise of the floor's size, seen through a Hann window.
            const double noise = 2.45 * c.gap.floor / std::sqrt(static_cast<double>(y.size()));
            std::vector<double> frequency;
            for (int i = 0; i < 200; ++i) frequency.push_back(std::pow(0.45 / Ts, i / 199.0));
            const auto amplitude = amplitude_spectrum(y, Ts, frequency);
            for (std::size_t i = 0; i < frequency.size(); ++i) {
                if (amplitude[i] > 5 * noise) highest = std::max(highest, frequency[i]);
            }
        }
    }
    std::vector<std::string> list = {
        fmt::format("The thrust stays within {:.3g} N: a saturation above shows nowhere.", thrust),
        fmt::format(
            "The axis moves between {:.4g} and {:.4g} mm: what lies outside, or changes little over {:.3g} mm, is "
            "not seen.",
            1e3 * low, 1e3 * high, 1e3 * (high - low)),
        fmt::format("It moves at {:.3g} m/s at most: drag that begins above is not seen.", fastest),
        fmt::format(
            "The position stands out of the noise up to {:.3g} Hz: vibration modes and lags above are not seen.",
            highest),
        fmt::format("The longest record has {:.3g} s: what changes more slowly looks constant.", longest)};
    const double moving = static_cast<double>(std::max<std::size_t>(forward + backward, 1));
    if (static_cast<double>(std::min(forward, backward)) < 0.02 * moving) {
        list.push_back(
            "The axis moves in one direction only: a constant force, friction by direction and Coulomb friction "
            "cannot be told apart.");
    }
    if (reversals < 2) {
        list.push_back("The motion turns at most once: backlash and pre-sliding friction are hardly seen.");
    }
    return list;
}

std::string where_they_disagree(const Diagnosis& d) {
    const Compared& c = d.validation.empty() ? d.fitted.front() : d.validation.front();
    const double ratio = c.gap.before / c.described_floor;
    std::string text =
        fmt::format("On {} measured and simulated position differ by {:.4g} um rms, {:.4g} times what noise "
                    "and rounding leave",
                    c.measurement.source, 1e6 * c.gap.before, ratio);
    const auto repetition = repetition_of(c.measurement);
    const std::string repeats =
        repetition ? fmt::format(" The drive repeats every {:.4g} s; repetitions of the measured position differ by "
                                 "{:.4g} um rms each, {:.4g} times what noise and rounding leave: {}.",
                                 repetition->period, 1e6 * repetition->rms, repetition->rms / c.gap.floor,
                                 repetition->rms < 1.5 * c.gap.floor
                                     ? "what is more than that comes back in each of them"
                                     : "the machine is noisier than described, or something keeps a time of its own")
                   : "";
    if (ratio < 1.3) return text + ": they agree everywhere." + repeats;
    auto shares = gap_shares(c);
    std::stable_sort(shares.begin(), shares.end(),
                     [](const GapShare& a, const GapShare& b) { return a.lift() > b.lift(); });
    text += ".";
    std::vector<std::string> told;
    for (const auto& part : shares) {
        if (part.lift() < 1.3 || part.error < 0.1 || told.size() == 4) break;
        if (std::find(told.begin(), told.end(), part.axis) != told.end()) continue;
        text += fmt::format(" {:.0f} % of the squared error falls into {:.0f} % of the time: {} {}.", 100 * part.error,
                            100 * part.time, part.axis, part.part);
        told.push_back(part.axis);
    }
    if (told.empty()) text += " The error is spread evenly over times, positions, velocities and directions.";
    text += repeats;
    // The strongest frequencies.
    const double Ts = sample_time_of(c);
    std::vector<double> gap(c.y_before.size());
    for (std::size_t k = 0; k < gap.size(); ++k) gap[k] = c.measurement.position()[k] - c.y_before[k];
    std::vector<double> frequency;
    for (int i = 0; i < 120; ++i) frequency.push_back(0.5 * std::pow(400.0, i / 119.0));
    const auto amplitude = amplitude_spectrum(gap, Ts, frequency);
    const auto top = static_cast<std::size_t>(std::max_element(amplitude.begin(), amplitude.end()) - amplitude.begin());
    text += fmt::format(" Its strongest frequency is {:.3g} Hz ({:.3g} um).", frequency[top], 1e6 * amplitude[top]);
    return text;
}

} // namespace tribode
