#include "tribode/analysis/statistics.hpp"
#include "tribode/diagnosis/term_library.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tribode {

namespace {

using Parameter = SystemTerm::Parameter;
constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double fastest_overflow = 20;    // in a sample: a wall, above which nothing stands that shows
constexpr double no_lag = 0.2;             // of a sample: shorter ones show nowhere, and make the equations stiff
constexpr double least_delay = 0.5;        // of a sample, of an output: shorter ones make the equations stiff
constexpr double as_fast_as_samples = 0.2; // of a sample: the lag of what follows at once

} // namespace

// Above a level a store spills: what is spilt is lost, or falls into another one in part.
void add_overflows(TermLibrary& library) {
    for (const TermTarget& own : library.targets) {
        if (own.is_output || own.is_inner || !own.position.empty()) continue;
        const auto from = std::find_if(library.variables.begin(), library.variables.end(),
                                       [&](const auto& one) { return one.state == own.place; });
        if (from == library.variables.end()) continue;
        const double span = from->high - from->low;
        const double step = library.step;
        if (!(span > 0) || !(step > 0)) continue;
        for (const double share : {0.6, 0.8, 0.95}) {
            const double level = lower_quantile(from->values, share);
            std::vector<double> above;
            for (const double w : from->values) above.push_back(std::max(w - level, 0.0));
            const double rms = rms_of_values(above);
            if (!(rms > 0)) continue;
            Parameter rate = library.amplitude(own, "rate", rms, from->unit);
            rate.low = 0;
            rate.high = fastest_overflow / step;
            const Parameter height{"level", level, from->low, from->high + 0.5 * span, span, from->unit};
            for (const TermTarget& other : library.targets) {
                if (other.is_output || other.is_inner || !other.position.empty() || other.place == own.place) continue;
                Parameter caught = rate;
                caught.name = "caught";
                caught.unit.clear();
                SystemTerm into{.name = "overflow_into",
                                .equation = own.name,
                                .of = from->name + " " + library.model.equations.states[other.place].name};
                into.parameters = {rate, caught, height};
                into.amplitudes = 2;
                into.neutral = {0, 0};
                into.apply = [own, other, w = from->symbol](Equations& equations, const std::vector<Term>& p) {
                    const TermArithmetic m{*equations.graph};
                    const Term spilt = m.positive(m.subtract(w, p[2]));
                    const Term lost = m.negate(m.multiply(p[0], spilt));
                    own.add(equations, lost);
                    other.add(equations, m.multiply(p[1], spilt));
                    return lost;
                };
                library.terms.push_back(std::move(into));
            }
            SystemTerm lost{.name = "overflow", .equation = own.name, .of = from->name};
            lost.parameters = {rate, height};
            lost.apply = [own, w = from->symbol](Equations& equations, const std::vector<Term>& p) {
                const TermArithmetic m{*equations.graph};
                const Term spilt = m.negate(m.multiply(p[0], m.positive(m.subtract(w, p[1]))));
                own.add(equations, spilt);
                return spilt;
            };
            library.terms.push_back(std::move(lost));
        }
    }
}

void add_one_ways(TermLibrary& library, const std::string& equation, double size, const std::string& unit,
                  const std::function<Term(Equations&, const SignalFunction&)>& change) {
    for (const bool forward : {true, false}) {
        SystemTerm made{.name = "one_way", .equation = equation};
        made.parameters = {{forward ? "closed_below" : "closed_above", 0.1, 0, 1, 1},
                           {"level", 0.1 * size, -size, size, size, unit}};
        made.apply = [change, forward](Equations& equations, const std::vector<Term>& p) {
            return change(equations, [&](const TermArithmetic& m, Term d) {
                const Term open =
                    forward ? m.positive(m.subtract(d, p[1])) : m.negate(m.positive(m.negate(m.add(d, p[1]))));
                return m.subtract(d, m.multiply(p[0], m.subtract(d, open)));
            });
        };
        library.terms.push_back(std::move(made));
    }
}

