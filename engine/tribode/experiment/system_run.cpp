#include "tribode/experiment/system_run.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/solver/simulator.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fmt/format.h>
#include <functional>

namespace tribode {

namespace {

constexpr double max_rows = 1e7;

class SystemRecorder final : public Observer {
  public:
    SystemRecorder(const EquationSystem& system, Table& table, const RunControl& control, double from, double to,
                   bool with_jumps)
        : system_(system),
          table_(table),
          control_(control),
          from_(from),
          to_(to),
          outputs_(system.equations().outputs.size()),
          with_jumps_(with_jumps) {
        const auto& whens = system.equations().whens;
        keeps_before_ =
            with_jumps || std::any_of(whens.begin(), whens.end(), [](const auto& when) { return when.stop; });
    }

    void before_instant(const SystemState& state) override {
        if (!keeps_before_) return;
        before_ = state;
        events_before_ = of_guards_->size() + events_.size();
    }

    void after_instant(const SystemState& state) override {
        if (!with_jumps_) return;
        const auto before = system_.discrete(before_), after = system_.discrete(state);
        const bool same = before_.x == state.x && std::equal(before.begin(), before.end(), after.begin()) &&
                          of_guards_->size() + events_.size() == events_before_;
        if (same) return;
        left_limit_of_last_instant();
        output(state);
    }

    // A row, unless the last one is at that time.
    void left_limit_of_last_instant() {
        const auto& times = table_.columns.front().values;
        if (times.empty() || times.back() != before_.t) output(before_);
    }

    void output(const SystemState& state) override {
        if (static_cast<double>(table_.rows()) >= 2 * max_rows) {
            throw InputError(fmt::format("the results have more than {} rows at t = {:.9g} s; output_events gives two "
                                         "for each event and each jump",
                                         2 * max_rows, state.t));
        }
        auto column = table_.columns.begin();
        (column++)->values.push_back(state.t);
        for (const double value : state.x) (column++)->values.push_back(value);
        for (const double value : system_.discrete(state)) (column++)->values.push_back(value);
        system_.outputs(state, outputs_);
        for (const double value : outputs_) (column++)->values.push_back(value);
        if (control_.progress) show_progress(state.t);
    }

    void sampled(ClockId, long, const SystemState& state) override {
        for (const int when : system_.fired_by_sample(state)) {
            events_.emplace_back(of_guards_->size(), Event{state.t, when, 0});
        }
    }

    void follow(const EventLog& of_guards) { of_guards_ = &of_guards; }

    // Those of guards and those of samples, in the order in which they happened.
    EventLog events() const {
        EventLog all;
        auto sampled = events_.begin();
        for (std::size_t i = 0; i <= of_guards_->size(); ++i) {
            for (; sampled != events_.end() && sampled->first == i; ++sampled) all.push_back(sampled->second);
            if (i < of_guards_->size()) all.push_back((*of_guards_)[i]);
        }
        return all;
    }

  private:
    // Once a run takes long.
    void show_progress(double t) const {
        constexpr std::chrono::seconds long_time{1};
        if (std::chrono::steady_clock::now() - began_ < long_time) return;
        constexpr std::size_t parts = 1000;
        const auto done = static_cast<std::size_t>(parts * std::clamp((t - from_) / (to_ - from_), 0.0, 1.0));
        control_.progress(system_.equations().name, done, parts);
    }

