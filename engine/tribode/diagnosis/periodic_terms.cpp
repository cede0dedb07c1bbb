#include "tribode/base/constants.hpp"
#include "tribode/diagnosis/term_library.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>

namespace tribode {

namespace {

constexpr std::size_t max_samples = 3000; // of the spectrum of errors
constexpr std::size_t max_turns = 400;    // of a period over the span
constexpr int per_turn = 4;               // points of the spectrum, and quarters
constexpr std::size_t least_values = 8;   // of a variable, different ones, over which a wave is sought
constexpr std::size_t max_peaks = 3;

// Periods, of so many that can be told apart.
struct Periods {
    std::vector<double> found;
    std::size_t looked_at = 1;
};

// Of so many intervals of the span: those that hold values, and those of them beside one that does.
struct Visited {
    std::size_t all = 0, beside_another = 0;
};

Visited visited(const std::vector<double>& ascending, std::size_t intervals, double span) {
    Visited made;
    double before = -2; // the last interval that holds a value
    bool is_counted = false;
    for (const double value : ascending) {
        const double last = static_cast<double>(intervals - 1);
        const double here =
            std::min(std::floor((value - ascending.front()) / span * static_cast<double>(intervals)), last);
        if (here == before) continue;
        const bool touches = here == before + 1;
        ++made.all;
        if (touches) made.beside_another += is_counted ? 1 : 2;
        is_counted = touches;
        before = here;
    }
    return made;
}

// The periods that show most in the errors over the values of a variable: from twice its span to a few samples.
Periods periods(const TermLibrary& library, const TermTarget& target, const std::vector<double>& values, double span) {
    const auto& measured = library.model.measured;
    std::size_t output = 0;
    for (std::size_t o = 0; o < measured.size(); ++o) {
        if (target.is_output && measured[o] == target.place) output = o;
    }
    const std::vector<double> errors = library.errors_of(output);
    const std::size_t stride = std::max<std::size_t>(1, errors.size() / max_samples);
    std::vector<double> w, e;
    double mean = 0;
    for (std::size_t k = 0; k < errors.size(); k += stride) {
        if (std::isnan(errors[k])) continue;
        w.push_back(values[k]);
        e.push_back(errors[k]);
        mean += errors[k];
    }
    mean /= static_cast<double>(e.size());
    std::vector<double> ascending = w;
    std::sort(ascending.begin(), ascending.end());
    if (visited(ascending, per_turn * max_turns, span).all < least_values) return {};
    struct Line {
        double power, frequency;
    };
    std::vector<Line> spectrum, peaks;
    const std::size_t most = std::min(w.size() / 4, max_turns), first = per_turn / 2;
    // The angle of each value turns by the same from one frequency to the next.
    std::vector<std::complex<double>> turned, turns;
    for (const double value : w) {
        const double angle = two_pi * value / (per_turn * span);
        turned.push_back(std::polar(1.0, static_cast<double>(first) * angle));
        turns.push_back(std::polar(1.0, angle));
    }
    for (std::size_t n = first; n <= most * per_turn; ++n) {
        const double frequency = static_cast<double>(n) / (per_turn * span);
        // Over levels that lie apart, as those of a staircase, a wave is whatever they are: the variable must pass through
        // it, through neighboring quarters of a turn.
        const Visited quarters = visited(ascending, n, span);
        const bool passes_through = 2 * quarters.beside_another >= quarters.all;
        std::complex<double> sum = 0;
        for (std::size_t k = 0; k < w.size(); ++k) {
            if (passes_through) sum += (e[k] - mean) * turned[k];
            turned[k] *= turns[k];
        }
        spectrum.push_back({std::norm(sum), frequency});
    }
    for (std::size_t n = 1; n + 1 < spectrum.size(); ++n) {
        const double power = spectrum[n].power;
        if (power >= spectrum[n - 1].power && power > spectrum[n + 1].power) peaks.push_back(spectrum[n]);
    }
    std::sort(peaks.begin(), peaks.end(), [](const Line& a, const Line& b) { return a.power > b.power; });
    if (peaks.size() > max_peaks) peaks.resize(max_peaks);
    Periods best{.found = {}, .looked_at = std::max<std::size_t>(1, most)};
    for (const auto& peak : peaks) best.found.push_back(1 / peak.frequency);
    return best;
}

constexpr double widths_beside = 3; // of a peak, that the period may be beside it

// a sin(2 pi w/period) + b cos(2 pi w/period)
SystemTerm wave(const TermLibrary& library, const TermTarget& target, const std::string& name, const std::string& of,
                Term w, SystemTerm::Parameter period, bool is_fitted) {
    const double rms = std::sqrt(0.5);
    SystemTerm made{.name = name, .equation = target.name, .of = of};
    made.parameters = {library.amplitude(target, "a", rms, "1"), library.amplitude(target, "b", rms, "1")};
    (is_fitted ? made.parameters : made.constants).push_back(std::move(period));
    made.amplitudes = 2;
    made.neutral = {0, 0};
    made.apply = [target, w](Equations& equations, const std::vector<Term>& p) {
        const TermArithmetic m{*equations.graph};
        const Term angle = m.divide(m.multiply(m.number(two_pi), w), p[2]);
        const Term added =
            m.add(m.multiply(p[0], m.g.make(Op::sin, angle)), m.multiply(p[1], m.g.make(Op::cos, angle)));
        target.add(equations, added);
        return added;
    };
    return made;
}

// The states of a vibration: q'' = w^2 (drive - q) - 2 damping w q', w = 2 pi frequency.
std::array<Equations::State, 2> vibration(const Equations& equations, const std::string& name, const std::string& unit,
                                          Term drive, Term frequency, Term damping) {
    const TermArithmetic m{*equations.graph};
    const std::string own = free_name(equations, name + "_mode");
    Equations::State q{.name = own, .unit = unit}, rate{.name = own + "_rate"};
    if (!unit.empty()) rate.unit = "(" + unit + ")/s";
    q.symbol = equations.graph->variable(q.name);
    rate.symbol = equations.graph->variable(rate.name);
    const Term w = m.multiply(m.number(two_pi), frequency);
    q.rate = rate.symbol;
    rate.rate = m.subtract(m.multiply(m.multiply(w, w), m.subtract(drive, q.symbol)),
                           m.multiply(m.multiply(m.number(2), damping), m.multiply(w, rate.symbol)));
    return {q, rate};
}

std::vector<SystemTerm::Parameter> parameters_of_mode(SystemTerm::Parameter amplitude, double frequency) {
    return {std::move(amplitude),
            {"frequency", frequency, frequency / 3, 3 * frequency, frequency, "Hz"},
            {"damping", 0.05, 1e-4, 2, 0.1}};
}

// An input u acts as u + gain q, where q vibrates and u drives it; at rest until the record begins, at u or at what that was before.
SystemTerm mode_of_input(const SystemVariable& input, double frequency, std::optional<double> before) {
    SystemTerm made{.name = "resonant_mode", .equation = "input " + input.name};
    made.parameters = parameters_of_mode({.name = "gain", .start = 0.01}, frequency);
    if (!before) made.begins_as = [u = input.symbol](const Equations&) { return u; };
    made.apply = [u = input.symbol, name = input.name, unit = input.unit,
                  start = before.value_or(input.values.front())](Equations& equations, const std::vector<Term>& p) {
        const TermArithmetic m{*equations.graph};
        auto states = vibration(equations, name, unit, u, p[1], p[2]);
        states[0].start = start;
        const Term stand_in = equations.graph->variable("stand_in");
        equations.replace({{u, stand_in}});
        const Term changed = m.add(u, m.multiply(p[0], states[0].symbol));
        equations.replace({{stand_in, changed}});
        equations.states.insert(equations.states.end(), states.begin(), states.end());
        return changed;
    };
    return made;
}

// A body on a spring that acts back on what carries it. With the acceleration f of both as one body, v' = f + ratio (f - a),
// where a is the acceleration of the body on the spring: that of the vibration q which f drives, as far as the spring passes it on,
// and 2 damping/w q' through the damper. Of a mass m1 that carries m2 the ratio is m2/m1. At a ratio of -1 v is the velocity of
// the body on the spring.
SystemTerm mode_that_acts_back(const TermLibrary& library, const TermTarget& target, double frequency) {
    SystemTerm made{.name = "resonant_mode", .equation = target.name};
    made.parameters = parameters_of_mode({.name = "ratio", .start = 0.01, .low = -1, .high = 100}, frequency);
    const auto& state = library.model.equations.states[target.place];
    made.apply = [target, name = state.name](Equations& equations, const std::vector<Term>& p) {
        const TermArithmetic m{*equations.graph};
        const Term f = equations.states[target.place].rate;
        const auto states = vibration(equations, name, target.unit, f, p[1], p[2]);
        equations.states.insert(equations.states.end(), states.begin(), states.end());
        const Term through_damper =
            m.multiply(m.divide(p[2], m.multiply(m.number(two_pi / 2), p[1])), states[1].symbol);
        const Term added = m.multiply(p[0], m.subtract(f, m.add(states[0].symbol, through_damper)));
        target.add(equations, added);
        return added;
    };
    return made;
}

// Whether a state is the velocity of a body.
bool is_velocity(const TermLibrary& library, const TermTarget& target) {
    if (target.is_output || target.is_inner) return false;
    const auto& unit = library.model.equations.states[target.place].unit;
    return !target.velocity.empty() || unit == "m/s" || unit == "rad/s";
}

SystemTerm::Parameter period_of(double period, double span, const std::string& unit) {
    // A peak of the spectrum is period^2/span wide. What a model leaves that is led away by the wave itself may have it some widths beside
    // the wave.
    const double width = period * period / span, tolerance = std::min(0.2 * period, widths_beside * width);
    return {"period", period, period - tolerance, period + tolerance, std::min(0.02 * period, 0.05 * width), unit};
}

} // namespace

void add_periodic(TermLibrary& library) {
    std::vector<double> instants;
    for (std::size_t r = 0; r < library.fit.records().size(); ++r) {
        const auto& t = library.fit.records()[r].t;
        instants.insert(instants.end(), t.begin(), t.begin() + static_cast<std::ptrdiff_t>(library.fit.used()[r]));
    }
    for (const TermTarget& target : library.targets) {
        for (const auto& variable : library.variables) {
            const double span = variable.high - variable.low;
            const bool ripples = variable.name == target.position;
            const auto best = periods(library, target, variable.values, span);
            for (const double period : best.found) {
                library.terms.push_back(wave(library, target, ripples ? "force_ripple" : "periodic", variable.name,
                                             variable.symbol, period_of(period, span, variable.unit), true));
                library.terms.back().looked_at = best.looked_at;
            }
            // A weight that turns with an angle.
            if (ripples && (variable.unit == "rad" || variable.unit.empty())) {
                library.terms.push_back(wave(library, target, "gravity", variable.name, variable.symbol,
                                             {.name = "turn", .start = two_pi, .unit = variable.unit}, false));
            }
        }
        if (!library.model.equations.states.empty() && library.duration > 0) {
            const auto best = periods(library, target, instants, library.duration);
            for (const double period : best.found) {
                const bool force = !target.position.empty();
                library.terms.push_back(wave(library, target, force ? "periodic_disturbance" : "periodic_in_time", "t",
                                             library.model.equations.time, period_of(period, library.duration, "s"),
                                             true));
                library.terms.back().looked_at = best.looked_at;
            }
        }
    }
    if (library.model.equations.states.empty() || !(library.duration > 0)) return;
    const auto best = periods(library, {}, instants, library.duration);
    const auto add = [&](SystemTerm term) {
        term.looked_at = best.looked_at;
        library.terms.push_back(std::move(term));
    };
    for (const double period : best.found) {
        for (const auto& input : library.variables) {
            if (input.state) continue;
            add(mode_of_input(input, 1 / period, {}));
            if (const auto before = library.before(input)) add(mode_of_input(input, 1 / period, before));
        }
        for (const TermTarget& target : library.targets) {
            if (is_velocity(library, target)) add(mode_that_acts_back(library, target, 1 / period));
        }
    }
}

} // namespace tribode
