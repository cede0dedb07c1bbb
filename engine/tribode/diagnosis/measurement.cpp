#include "tribode/diagnosis/measurement.hpp"
#include "tribode/analysis/signal_fit.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/machine/machine_controller.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace tribode {

namespace {

constexpr std::size_t min_samples = 200;
// Of the values of a text file with nine or ten digits, relative to the largest u.
constexpr double file_rounding = 2e-8;

double range_of(const std::vector<double>& values) {
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    return *high - *low;
}

// A stretch of equal values: [first, last], of `least` samples and more.
struct Stand {
    std::size_t first, last;
    std::size_t repeats() const { return last - first; }
};

std::vector<Stand> stands_of(const std::vector<double>& values, std::size_t least) {
    std::vector<Stand> list;
    for (std::size_t first = 0, k = 1; k <= values.size(); ++k) {
        if (k < values.size() && values[k] == values[first]) continue;
        if (k - first >= least) list.push_back({first, k - 1});
        first = k;
    }
    return list;
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
    if (m.size() < min_samples) {
        refuse(where,
               fmt::format("{} samples are too few to tell effects apart, must be {} at least", m.size(), min_samples));
    }
    const double rounding = std::max(machine.encoder_resolution, machine.noise_rms);
    if (stroke <= 6 * machine.noise_rms + 3 * machine.encoder_resolution || stroke == 0) {
        refuse(where, fmt::format("y moves over {} m only, no more than noise and rounding ({} m): a record with "
                                  "motion is needed",
                                  to_text(stroke), to_text(rounding)));
    }
    if (range_of(m.thrust) == 0) refuse(where, "u is constant: a record in which the thrust changes is needed");
}

// Samples of y that are not those of the machine: clipped, held while it moved, out of place. A body under so much thrust
// cannot stop within a sample from a velocity above `swift`.
void check_position(const Measurement& m, const MachineModel& machine, const std::string& where) {
    const std::vector<double>& y = m.position();
    double gain = machine.rigid_gain;
    for (const auto& mode : machine.modes) gain += mode.gain;
    const double step = std::max(machine.encoder_resolution, lattice_step(y, machine.encoder_resolution));
    const double rounding = 6 * machine.noise_rms + 2 * step;
    const double acceleration = 2 * gain * largest(m.thrust);
    const double swift = rounding + acceleration * machine.sample_time * machine.sample_time; // [m per sample]
    const auto [low, high] = std::minmax_element(y.begin(), y.end());
    std::size_t clipped = 0, held = 0, first = 0;
    for (const auto& stand : stands_of(y, 2)) {
        if (stand.first < 2) continue;
        const bool ends = stand.last + 1 == y.size();
        const double arrival = y[stand.first - 1] - y[stand.first - 2];
        const double before = y[stand.first] - y[stand.first - 1], after = ends ? 0 : y[stand.last + 1] - y[stand.last];
        const bool stops_dead = before * arrival >= 0 && std::abs(arrival) > swift;
        const bool at_end = y[stand.first] == *low || y[stand.first] == *high;
        if (at_end && stops_dead && stand.repeats() >= 3) {
            clipped += stand.repeats() + 1;
            continue;
        }
        // One step makes up for what was missed.
        const bool catches_up =
            before * after > 0 && std::abs(before) > swift && std::abs(after) > 1.5 * std::abs(before);
        const bool there_and_back = before * after < 0 && std::min(std::abs(before), std::abs(after)) > 4 * swift;
        // A body that an impact stops and friction holds does not jump when it goes on.
        const bool jumps = ends || std::abs(after) > swift;
        if (catches_up || there_and_back || (stops_dead && jumps && stand.repeats() >= 7)) {
            if (held == 0) first = stand.first;
            held += stand.repeats();
        }
    }
    if (clipped > 0) {
        refuse(where,
               fmt::format("y stops dead at its end ({} to {} m) in {} samples: it seems clipped, a record within "
                           "the range of the encoder is needed",
                           to_text(*low), to_text(*high), clipped));
    }
    if (held >= 3) {
        refuse(where, fmt::format("y repeats its value in {} samples while the machine moves, first at t = {} s: "
                                  "samples were dropped",
                                  held, to_text(m.drive.t[first])));
    }
    std::size_t jumps = 0;
    for (std::size_t k = 2; k + 1 < y.size(); ++k) {
        const double before = y[k - 1] - y[k - 2], after = y[k + 1] - y[k];
        const double steps = (y[k] - y[k - 1]) / before;
        // From slower motion noise alone makes such a jump now and then.
        if (std::abs(before) > 4 * swift && std::abs(after - before) < 0.2 * std::abs(before) && steps > 1.7 &&
            std::abs(steps - std::round(steps)) < 0.2) {
            if (jumps++ == 0) first = k;
        }
    }
    if (jumps >= 3) {
        refuse(where, fmt::format("y moves by several steps at once in {} places, first at t = {} s, and goes on as "
                                  "before: samples are missing there",
                                  jumps, to_text(m.drive.t[first])));
    }
    const auto bend = [&](std::size_t k) { return y[k - 1] - 2 * y[k] + y[k + 1]; };
    std::vector<double> bends;
    for (std::size_t k = 1; k + 1 < y.size(); ++k) bends.push_back(std::abs(bend(k)));
    const auto middle = bends.begin() + static_cast<std::ptrdiff_t>(bends.size() / 2);
    std::nth_element(bends.begin(), middle, bends.end());
    const double most = 8 * swift + 20 * *middle;
    for (std::size_t k = 3; k + 3 < y.size(); ++k) {
        const double here = bend(k);
        const auto is_about = [&](double part, std::size_t i) {
            return std::abs(bend(i) - part * here) < 0.15 * std::abs(here);
        };
        if (std::abs(here) > most && is_about(-0.5, k - 1) && is_about(-0.5, k + 1) && is_about(0, k - 2) &&
            is_about(0, k + 2)) {
            refuse(where,
                   fmt::format("y jumps by {:.3g} m for the one sample at t = {} s: an outlier of the log, to be "
                               "mended or cut out",
                               here / -2, to_text(m.drive.t[k])));
        }
    }
}

// Thrust cut off in the log. In closed loop the controller's output goes on where u stands at an extreme; a thrust that
// was made for the record may stand there as designed, but not where it comes in arcs, of whatever slope, and breaks off.
void check_thrust(const Measurement& m, const std::vector<double>& output, const std::string& where) {
    const std::vector<double>& u = m.thrust;
    const auto [low, high] = std::minmax_element(u.begin(), u.end());
    const double least = 1e-2 * (*high - *low);
    std::size_t samples = 0, breaks = 0;
    for (const auto& stand : stands_of(u, 4)) {
        if ((u[stand.first] != *low && u[stand.first] != *high) || stand.first < 3) continue;
        if (!output.empty()) {
            const auto [min_output, max_output] =
                std::minmax_element(output.begin() + static_cast<std::ptrdiff_t>(stand.first),
                                    output.begin() + static_cast<std::ptrdiff_t>(stand.last) + 1);
            if (*max_output - *min_output > least) ++breaks;
        } else {
            const double slope = u[stand.first - 1] - u[stand.first - 2];
            const double bend = slope - (u[stand.first - 2] - u[stand.first - 3]);
            const double ratio = std::abs(slope / bend);
            if (ratio > 4 && ratio < 1e4) ++breaks;
        }
        samples += stand.repeats() + 1;
    }
    if (breaks >= (output.empty() ? 3 : 1)) {
        refuse(where,
               fmt::format("u stands at its largest values ({} and {} N) in {} samples and breaks off on the way "
                           "there: it seems clipped; a record below the limit is needed, or the limit in the "
                           "controller",
                           to_text(*low), to_text(*high), samples));
    }
}

// Whether the residual of u comes from when or how finely it was logged, not from another controller: it is no more than
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

// Units and places of the columns in closed loop, by what the controller would have made of r and y.
void check_units(const Measurement& m, const std::vector<double>& output, const std::string& where) {
    const double ratio = rms(output) / rms(m.thrust);
    const double tracking = range_of(m.drive.reference) > 0 ? range_of(m.position()) / range_of(m.drive.reference) : 1;
    if (tracking > 30 || (tracking < 1.0 / 30 && ratio > 3)) {
        refuse(where,
               fmt::format("y moves {} times as far as r: the two seem to be in different units, both must be in "
                           "metres (--scale y=...)",
                           to_text(std::round(tracking * 1e4) / 1e4)));
    }
    if (ratio > 300) {
        refuse(where,
               "the machine's controller on r and y gives a thrust hundreds of times u: y seems to be in another "
               "unit, or u and y in each other's place");
    }
}

void check_controller(const Measurement& m, const std::vector<double>& output, const MachineModel& machine,
                      const std::string& where) {
    const std::vector<double>& excitation = m.drive.excitation;
    const double scale = rms(m.thrust);
    if (rms(excitation) < 1e-4 * scale) return;
    // What is left of u should be an excitation of its own. One that carries the rounding of y was made by a
    // controller of other gains, or the log has another instant or other digits than the controller had.
    const double shared = std::abs(correlation(fine_part(excitation), fine_part(output)));
    if (shared > 0.4 && !differs_by_the_log(m, output, machine)) {
        refuse(where, fmt::format("the machine's controller does not make the recorded u from r and y: the residual is "
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
    std::size_t distinct = 1;
    for (std::size_t k = 1; k < sorted.size(); ++k) {
        const double difference = sorted[k] - sorted[k - 1];
        if (!(difference > least / 4)) continue;
        ++distinct;
        if (step == 0 || difference < step) step = difference;
    }
    // By chance, a value is as near to a multiple as is asked below once in ten times.
    constexpr std::size_t enough = 6;
    if (distinct < enough) return 0;
    const double levels = (sorted.back() - sorted.front()) / step;
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
    const bool closed_loop = machine.in_closed_loop();
    if (closed_loop) m.drive.reference = table["r"].values;
    check_signals(m, machine, where);
    if (!closed_loop) {
        m.drive.u = m.thrust;
        check_position(m, machine, where);
        check_thrust(m, {}, where);
        return m;
    }
    const std::vector<double> output = controller_output(machine, m.drive.reference, m.drive.measured);
    check_units(m, output, where);
    check_position(m, machine, where);
    check_thrust(m, output, where);
    m.drive.excitation.resize(m.size());
    const double rounding = file_rounding * largest(m.thrust);
    for (std::size_t k = 0; k < m.size(); ++k) {
        const double rest = m.thrust[k] - output[k];
        m.drive.excitation[k] = std::abs(rest) < rounding ? 0 : rest;
    }
    check_controller(m, output, machine, where);
    return m;
}

} // namespace tribode
