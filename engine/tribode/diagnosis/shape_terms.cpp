#include "tribode/analysis/statistics.hpp"
#include "tribode/diagnosis/term_library.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

using Parameter = SystemTerm::Parameter;

// The friction of a tanh turns over this part of the largest velocity, and over these at least and at most.
constexpr double dry_width = 0.03, min_width = 0.003, max_width = 0.3;
constexpr double stribeck_edge = 5; // of a Stribeck velocity such a part is where friction turns

// A function of variables times an amplitude: its name, its values over the record, and itself in the graph, of the
// parameters behind the amplitude.
struct Shape {
    std::string name;
    std::vector<const SystemVariable*> of;
    std::string unit; // of the function; empty: not known
    std::function<double(std::size_t sample)> value;
    std::function<Term(const TermArithmetic&, const std::vector<Term>& w, const std::vector<Term>& p)> term;
    std::vector<Parameter> parameters = {};
    std::string text = {}; // of what has no name
    bool is_flexible = false;
};

class Shapes {
  public:
    explicit Shapes(TermLibrary& library) : library_(library) {}

    void add_all(bool with_nameless) {
        for (const TermTarget& target : library_.targets) {
            target_ = &target;
            add({physical("constant", ""),
                 {},
                 "1",
                 [](std::size_t) { return 1.0; },
                 [](const TermArithmetic& m, const auto&, const auto&) { return m.number(1); }});
            for (const auto& variable : library_.variables) {
                powers(variable);
                if (changes_sign(variable)) dry_friction(variable);
                if (changes_sign(variable) && variable.state && variable.name == target_->velocity) sticking(variable);
                if (changes_sign(variable) && variable.name == target_->velocity) stribeck(variable);
                if (variable.name == target_->position) local_forces(variable);
                if (target_->is_inner) continue;
                thresholds(variable);
                hysteresis(variable, nullptr);
                bouc_wen(variable);
                memory(variable);
            }
            for (std::size_t i = 0; i < library_.variables.size() && !target_->is_inner; ++i) {
                if (with_nameless) square_above(library_.variables[i]);
                for (std::size_t j = i + 1; j < library_.variables.size(); ++j) {
                    product(library_.variables[i], library_.variables[j]);
                    if (!with_nameless) continue;
                    nameless(library_.variables[i], library_.variables[j]);
                    nameless(library_.variables[j], library_.variables[i]);
                }
            }
            if (!target_->is_inner) load_dependent_friction();
            variable_capacity();
            whole_derivative();
            for (const auto& difference : library_.differences) {
                powers(difference);
                if (changes_sign(difference)) dry_friction(difference);
            }
        }
    }

    void add_curves() {
        for (const TermTarget& target : library_.targets) {
            target_ = &target;
            if (target.is_inner) continue;
            for (const auto& variable : library_.variables) curve(variable);
        }
    }

  private:
    // The name that a term of a force or an acceleration has among effects.
    std::string physical(const std::string& name, const std::string& of) const {
        if (target_->position.empty()) return name;
        if (name == "constant") return "constant_force";
        if (of == target_->velocity) {
            if (name == "linear") return "viscous_friction";
            if (name == "quadratic") return "quadratic_drag";
            if (name == "dry_friction") return "coulomb_friction";
        }
        if (of == target_->position) {
            if (name == "linear") return "spring_force";
            if (name == "cubic") return "cubic_stiffness";
            if (name == "hysteresis") return "presliding_hysteresis";
            if (name == "bouc_wen") return "bouc_wen_friction";
            // Friction has no sign of a position.
            if (name == "dry_friction") return "preloaded_spring";
        }
        return name;
    }

    static double size_of(const SystemVariable& variable) {
        return std::max(std::abs(variable.low), std::abs(variable.high));
    }
    static bool changes_sign(const SystemVariable& variable) {
        const double size = size_of(variable);
        return variable.low < -0.05 * size && variable.high > 0.05 * size;
    }
    static std::string power_of(const std::string& unit, const char* power) {
        return unit.empty() ? "" : fmt::format("({}){}", unit, power);
    }

