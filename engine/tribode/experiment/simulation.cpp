#include "tribode/experiment/simulation.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/csv.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <bit>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace tribode {

namespace {

const std::vector<std::string> known_columns = {"t", "u", "r", "exc", "y", "x", "v", "f"};

// Position and velocity at the first sample: the line through the first measured positions, over up to 10 samples.
ServoSystem::Start fitted_start(const DriveView& drive, const MachineModel& machine) {
    if (drive.measured.size() < 2) {
        throw InputError("the machine's initial state is \"fitted\", which needs a column y with two samples or more; "
                         "give one or set initial to \"rest\"");
    }
    const auto count = static_cast<Eigen::Index>(std::min<std::size_t>(drive.measured.size(), 10));
    Eigen::MatrixXd lines(count, 2);
    Eigen::VectorXd y(count);
    for (Eigen::Index k = 0; k < count; ++k) {
        // y[k] is the position at t_k - output_delay.
        lines(k, 0) = 1;
        lines(k, 1) = static_cast<double>(k) * machine.sample_time - machine.output_delay;
        y[k] = drive.measured[static_cast<std::size_t>(k)];
    }
    const Eigen::VectorXd fit = lines.colPivHouseholderQr().solve(y);
    const bool moves = std::abs(fit[1]) * machine.sample_time > machine.encoder_resolution;
    return moves ? ServoSystem::Start{fit[0], fit[1]} : ServoSystem::Start{y.mean(), 0.0};
}

// Every column has a value for each instant, all finite.
void require_complete(const DriveView& drive) {
    if (drive.samples == 0)
        throw InputError("the record that drives the machine has no instants, must have one at least");
    const std::pair<const char*, std::span<const double>> columns[] = {
        {"u", drive.u}, {"r", drive.reference}, {"exc", drive.excitation}, {"y", drive.measured}};
    for (const auto& [name, values] : columns) {
        if (values.empty()) continue;
        if (values.size() != drive.samples) {
            throw InputError(fmt::format("the record that drives the machine has {} values of {}, must have {}, one "
                                         "for each instant",
                                         values.size(), name, drive.samples));
        }
        // The exponent of what is infinite or NaN has all bits set, so that one more carries into the highest bit: a
        // loop that the compiler makes wide.
        constexpr std::uint64_t exponent = std::uint64_t{0x7ff} << 52, one = std::uint64_t{1} << 52;
        std::uint64_t carried = 0;
        for (const double x : values) carried |= (std::bit_cast<std::uint64_t>(x) & exponent) + one;
        if (carried >> 63 == 0) continue;
        const auto bad = std::find_if_not(values.begin(), values.end(), [](double x) { return std::isfinite(x); });
        throw InputError(fmt::format("the record that drives the machine has {}[{}] = {}, must be finite", name,
                                     bad - values.begin(), to_text(*bad)));
    }
}

Drive drive_of(const MachineModel& machine, const DriveView& drive, double friction_feedback) {
    const auto last = drive.samples - 1;
    const auto at = [last](std::span<const double> values, long k) {
        return values.empty() ? 0.0 : values[std::min(static_cast<std::size_t>(k), last)];
    };
    if (drive.closed_loop()) {
        return ClosedLoop{[r = drive.reference, exc = drive.excitation, at](long k) {
                              return LoopInput{at(r, k), at(exc, k)};
                          },
                          friction_feedback};
    }
    if (machine.input == InputKind::hold) {
        return OpenLoop{[u = drive.u, at](long k) { return std::array{at(u, k), 0.0, 0.0, 0.0}; }};
    }
    return OpenLoop{[pieces = band_limited({drive.u.begin(), drive.u.end()}), last](long k) {
        return pieces[std::min(static_cast<std::size_t>(k), last)];
    }};
}

} // namespace

bool DriveRecord::is_column(const std::string& name) {
    return std::find(known_columns.begin(), known_columns.end(), name) != known_columns.end();
}

const std::vector<std::string>& DriveRecord::columns() {
    static const std::vector<std::string> names = {"t", "u", "r", "exc", "y"};
    return names;
}

DriveRecord DriveRecord::from_table(Table table, const MachineModel& machine, const std::string& where) {
    for (const auto& column : table.columns) {
        if (!is_column(column.name)) {
            throw InputError(fmt::format("{}: column \"{}\" is not known{}", where, column.name,
                                         suggestion(column.name, known_columns)));
        }
    }
    require_uniform_time(table, machine.sample_time);
    // Taken out of the table: a copy of each column takes as long as the rest of a short call.
    const auto values = [&](const std::string& name) {
        for (auto& column : table.columns) {
            if (column.name == name) return std::move(column.values);
        }
        return std::vector<double>{};
    };
    DriveRecord record;
    record.t = values("t");
    record.reference = values("r");
    record.excitation = values("exc");
    record.measured = values("y");
    const bool has_u = table.find("u") != nullptr;
    const bool has_loop_input = table.find("r") != nullptr || table.find("exc") != nullptr;
    if (!closes_loop(machine, has_u, has_loop_input, record.t.size(), where)) {
        record.u = values("u");
        record.reference.clear();
        record.excitation.clear();
    }
    return record;
}

