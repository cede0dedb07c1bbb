#include "tribode/experiment/comparison.hpp"
#include "tribode/analysis/sine_fit.hpp"
#include "tribode/analysis/spectrum.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/csv.hpp"
#include "tribode/solver/fixed_step_integrator.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <ctime>
#include <fmt/format.h>
#include <limits>
#include <map>
#include <numbers>
#include <set>

namespace tribode {

namespace {

double processor_seconds() {
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// ---- the methods -------------------------------------------------------------------------------------------------

std::string step_text(double seconds) { return fmt::format("{:.4g} us", seconds * 1e6); }

// Collocation where it says something that the exact solution does not.
std::vector<MethodResult> methods_of(const MachineModel& machine, const ServoSystem& system,
                                     const ComparisonOptions& options) {
    std::vector<MethodResult> methods;
    const bool nearly_affine = resolved(Method::automatic, system, Purpose::search) == Method::collocation;
    for (const Method method : {Method::collocation, Method::erk, Method::adams, Method::bdf}) {
        if (method == Method::collocation && !nearly_affine) continue;
        for (const double tolerance : options.tolerances) {
            MethodResult m;
            m.solver = {.method = method, .relative_tolerance = tolerance, .absolute_tolerance = 1e-3 * tolerance};
            m.name = fmt::format("{} {}", name_of(method), to_text(tolerance));
            methods.push_back(std::move(m));
        }
    }
    for (const Method method : {Method::fixed, Method::euler, Method::semi_implicit_euler, Method::zoh}) {
        for (const long n : options.divisions) {
            MethodResult m;
            m.solver = {.method = method, .fixed_step = machine.sample_time / static_cast<double>(n)};
            m.name = fmt::format("{} {}", name_of(method), step_text(m.solver.fixed_step));
            methods.push_back(std::move(m));
        }
    }
    return methods;
}

void run(MethodResult& m, const MachineModel& machine, const DriveRecord& record, std::uint64_t seed,
         const RunControl& control, EventLog& events) {
    RunControl quiet;
    quiet.stop = control.stop;
    const double start = processor_seconds();
    Simulation s = simulate(machine, record, {.solver = m.solver, .seed = seed}, quiet);
    m.seconds = processor_seconds() - start;
    m.outcome = s.outcome;
    m.statistics = s.statistics;
    m.trace = std::move(s.trace);
    events = std::move(s.events);
    if (m.outcome.end == RunEnd::interrupted) throw EndedEarly(m.outcome.message);
}

// ---- beside the reference ----------------------------------------------------------------------------------------

void compare_positions(MethodResult& m, const ServoTrace& exact) {
    double sum = 0;
    const std::size_t count = m.trace.x.size();
    for (std::size_t k = 0; k < count; ++k) {
        const double difference = std::abs(m.trace.x[k] - exact.x[k]);
        m.max_difference = std::max(m.max_difference, difference);
        sum += difference * difference;
    }
    m.rms_difference = count ? std::sqrt(sum / static_cast<double>(count)) : 0;
    double size = 0;
    for (const double x : exact.x) size = std::max(size, std::abs(x));
    m.diverged = !m.outcome.ok() || m.max_difference > 10 * size;
}

// Each event of the reference takes the earliest one of its element and kind within reach that is not taken yet.
void compare_events(MethodResult& m, const EventLog& exact, const EventLog& own, double window) {
    std::map<std::pair<int, int>, std::vector<double>> times;
    for (const auto& event : own) times[{event.subject, event.kind}].push_back(event.t);
    std::map<std::pair<int, int>, std::size_t> next;
    for (const auto& event : exact) {
        const auto& list = times[{event.subject, event.kind}];
        std::size_t& at = next[{event.subject, event.kind}];
        while (at < list.size() && list[at] < event.t - window) ++at;
        if (at < list.size() && list[at] <= event.t + window) {
            ++m.events_found;
            ++at;
        }
    }
    m.events_missed = static_cast<long>(exact.size()) - m.events_found;
    m.events_extra = static_cast<long>(own.size()) - m.events_found;
}

// Where one sine makes up four fifths of the input's power: its frequency, from a least-squares search.
std::optional<double> strongest_frequency(const DriveRecord& record, double ts) {
    const auto varies = [](const std::vector<double>& v) {
        return !v.empty() && *std::max_element(v.begin(), v.end()) > *std::min_element(v.begin(), v.end());
    };
    const std::vector<double>& input = !record.u.empty()           ? record.u
                                       : varies(record.excitation) ? record.excitation
                                                                   : record.reference;
    if (!varies(input) || input.size() < 50) return std::nullopt;
    const double length = static_cast<double>(input.size()) * ts;
    // From two periods in the record on: a single step looks much like one period of a square wave. The spectrum says
    // where to look, and the least rest of a sine where it is: leakage moves a line of few periods.
    const auto line = strongest_line(input, ts, 2 / length, 0.2 / ts);
    if (!line) return std::nullopt;
    const auto rest = [&](double f) { return fit_sine(input, ts, f, 0).residual_rms; };
    const double reach = 1 / (3 * length);
    double low = *line - reach, high = *line + reach;
    for (int round = 0; round < 60; ++round) {
        const double a = low + 0.382 * (high - low), b = low + 0.618 * (high - low);
        (rest(a) < rest(b) ? high : low) = rest(a) < rest(b) ? b : a;
    }
    double mean = 0, square = 0;
    for (const double u : input) mean += u / static_cast<double>(input.size());
    for (const double u : input) square += (u - mean) * (u - mean) / static_cast<double>(input.size());
    const double frequency = 0.5 * (low + high);
    const double left = rest(frequency);
    return left * left < 0.2 * square ? std::optional(frequency) : std::nullopt;
}

void compare_phasors(MethodResult& m, const ServoTrace& exact, double frequency, double ts) {
    if (m.diverged) return;
    // The second half, over whole periods.
    const std::size_t half = exact.x.size() / 2;
    const long periods = periods_within(exact.x.size() - half, ts, frequency);
    if (periods < 1) return;
    const Window window = whole_periods(half, periods, ts, frequency);
    const auto phasor = [&](const std::vector<double>& x) { // an axis in open loop drifts
        return fit_sine(std::span(x).subspan(window.first, std::min(window.count, x.size() - window.first)), ts,
                        frequency, static_cast<double>(window.first) * ts, 3, Drift::linear)
            .fundamental();
    };
    const std::complex<double> ratio = phasor(m.trace.x) / phasor(exact.x);
    m.gain_error = std::abs(ratio) - 1;
    m.phase_error_deg = std::arg(ratio) * 180 / std::numbers::pi;
}

// ---- stability of the fixed-step methods -------------------------------------------------------------------------

// The matrix that one step of the method multiplies the state by, for the plant with a spring of this stiffness at the
// driven point, which takes the place of the friction.
Eigen::MatrixXd step_matrix(const ServoPlant& plant, Method method, double h, double stiffness) {
    const auto n = static_cast<Eigen::Index>(plant.states().size());
    Eigen::MatrixXd linear = Eigen::MatrixXd::Zero(n, n);
    plant.linear_part({linear.data(), static_cast<std::size_t>(n * n)});
    // A force at the driven point enters as the thrust does: x'' gains of driven point and modes.
    Eigen::VectorXd force = Eigen::VectorXd::Zero(n);
    force[1] = plant.driven_gain();
    for (std::size_t j = 0; j < plant.parameters().modes.size(); ++j) {
        force[static_cast<Eigen::Index>(2 * j + 3)] = plant.parameters().modes[j].gain;
    }
    Eigen::MatrixXd all = linear;
    all.col(0) -= stiffness * force;
    const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(n, n), a = all * h;
    switch (method) {
    case Method::euler: return one + a;
    case Method::semi_implicit_euler: {
        Eigen::MatrixXd step = one + a;
        for (Eigen::Index i = 0; i < n; ++i) {
            const auto rate = plant.states()[static_cast<std::size_t>(i)].rate;
            if (!rate) continue;
            step.row(i) = one.row(i) + h * step.row(static_cast<Eigen::Index>(*rate));
        }
        return step;
    }
    case Method::zoh: {
        const std::vector<double> l(linear.data(), linear.data() + n * n);
        const std::vector<double> psi = integral_of_exponential(l, static_cast<std::size_t>(n), h);
        return one + Eigen::Map<const Eigen::MatrixXd>(psi.data(), n, n) * all;
    }
    default: return one + a * (one + a / 2 * (one + a / 3 * (one + a / 4)));
    }
}

// The stiffness above which the method blows a motion up more than twofold a second; zero where it does so without any.
// Steps are cut at the instants of the machine's clocks, so the steps of one sample time are taken together.
double largest_stable_stiffness(const ServoSystem& system, Method method, double h) {
    const ServoPlant& plant = system.plant();
    const double ts = system.sample_time();
    std::set<double> instants = {0.0, ts};
    for (const auto& clock : system.clocks()) instants.insert(clock.offset);
    const auto growth = [&](double stiffness) {
        Eigen::MatrixXd sample = Eigen::MatrixXd::Identity(static_cast<Eigen::Index>(plant.states().size()),
                                                           static_cast<Eigen::Index>(plant.states().size()));
        for (auto next = std::next(instants.begin()); next != instants.end(); ++next) {
            const double length = *next - *std::prev(next);
            const double whole = std::floor(length / h * (1 + 1e-9)), rest = length - whole * h;
            const Eigen::MatrixXd step = step_matrix(plant, method, h, stiffness);
            for (double n = 0; n < whole; ++n) sample = step * sample;
            if (rest > 1e-9 * h) sample = step_matrix(plant, method, rest, stiffness) * sample;
        }
        return sample.eigenvalues().cwiseAbs().maxCoeff();
    };
    const double limit = std::exp2(ts) * (1 + 1e-6); // a free mass has the eigenvalue 1 twice, which rounding splits
    double low = 1.0, high = 1e12;
    if (growth(low) > limit) return 0;
    if (growth(high) <= limit) return std::numeric_limits<double>::infinity();
    for (int round = 0; round < 40; ++round) {
        const double middle = std::sqrt(low * high);
        (growth(middle) <= limit ? low : high) = middle;
    }
    return low;
}

} // namespace

Comparison compare(const MachineModel& machine, const DriveRecord& record, const ComparisonOptions& options,
                   const RunControl& control) {
    const double ts = machine.sample_time;
    const ServoSystem system(machine, OpenLoop{});
    Comparison result;
    const auto reason = system.why_not_affine();
    result.exact.solver = {
        .method = resolved(Method::automatic, system), .relative_tolerance = 1e-12, .absolute_tolerance = 1e-15};
    result.exact.name = reason ? "erk 1e-12" : "exact";
    result.reference = reason ? fmt::format("erk at 1e-12, because {}", *reason) : "exact";
    const ServoPlant::Parameters plant = machine.axis().plant;
    for (const auto& element : plant.rolling.elements()) result.friction_stiffness += element.stiffness;
    result.excitation_hz = strongest_frequency(record, ts);

    EventLog exact_events, events;
    run(result.exact, machine, record, options.seed, control, exact_events);
    if (!result.exact.outcome.ok()) throw EndedEarly("the reference ended early: " + result.exact.outcome.message);
    result.exact.events_found = static_cast<long>(exact_events.size());

    // One after another on one thread: their processor times are to be compared.
    result.methods = methods_of(machine, system, options);
    for (std::size_t i = 0; i < result.methods.size(); ++i) {
        MethodResult& m = result.methods[i];
        run(m, machine, record, options.seed, control, events);
        compare_positions(m, result.exact.trace);
        compare_events(m, exact_events, events, ts);
        if (result.excitation_hz) compare_phasors(m, result.exact.trace, *result.excitation_hz, ts);
        if (has_fixed_step(m.solver.method)) {
            m.stable_stiffness = largest_stable_stiffness(system, m.solver.method, m.solver.fixed_step);
        }
        if (control.progress) control.progress("methods", i + 1, result.methods.size());
    }
    return result;
}

std::vector<const MethodResult*> Comparison::all() const {
    std::vector<const MethodResult*> list = {&exact};
    for (const auto& m : methods) list.push_back(&m);
    return list;
}

Table Comparison::table() const {
    Table table;
    const auto column = [&](const std::string& name, const std::string& unit, auto value) {
        std::vector<double> values;
        for (const MethodResult* m : all()) values.push_back(value(*m));
        table.add(name, unit, std::move(values));
    };
    constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
    const auto fixed = [](const MethodResult& m) { return has_fixed_step(m.solver.method); };
    column("tolerance", "", [&](const MethodResult& m) {
        return fixed(m) || m.solver.method == Method::exact ? unknown : m.solver.relative_tolerance;
    });
    column("step_s", "s", [&](const MethodResult& m) { return fixed(m) ? m.solver.fixed_step : unknown; });
    column("completed", "", [](const MethodResult& m) { return m.outcome.ok() ? 1.0 : 0.0; });
    column("max_difference_m", "m", [](const MethodResult& m) { return m.max_difference; });
    column("rms_difference_m", "m", [](const MethodResult& m) { return m.rms_difference; });
    column("events_found", "", [](const MethodResult& m) { return static_cast<double>(m.events_found); });
    column("events_missed", "", [](const MethodResult& m) { return static_cast<double>(m.events_missed); });
    column("events_extra", "", [](const MethodResult& m) { return static_cast<double>(m.events_extra); });
    column("gain_error", "", [&](const MethodResult& m) { return m.gain_error.value_or(unknown); });
    column("phase_error_deg", "deg", [&](const MethodResult& m) { return m.phase_error_deg.value_or(unknown); });
    column("stable_stiffness_N_per_m", "N/m",
           [&](const MethodResult& m) { return m.stable_stiffness.value_or(unknown); });
    column("derivative_evaluations", "",
           [](const MethodResult& m) { return static_cast<double>(m.statistics.derivative_evaluations); });
    column("steps", "", [](const MethodResult& m) { return static_cast<double>(m.statistics.steps); });
    return table;
}

Json Comparison::json() const {
    Json json{{"findings", findings()}, {"reference", reference}};
    if (excitation_hz) json["excitation_hz"] = *excitation_hz;
    json["methods"] = Json::array();
    for (const auto& m : methods) {
        Json method{{"name", m.name},
                    {"ok", m.outcome.ok()},
                    {"diverged", m.diverged},
                    {"max_difference", m.max_difference},
                    {"rms_difference", m.rms_difference},
                    {"events_found", m.events_found},
                    {"events_missed", m.events_missed},
                    {"events_extra", m.events_extra},
                    {"derivative_evaluations", m.statistics.derivative_evaluations},
                    {"steps", m.statistics.steps},
                    {"seconds", m.seconds}};
        const auto put = [&](const char* name, const std::optional<double>& value) {
            if (value) method[name] = *value;
        };
        put("gain_error", m.gain_error);
        put("phase_error_deg", m.phase_error_deg);
        put("stable_stiffness", m.stable_stiffness);
        json["methods"].push_back(std::move(method));
    }
    return json;
}

std::string Comparison::text() const {
    std::string text = fmt::format("{:<28} {:>12} {:>12} {:>20} {:>12} {:>12}\n", "method", "max diff [m]",
                                   "rms diff [m]", "events found/miss/+", "rhs/sample", "us/sample");
    const auto line = [&](const MethodResult& m) {
        const double samples = static_cast<double>(std::max<std::size_t>(m.trace.t.size(), 1));
        text +=
            fmt::format("{:<28} {:>12.3g} {:>12.3g} {:>20} {:>12.1f} {:>12.3f}{}\n", m.name, m.max_difference,
                        m.rms_difference, fmt::format("{}/{}/{}", m.events_found, m.events_missed, m.events_extra),
                        static_cast<double>(m.statistics.derivative_evaluations) / samples, m.seconds / samples * 1e6,
                        !m.outcome.ok() ? "  ended early"
                        : m.diverged    ? "  diverged"
                                        : "");
    };
    for (const MethodResult* m : all()) line(*m);
    return text;
}

std::vector<std::string> Comparison::findings() const {
    std::vector<std::string> texts;
    for (const auto& m : methods) {
        if (!has_fixed_step(m.solver.method)) continue;
        const double h = m.solver.fixed_step;
        if (!m.outcome.ok()) {
            texts.push_back(fmt::format("{} ends early: {}.", m.name, m.outcome.message));
        } else if (m.diverged) {
            texts.push_back(fmt::format("{} diverges: its position goes {} astray.", m.name,
                                        format_quantity(m.max_difference, "m", 2)));
        }
        if (m.stable_stiffness && *m.stable_stiffness == 0) {
            texts.push_back(fmt::format("{} is unstable for this machine even without friction.", m.name));
        } else if (m.stable_stiffness && *m.stable_stiffness < friction_stiffness) {
            texts.push_back(fmt::format(
                "{} is unstable above a stiffness of {} at the driven point; all friction elements in stick "
                "have {}.",
                m.name, format_quantity(*m.stable_stiffness, "N/m", 3), format_quantity(friction_stiffness, "N/m", 3)));
        }
        if (m.events_missed + m.events_extra > 0 && !m.diverged) {
            texts.push_back(fmt::format("{} misses {} of {} stick-slip transitions and has {} that do not exist: it "
                                        "looks at the friction every {} only.",
                                        m.name, m.events_missed, exact.events_found, m.events_extra, step_text(h)));
        }
        if (m.phase_error_deg && excitation_hz && std::abs(*m.phase_error_deg) > 0.01) {
            const double delay = -*m.phase_error_deg / (360 * *excitation_hz);
            texts.push_back(
                fmt::format("{} turns the position at {:.4g} Hz by {:+.3f} deg, as a delay of {:+.1f} us or "
                            "{:+.2f} steps would, and changes its gain by {:+.3f} %.",
                            m.name, *excitation_hz, *m.phase_error_deg, delay * 1e6, delay / h, *m.gain_error * 100));
        }
    }
    return texts;
}

// ---- files -------------------------------------------------------------------------------------------------------

namespace {

// The names are texts, which a table of numbers does not hold; they stand in front of its lines.
std::string csv_with_names(const Comparison& comparison, const Table& table) {
    const std::string numbers = to_csv(table);
    const auto methods = comparison.all();
    std::string text = "method,";
    std::size_t row = 0;
    for (std::size_t begin = 0; begin < numbers.size();) {
        const std::size_t end = numbers.find('\n', begin) + 1;
        if (begin > 0) text += methods[row++]->name + ',';
        text.append(numbers, begin, end - begin);
        begin = end;
    }
    return text;
}

// Per family, the coarsest step that stayed in sight of the reference.
std::vector<const MethodResult*> shown(const Comparison& comparison) {
    double size = 0;
    for (const double x : comparison.exact.trace.x) size = std::max(size, std::abs(x));
    std::set<Method> seen;
    std::vector<const MethodResult*> list;
    for (const auto& m : comparison.methods) {
        if (!has_fixed_step(m.solver.method) || m.diverged || m.max_difference > size) continue;
        if (seen.insert(m.solver.method).second) list.push_back(&m);
    }
    return list;
}

std::vector<double> scaled(const std::vector<double>& values, double factor) {
    std::vector<double> result = values;
    for (double& value : result) value *= factor;
    return result;
}

Plot trajectories(const Comparison& c) {
    const auto ms = scaled(c.exact.trace.t, 1e3);
    Panel panel{.x_label = "Time [ms]", .y_label = "Position [um]"};
    panel.series.push_back(
        {.name = c.exact.name, .x = ms, .y = scaled(c.exact.trace.x, 1e6), .color = "#000000", .width = 2.5});
    for (const auto* m : shown(c)) panel.series.push_back({.name = m->name, .x = ms, .y = scaled(m->trace.x, 1e6)});
    return {.title = "True position, method by method", .panels = {panel}};
}

Plot differences(const Comparison& c) {
    const auto ms = scaled(c.exact.trace.t, 1e3);
    const auto series = [&](const MethodResult& m) {
        std::vector<double> difference;
        for (std::size_t k = 0; k < m.trace.x.size(); ++k) {
            difference.push_back(std::abs(m.trace.x[k] - c.exact.trace.x[k]));
        }
        const auto end = ms.begin() + static_cast<std::ptrdiff_t>(difference.size());
        return Series{.name = m.name, .x = {ms.begin(), end}, .y = std::move(difference), .width = 1};
    };
    const std::string label = "Difference to " + c.exact.name + " [m]";
    Panel fixed{.x_label = "", .y_label = label, .y_log = true};
    for (const auto* m : shown(c)) fixed.series.push_back(series(*m));
    Panel variable{.x_label = "Time [ms]", .y_label = label, .y_log = true};
    for (const auto& m : c.methods) {
        if (!has_fixed_step(m.solver.method) && m.solver.relative_tolerance == 1e-6) {
            variable.series.push_back(series(m));
        }
    }
    return {.title = "Difference of the position, fixed steps (above) and variable steps (below)",
            .panels = {fixed, variable}};
}

// The loop around the last reversal but one: where the friction changes fastest.
Plot hysteresis(const Comparison& c) {
    const auto& v = c.exact.trace.v;
    std::vector<std::size_t> reversals;
    for (std::size_t k = 1; k < v.size(); ++k) {
        if (v[k - 1] * v[k] < 0) reversals.push_back(k);
    }
    Panel whole{.x_label = "Position [um]", .y_label = "Friction [N]"};
    Panel close{.x_label = "Position [um]", .y_label = "Friction [N]"};
    const std::size_t begin = reversals.size() >= 3 ? reversals[reversals.size() - 3] : 0;
    const std::size_t center = reversals.size() >= 2 ? reversals[reversals.size() - 2] : v.size() / 2;
    const auto cut = [&](const MethodResult& m, std::size_t from, std::size_t to, double width, const char* color) {
        Series series{.name = m.name, .style = SeriesStyle::line_points, .color = color, .width = width};
        for (std::size_t k = from; k < std::min(to, m.trace.x.size()); ++k) {
            series.x.push_back(m.trace.x[k] * 1e6);
            series.y.push_back(m.trace.f[k]);
        }
        return series;
    };
    const std::size_t reach = std::max<std::size_t>((v.size() - begin) / 40, 10);
    const auto add = [&](const MethodResult& m, double width, const char* color) {
        whole.series.push_back(cut(m, begin, v.size(), width, color));
        whole.series.back().style = SeriesStyle::line;
        close.series.push_back(cut(m, center - std::min(center, reach), center + reach, width, color));
    };
    add(c.exact, 2.5, "#000000");
    for (const auto* m : shown(c)) add(*m, 1.4, "");
    close.legend = "none";
    // The close up keeps to the reference, whatever the others do.
    const auto range = [](const std::vector<double>& values) -> std::optional<Range> {
        const auto [low, high] = std::minmax_element(values.begin(), values.end());
        const double margin = 0.15 * (*high - *low);
        return margin > 0 ? std::optional(Range{*low - margin, *high + margin}) : std::nullopt;
    };
    close.x_range = range(close.series.front().x);
    close.y_range = range(close.series.front().y);
    return {.title = "Friction against position: loop, and close up around a reversal", .panels = {whole, close}};
}

Plot work_precision(const Comparison& c) {
    Panel panel{.x_label = "Processor time per sample [us]",
                .y_label = "rms difference to " + c.exact.name + " [m]",
                .x_log = true,
                .y_log = true};
    const double samples = static_cast<double>(c.exact.trace.t.size());
    std::map<Method, std::size_t> family;
    for (const auto& m : c.methods) {
        if (m.diverged) continue;
        const auto [at, added] = family.emplace(m.solver.method, panel.series.size());
        if (added) panel.series.push_back({.name = name_of(m.solver.method), .style = SeriesStyle::line_points});
        panel.series[at->second].x.push_back(m.seconds / samples * 1e6);
        panel.series[at->second].y.push_back(m.rms_difference);
    }
    // The exact solution has no difference to itself; a line marks its cost.
    double least = INFINITY, most = 0;
    for (const auto& m : c.methods) {
        if (m.diverged || m.rms_difference == 0) continue;
        least = std::min(least, m.rms_difference);
        most = std::max(most, m.rms_difference);
    }
    const double cost = c.exact.seconds / samples * 1e6;
    panel.series.push_back({.name = c.exact.name + " (its cost)",
                            .x = {cost, cost},
                            .y = {least, most},
                            .style = SeriesStyle::dashed,
                            .color = "#000000"});
    return {.title = "Error against cost", .height = 800, .panels = {panel}};
}

} // namespace

void write_comparison(const Comparison& comparison, const MachineModel& machine, RunFolder& folder) {
    folder.write("comparison.csv", csv_with_names(comparison, comparison.table()));
    Table cost;
    std::vector<double> seconds, per_sample;
    for (const MethodResult* m : comparison.all()) {
        seconds.push_back(m->seconds);
        per_sample.push_back(m->seconds / static_cast<double>(std::max<std::size_t>(m->trace.t.size(), 1)) * 1e6);
    }
    cost.add("processor_time_s", "s", seconds);
    cost.add("per_sample_us", "us", per_sample);
    folder.write("cost.csv", csv_with_names(comparison, cost));
    std::string text =
        fmt::format("Reference: {}. {} samples of {} s, {} stick-slip transitions.\n", comparison.reference,
                    comparison.exact.trace.t.size(), to_text(machine.sample_time), comparison.exact.events_found);
    for (const auto& finding : comparison.findings()) text += finding + "\n";
    folder.write("findings.txt", text);
    for (const auto& [name, plot] : {std::pair{"trajectories", trajectories(comparison)},
                                     {"differences", differences(comparison)},
                                     {"hysteresis", hysteresis(comparison)},
                                     {"work_precision", work_precision(comparison)}}) {
        draw_plot(folder.path(name), plot);
        folder.add(std::string(name) + ".png");
        folder.add(std::string(name) + ".svg");
    }
}

} // namespace tribode