    void add(Shape shape) {
        std::vector<double> phi(samples());
        for (std::size_t k = 0; k < phi.size(); ++k) phi[k] = shape.value(k);
        const double rms = rms_of_values(phi);
        if (!(rms > 0) || !std::isfinite(rms)) return;
        SystemTerm made{.name = shape.name, .equation = target_->name};
        made.is_flexible = shape.is_flexible;
        std::vector<Term> symbols;
        for (const auto* variable : shape.of) {
            made.of += (made.of.empty() ? "" : " ") + variable->name;
            made.variables.push_back(variable->name);
            symbols.push_back(variable->symbol);
        }
        if (!shape.text.empty()) made.of = shape.text;
        made.parameters = {library_.amplitude(*target_, "a", rms, shape.unit)};
        made.parameters.insert(made.parameters.end(), shape.parameters.begin(), shape.parameters.end());
        made.apply = [target = *target_, symbols, term = shape.term](Equations& equations, const std::vector<Term>& p) {
            const TermArithmetic m{*equations.graph};
            const Term added = m.multiply(p[0], term(m, symbols, {p.begin() + 1, p.end()}));
            target.add(equations, added);
            return added;
        };
        library_.terms.push_back(std::move(made));
    }

    std::size_t samples() const {
        std::size_t count = 0;
        for (const std::size_t used : library_.fit.used()) count += used;
        return count;
    }

    void powers(const SystemVariable& variable) {
        const auto& w = variable.values;
        const auto& unit = variable.unit;
        add({physical("linear", variable.name),
             {&variable},
             unit,
             [&w](std::size_t k) { return w[k]; },
             [](const TermArithmetic&, const auto& x, const auto&) { return x[0]; }});
        add({physical("quadratic", variable.name),
             {&variable},
             power_of(unit, "^2"),
             [&w](std::size_t k) { return w[k] * std::abs(w[k]); },
             [](const TermArithmetic& m, const auto& x, const auto&) { return m.multiply(x[0], m.abs(x[0])); }});
        if (variable.low < 0 && variable.high > 0) {
            add({"square",
                 {&variable},
                 power_of(unit, "^2"),
                 [&w](std::size_t k) { return w[k] * w[k]; },
                 [](const TermArithmetic& m, const auto& x, const auto&) { return m.multiply(x[0], x[0]); }});
        }
        add({physical("cubic", variable.name),
             {&variable},
             power_of(unit, "^3"),
             [&w](std::size_t k) { return w[k] * w[k] * w[k]; },
             [](const TermArithmetic& m, const auto& x, const auto&) {
                 return m.multiply(x[0], m.multiply(x[0], x[0]));
             }});
        // Rounded off at zero, where its slope is infinite.
        add({"square_root",
             {&variable},
             power_of(unit, "^0.5"),
             [&w](std::size_t k) { return std::copysign(std::sqrt(std::abs(w[k])), w[k]); },
             [rest = 1e-6 * size_of(variable)](const TermArithmetic& m, const auto& x, const auto&) {
                 return m.divide(x[0], m.g.make(Op::sqrt, m.add(m.abs(x[0]), m.number(rest))));
             }});
    }

    static Parameter width_of(const SystemVariable& velocity) {
        const double size = size_of(velocity);
        return {"width", dry_width * size, min_width * size, max_width * size, dry_width * size, velocity.unit};
    }

    // Dry friction without its sticking.
    void dry_friction(const SystemVariable& velocity) {
        const double width = width_of(velocity).start;
        add({physical("dry_friction", velocity.name),
             {&velocity},
             "1",
             [&velocity, width](std::size_t k) { return std::tanh(velocity.values[k] / width); },
             [](const TermArithmetic& m, const auto& x, const auto& p) {
                 return m.g.make(Op::tanh, m.divide(x[0], p[0]));
             },
             {width_of(velocity)}});
    }

