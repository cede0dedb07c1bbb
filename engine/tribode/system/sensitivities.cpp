#include "tribode/system/sensitivities.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/system/function_jumps.hpp"
#include "tribode/system/message_text.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <set>

namespace tribode {

namespace {

// Discrete variables that no derivative reaches, such as modes and samples of inputs, get none.
class Variations {
  public:
    Variations(Equations& equations, const std::vector<std::string>& names)
        : equations_(equations),
          graph_(*equations.graph),
          names_(names) {}

    void add() {
        equations_.sensitivities.clear();
        find_parameters();
        refuse_jumps();
        find_discrete();
        refuse_functions();
        add_variables();
        for (std::size_t p = 0; p < names_.size(); ++p) add_equations(p);
        refresh_functions();
    }

  private:
    using Assignments = Equations::Assignments;

    // By what, and where each start value is.
    void find_parameters() {
        std::vector<std::string> known;
        for (const auto& parameter : equations_.parameters) known.push_back(parameter.name);
        for (const auto& input : equations_.inputs) known.push_back(input.name);
        for (const auto& state : equations_.states) {
            if (!state.is_algebraic()) known.push_back(state.name + ".start");
        }
        for (const auto& variable : equations_.discrete) {
            if (variable.modes.empty()) known.push_back(variable.name + ".start");
        }
        for (std::size_t p = 0; p < names_.size(); ++p) {
            const std::string& name = names_[p];
            if (std::find(known.begin(), known.end(), name) == known.end()) {
                throw InputError(fmt::format(
                    "{}: sensitivities[{}] = \"{}\", must be a parameter, an input that is constant, or STATE.start{}",
                    equations_.name, p + 1, name, suggestion(name, known)));
            }
            if (std::count(names_.begin(), names_.end(), name) > 1) {
                throw InputError(fmt::format("{}: sensitivities name {} twice", equations_.name, name));
            }
            auto& made = equations_.sensitivities.emplace_back();
            made.name = name;
            const auto take = [&](const auto& variables) {
                for (const auto& variable : variables) {
                    if (variable.name != name) continue;
                    made.parameter = variable.symbol;
                    sizes_.push_back(variable.value == 0 ? 1 : std::abs(variable.value));
                }
            };
            take(equations_.parameters);
            take(equations_.inputs);
            for (const auto& state : equations_.states) {
                if (state.name + ".start" == name) sizes_.push_back(state.nominal);
            }
            for (const auto& variable : equations_.discrete) {
                if (variable.name + ".start" != name) continue;
                sizes_.push_back(variable.start == 0 ? 1 : std::abs(variable.start));
                started_.insert(variable.symbol);
            }
            if (made.parameter == 0) made.parameter = graph_.variable(name);
        }
    }

    // Below no_event a value follows its condition within a step, and a jump would go unseen: only branches that go on
    // continuously, as those of max, min and abs, may stand there.
    void refuse_jumps() {
        std::vector<Term> below;
        for (const auto& state : equations_.states) {
            for (const Term term : graph_.reachable(std::span(&state.rate, 1))) {
                if (graph_[term].op == Op::no_event) below.push_back(term);
            }
        }
        const auto moves = [&](Term term) {
            const auto variables = graph_.variables_of(std::span(&term, 1));
            return std::any_of(variables.begin(), variables.end(), [&](Term variable) {
                return variable == equations_.time ||
                       std::any_of(equations_.states.begin(), equations_.states.end(),
                                   [&](const auto& state) { return state.symbol == variable; });
            });
        };
        std::set<Term> continuous; // conditions
        std::vector<std::pair<Term, Term>> uses;
        const auto order = graph_.reachable(below);
        for (const Term term : order) {
            const auto& node = graph_[term];
            const int count = operand_count(node.op);
            const bool harmless = node.op == Op::lookup || (node.op == Op::select && graph_.is_continuous(term));
            if (count > 0 && !(harmless && node.op == Op::select)) uses.emplace_back(node.a, term);
            if (count > 1) uses.emplace_back(node.b, term);
            if (count > 2 && !(harmless && node.op == Op::lookup)) uses.emplace_back(node.c, term);
        }
        for (const auto& [term, parent] : uses) {
            const auto node = graph_[term];
            const bool jumps = node.op == Op::less || node.op == Op::less_equal || node.op == Op::equal ||
                               node.op == Op::floor || jump_of(graph_, node.op, node.a, node.b);
            if (!jumps || !moves(term)) continue;
            throw InputError(
                fmt::format("{}: a run has no sensitivities where {} stands below no_event, because it may "
                            "jump there unseen; without no_event it is an event",
                            equations_.name, shortened(graph_.text(term))));
        }
    }