namespace {

// Of a lag or a delay.
double start_of_lag(const TermLibrary& library) { return std::max(2 * library.step, 1e-3 * library.duration); }

// Its least value stands for none.
Parameter lag_time(const TermLibrary& library) {
    const double start = start_of_lag(library);
    return {"time", start, no_lag * library.step, 0.5 * library.duration, start, "s"};
}

// Replaces an input by a function of it, everywhere.
void add_input_path(TermLibrary& library, const SystemVariable& input, const std::string& name,
                    std::vector<Parameter> parameters, std::vector<double> neutral,
                    std::function<Term(const TermArithmetic&, Equations&, Term u, const std::vector<Term>& p)> path,
                    std::vector<Parameter> constants = {}, std::function<Term(const Equations&)> begins_as = {}) {
    SystemTerm made{.name = name, .equation = "input " + input.name};
    made.amplitudes = neutral.size();
    made.parameters = std::move(parameters);
    made.constants = std::move(constants);
    made.neutral = std::move(neutral);
    made.begins_as = std::move(begins_as);
    made.apply = [u = input.symbol, path = std::move(path)](Equations& equations, const std::vector<Term>& p) {
        const TermArithmetic m{*equations.graph};
        const Term stand_in = equations.graph->variable("stand_in");
        equations.replace({{u, stand_in}});
        const Term changed = path(m, equations, u, p);
        equations.replace({{stand_in, changed}});
        return changed;
    };
    library.terms.push_back(std::move(made));
}

// Between two samples of a record, per second.
double fastest_change(const TermLibrary& library, const std::vector<double>& values) {
    double fastest = 0;
    std::size_t begin = 0;
    for (const std::size_t samples : library.fit.used()) {
        for (std::size_t k = begin + 1; k < begin + samples; ++k) {
            fastest = std::max(fastest, std::abs(values[k] - values[k - 1]) / library.step);
        }
        begin += samples;
    }
    return std::isfinite(fastest) ? fastest : 0;
}

// Follows a signal as fast as the samples show, but no faster than the limit, as a valve or the horn of a servo goes from one place to
// another. It begins where the signal does.
struct RateLimit {
    static constexpr double shares[] = {0.5, 0.1, 0.02}; // of the fastest change, to begin with

    Parameter limit;
    std::vector<double> neutral;
    Parameter time;

    RateLimit(const TermLibrary& library, double fastest, double share, const std::string& unit)
        : limit{"limit", share * fastest, 1e-4 * fastest, 1.2 * fastest, share * fastest, per_second(unit)},
          neutral{1.2 * fastest},
          time{.name = "time", .start = as_fast_as_samples * library.step, .unit = "s"} {}