    // Dry friction that holds the velocity at zero, a force that nature chooses.
    void sticking(const SystemVariable& velocity) {
        const auto& contacts = library_.model.equations.contacts;
        if (std::ranges::find(contacts, velocity.symbol, &Equations::Contact::quantity) != contacts.end()) return;
        SystemTerm made{.name = physical("dry_friction", velocity.name),
                        .equation = target_->name,
                        .of = velocity.name,
                        .variables = {velocity.name}};
        made.parameters = {library_.amplitude(*target_, "level", 1, "1")};
        made.parameters[0].low = 0;
        made.apply = [target = *target_, v = velocity.symbol](Equations& equations, const std::vector<Term>& p) {
            auto& graph = *equations.graph;
            std::string name = "sticking_friction";
            while (free_name(equations, name + ".mode") != name + ".mode") name += "_";
            Equations::Contact contact{
                .name = name, .force = graph.variable(name), .mode = graph.variable(name + ".mode")};
            equations.discrete.push_back({name + ".mode", "", 0, contact.mode, {"stick", "forward", "backward"}});
            contact.quantity = v;
            contact.level = contact.release = p[0];
            const Term added = graph.make(Op::negate, contact.force);
            equations.contacts.push_back(std::move(contact));
            target.add(equations, added);
            return added;
        };
        library_.terms.push_back(std::move(made));
    }

    // What dry friction is larger by near rest [Stribeck 1902], as a share of it or of what holds the velocity there.
    void stribeck(const SystemVariable& velocity) {
        const double size = size_of(velocity);
        const auto& e = library_.model.equations;
        const auto held = std::ranges::find(e.contacts, velocity.symbol, &Equations::Contact::quantity);
        for (const double share : {0.02, 0.1, 0.3}) {
            const double start = share * size;
            SystemTerm made{.name = "stribeck_friction",
                            .equation = target_->name,
                            .of = velocity.name,
                            .variables = {velocity.name}};
            std::vector<double> phi = velocity.values;
            for (double& v : phi) v = std::tanh(stribeck_edge * v / start) * std::exp(-(v / start) * (v / start));
            const double rms = rms_of_values(phi);
            if (!(rms > 0)) continue;
            made.parameters = {library_.amplitude(*target_, "rise", rms, "1"),
                               {"velocity", start, min_width * size, size, start, velocity.unit}};
            if (held != e.contacts.end()) {
                // Then it is a part of that level, whatever the force is multiplied by in the derivative.
                Parameter& rise = made.parameters[0];
                const double level = rms_of_values(library_.values_of(held->level));
                if (level > 0 && std::isfinite(level)) {
                    rise.start = 0.1 * level;
                    rise.scale = level;
                }
                const auto named = std::ranges::find(e.parameters, held->level, &Equations::Parameter::symbol);
                rise.unit = named == e.parameters.end() ? "" : named->unit;
            }
            // Of a measured force the sign is as it was measured.
            if (held != e.contacts.end() || !target_->is_output) made.parameters[0].low = 0;
            made.apply = [target = *target_, v = velocity.symbol](Equations& equations, const std::vector<Term>& p) {
                const TermArithmetic m{*equations.graph};
                const Term ratio = m.divide(v, p[1]),
                           near = m.multiply(p[0], m.g.make(Op::exp, m.negate(m.multiply(ratio, ratio))));
                const auto contact = std::ranges::find(equations.contacts, v, &Equations::Contact::quantity);
                if (contact != equations.contacts.end()) {
                    contact->level = m.add(contact->level, near);
                    contact->release = m.add(contact->release, p[0]);
                    return near;
                }
                const Term added =
                    m.negate(m.multiply(near, m.g.make(Op::tanh, m.multiply(m.number(stribeck_edge), ratio))));
                target.add(equations, added);
                return added;
            };
            library_.terms.push_back(std::move(made));
        }
    }