bool DriveRecord::closes_loop(const MachineModel& machine, bool has_u, bool has_r_or_exc, std::size_t rows,
                              const std::string& where) {
    if (!has_u && !has_r_or_exc) {
        throw InputError(fmt::format("{}: there is no column u (open loop) nor r or exc (closed loop)", where));
    }
    if (rows == 0) throw InputError(fmt::format("{}: there are no rows, must be one at least", where));
    if (has_u && (!has_r_or_exc || !machine.in_closed_loop())) return false;
    if (machine.has_controller()) return true;
    throw InputError(fmt::format("{}: columns r and exc need a controller, and the machine has none; give it one or a "
                                 "column u",
                                 where));
}

DriveRecord DriveRecord::of(GivenRecord record, const RecordOptions& options, const MachineModel& machine) {
    const std::string name = record.name();
    return from_table(std::move(record).read(options, columns(), machine.sample_time), machine, name);
}

Method resolved(Method method, const MachineModel& machine) {
    return resolved(method, ServoSystem(machine, OpenLoop{}));
}

ServoRun driven_run(const MachineModel& machine, const DriveView& drive, ServoRunOptions options,
                    double friction_feedback, const RunControl& control) {
    require_complete(drive);
    if (friction_feedback != 0 && !drive.closed_loop()) {
        throw InputError("friction_feedback belongs to a closed loop, and the input is u, an open loop; give r or exc");
    }
    options.start = machine.initial == InitialKind::fitted ? fitted_start(drive, machine) : ServoSystem::Start{};
    return ServoRun(machine, drive_of(machine, drive, friction_feedback), options, control);
}

Simulation simulate(const MachineModel& machine, const DriveView& drive, const SimulationOptions& options,
                    const RunControl& control, ServoTrace memory) {
    ServoRunOptions run_options{.solver = options.solver, .seed = options.seed};
    for (const auto& name : options.sensitivities) {
        run_options.sensitivities.push_back(servo_direction(machine, name));
        if (machine.initial == InitialKind::fitted && run_options.sensitivities.back().numbers.output_delay != 0) {
            throw InputError(
                fmt::format("sensitivities: a run has no derivative by {}: the start is fitted with it", name));
        }
    }
    ServoRun run = driven_run(machine, drive, run_options, options.friction_feedback, control);
    run.reserve(drive.samples, std::move(memory));
    Simulation result;
    // Progress in a hundred parts: each ends at a sample instant, so the parts do not show in the results.
    const auto last = static_cast<long>(drive.samples) - 1, part = std::max(last / 100, 1L);
    for (long k = 0;; k = std::min(k + part, last)) {
        result.outcome = run.advance_to(k);
        if (control.progress) {
            control.progress("simulate", static_cast<std::size_t>(k), static_cast<std::size_t>(last));
        }
        if (k == last || !result.outcome.ok()) break;
    }
    result.method = run.method();
    result.trace = run.take_trace();
    if (!drive.t.empty()) std::copy_n(drive.t.begin(), result.trace.t.size(), result.trace.t.begin());
    result.events = run.events();
    result.sensitivities = run.sensitivities();
    result.statistics = run.statistics();
    return result;
}

Table to_table(const ServoTrace& trace) {
    Table table;
    table.add("t", "s", trace.t);
    table.add("r", "m", trace.r);
    table.add("u", "N", trace.u);
    table.add("y", "m", trace.y);
    table.add("x", "m", trace.x);
    table.add("v", "m/s", trace.v);
    table.add("f", "N", trace.f);
    return table;
}

std::string to_csv(const EventLog& events) {
    std::string text = "t,element,kind\n";
    for (const auto& event : events) {
        append_text(text, event.t);
        text += fmt::format(",{},{}\n", event.subject, name_of(static_cast<SlipState>(event.kind)));
    }
    return text;
}

std::vector<std::array<double, 4>> band_limited(const std::vector<double>& u) {
    constexpr long reach = 32;
    const long count = static_cast<long>(u.size());
    const auto sample = [&](long k) { return u[static_cast<std::size_t>(std::clamp(k, 0L, count - 1))]; };
    // d/ds of sum u[n] sinc(s - n) at s = k: (-1)^(k-n)/(k-n), under a Hann window.
    static const auto weights = [] {
        std::array<double, reach> all{};
        for (long n = 1; n <= reach; ++n) {
            const double window = 0.5 + 0.5 * std::cos(std::numbers::pi * static_cast<double>(n) / (reach + 1));
            all[static_cast<std::size_t>(n - 1)] = (n % 2 ? 1.0 : -1.0) * window / static_cast<double>(n);
        }
        return all;
    }();
    const auto slope = [&](long k) {
        double sum = 0;
        for (long n = 1; n <= reach; ++n) {
            sum += weights[static_cast<std::size_t>(n - 1)] * (sample(k + n) - sample(k - n));
        }
        return sum;
    };
    std::vector<double> slopes(u.size());
    for (long k = 0; k < count; ++k) slopes[static_cast<std::size_t>(k)] = slope(k);
    std::vector<std::array<double, 4>> pieces(u.size());
    for (std::size_t k = 0; k + 1 < u.size(); ++k) {
        const double rise = u[k + 1] - u[k], from = slopes[k], to = slopes[k + 1];
        pieces[k] = {u[k], from, 3 * rise - 2 * from - to, from + to - 2 * rise};
    }
    if (!u.empty()) pieces.back() = {u.back(), 0, 0, 0};
    return pieces;
}

} // namespace tribode