    // Those that a derivative can reach, from assignment to assignment.
    void find_discrete() {
        std::set<Term> moving = started_;
        for (const auto& state : equations_.states) moving.insert(state.symbol);
        for (const auto& by : equations_.sensitivities) moving.insert(by.parameter);
        const auto reached = [&](Term value, bool with_time) {
            Expressions::Replacement direction = some_direction(moving);
            if (with_time) direction[equations_.time] = graph_.variable("d t");
            return !graph_.is_constant(graph_.derivatives(std::span(&value, 1), direction)[0], 0);
        };
        for (bool more = true; more;) {
            more = false;
            const auto follow = [&](const Assignments& set, bool with_time) {
                for (const auto& [target, value] : set) {
                    if (moving.contains(target) || !reached(value, with_time)) continue;
                    moving.insert(target);
                    more = true;
                }
            };
            for (const auto& when : equations_.whens) follow(when.set, true);
            for (const auto& clock : equations_.clocks) follow(clock.set, false);
        }
        for (const auto& variable : equations_.discrete) carries_.push_back(moving.contains(variable.symbol));
        direction_ = some_direction(moving);
    }

    Expressions::Replacement some_direction(const std::set<Term>& moving) {
        Expressions::Replacement direction;
        for (const Term symbol : moving) direction[symbol] = graph_.variable("d");
        return direction;
    }

    void refuse_functions() {
        for (const auto& clock : equations_.clocks) {
            if (!clock.function) continue;
            for (const Term read : clock.function->reads) {
                if (graph_.is_constant(graph_.derivatives(std::span(&read, 1), direction_)[0], 0)) continue;
                throw InputError(fmt::format(
                    "{}: a run has no sensitivities where the function that {} calls reads {}: what the function does "
                    "with it is not known as equations; `set` is",
                    equations_.name, clock.name, shortened(graph_.text(read))));
            }
        }
    }

    void add_variables() {
        const std::size_t states = equations_.states.size(), discrete = equations_.discrete.size(),
                          outputs = equations_.outputs.size();
        for (std::size_t p = 0; p < names_.size(); ++p) {
            auto& by = equations_.sensitivities[p];
            const auto named = [&](const std::string& name) { return fmt::format("d {}/d {}", name, by.name); };
            Expressions::Replacement& direction = directions_.emplace_back();
            by.states = equations_.states.size();
            by.outputs = outputs * (p + 1);
            for (std::size_t i = 0; i < states; ++i) {
                Equations::State made = equations_.states[i];
                made.name = named(made.name);
                made.unit.clear();
                if (made.is_algebraic()) made.equation = named(made.equation);
                made.start = equations_.states[i].name + ".start" == by.name ? 1 : 0;
                made.nominal /= sizes_[p];
                made.symbol = graph_.variable(made.name);
                direction[equations_.states[i].symbol] = made.symbol;
                equations_.states.push_back(std::move(made));
            }
            by.instant = equations_.discrete.size();
            equations_.discrete.push_back({named("t"), "", 0, graph_.variable(named("t")), {}});
            for (std::size_t i = 0; i < discrete; ++i) {
                if (!carries_[i]) continue;
                const auto& own = equations_.discrete[i];
                const double start = own.name + ".start" == by.name ? 1 : 0;
                const Term symbol = graph_.variable(named(own.name));
                direction[own.symbol] = symbol;
                by.discrete.emplace_back(i, equations_.discrete.size());
                equations_.discrete.push_back({named(own.name), "", start, symbol, {}});
            }
            direction[by.parameter] = graph_.constant(1);
        }
    }