    // A force about a place, as of a joint of a rail or a magnet: a hill of it, or one toward the place or away from it.
    void local_forces(const SystemVariable& position) {
        const double span = position.high - position.low, width = 0.1 * span;
        const auto& w = position.values;
        for (const double share : {0.1, 0.3, 0.5, 0.7, 0.9}) {
            const double center = position.low + share * span;
            const std::vector<Parameter> parameters = {
                {"center", center, position.low, position.high, width, position.unit},
                {"width", width, 0.1 * width, 10 * width, width, position.unit}};
            const auto hill = [](const TermArithmetic& m, Term ratio) {
                return m.g.make(Op::exp, m.negate(m.multiply(ratio, ratio)));
            };
            const auto ratio = [](const TermArithmetic& m, Term x, const std::vector<Term>& p) {
                return m.divide(m.subtract(x, p[0]), p[1]);
            };
            add({"local_force",
                 {&position},
                 "1",
                 [&w, center, width](std::size_t k) { return std::exp(-std::pow((w[k] - center) / width, 2)); },
                 [hill, ratio](const TermArithmetic& m, const auto& x, const auto& p) {
                     return hill(m, ratio(m, x[0], p));
                 },
                 parameters,
                 {},
                 true});
            add({"detent",
                 {&position},
                 "1",
                 [&w, center, width](std::size_t k) {
                     const double r = (w[k] - center) / width;
                     return r * std::exp(-r * r);
                 },
                 [hill, ratio](const TermArithmetic& m, const auto& x, const auto& p) {
                     const Term r = ratio(m, x[0], p);
                     return m.multiply(r, hill(m, r));
                 },
                 parameters,
                 {},
                 true});
        }
    }

    // Friction that grows with another variable, as a gear's with its load and a seal's with the pressure.
    void load_dependent_friction() {
        for (const auto& velocity : library_.variables) {
            if (velocity.name != target_->velocity || !changes_sign(velocity)) continue;
            const double width = width_of(velocity).start;
            for (const auto& load : library_.variables) {
                if (load.name == target_->velocity || load.name == target_->position || load.name.ends_with("_rate")) {
                    continue;
                }
                add({"load_dependent_friction",
                     {&velocity, &load},
                     load.unit,
                     [&, width](std::size_t k) {
                         return std::tanh(velocity.values[k] / width) * std::abs(load.values[k]);
                     },
                     [](const TermArithmetic& m, const auto& x, const auto& p) {
                         return m.multiply(m.g.make(Op::tanh, m.divide(x[0], p[0])), m.abs(x[1]));
                     },
                     {width_of(velocity)}});
                for (const auto& position : library_.variables) {
                    if (position.name == target_->position) hysteresis(position, &load);
                }
            }
        }
    }

    void thresholds(const SystemVariable& variable) {
        // Of a state, above a level, in its own rate: that is an overflow. Below a level it is what keeps the state above it, as a diode
        // a current; nothing does so with a velocity.
        const bool is_own = variable.state && !target_->is_output && *variable.state == target_->place;
        if (is_own && !target_->position.empty()) return;
        const double span = variable.high - variable.low;
        const auto& w = variable.values;
        // A level above the whole range would make a line of it.
        const double highest = is_own ? lower_quantile(w, 0.75) : variable.high + 0.5 * span;
        for (const double p : {0.5, 0.75, 0.9}) {
            for (const bool above : {true, false}) {
                if (p == 0.5 && !above && !is_own) continue; // the same as from above, beside a linear term
                if (is_own && above) continue;
                const double level = lower_quantile(w, above ? p : 1 - p);
                add({"threshold",
                     {&variable},
                     variable.unit,
                     [&w, level, above](std::size_t k) { return std::max(above ? w[k] - level : level - w[k], 0.0); },
                     [above](const TermArithmetic& m, const auto& x, const auto& q) {
                         return m.positive(above ? m.subtract(x[0], q[0]) : m.subtract(q[0], x[0]));
                     },
                     {{"level", level, variable.low - 0.5 * span, highest, span, variable.unit}}});
            }
        }
    }