    const EquationSystem& system_;
    Table& table_;
    const RunControl& control_;
    const double from_, to_; // of the run [s]
    const std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();
    std::vector<double> outputs_;
    const bool with_jumps_;
    bool keeps_before_ = false;
    SystemState before_; // of the last instant, where it is kept
    std::size_t events_before_ = 0;
    const EventLog* of_guards_ = nullptr;
    std::vector<std::pair<std::size_t, Event>> events_; // of samples, each behind so many of guards
};

Table empty_table(const Equations& equations) {
    Table table;
    table.add("t", "s", {});
    for (const auto& state : equations.states) table.add(state.name, state.unit, {});
    for (const auto& discrete : equations.discrete) table.add(discrete.name, discrete.unit, {});
    for (const auto& output : equations.outputs) table.add(output.name, output.unit, {});
    return table;
}

// Takes the columns of derivatives out of the table.
std::vector<SystemSensitivity> take_sensitivities(Table& table, const Equations& equations) {
    std::vector<SystemSensitivity> list;
    const std::size_t discrete = 1 + equations.states.size(), outputs = discrete + equations.discrete.size();
    for (const auto& by : equations.sensitivities) {
        Table& own = list.emplace_back(SystemSensitivity{by.name, {}}).table;
        const auto take = [&](const std::string& name, std::size_t column) {
            own.add(name, "", std::move(table.columns[column].values));
        };
        for (std::size_t i = 0; i < equations.own_states(); ++i) take(equations.states[i].name, 1 + by.states + i);
        for (const auto& [of, place] : by.discrete) take(equations.discrete[of].name, discrete + place);
        for (std::size_t i = 0; i < equations.own_outputs(); ++i) {
            take(equations.outputs[i].name, outputs + by.outputs + i);
        }
    }
    const auto erase = [&](std::size_t from, std::size_t to) {
        table.columns.erase(table.columns.begin() + static_cast<std::ptrdiff_t>(from),
                            table.columns.begin() + static_cast<std::ptrdiff_t>(to));
    };
    erase(outputs + equations.own_outputs(), outputs + equations.outputs.size());
    erase(discrete + equations.own_discrete(), outputs);
    erase(1 + equations.own_states(), discrete);
    return list;
}

// Of the tables in a term that have no values everywhere, where they have.
std::string limits_of_tables(const Equations& equations, Term root) {
    std::string text;
    for (const Term term : equations.graph->reachable(std::span(&root, 1))) {
        if ((*equations.graph)[term].op != Op::lookup) continue;
        const auto& table = *equations.graph->table_of(term);
        for (int variable = 0; variable < table.variables(); ++variable) {
            const auto [low, high] = table.domain(variable);
            if (!std::isfinite(low)) continue;
            const std::string in = table.variables() == 1 ? "" : variable == 0 ? " in x" : " in y";
            text += fmt::format("; {} has values from {} to {}{}", table.name(), to_text(low), to_text(high), in);
        }
    }
    return text;
}

// From the start in steps, and the end.
std::vector<double> grid_of(double start, double end, const SystemRunOptions& options) {
    const double duration = end - start;
    const double step = options.output_step > 0 ? options.output_step : duration / 1000;
    const double count = std::floor(duration / step * (1 + 1e-12));
    if (!(count < max_rows)) {
        throw InputError(fmt::format("{} s in steps of {} s are more than {} rows", duration, step, max_rows));
    }
    std::vector<double> grid;
    for (double k = 0; k <= count; ++k) grid.push_back(std::min(start + k * step, end));
    if (end - grid.back() > std::max(1e-12 * duration, 1e-15 * end)) {
        grid.push_back(end);
    } else {
        grid.back() = end;
    }
    return grid;
}

} // namespace

void SystemRunOptions::check(const FieldReader& fields) const {
    if (duration && end) fields.fail("duration_s", "and end_time_s say both when the run ends, must be one of the two");
    if (!duration && !end) fields.fail("duration_s", "is missing (a number in s)");
    if (end && !(*end > start)) {
        fields.fail("end_time_s",
                    fmt::format("= {} s, must be after the start at {} s", to_text(*end), to_text(start)));
    }
    if (!fields.has("output_times_s")) return;
    if (fields.has("output_step_s")) fields.fail("output_times_s", "and output_step_s are both there, must be one");
    if (output_times.empty()) fields.fail("output_times_s", "is empty, must have a time");
    const auto bad = std::adjacent_find(output_times.begin(), output_times.end(), std::greater_equal<>());
    if (bad == output_times.end()) return;
    fields.fail("output_times_s", fmt::format("has {} behind {}, must increase", to_text(bad[1]), to_text(*bad)));
}

SystemRun run_system(const EquationSystem& system, const SystemRunOptions& options, const RunControl& control) {
    SystemRun result;
    result.table = empty_table(system.equations());
    result.method = resolved(options.solver.method, system);
    if (!system.equations().sensitivities.empty() && has_fixed_step(result.method)) {
        throw InputError(
            fmt::format("solver \"{}\" gives no sensitivities, because a fixed step locates no events; must "
                        "be auto, exact, erk, adams, bdf or ida",
                        name_of(result.method)));
    }
    SystemState start = options.resume ? system.restored(options.resume->system) : system.initial_state(options.start);
    const double begin = start.t, end = options.end.value_or(begin + options.duration.value_or(0));
    if (!(end > begin)) {
        throw InputError(
            fmt::format("the run is to end at t = {:.9g} s, must be after its start at t = {:.9g} s", end, begin));
    }
    // What lies within a step and outside all conditions, a short bump of an input for one, only shorter steps can see.
    constexpr double max_step_part = 1.0 / 50;
    SolverOptions solver = options.solver;
    // One that had been found stiff goes on as such.
    const auto before = options.resume ? std::optional(method_named(options.resume->method)) : std::nullopt;
    const bool was_stiff = before == Method::bdf;
    if (solver.method == Method::automatic && result.method == Method::erk && was_stiff) {
        solver.method = result.method = Method::bdf;
    }
    if (solver.max_step == 0) solver.max_step = max_step_part * (end - begin);
    Simulator run(system, solver, std::move(start), control);
    if (before == result.method) run.propose_step(options.resume->step);
    SystemRecorder recorder(system, result.table, control, begin, end, options.output_jumps);
    recorder.follow(run.events());
    run.observe(&recorder);
    for (const double t : options.output_times) {
        if (t >= begin && t <= end) continue;
        throw InputError(
            fmt::format("a row is to be at t = {} s, must be between the start at {} s and the end at {} s", to_text(t),
                        to_text(begin), to_text(end)));
    }
    run.set_output_grid(options.output_times.empty() ? grid_of(begin, end, options) : options.output_times);
    result.outcome = run.advance_to(end);
    result.statistics = run.statistics();

    result.events = recorder.events();
    if (result.outcome.end == RunEnd::stopped) {
        recorder.left_limit_of_last_instant();
        const auto last = std::find_if(result.events.rbegin(), result.events.rend(), [&](const Event& event) {
            return system.equations().whens[static_cast<std::size_t>(event.subject)].stop;
        });
        if (last != result.events.rend()) result.ended_by = static_cast<std::size_t>(last->subject);
    }
    result.sensitivities = take_sensitivities(result.table, system.equations());
    result.final_states = run.state().x;
    result.final_states.resize(system.equations().own_states());
    const auto discrete = system.discrete(run.state()).first(system.equations().own_discrete());
    result.final_discrete.assign(discrete.begin(), discrete.end());
    result.stiff_from = run.stiff_from();
    const Method method = result.stiff_from ? Method::bdf : result.method;
    result.state = {system.snapshot(run.state()), options.fingerprint, name_of(method), run.proposed_step()};

    if (const auto& culprit = result.outcome.not_finite) {
        const auto& state = system.equations().states[culprit->state];
        result.outcome.message = fmt::format(
            "{} is not a finite number at t = {:.9g} s; the last good state is that of t = {:.9g} s{}",
            state.equation_text(), culprit->t, result.outcome.t, limits_of_tables(system.equations(), state.rate));
    }
    return result;
}

} // namespace tribode