    void add_equations(std::size_t p) {
        const std::size_t states = equations_.own_states(), outputs = equations_.own_outputs();
        const auto& by = equations_.sensitivities[p];
        Expressions::Replacement direction = directions_[p];
        std::vector<Term> rates;
        for (std::size_t i = 0; i < states; ++i) rates.push_back(equations_.states[i].rate);
        // Algebraic equations hold at an event too, whose time moves.
        Expressions::Replacement at_events = direction;
        at_events[equations_.time] = equations_.discrete[by.instant].symbol;
        const auto between = graph_.derivatives(rates, direction), there = graph_.derivatives(rates, at_events);
        for (std::size_t i = 0; i < states; ++i) {
            equations_.states[by.states + i].rate = equations_.states[i].is_algebraic() ? there[i] : between[i];
        }
        for (std::size_t i = 0; i < outputs; ++i) {
            const auto output = equations_.outputs[i];
            equations_.outputs.push_back({fmt::format("d {}/d {}", output.name, by.name), "",
                                          graph_.derivatives(std::span(&output.value, 1), direction)[0]});
        }
        for (auto& when : equations_.whens) differentiate(when.set, at_events);
        for (auto& clock : equations_.clocks) differentiate(clock.set, direction);
    }

    // Of each value that is set also the derivative; those of the set before it are left as they are.
    void differentiate(Assignments& set, const Expressions::Replacement& direction) {
        std::vector<Term> targets, values;
        for (const auto& [target, value] : set) {
            const auto own = direction.find(target);
            if (own == direction.end()) continue;
            targets.push_back(own->second);
            values.push_back(value);
        }
        const auto made = graph_.derivatives(values, direction);
        for (std::size_t i = 0; i < made.size(); ++i) set.emplace_back(targets[i], made[i]);
    }

    // What a function sets does not depend on the parameters.
    void refresh_functions() {
        for (auto& clock : equations_.clocks) {
            if (!clock.function) continue;
            for (const Term target : clock.function->writes) {
                for (const auto& direction : directions_) {
                    const auto own = direction.find(target);
                    if (own != direction.end()) clock.set.emplace_back(own->second, graph_.constant(0));
                }
            }
        }
    }

    Equations& equations_;
    Expressions& graph_;
    const std::vector<std::string>& names_;
    std::vector<double> sizes_;          // of what it is by
    std::set<Term> started_;             // discrete variables by whose start it is
    Expressions::Replacement direction_; // of all that a derivative can reach
    std::vector<bool> carries_;          // of the discrete variables: whether they have derivatives
    std::vector<Expressions::Replacement> directions_;
};

} // namespace

Equations with_sensitivities(Equations equations, const std::vector<std::string>& names) {
    if (!names.empty()) Variations(equations, names).add();
    return equations;
}

void check_delays(const Equations& equations, const std::vector<std::string>& names) {
    const auto& graph = *equations.graph;
    for (const Term term : graph.reachable(equations.terms())) {
        if (graph[term].op != Op::delay) continue;
        const Term delay = graph[term].b;
        const auto variables = graph.variables_of(std::span(&delay, 1));
        for (const auto& parameter : equations.parameters) {
            if (!std::binary_search(variables.begin(), variables.end(), parameter.symbol) ||
                std::find(names.begin(), names.end(), parameter.name) == names.end()) {
                continue;
            }
            throw InputError(fmt::format("{}: a run has no sensitivity to {}, on which a delay depends: samples and "
                                         "events of the delayed input would move",
                                         equations.name, parameter.name));
        }
    }
}

} // namespace tribode