    // What a characteristic is beside a straight line, whatever its shape: straight pieces between levels that lie closer together at the
    // ends of the range, where knees are.
    void curve(const SystemVariable& variable) {
        const auto& w = variable.values;
        std::vector<double> sorted = w, levels;
        std::ranges::sort(sorted);
        const double span = variable.high - variable.low, digits = 2 - std::floor(std::log10(span));
        const auto rounded = [ten = std::pow(10, std::abs(digits)),
                              digits](double value) { // to a hundredth of the span or less
            return digits > 0 ? std::round(value * ten) / ten : std::round(value / ten) * ten;
        };
        // Each piece needs samples of its own.
        const auto least = static_cast<std::ptrdiff_t>(std::max<std::size_t>(5, w.size() / 200));
        auto begin = sorted.begin();
        for (const double place : {0.03, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97}) {
            const double level = rounded(variable.low + place * span);
            const auto end = std::ranges::lower_bound(sorted, level);
            if (end - begin < least || sorted.end() - end < least) continue;
            levels.push_back(level);
            begin = end;
        }
        if (levels.size() < 3) return;
        SystemTerm made{
            .name = curve_term, .equation = target_->name, .of = variable.name, .variables = {variable.name}};
        made.is_flexible = true;
        made.amplitudes = levels.size();
        made.neutral.assign(levels.size(), 0);
        for (std::size_t i = 0; i < levels.size(); ++i) {
            std::vector<double> above = w;
            for (double& value : above) value = std::max(value - levels[i], 0.0);
            made.parameters.push_back(
                library_.amplitude(*target_, fmt::format("bend{}", i + 1), rms_of_values(above), variable.unit));
        }
        made.apply = [target = *target_, w = variable.symbol, levels](Equations& equations,
                                                                      const std::vector<Term>& p) {
            const TermArithmetic m{*equations.graph};
            const auto piece = [&](std::size_t i) {
                return m.multiply(p[i], m.positive(m.subtract(w, m.number(levels[i]))));
            };
            Term sum = piece(0);
            for (std::size_t i = 1; i < levels.size(); ++i) sum = m.add(sum, piece(i));
            target.add(equations, sum);
            return sum;
        };
        library_.terms.push_back(std::move(made));
    }

    void product(const SystemVariable& one, const SystemVariable& other) {
        add({"product",
             {&one, &other},
             one.unit.empty() || other.unit.empty() ? "" : fmt::format("({})*({})", one.unit, other.unit),
             [&](std::size_t k) { return one.values[k] * other.values[k]; },
             [](const TermArithmetic& m, const auto& x, const auto&) { return m.multiply(x[0], x[1]); }});
    }

    // A product of a variable with what it exceeds a level by.
    void square_above(const SystemVariable& variable) {
        const double level = lower_quantile(variable.values, 0.5), span = variable.high - variable.low;
        add({.name = nameless_term,
             .of = {&variable},
             .unit = power_of(variable.unit, "^2"),
             .value = [&,
                       level](std::size_t k) { return std::max(variable.values[k] - level, 0.0) * variable.values[k]; },
             .term = [](const TermArithmetic& m, const auto& x,
                        const auto& p) { return m.multiply(m.positive(m.subtract(x[0], p[0])), x[0]); },
             .parameters = {{"level", level, variable.low - 0.5 * span, variable.high + 0.5 * span, span,
                             variable.unit}},
             .text = fmt::format("max({0} - level, 0) {0}", variable.name)});
    }

    // Products of a function of one variable with another one: what a formula is made of where no name fits.
    void nameless(const SystemVariable& one, const SystemVariable& other) {
        const auto unit = [&](const char* power) {
            return one.unit.empty() || other.unit.empty() ? ""
                                                          : fmt::format("({}){}*({})", one.unit, power, other.unit);
        };
        add({.name = nameless_term,
             .of = {&one, &other},
             .unit = unit("^2"),
             .value = [&](std::size_t k) { return one.values[k] * one.values[k] * other.values[k]; },
             .term = [](const TermArithmetic& m, const auto& x,
                        const auto&) { return m.multiply(m.multiply(x[0], x[0]), x[1]); },
             .text = fmt::format("{}^2 {}", one.name, other.name)});
        if (!changes_sign(one)) return;
        add({.name = nameless_term,
             .of = {&one, &other},
             .unit = unit(""),
             .value = [&](std::size_t k) { return std::abs(one.values[k]) * other.values[k]; },
             .term = [](const TermArithmetic& m, const auto& x, const auto&) { return m.multiply(m.abs(x[0]), x[1]); },
             .text = fmt::format("abs({}) {}", one.name, other.name)});
        const double level = lower_quantile(one.values, 0.5), span = one.high - one.low;
        add({.name = nameless_term,
             .of = {&one, &other},
             .unit = unit(""),
             .value = [&, level](std::size_t k) { return std::max(one.values[k] - level, 0.0) * other.values[k]; },
             .term = [](const TermArithmetic& m, const auto& x,
                        const auto& p) { return m.multiply(m.positive(m.subtract(x[0], p[0])), x[1]); },
             .parameters = {{"level", level, one.low - 0.5 * span, one.high + 0.5 * span, span, one.unit}},
             .text = fmt::format("max({} - level, 0) {}", one.name, other.name)});
        // Of a velocity and a load that has one sign, that is a friction with a name.
        if (one.name == target_->velocity && other.name != target_->position && !changes_sign(other)) return;
        const Parameter width = width_of(one);
        const double start = 10 * width.start;
        add({.name = nameless_term,
             .of = {&one, &other},
             .unit = other.unit,
             .value = [&, start](std::size_t k) { return std::tanh(one.values[k] / start) * other.values[k]; },
             .term = [](const TermArithmetic& m, const auto& x,
                        const auto& p) { return m.multiply(m.g.make(Op::tanh, m.divide(x[0], p[0])), x[1]); },
             .parameters = {{"width", start, width.low, 10 * width.high, width.scale, width.unit}},
             .text = fmt::format("tanh({}) {}", one.name, other.name)});
    }

