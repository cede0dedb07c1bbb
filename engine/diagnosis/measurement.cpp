#include "diagnosis/measurement.hpp"
#include "base/error.hpp"
#include "base/text.hpp"
#include "machine/machine_controller.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace tribode {

namespace {

constexpr std::size_t least_samples = 200;
// Of the values of a text file with nine or ten digits, relative to the largest u.
constexpr double file_rounding = 2e-8;

double range_of(const std::vector<double>& values) {
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    return *high - *low;
}

double rms(const std::vector<double>& values) {
    double sum = 0;
    for (const double value : values) sum += value * value;
    return std::sqrt(sum / static_cast<double>(values.size()));
}

double largest(const std::vector<double>& values) {
    double most = 0;
    for (const double value : values) most = std::max(most, std::abs(value));
    return most;
}

// The share of the samples at the largest or smallest value, where they stand in runs of four and more while the
// signal moves elsewhere: what a limit leaves.
std::size_t clipped(const std::vector<double>& values) {
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    std::size_t count = 0, run = 0;
    for (std::size_t k = 0; k < values.size(); ++k) {
        const bool at = values[k] == *low || values[k] == *high;
        run = at && (k == 0 || values[k] == values[k - 1]) ? run + 1 : (at ? 1 : 0);
        if (run == 4) count += 4;
        if (run > 4) ++count;
    }
    return count;
}

// Eighth differences: of a smooth excitation hardly anything is left, of noise and rounding a hundred times their size.
std::vector<double> fine_part(std::vector<double> x) {
    for (int order = 0; order < 8; ++order) {
        for (std::size_t k = 0; k + 1 < x.size(); ++k) x[k] = x[k + 1] - x[k];
        x.pop_back();
    }
    return x;
}

double correlation(const std::vector<double>& a, const std::vector<double>& b) {
    double ab = 0, aa = 0, bb = 0;
    for (std::size_t k = 0; k < a.size(); ++k) {
        ab += a[k] * b[k];
        aa += a[k] * a[k];
        bb += b[k] * b[k];
    }
    return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

[[noreturn]] void refuse(const std::string& where, const std::string& problem) {
    throw InputError(where + ": " + problem);
}

void check_signals(const Measurement& m, const MachineModel& machine, const std::string& where) {
    const std::vector<double>& y = m.position();
    const double stroke = range_of(y);
    if (m.size() < least_samples) {
        refuse(where, fmt::format("{} samples are too few to tell effects apart, must be {} at least", m.size(),
                                  least_samples));
    }
    const double rounding = std::max(machine.encoder_resolution, machine.noise_rms);
    if (stroke <= 6 * machine.noise_rms + 3 * machine.encoder_resolution || stroke == 0) {
        refuse(where, fmt::format("y moves over {} m only, no more than noise and rounding ({} m): a record with "
                                  "motion is needed",
                                  to_text(stroke), to_text(rounding)));
    }
    if (range_of(m.thrust) == 0) refuse(where, "u is constant: a record in which the thrust changes is needed");
    if (const std::size_t count = clipped(y); count > m.size() / 20 && clipped(m.thrust) < m.size() / 50) {
        // A machine at rest at the end of its way stands still too, but not at both ends with r or u moving on.
        const auto [low, high] = std::minmax_element(y.begin(), y.end());
        const std::vector<double>& asked = m.drive.closed_loop() ? m.drive.reference : m.thrust;
        const auto rests_at = [&](double end) {
            std::size_t samples = 0;
            for (std::size_t k = 1; k < y.size(); ++k) {
                if (y[k] == end && asked[k] != asked[k - 1]) ++samples;
            }
            return samples;
        };
        const std::size_t at_low = rests_at(*low), at_high = rests_at(*high);
        if (at_low > 20 && at_high > 20 && stroke > 1000 * rounding) {
            refuse(where,
                   fmt::format("y rests at {} and {} m in {} samples: it seems clipped, a whole record is needed",
                               to_text(*low), to_text(*high), count));
        }
    }
}

// Samples of y repeated while the machine moves on: the transfer dropped them.
void check_dropped(const Measurement& m, const MachineModel& machine, const std::string& where) {
    const std::vector<double>& y = m.position();
    const double rounding = 6 * machine.noise_rms + 2 * machine.encoder_resolution;
    std::size_t dropped = 0, first = 0;
    for (std::size_t k = 2; k + 2 < y.size(); ++k) {
        if (y[k] != y[k - 1]) continue;
        // On either side the steps are far above rounding and in one direction: the velocity did not stop for a sample.
        const double before = y[k - 1] - y[k - 2], after = y[k + 1] - y[k];
        if (before * after > 0 && std::abs(before) > rounding && std::abs(after) > 1.5 * std::abs(before) &&
            std::abs(before) > 20 * machine.encoder_resolution) {
            if (dropped++ == 0) first = k;
        }
    }
    if (dropped >= 3) {
        refuse(where, fmt::format("y repeats its value in {} samples while the machine moves, first at t = {} s: "
                                  "samples were dropped",
                                  dropped, to_text(m.drive.t[first])));
    }
}

// Whether what is left of u comes from when or how finely it was logged, not from another controller: it is no more than
// one step of the encoder makes, or u is the controller's output one sample earlier or later. The excitation makes up for
// that. The first samples depend on what was before the record.
bool differs_by_the_log(const Measurement& m, const std::vector<double>& output, const MachineModel& machine) {
    constexpr std::size_t begin = 10;
    const auto left_with = [&](std::size_t later, std::size_t earlier) {
        double sum = 0;
        for (std::size_t k = begin + later; k + earlier < m.size(); ++k) {
            const double left = m.thrust[k - later] - output[k - earlier];
            sum += left * left;
        }
        return std::sqrt(sum / static_cast<double>(m.size()));
    };
    const double left = left_with(0, 0);
    std::vector<double> step(begin, 0.0);
    step[begin / 2] = machine.axis().encoder_resolution;
    const auto response = controller_output(machine, {}, step);
    const auto [low, high] = std::minmax_element(response.begin(), response.end());
    return left < std::max(-*low, *high) || std::min(left_with(1, 0), left_with(0, 1)) < left / 4;
}

void check_controller(const Measurement& m, const MachineModel& machine, const std::string& where) {
    const std::vector<double>& y = m.position();
    const std::vector<double>& excitation = m.drive.excitation;
    std::vector<double> output(m.size());
    for (std::size_t k = 0; k < m.size(); ++k) output[k] = m.thrust[k] - excitation[k];
    const double scale = rms(m.thrust);
    if (rms(excitation) < 1e-4 * scale) return;
    const double ratio = rms(output) / scale;
    const double tracking = range_of(m.drive.reference) > 0 ? range_of(y) / range_of(m.drive.reference) : 1;
    if (tracking > 30 || (tracking < 1.0 / 30 && ratio > 3)) {
        refuse(where,
               fmt::format("y moves {} times as far as r: the two seem to be in different units, both must be in "
                           "metres (--scale y=...)",
                           to_text(std::round(tracking * 1e4) / 1e4)));
    }
    if (ratio > 1e3) {
        // The controller on y gives thrusts that have nothing to do with u.
        refuse(where, "the machine's controller on r and y gives a thrust a thousand times u: y seems to be in another "
                      "unit, or u and y in each other's place");
    }
    // What is left of u should be an excitation of its own. One that carries the rounding of y was made by a
    // controller of other gains, or the log has another instant or other digits than the controller had.
    const double shared = std::abs(correlation(fine_part(excitation), fine_part(output)));
    if (shared > 0.4 && !differs_by_the_log(m, output, machine)) {
        refuse(where, fmt::format("the machine's controller does not make the recorded u from r and y: what is left is "
                                  "{:.0f} % of u (rms) and follows y; gains, filter, delay or order of operations are "
                                  "other than described",
                                  100 * rms(excitation) / scale));
    }
}

} // namespace

void Measurement::cut(std::size_t samples) {
    for (auto* column : {&drive.t, &drive.u, &drive.reference, &drive.excitation, &drive.measured, &thrust}) {
        if (column->size() > samples) column->resize(samples);
    }
}

std::vector<double> controller_output(const MachineModel& machine, const std::vector<double>& reference,
                                      const std::vector<double>& position) {
    const MachineController controller(machine);
    MachineController::State state;
    std::vector<double> output(position.size());
    for (std::size_t k = 0; k < position.size(); ++k) {
        output[k] = controller.step(state, k < reference.size() ? reference[k] : 0, position[k]);
    }
    return output;
}

double lattice_step(const std::vector<double>& values, double least) {
    // The smallest difference of distinct values, then: are all values multiples of it?
    std::vector<double> sorted = values;
    std::sort(sorted.begin(), sorted.end());
    double step = 0;
    for (std::size_t k = 1; k < sorted.size(); ++k) {
        const double difference = sorted[k] - sorted[k - 1];
        if (difference > least / 4 && (step == 0 || difference < step)) step = difference;
    }
    if (step == 0) return 0;
    const double levels = (sorted.back() - sorted.front()) / step;
    if (levels < 50) return 0;
    // Refined over the whole range, where the rounding of the text matters least.
    double refined = (sorted.back() - sorted.front()) / std::round(levels);
    for (const double value : sorted) {
        const double place = (value - sorted.front()) / refined;
        if (std::abs(place - std::round(place)) > 0.05) return 0;
    }
    // A lattice in text has a short name: 5e-06 rather than 5.00000000002e-06.
    const double short_name = std::stod(fmt::format("{:.4g}", refined));
    return std::abs(short_name - refined) < 1e-6 * refined ? short_name : refined;
}

Measurement read_measurement(const std::filesystem::path& file, const MachineModel& machine,
                             const RecordOptions& options) {
    return measurement_from_table(read_record(file, options, {"t", "r", "u", "y"}).table, machine, file.string());
}

Measurement measurement_from_table(const Table& table, const MachineModel& machine, const std::string& where) {
    Measurement m;
    m.source = where;
    for (const char* name : {"t", "u", "y"}) table[name];
    require_uniform_time(table, machine.sample_time);
    for (const auto& column : table.columns) {
        for (std::size_t row = 0; row < column.values.size(); ++row) {
            if (!std::isfinite(column.values[row])) {
                throw InputError(fmt::format("{}: {} = {}, must be finite", table.place(row), column.name,
                                             to_text(column.values[row])));
            }
        }
    }
    m.drive.t = table["t"].values;
    m.drive.measured = table["y"].values;
    m.thrust = table["u"].values;
    const bool closed_loop = machine.closed_loop && machine.has_controller();
    if (closed_loop) m.drive.reference = table["r"].values;
    check_signals(m, machine, where);
    if (!closed_loop) {
        m.drive.u = m.thrust;
        check_dropped(m, machine, where);
        return m;
    }
    const std::vector<double> output = controller_output(machine, m.drive.reference, m.drive.measured);
    m.drive.excitation.resize(m.size());
    const double rounding = file_rounding * largest(m.thrust);
    for (std::size_t k = 0; k < m.size(); ++k) {
        const double rest = m.thrust[k] - output[k];
        m.drive.excitation[k] = std::abs(rest) < rounding ? 0 : rest;
    }
    check_controller(m, machine, where);
    check_dropped(m, machine, where);
    return m;
}

} // namespace tribode