    // The state with its symbol and its rate, for the equations to take.
    static Equations::State follower(const TermArithmetic& m, Term ahead, Equations::State state, Term limit,
                                     Term time) {
        state.symbol = m.g.variable(state.name);
        state.rate = m.clip(m.divide(m.subtract(ahead, state.symbol), time), m.negate(limit), limit);
        return state;
    }
};

void add_input_paths(TermLibrary& library, const SystemVariable& input) {
    const double size = std::max(std::abs(input.low), std::abs(input.high));
    const auto& unit = input.unit;
    add_input_path(library, input, "offset", {{"c", 0.01 * size, -infinity, infinity, size, unit}}, {0},
                   [](const TermArithmetic& m, Equations&, Term u, const auto& p) { return m.add(u, p[0]); });
    add_input_path(library, input, "gain", {{"gain", 1.01, -infinity, infinity, 1}}, {1},
                   [](const TermArithmetic& m, Equations&, Term u, const auto& p) { return m.multiply(u, p[0]); });
    // What a narrow dead zone or a high limit changes says little about a wide or a low one: each is looked for from several.
    for (const double share : {0.03, 0.15, 0.4}) {
        add_input_path(library, input, "dead_zone", {{"width", share * size, 0, size, size, unit}}, {0},
                       [](const TermArithmetic& m, Equations&, Term u, const auto& p) {
                           return m.subtract(u, m.clip(u, m.negate(p[0]), p[0]));
                       });
    }
    for (const double share : {0.9, 0.6, 0.3}) {
        add_input_path(
            library, input, "saturation", {{"limit", share * size, 0.02 * size, 1.2 * size, size, unit}}, {size},
            [](const TermArithmetic& m, Equations&, Term u, const auto& p) { return m.clip(u, m.negate(p[0]), p[0]); });
    }
    // size sign(u) (|u|/size)^exponent: a characteristic that bends. Behind a dead zone, as of a pump or a valve, neither of the two shows
    // alone.
    const SystemTerm::Parameter exponent = {"exponent", 1.05, 0.2, 5, 1},
                                largest = {.name = "size", .start = size, .unit = unit};
    const auto bent = [](const TermArithmetic& m, Term u, Term above, Term power, Term scale) {
        const Term value = m.multiply(scale, m.g.make(Op::power, m.divide(above, scale), power));
        return m.where(m.less(u, m.number(0)), m.negate(value), value);
    };
    add_input_path(
        library, input, "power_law", {exponent}, {1},
        [bent](const TermArithmetic& m, Equations&, Term u, const auto& p) { return bent(m, u, m.abs(u), p[0], p[1]); },
        {largest});
    add_input_path(library, input, "power_law", {{"width", 0.15 * size, 0, size, size, unit}, exponent}, {0, 1},
                   [bent](const TermArithmetic& m, Equations&, Term u, const auto& p) {
                       return bent(m, u, m.positive(m.subtract(m.abs(u), p[0])), p[1], p[2]);
                   },
                   {largest});
    // Forward the gain is one.
    if (input.low < 0 && input.high > 0) {
        add_input_path(library, input, "asymmetric_gain", {{"difference", 0.1, -infinity, infinity, 1}}, {0},
                       [](const TermArithmetic& m, Equations&, Term u, const auto& p) {
                           return m.subtract(u, m.multiply(p[0], m.positive(m.negate(u))));
                       });
    }
    const auto& e = library.model.equations;
    const bool has_rate =
        std::ranges::any_of(e.inputs, [&](const auto& one) { return one.name == rate_name_of(input.name); });
    if ((e.states.empty() && !has_rate) || !(library.duration > 0)) return;
    // A play before what the input drives: it holds its place until the input has moved by the width to either side, and follows
    // as fast as the samples show.
    for (const double share : {0.05, 0.2}) {
        add_input_path(library, input, "play", {{"width", share * size, 0, size, size, unit}}, {0},
                       [name = input.name, unit](const TermArithmetic& m, Equations& equations, Term u, const auto& p) {
                           Equations::State held{.name = name + "_play", .unit = unit};
                           held.symbol = equations.graph->variable(held.name);
                           const Term ahead = m.subtract(u, held.symbol);
                           const Term within = m.clip(ahead, m.negate(p[0]), p[0]);
                           held.rate = m.divide(m.subtract(ahead, within), p[1]);
                           equations.states.push_back(held);
                           return m.subtract(u, within);
                       },
                       {{.name = "time", .start = as_fast_as_samples * library.step, .unit = "s"}});
    }
    if (e.states.empty()) return;
    const double late = start_of_lag(library);
    if (const double fastest = fastest_change(library, input.values); fastest > 0) {
        for (const double share : RateLimit::shares) {
            const RateLimit made(library, fastest, share, unit);
            add_input_path(
                library, input, "rate_limit", {made.limit}, made.neutral,
                [name = input.name, unit, first = input.values.front()](const TermArithmetic& m, Equations& equations,
                                                                        Term u, const auto& p) {
                    equations.states.push_back(RateLimit::follower(
                        m, u, {.name = name + "_limited", .unit = unit, .start = first}, p[0], p[1]));
                    return equations.states.back().symbol;
                },
                {made.time}, [u = input.symbol](const Equations&) { return u; });
        }
    }
    const auto lag_from = [name = input.name, unit](double start) {
        return [name, unit, start](const TermArithmetic& m, Equations& equations, Term u, const auto& p) {
            Equations::State behind{.name = name + "_behind", .unit = unit, .start = start};
            behind.symbol = equations.graph->variable(behind.name);
            behind.rate = m.divide(m.subtract(u, behind.symbol), p[0]);
            equations.states.push_back(behind);
            return behind.symbol;
        };
    };
    const double first = input.values.front();
    add_input_path(library, input, "lag", {lag_time(library)}, {lag_time(library).low}, lag_from(first), {},
                   [u = input.symbol](const Equations&) { return u; });
    add_input_path(
        library, input, "delay", {{"time", late, 0, 0.25 * library.duration, late, "s"}}, {0},
        [](const TermArithmetic& m, Equations&, Term u, const auto& p) { return m.g.make(Op::delay, u, p[0]); });
    const auto before = library.before(input);
    if (!before) return;
    add_input_path(library, input, "lag", {lag_time(library)}, {lag_time(library).low}, lag_from(*before));
    add_input_path(library, input, "delay", {{"time", late, 0, 0.25 * library.duration, late, "s"}}, {0},
                   [time = library.model.equations.time, begin = library.fit.records()[0].t.front(),
                    before = *before](const TermArithmetic& m, Equations&, Term u, const auto& p) {
                       return m.where(m.less(m.subtract(time, p[0]), m.number(begin)), m.number(before),
                                      m.g.make(Op::delay, u, p[0]));
                   });
}

// What a sensor does to what it shows.
void add_output_paths(TermLibrary& library, std::size_t o) {
    const std::size_t place = library.model.measured[o];
    const auto& output = library.model.equations.outputs[place];
    double low = infinity, high = -infinity;
    for (std::size_t r = 0; r < library.fit.records().size(); ++r) {
        for (std::size_t k = 0; k < library.fit.used()[r]; ++k) {
            low = std::min(low, library.fit.records()[r].outputs[o][k]);
            high = std::max(high, library.fit.records()[r].outputs[o][k]);
        }
    }
    const double span = high - low;
    if (!(span > 0)) return;
    const auto add = [&](const std::string& name, const Parameter& parameter, double neutral, auto change) {
        SystemTerm made{.name = name, .equation = "output " + output.name};
        made.parameters = {parameter};
        made.neutral = {neutral};
        made.apply = [place, change](Equations& equations, const std::vector<Term>& p) {
            const TermArithmetic m{*equations.graph};
            Term& value = equations.outputs[place].value;
            value = change(m, value, p[0]);
            return value;
        };
        library.terms.push_back(std::move(made));
    };
    if (library.is_state(output.value)) {
        add("offset", {"c", 0.01 * span, -infinity, infinity, span, output.unit}, 0,
            [](const TermArithmetic& m, Term y, Term p) { return m.add(y, p); });
        add("gain", {"gain", 1.01, -infinity, infinity, 1}, 1,
            [](const TermArithmetic& m, Term y, Term p) { return m.multiply(y, p); });
    }
    // A share of an input that is there at once.
    for (const auto& input : library.variables) {
        const double size = std::max(std::abs(input.low), std::abs(input.high));
        if (input.state || !library.is_state(output.value)) continue;
        SystemTerm made{.name = "feedthrough", .equation = "output " + output.name, .of = input.name};
        made.parameters = {
            {"gain", 0.01 * span / size, -infinity, infinity, span / size, unit_of_quotient(output.unit, input.unit)}};
        made.apply = [place, u = input.symbol](Equations& equations, const std::vector<Term>& p) {
            const TermArithmetic m{*equations.graph};
            Term& value = equations.outputs[place].value;
            value = m.add(value, m.multiply(p[0], u));
            return value;
        };
        library.terms.push_back(std::move(made));
    }
    add("clipping", {"limit", high - 0.05 * span, low, high + 0.05 * span, span, output.unit}, high + 0.05 * span,
        [](const TermArithmetic& m, Term y, Term p) { return m.where(m.less(p, y), p, y); });
    add("clipping", {"lower", low + 0.05 * span, low - 0.05 * span, high, span, output.unit}, low - 0.05 * span,
        [](const TermArithmetic& m, Term y, Term p) { return m.where(m.less(y, p), p, y); });
    if (low < 0 && high > 0) {
        const double size = std::max(-low, high);
        add("saturation", {"limit", 0.95 * size, 0.02 * size, 1.05 * size, size, output.unit}, 1.05 * size,
            [](const TermArithmetic& m, Term y, Term p) { return m.clip(y, m.negate(p), p); });
    }
    const auto first = library.fit.records()[0].first_measured(o);
    if (!library.model.equations.states.empty() && library.duration > 0 && first) {
        SystemTerm made{.name = "lag", .equation = "output " + output.name};
        made.parameters = {lag_time(library)};
        made.neutral = {made.parameters[0].low};
        made.begins_as = [place](const Equations& equations) { return equations.outputs[place].value; };
        made.begins_as_measured = o;
        made.apply = [place, first = *first](Equations& equations, const std::vector<Term>& p) {
            const TermArithmetic m{*equations.graph};
            Equations::Output& shown = equations.outputs[place];
            Equations::State behind{.name = shown.name + "_behind", .unit = shown.unit, .start = first};
            behind.symbol = equations.graph->variable(behind.name);
            behind.rate = m.divide(m.subtract(shown.value, behind.symbol), p[0]);
            equations.states.push_back(behind);
            shown.value = behind.symbol;
            return behind.symbol;
        };
        library.terms.push_back(std::move(made));
    }
    // Of several that one is late shows nowhere else; of a single one the inputs are late as well.
    if (library.model.measured.size() > 1 && !library.model.equations.states.empty() && library.duration > 0 && first) {
        SystemTerm made{.name = "delay", .equation = "output " + output.name};
        const double start = start_of_lag(library), least = least_delay * library.step;
        made.parameters = {{"time", start, least, 0.25 * library.duration, start, "s"}};
        made.neutral = {least};
        made.begins_as = [place](const Equations& equations) { return equations.outputs[place].value; };
        made.begin_so = {0, 2};
        made.apply = [place, first = *first](Equations& equations, const std::vector<Term>& p) {
            // Twice (T^2 s^2 - 6 T s + 12) / (T^2 s^2 + 6 T s + 12), T a half of the time: Pade approximants.
            const TermArithmetic m{*equations.graph};
            const std::string name = equations.outputs[place].name, unit = equations.outputs[place].unit;
            const Term half = m.multiply(m.number(0.5), p[0]);
            for (int section = 0; section < 2; ++section) {
                Term& value = equations.outputs[place].value;
                Equations::State behind{.name = free_name(equations, name + (section == 0 ? "_behind" : "_behind2")),
                                        .unit = unit,
                                        .start = first};
                Equations::State rate{.name = behind.name + "_rate", .unit = per_second(unit)};
                behind.symbol = equations.graph->variable(behind.name);
                rate.symbol = equations.graph->variable(rate.name);
                behind.rate = rate.symbol;
                const Term moved = m.multiply(half, rate.symbol);
                rate.rate = m.divide(m.subtract(m.multiply(m.number(12), m.subtract(value, behind.symbol)),
                                                m.multiply(m.number(6), moved)),
                                     m.multiply(half, half));
                equations.states.push_back(behind);
                equations.states.push_back(rate);
                value = m.subtract(value, moved);
            }
            return equations.outputs[place].value;
        };
        library.terms.push_back(std::move(made));
    }
    // A sensor that does not tell the direction.
    if (low > -0.05 * span) {
        add("magnitude", {"share", 0.1, 0, 1, 1}, 0,
            [](const TermArithmetic& m, Term y, Term p) { return m.add(y, m.multiply(p, m.subtract(m.abs(y), y))); });
    }
}

// What an error of a loop, a deflection or another inner signal goes through.
void add_inner_paths(TermLibrary& library, const SystemModel::InnerSignal& signal) {
    const auto& output = library.model.equations.outputs[signal.output];
    const auto values = library.values_of(output.value);
    double size = 0;
    for (const double value : values) size = std::max(size, std::abs(value));
    if (!(size > 0) || !std::isfinite(size)) return;
    // Of two states it is the deflection of what is between them: a dead zone of that is a backlash.
    const auto node = (*library.model.equations.graph)[signal.term];
    const bool is_deflection = node.op == Op::subtract && library.is_state(node.a) && library.is_state(node.b);
    const auto add = [&](const std::string& name, const Parameter& parameter, double neutral, auto change) {
        SystemTerm made{.name = name, .equation = output.name};
        made.parameters = {parameter};
        made.neutral = {neutral};
        made.apply = [place = signal.output, change](Equations& equations, const std::vector<Term>& p) {
            const TermArithmetic m{*equations.graph};
            const Term changed = change(m, equations.outputs[place].value, p[0]);
            replace_inner(equations, place, changed);
            return changed;
        };
        library.terms.push_back(std::move(made));
    };
    const auto& unit = output.unit;
    // What it drives follows it late, as the current of a coil does the output of a controller.
    if (library.duration > 0) {
        SystemTerm made{.name = "lag", .equation = output.name};
        made.parameters = {lag_time(library)};
        made.neutral = {made.parameters[0].low};
        made.begins_as = [place = signal.output](const Equations& equations) { return equations.outputs[place].value; };
        made.apply = [place = signal.output, first = values.front()](Equations& equations, const std::vector<Term>& p) {
            const TermArithmetic m{*equations.graph};
            const Term ahead = equations.outputs[place].value;
            Equations::State behind{
                .name = free_name(equations, "behind"), .unit = equations.outputs[place].unit, .start = first};
            behind.symbol = equations.graph->variable(behind.name);
            replace_inner(equations, place, behind.symbol);
            behind.rate = m.divide(m.subtract(ahead, behind.symbol), p[0]);
            equations.states.push_back(behind);
            return behind.symbol;
        };
        library.terms.push_back(std::move(made));
    }
    if (const double fastest = library.duration > 0 ? fastest_change(library, values) : 0; fastest > 0) {
        for (const double share : RateLimit::shares) {
            const RateLimit limited(library, fastest, share, unit);
            SystemTerm made{.name = "rate_limit", .equation = output.name};
            made.parameters = {limited.limit};
            made.constants = {limited.time};
            made.neutral = limited.neutral;
            made.begins_as = [place = signal.output](const Equations& equations) {
                return equations.outputs[place].value;
            };
            made.apply = [place = signal.output, first = values.front()](Equations& equations,
                                                                         const std::vector<Term>& p) {
                const TermArithmetic m{*equations.graph};
                const auto& own = equations.outputs[place];
                const Equations::State state = RateLimit::follower(
                    m, own.value, {.name = free_name(equations, "limited"), .unit = own.unit, .start = first}, p[0],
                    p[1]);
                replace_inner(equations, place, state.symbol);
                equations.states.push_back(state);
                return state.symbol;
            };
            library.terms.push_back(std::move(made));
        }
    }
    for (const double share : {0.03, 0.15, 0.4}) {
        add(is_deflection ? "backlash" : "dead_zone", {"width", share * size, 0, size, size, unit}, 0,
            [](const TermArithmetic& m, Term d, Term p) { return m.subtract(d, m.clip(d, m.negate(p), p)); });
    }
    for (const double share : {0.9, 0.6, 0.3}) {
        add("saturation", {"limit", share * size, 0.02 * size, 1.2 * size, size, unit}, 1.2 * size,
            [](const TermArithmetic& m, Term d, Term p) { return m.clip(d, m.negate(p), p); });
    }
    add_one_ways(library, output.name, size, unit,
                 [place = signal.output](Equations& equations, const SignalFunction& of) {
                     const Term changed = of(TermArithmetic{*equations.graph}, equations.outputs[place].value);
                     replace_inner(equations, place, changed);
                     return changed;
                 });
    const double small = 0.01 / (size * size);
    add(is_deflection ? "cubic_stiffness" : "cubic",
        {"a", small, -infinity, infinity, 100 * small, unit.empty() ? "" : "1/(" + unit + ")^2"}, 0,
        [](const TermArithmetic& m, Term d, Term p) {
            return m.add(d, m.multiply(p, m.multiply(d, m.multiply(d, d))));
        });
}

} // namespace

void add_paths(TermLibrary& library) {
    for (const auto& variable : library.variables) {
        if (!variable.state) add_input_paths(library, variable);
    }
    for (std::size_t o = 0; o < library.model.measured.size(); ++o) add_output_paths(library, o);
    for (const auto& signal : library.model.inner) {
        if (signal.kind == SystemModel::InnerSignal::Kind::difference) add_inner_paths(library, signal);
    }
}

} // namespace tribode