    // What a state is stored in, as an inductance that saturates, a tank that widens, or an inertia that depends on the angle, varies
    // with the state, or with the position of a velocity: the whole derivative becomes 1 + c times as large, or 1/(1 - c) times
    // where c is negative, so that it keeps its sign.
    void variable_capacity() {
        if (target_->is_output || target_->is_inner) return;
        const auto& state = library_.model.equations.states[target_->place];
        const std::string& of = target_->position.empty() ? state.name : target_->position;
        const auto found = std::ranges::find(library_.variables, of, &SystemVariable::name);
        if (found == library_.variables.end()) return;
        const SystemVariable& variable = *found;
        const auto rate = library_.values_of(state.rate);
        const auto add_form = [&](const std::string& amplitude, const std::string& unit, const auto& value,
                                  const std::function<Term(const TermArithmetic&, const std::vector<Term>&)>& factor,
                                  std::vector<Parameter> parameters) {
            std::vector<double> changes(samples());
            for (std::size_t k = 0; k < changes.size(); ++k) changes[k] = value(variable.values[k]) * rate[k];
            const double rms = rms_of_values(changes);
            if (!(rms > 0) || !std::isfinite(rms)) return;
            SystemTerm made{.name = "variable_capacity",
                            .equation = target_->name,
                            .of = variable.name,
                            .variables = {variable.name}};
            made.parameters = {library_.amplitude(*target_, amplitude, rms, "")};
            made.parameters[0].unit = unit;
            made.parameters.insert(made.parameters.end(), parameters.begin(), parameters.end());
            made.apply = [target = *target_, factor](Equations& equations, const std::vector<Term>& p) {
                const TermArithmetic m{*equations.graph};
                const Term c = m.multiply(p[0], factor(m, p));
                const Term share = m.divide(c, m.add(m.number(1), m.positive(m.negate(c)))); // above -1
                const Term added = m.multiply(share, equations.states[target.place].rate);
                target.add(equations, added);
                return added;
            };
            library_.terms.push_back(std::move(made));
        };
        const Term w = variable.symbol;
        const auto per = [&](const char* power) { return unit_of_quotient("1", power_of(variable.unit, power)); };
        add_form(
            "curvature", per("^2"), [](double x) { return x * x; },
            [w](const TermArithmetic& m, const auto&) { return m.multiply(w, w); }, {});
        add_form(
            "slope", per(""), [](double x) { return std::abs(x); },
            [w](const TermArithmetic& m, const auto&) { return m.abs(w); }, {});
        std::vector<double> sizes = variable.values;
        for (double& x : sizes) x = std::abs(x);
        const double level = lower_quantile(sizes, 0.5), largest = size_of(variable);
        add_form(
            "excess", per(""), [level](double x) { return std::max(std::abs(x) - level, 0.0); },
            [w](const TermArithmetic& m, const auto& p) { return m.positive(m.subtract(m.abs(w), p[1])); },
            {{"level", level, 0, largest, largest, variable.unit}});
    }

    // The whole derivative is limited, as the output of an amplifier can only follow so fast; and that of a store differs by direction,
    // as where a fan is driven and coasts.
    void whole_derivative() {
        if (target_->is_output || target_->is_inner) return;
        const auto& state = library_.model.equations.states[target_->place];
        double largest = 0;
        for (const double rate : library_.values_of(state.rate)) largest = std::max(largest, std::abs(rate));
        if (!(largest > 0) || !std::isfinite(largest)) return;
        for (const double share : {0.6, 0.2, 0.05}) {
            SystemTerm made{.name = "rate_limit", .equation = target_->name};
            made.parameters = {
                {"limit", share * largest, 1e-3 * largest, 1.2 * largest, largest, per_second(state.unit)}};
            made.neutral = {1.2 * largest};
            made.apply = [place = target_->place](Equations& equations, const std::vector<Term>& p) {
                const TermArithmetic m{*equations.graph};
                Term& rate = equations.states[place].rate;
                rate = m.clip(rate, m.negate(p[0]), p[0]);
                return rate;
            };
            library_.terms.push_back(std::move(made));
        }
        // Times a factor, a difference is an inner signal, which says the same.
        const auto node = (*library_.model.equations.graph)[state.rate];
        const bool is_inner = std::ranges::any_of(library_.model.inner, [&](const auto& signal) {
            return (node.op == Op::multiply || node.op == Op::divide) &&
                   (signal.term == node.a || signal.term == node.b);
        });
        if (!target_->position.empty() || is_inner) return;
        add_one_ways(library_, target_->name, largest, target_->unit,
                     [place = target_->place](Equations& equations, const SignalFunction& of) {
                         Term& rate = equations.states[place].rate;
                         rate = of(TermArithmetic{*equations.graph}, rate);
                         return rate;
                     });
    }

    // Of a position: by what rate it moves. Of a state that is no position the rate is not what it moves by.
    std::optional<Term> motion_of(const SystemVariable& variable) const {
        for (const auto& input : library_.model.equations.inputs) {
            if (input.name == rate_name_of(variable.name)) return input.symbol;
        }
        if (!variable.state) return std::nullopt;
        const Term rate = library_.model.equations.states[*variable.state].rate;
        return library_.is_definition(rate) ? std::optional(rate) : std::nullopt;
    }

    // A state z of its own, between -1 and 1, that follows the direction of a motion over a distance; its force is a function of z.
    // `with_rate`: der(z) from the rate of the motion, z and the parameters.
    void
    slipping(SystemTerm made, const std::string& name, Term rate,
             const std::function<Term(const TermArithmetic&, Term rate, Term z, const std::vector<Term>&)>& rate_of,
             const std::function<Term(const TermArithmetic&, Term z, const std::vector<Term>&)>& force_of) {
        made.apply = [target = *target_, name, rate, rate_of, force_of](Equations& equations,
                                                                        const std::vector<Term>& p) {
            const TermArithmetic m{*equations.graph};
            const std::string own = free_name(equations, name + "_slip");
            Equations::State z{.name = own};
            z.symbol = equations.graph->variable(own);
            z.rate = rate_of(m, rate, z.symbol, p);
            equations.states.push_back(z);
            const Term added = force_of(m, z.symbol, p);
            target.add(equations, added);
            return added;
        };
        library_.terms.push_back(std::move(made));
    }

    // A force that follows the direction of motion over a distance [Dahl 1968]. With a load, in proportion to it.
    void hysteresis(const SystemVariable& variable, const SystemVariable* load) {
        const auto motion = motion_of(variable);
        if (!motion) return;
        const double span = variable.high - variable.low;
        for (const double share : {0.003, 0.03}) {
            const double distance = share * span;
            SystemTerm made{.name = load ? "load_dependent_presliding" : physical("hysteresis", variable.name),
                            .equation = target_->name,
                            .of = variable.name + (load ? " " + load->name : ""),
                            .variables = {variable.name}};
            if (load) made.variables.push_back(load->name);
            const double rms = load ? rms_of_values(load->values) : 1;
            made.parameters = {library_.amplitude(*target_, "a", rms, load ? load->unit : "1"),
                               {"distance", distance, 1e-5 * span, span, distance, variable.unit}};
            slipping(
                std::move(made), variable.name, *motion,
                [](const TermArithmetic& m, Term rate, Term z, const auto& p) {
                    return m.divide(m.subtract(rate, m.multiply(m.abs(rate), z)), p[1]);
                },
                [load = load ? std::optional<Term>(load->symbol) : std::nullopt](const TermArithmetic& m, Term z,
                                                                                 const auto& p) {
                    const Term force = m.multiply(p[0], z);
                    return load ? m.multiply(force, m.abs(*load)) : force;
                });
        }
    }

    // The same with a way back of any shape and a rounder or sharper corner [Bouc 1967], [Wen 1976], by a spring that may harden.
    void bouc_wen(const SystemVariable& variable) {
        const auto motion = motion_of(variable);
        if (!motion) return;
        const double span = variable.high - variable.low, distance = 0.03 * span;
        // The exponent is 2 or 8.
        for (const int squares : {1, 3}) {
            SystemTerm made{.name = physical("bouc_wen", variable.name),
                            .equation = target_->name,
                            .of = variable.name,
                            .variables = {variable.name}};
            made.parameters = {library_.amplitude(*target_, "a", 1, "1"),
                               library_.amplitude(*target_, "hardening", 1, "1"),
                               {"distance", distance, 1e-5 * span, span, distance, variable.unit},
                               {"beta", 0.6, 0.1, 2, 1}};
            made.amplitudes = 2;
            made.neutral = {0, 0};
            slipping(
                std::move(made), variable.name, *motion,
                [squares](const TermArithmetic& m, Term rate, Term z, const auto& p) {
                    // rate/distance (1 - |z|^exponent (beta sign(z rate) + 1 - beta))
                    Term share = z;
                    for (int i = 0; i < squares; ++i) share = m.multiply(share, share);
                    const Term one = m.number(1), back = m.subtract(one, m.add(p[3], p[3]));
                    const Term shape = m.where(m.less(m.multiply(z, rate), m.number(0)), back, one);
                    return m.multiply(m.divide(rate, p[2]), m.subtract(one, m.multiply(share, shape)));
                },
                [](const TermArithmetic& m, Term z, const auto& p) {
                    return m.multiply(z, m.add(p[0], m.multiply(p[1], m.multiply(z, z))));
                });
        }
    }

    // What lags behind a state; what lags behind an input is its path. It begins where the state does, as if that had rested.
    void memory(const SystemVariable& variable) {
        if (target_->is_output || !variable.state || !(library_.duration > 0)) return;
        const double step = library_.step;
        for (const double share : {0.01, 0.05}) {
            const double time = share * library_.duration;
            SystemTerm made{
                .name = "memory", .equation = target_->name, .of = variable.name, .variables = {variable.name}};
            made.parameters = {library_.amplitude(*target_, "a", rms_of_values(variable.values), variable.unit),
                               {"time", time, 0.5 * step, 0.5 * library_.duration, time, "s"}};
            made.begins_as = [w = variable.symbol](const Equations&) { return w; };
            made.apply = [target = *target_, name = variable.name, unit = variable.unit, w = variable.symbol,
                          state = *variable.state](Equations& equations, const std::vector<Term>& p) {
                auto& graph = *equations.graph;
                const TermArithmetic m{graph};
                const std::string own = free_name(equations, name + "_memory");
                Equations::State z{.name = own, .unit = unit, .start = equations.states[state].start};
                z.symbol = graph.variable(own);
                z.rate = m.divide(m.subtract(w, z.symbol), p[1]);
                equations.states.push_back(z);
                const Term added = m.multiply(p[0], z.symbol);
                target.add(equations, added);
                return added;
            };
            library_.terms.push_back(std::move(made));
        }
    }

    TermLibrary& library_;
    const TermTarget* target_ = nullptr;
};

} // namespace

void add_shapes(TermLibrary& library, bool with_nameless) { Shapes(library).add_all(with_nameless); }

void add_curves(TermLibrary& library) { Shapes(library).add_curves(); }

} // namespace tribode
