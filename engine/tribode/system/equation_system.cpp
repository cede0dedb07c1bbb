#include "tribode/system/equation_system.hpp"
#include "tribode/base/error.hpp"
#include "tribode/system/algebraic_equations.hpp"
#include "tribode/system/function_jumps.hpp"
#include "tribode/system/message_text.hpp"
#include "tribode/system/work_space.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <fmt/format.h>
#include <numeric>
#include <utility>

namespace tribode {

namespace {

constexpr std::size_t usual_size = 64; // of a work space: more goes to the heap

} // namespace

EquationSystem::EquationSystem(Equations equations) : equations_(std::move(equations)) {
    std::set<std::string> names;
    const auto once = [&](const std::string& name) {
        if (names.insert(name).second) return;
        throw InputError(fmt::format("{}: the name {} stands twice, each must stand once", equations_.name, name));
    };
    for (const auto& state : equations_.states) once(state.name);
    for (const auto& discrete : equations_.discrete) once(discrete.name);
    for (const auto& parameter : equations_.parameters) once(parameter.name);
    for (const auto& input : equations_.inputs) once(input.name);
    for (const auto& output : equations_.outputs) once(output.name);
    for (const auto& clock : equations_.clocks) {
        if (!(clock.period > 0) || !(clock.offset >= 0) || !std::isfinite(clock.period + clock.offset)) {
            throw InputError(
                fmt::format("{}: the clock {} has the period {} s and the offset {} s, must be positive and "
                            "not negative",
                            equations_.name, clock.name, clock.period, clock.offset));
        }
    }
    for (const Term term : equations_.graph->reachable(equations_.terms())) {
        const Op op = (*equations_.graph)[term].op;
        if (op != Op::delay && op != Op::rate) continue;
        throw InputError(fmt::format("{}: {} is still to be taken out", equations_.name, equations_.graph->text(term)));
    }
    put_in_parameters();
    assign_equations(equations_);
    keep_what_was_before();
    hold_relations();
    reads_conditions_ = find_conditions_read();
    differentiate_relations();
    mark_active();
    join_clocks();
    make_tapes();
    recognize_affine();
    make_blocks();
}

// From here on the equations hold no parameters and no inputs, but for those by which the events are still to be
// differentiated.
void EquationSystem::put_in_parameters() {
    auto& graph = *equations_.graph;
    Expressions::Replacement numbers;
    for (const auto& parameter : equations_.parameters) numbers[parameter.symbol] = graph.constant(parameter.value);
    for (const auto& input : equations_.inputs) numbers[input.symbol] = graph.constant(input.value);
    for (const auto& by : equations_.sensitivities) {
        const auto number = numbers.extract(by.parameter);
        if (!number.empty()) differentiated_[number.key()] = number.mapped();
    }
    equations_.replace(numbers);
}

// How the instant of each relation moves with the parameters; and their numbers.
void EquationSystem::differentiate_relations() {
    if (equations_.sensitivities.empty()) return;
    auto& graph = *equations_.graph;
    std::vector<Term> margins, symbols;
    for (const auto& relation : relations_) margins.push_back(relation.margin);
    for (std::size_t i = 0; i < equations_.own_states(); ++i) symbols.push_back(equations_.states[i].symbol);
    relation_rates_.resize(relations_.size());
    const auto by_time = graph.derivatives(margins, equations_.time);
    for (std::size_t i = 0; i < relations_.size(); ++i) relation_rates_[i].terms.push_back(by_time[i]);
    for (const auto& [row, column, term] : graph.jacobian(margins, symbols)) {
        relation_rates_[row].states.push_back(column);
        relation_rates_[row].terms.push_back(term);
    }
    for (const auto& by : equations_.sensitivities) {
        Expressions::Replacement direction{{by.parameter, graph.constant(1)}};
        for (std::size_t i = 0; i < symbols.size(); ++i) {
            direction[symbols[i]] = equations_.states[by.states + i].symbol;
        }
        for (const auto& [of, derivative] : by.discrete) {
            direction[equations_.discrete[of].symbol] = equations_.discrete[derivative].symbol;
        }
        const auto moved = graph.derivatives(margins, direction);
        for (std::size_t i = 0; i < relations_.size(); ++i) relation_rates_[i].terms.push_back(moved[i]);
    }
    const auto put_in = [&](std::vector<Term>& terms) { terms = graph.substitute(terms, differentiated_); };
    for (auto& rate : relation_rates_) put_in(rate.terms);
    put_in(rates_);
    put_in(conditions_);
    put_in(margins);
    for (std::size_t i = 0; i < relations_.size(); ++i) relations_[i].margin = margins[i];
    std::vector<Term> operands;
    for (const auto& counter : counters_) operands.push_back(counter.operand);
    for (const auto& before : befores_) operands.push_back(before.of);
    put_in(operands);
    for (std::size_t i = 0; i < counters_.size(); ++i) counters_[i].operand = operands[i];
    for (std::size_t i = 0; i < befores_.size(); ++i) befores_[i].of = operands[counters_.size() + i];
    equations_.replace(differentiated_);
}

// Puts a variable in the place of each term below `before`.
void EquationSystem::keep_what_was_before() {
    auto& graph = *equations_.graph;
    Expressions::Replacement kept;
    for (const Term term : graph.reachable(equations_.terms())) {
        if (graph[term].op != Op::before) continue;
        const Term of = graph.substitute(std::vector{graph[term].a}, kept)[0];
        befores_.push_back({graph.variable(shortened(graph.text(term))), of});
        kept[term] = befores_.back().held;
    }
    if (!kept.empty()) equations_.replace(kept);
}

// Finds the relations that are events and puts a held value in the place of each.
void EquationSystem::hold_relations() {
    auto& graph = *equations_.graph;
    std::vector<Term> roots;
    for (const auto& state : equations_.states) roots.push_back(state.rate);
    for (const auto& when : equations_.whens) roots.push_back(when.condition);

    const auto order = graph.reachable(roots, false);
    const auto moving = moving_terms(order);
    // The same relation may stand below no_event and elsewhere; there it stays as it is. An equality is no event either: whether
    // an operand rests at the edge of a domain, beyond an event too, is seen from its value.
    Expressions::Replacement held;
    const auto hold = [&](Term relation) {
        if (held.contains(relation)) return;
        const auto node = graph[relation];
        Relation made;
        made.text = shortened(graph.text(relation));
        made.held = graph.variable("(" + made.text + ")");
        made.margin = graph.make(Op::subtract, node.b, node.a);
        made.strict = node.op == Op::less;
        held[relation] = made.held;
        relations_.push_back(std::move(made));
    };
    for (const Term term : order) {
        const auto node = graph[term];
        if (node.op == Op::no_event || node.op == Op::equal) held[term] = term;
        if (!moving.contains(term)) continue;
        if (node.op == Op::floor) held[term] = add_counter(term);
        if (node.op == Op::less || node.op == Op::less_equal) hold(term);
        if (const auto jump = jump_of(graph, node.op, node.a, node.b); jump && moving.contains(node.a)) hold(*jump);
    }
    keep_in_domain(order, held);
    roots = graph.substitute(roots, held);
    rates_.assign(roots.begin(), roots.begin() + static_cast<std::ptrdiff_t>(equations_.states.size()));
    conditions_.assign(roots.begin() + static_cast<std::ptrdiff_t>(equations_.states.size()), roots.end());
    // An operand may itself have a branch.
    std::vector<Term> margins;
    for (const auto& relation : relations_) margins.push_back(relation.margin);
    for (const auto& counter : counters_) margins.push_back(counter.operand);
    for (const auto& before : befores_) margins.push_back(before.of);
    margins = graph.substitute(margins, held);
    for (std::size_t i = 0; i < relations_.size(); ++i) relations_[i].margin = margins[i];
    for (std::size_t i = 0; i < counters_.size(); ++i) counters_[i].operand = margins[relations_.size() + i];
    for (std::size_t i = 0; i < befores_.size(); ++i) {
        befores_[i].of = margins[relations_.size() + counters_.size() + i];
    }
}

// A floor that is an event, and the relations at which it changes. Its held value.
Term EquationSystem::add_counter(Term floor) {
    auto& graph = *equations_.graph;
    const std::string text = shortened(graph.text(floor));
    const Counter counter{graph.variable("(" + text + ")"), graph[floor].a};
    for (const double step : {1.0, -1.0}) {
        Relation made;
        made.text = text;
        made.held = graph.variable("(" + text + ")");
        made.margin =
            step > 0 ? graph.make(Op::subtract, counter.operand, graph.make(Op::add, counter.held, graph.constant(1)))
                     : graph.make(Op::subtract, counter.held, counter.operand);
        made.strict = true;
        made.counter = counters_.size();
        made.step = step;
        relations_.push_back(std::move(made));
    }
    counters_.push_back(counter);
    return counter.held;
}

// Below a function with a limited domain, a branch that goes on continuously, as those of max, min and abs, follows its
// operands at once: sqrt(max(h, 0)) has a value wherever a step leads. Other branches on the same relation keep the held one,
// by which they jump at the event and not before. So does a function that jumps by itself.
void EquationSystem::keep_in_domain(const std::vector<Term>& order, Expressions::Replacement& held) {
    auto& graph = *equations_.graph;
    for (const Term term : order) {
        const auto node = graph[term];
        if (const auto jump = jump_of(graph, node.op, node.a, node.b); jump && held.contains(*jump)) {
            const auto operands = graph.substitute(std::vector{node.a, node.b}, held);
            held[term] = without_jump(graph, node.op, operands[0], operands[1], held.at(*jump));
        }
        const bool limited = node.op == Op::sqrt || node.op == Op::log || node.op == Op::asin || node.op == Op::acos ||
                             node.op == Op::power;
        if (!limited) continue;
        Expressions::Replacement following = held;
        for (const Term below : graph.reachable(std::span(&node.a, 1), false)) {
            if (!graph.is_continuous(below)) continue;
            const auto branch = graph[below];
            const auto relation = graph[branch.a];
            const auto operands = graph.substitute(std::vector{relation.a, relation.b, branch.b, branch.c}, following);
            const Term now = graph.make(relation.op, operands[0], operands[1]);
            following[below] = graph.make(Op::select, now, operands[2], operands[3]);
        }
        if (following.size() == held.size()) continue;
        const auto operands = graph.substitute(std::vector{node.a, node.b}, following);
        held[term] = graph.make(node.op, operands[0], operands[1]);
    }
}

// Whether what events and clocks set, or conditions below no_event, have branches, or a function is called.
bool EquationSystem::find_conditions_read() const {
    const auto& graph = *equations_.graph;
    std::vector<Term> read;
    for (const Term term : graph.reachable(conditions_)) {
        if (graph[term].op == Op::no_event) read.push_back(term);
    }
    for (const auto& when : equations_.whens) {
        for (const auto& [target, value] : when.set) read.push_back(value);
    }
    for (const auto& clock : equations_.clocks) {
        if (clock.function) return true;
        for (const auto& [target, value] : clock.set) read.push_back(value);
    }
    return std::ranges::any_of(graph.reachable(read), [&](Term term) {
        const Op op = graph[term].op;
        return op == Op::less || op == Op::less_equal || op == Op::floor || op == Op::lookup;
    });
}

// The terms of an ascending list that depend on t or x.
std::set<Term> EquationSystem::moving_terms(const std::vector<Term>& order) const {
    std::set<Term> moving{equations_.time};
    for (const auto& state : equations_.states) moving.insert(state.symbol);
    for (const Term term : order) {
        const auto& node = (*equations_.graph)[term];
        const int count = operand_count(node.op);
        if ((count > 0 && moving.contains(node.a)) || (count > 1 && moving.contains(node.b)) ||
            (count > 2 && moving.contains(node.c))) {
            moving.insert(term);
        }
    }
    return moving;
}

// Where each relation matters, as a condition in the discrete state: from the roots down, through those branches that
// are open.
void EquationSystem::mark_active() {
    auto& graph = *equations_.graph;
    const Term always = graph.constant(1);
    std::vector<Term> roots = rates_;
    roots.insert(roots.end(), conditions_.begin(), conditions_.end());
    for (const auto& relation : relations_) roots.push_back(relation.margin);

    const auto order = graph.reachable(roots);
    const auto moving = moving_terms(order);
    std::unordered_map<Term, Term> active; // absent: nowhere
    const auto open = [&](Term term, Term where) {
        const auto [known, is_new] = active.try_emplace(term, where);
        if (!is_new) known->second = graph.make(Op::any, known->second, where);
    };
    for (const Term root : rates_) open(root, always);
    for (const Term root : conditions_) open(root, always);
    // A relation in the operand of another always matters.
    for (const auto& relation : relations_) open(relation.margin, always);
    // Parents stand behind their operands.
    for (auto place = order.rbegin(); place != order.rend(); ++place) {
        const Term term = *place;
        const auto known = active.find(term);
        if (known == active.end()) continue;
        const Term here = known->second;
        const auto node = graph[term];
        const int count = operand_count(node.op);
        if (node.op == Op::select && !moving.contains(node.a)) {
            open(node.a, here);
            open(node.b, graph.make(Op::all, here, node.a));
            open(node.c, graph.make(Op::all, here, graph.make(Op::logical_not, node.a)));
            continue;
        }
        if (node.op == Op::all) {
            // Either half closes the other; a relation may not close itself for good, so only what is no relation does.
            const auto closes = [&](Term half) { return !moving.contains(half) && graph[half].op == Op::equal; };
            open(node.a, closes(node.b) ? graph.make(Op::all, here, node.b) : here);
            open(node.b, closes(node.a) ? graph.make(Op::all, here, node.a) : here);
            continue;
        }
        if (count > 0) open(node.a, here);
        if (count > 1) open(node.b, here);
        if (count > 2) open(node.c, here);
    }
    for (auto& relation : relations_) {
        const auto known = active.find(relation.held);
        relation.active = known == active.end() ? always : known->second;
    }
}

Tape EquationSystem::tape_of(const std::vector<Term>& terms) const {
    return {*equations_.graph,
            inputs_,
            terms,
            {1, equations_.states.size(), inputs_.size() - 1 - equations_.states.size()}};
}

EquationSystem::Sparse EquationSystem::sparse_jacobian(const std::vector<Term>& rows, const std::vector<Term>& columns,
                                                       std::vector<Term>& terms) {
    Sparse sparse;
    terms.clear();
    auto derivatives = equations_.graph->jacobian(rows, columns);
    std::stable_sort(derivatives.begin(), derivatives.end(),
                     [](const auto& a, const auto& b) { return a.column < b.column; });
    for (const auto& derivative : derivatives) {
        sparse.entries.push_back({derivative.row, derivative.column});
        terms.push_back(derivative.term);
    }
    sparse.tape = tape_of(terms);
    return sparse;
}

EquationSystem::Update EquationSystem::update_of(const std::string& name, const Equations::Assignments& set) const {
    Update update;
    update.name = name;
    std::vector<Term> values;
    for (const auto& [target, value] : set) {
        update.targets.push_back(place_of(target));
        values.push_back(value);
    }
    update.tape = tape_of(values);
    return update;
}

// What each clock can change; and neighbors that always meet and cause no event become one.
void EquationSystem::join_clocks() {
    auto& graph = *equations_.graph;
    std::vector<Term> moving = rates_, watched = conditions_;
    for (const auto& relation : relations_) {
        watched.push_back(relation.margin);
        watched.push_back(relation.active);
    }
    for (const auto& before : befores_) watched.push_back(before.of);
    const auto of_motion = graph.variables_of(moving), of_events = graph.variables_of(watched);
    const auto in_conditions = graph.variables_of(conditions_);
    const auto is_in = [](const std::vector<Term>& variables, Term term) {
        return std::binary_search(variables.begin(), variables.end(), term);
    };
    const auto is_state = [&](Term term) {
        return std::any_of(equations_.states.begin(), equations_.states.end(),
                           [&](const auto& state) { return state.symbol == term; });
    };
    // A condition below no_event is looked at whenever it can be.
    const bool polled = std::any_of(in_conditions.begin(), in_conditions.end(),
                                    [&](Term term) { return term == equations_.time || is_state(term); });
    std::vector<Equations::Clock> joined;
    for (auto& clock : equations_.clocks) {
        Reach reach{false, polled};
        const auto add = [&](Term target) {
            reach.motion = reach.motion || is_in(of_motion, target);
            reach.events = reach.events || is_state(target) || is_in(of_events, target);
        };
        for (const auto& [target, value] : clock.set) add(target);
        if (clock.function) std::for_each(clock.function->writes.begin(), clock.function->writes.end(), add);

        // Algebraic variables are to agree with what has been set.
        const bool has_algebraic = std::any_of(equations_.states.begin(), equations_.states.end(),
                                               [](const auto& state) { return state.is_algebraic(); });
        reach.events = reach.events || (has_algebraic && reach.motion);

        const bool meet = !joined.empty() && joined.back().period == clock.period &&
                          joined.back().offset == clock.offset && !joined.back().function && !clock.function;
        if (!meet || reach.events || reach_.back().events) {
            joined.push_back(std::move(clock));
            reach_.push_back(reach);
            continue;
        }
        // The second reads what the first has set.
        auto& first = joined.back();
        const Expressions::Replacement before(first.set.begin(), first.set.end());
        for (auto& [target, value] : clock.set) {
            value = graph.substitute(std::span(&value, 1), before)[0];
            std::erase_if(first.set, [&chosen = target](const auto& set) { return set.first == chosen; });
        }
        first.set.insert(first.set.end(), clock.set.begin(), clock.set.end());
        first.name += ", " + clock.name;
        reach_.back().motion = reach_.back().motion || reach.motion;
    }
    equations_.clocks = std::move(joined);
    for (const auto& clock : equations_.clocks) clocks_.push_back({clock.name, clock.period, clock.offset});
}

void EquationSystem::make_tapes() {
    auto& graph = *equations_.graph;
    inputs_.push_back(equations_.time);
    for (const auto& state : equations_.states) {
        inputs_.push_back(state.symbol);
        StateVariable variable{state.name, state.unit, std::nullopt, state.nominal};
        if (state.is_algebraic()) variable.equation = state.equation_text();
        if (variable.is_algebraic()) algebraic_.push_back(variables_.size());
        // Where a rate is a state itself, as a velocity is.
        for (std::size_t i = 0; i < equations_.states.size() && !variable.is_algebraic(); ++i) {
            if (equations_.states[i].symbol == state.rate) variable.rate = i;
        }
        variables_.push_back(std::move(variable));
    }
    for (const auto& discrete : equations_.discrete) inputs_.push_back(discrete.symbol);
    for (const auto& relation : relations_) inputs_.push_back(relation.held);
    for (const auto& counter : counters_) inputs_.push_back(counter.held);
    for (const auto& before : befores_) inputs_.push_back(before.held);

    rate_ = tape_of(rates_);
    for (auto& rate : relation_rates_) rate.tape = tape_of(rate.terms);
    std::vector<Term> terms;
    for (const auto& output : equations_.outputs) terms.push_back(output.value);
    output_ = tape_of(terms);
    condition_ = tape_of(conditions_);

    const Term one = graph.constant(1);
    terms.clear();
    for (const auto& relation : relations_) {
        terms.push_back(relation.margin);
        const Term side =
            graph.make(Op::select, relation.held, relation.margin, graph.make(Op::negate, relation.margin));
        guard_terms_.push_back(graph.make(Op::select, relation.active, side, one));
    }
    guard_ = tape_of(terms);
    std::vector<Term> active;
    for (const auto& relation : relations_) active.push_back(relation.active);
    active_ = tape_of(active);
    terms.clear();
    for (const auto& counter : counters_) terms.push_back(counter.operand);
    counted_ = tape_of(terms);
    terms.clear();
    for (const auto& before : befores_) terms.push_back(before.of);
    before_ = tape_of(terms);
    for (const auto& when : equations_.whens) when_updates_.push_back(update_of(when.name, when.set));
    for (const auto& clock : equations_.clocks) {
        clock_updates_.push_back(update_of(clock.name, clock.set));
        auto& call = calls_.emplace_back();
        if (!clock.function) continue;
        call.emplace();
        for (const Term target : clock.function->writes) call->targets.push_back(place_of(target));
        call->reads = tape_of(clock.function->reads);
    }
    find_dependences();
    bound_margins();
}

void EquationSystem::find_dependences() {
    auto& graph = *equations_.graph;
    std::unordered_map<Term, std::size_t> place, state_of;
    for (std::size_t i = 0; i < inputs_.size(); ++i) place[inputs_[i]] = i;
    for (std::size_t i = 0; i < equations_.states.size(); ++i) state_of[equations_.states[i].symbol] = i;
    std::vector<Term> residuals;
    for (const std::size_t i : algebraic_) residuals.push_back(rates_[i]);
    const auto of_algebraic = graph.variables_of(residuals);
    relations_of_.resize(inputs_.size());
    moved_relations_of_.resize(inputs_.size());
    for (std::size_t i = 0; i < relations_.size(); ++i) {
        auto& relation = relations_[i];
        relation.of_time_alone = true;
        std::set<Term> moving;
        std::set<Term> operands;
        for (const Term variable : graph.variables_of(std::span(&relation.margin, 1))) {
            operands.insert(variable);
            const auto state = state_of.find(variable);
            if (state != state_of.end() && variables_[state->second].is_algebraic()) relation.of_algebraic = true;
        }
        // Through algebraic variables on all that their equations depend on, but for relations, which
        // make_consistent() compares.
        if (relation.of_algebraic) {
            for (const Term variable : of_algebraic) {
                if (place.at(variable) < held_place(0)) operands.insert(variable);
            }
        }
        for (const Term variable : operands) {
            relations_of_[place.at(variable)].push_back(i);
            const auto state = state_of.find(variable);
            if (state == state_of.end()) continue;
            relation.of_time_alone = false;
            const auto of_rate = graph.variables_of(std::span(&rates_[state->second], 1));
            moving.insert(of_rate.begin(), of_rate.end());
        }
        const bool with_algebraic = std::any_of(moving.begin(), moving.end(), [&](Term variable) {
            const auto state = state_of.find(variable);
            return state != state_of.end() && variables_[state->second].is_algebraic();
        });
        if (with_algebraic) moving.insert(of_algebraic.begin(), of_algebraic.end());
        for (const Term variable : moving) moved_relations_of_[place.at(variable)].push_back(i);
    }
    moves_.resize(inputs_.size());
    for (const Term variable : graph.variables_of(rates_)) moves_[place.at(variable)] = true;
    std::fill_n(moves_.begin() + 1, equations_.states.size(), true);
    std::vector<Term> all_margins, all_active;
    for (const auto& relation : relations_) {
        all_margins.push_back(relation.margin);
        all_active.push_back(relation.active);
    }
    seen_by_.resize(inputs_.size());
    for (const auto& [terms, what] : {std::pair(&all_margins, of_margins), std::pair(&all_active, of_activity),
                                      std::pair(&conditions_, of_conditions)}) {
        for (const Term variable : graph.variables_of(*terms)) seen_by_[place.at(variable)] |= what;
    }
    for (auto& update : when_updates_) {
        for (const std::size_t target : update.targets) {
            update.seen_by |= seen_by_[target];
            update.moves = update.moves || moves_[target] != 0;
        }
    }
    may_turn_.resize(relations_.size());
    for (const auto& update : when_updates_) {
        for (const std::size_t target : update.targets) {
            for (const std::size_t i : relations_of_[target]) may_turn_[i] = true;
            for (const std::size_t i : moved_relations_of_[target]) may_turn_[i] = true;
        }
    }
    for (std::size_t w = 0; w < conditions_.size(); ++w) {
        for (const Term variable : graph.variables_of(std::span(&conditions_[w], 1))) {
            const std::size_t at = place.at(variable);
            if (at < held_place(0)) continue;
            const std::size_t relation = at - held_place(0);
            if (relation < relations_.size()) relations_[relation].whens.push_back(w);
            for (auto& other : relations_) {
                if (other.counter && relation == relations_.size() + *other.counter) other.whens.push_back(w);
            }
        }
    }
}

// For all runs, unless there are so many relations that it would take long.
void EquationSystem::bound_margins() {
    constexpr std::size_t most = 100;
    if (relations_.size() > most) return;
    for (std::size_t i = 0; i < relations_.size(); ++i) bounded_margins_.push_back(make_bounded_margin(i));
}

void EquationSystem::recognize_affine() {
    auto& graph = *equations_.graph;
    std::vector<Term> matrix, guard_matrix, symbols;
    for (const auto& state : equations_.states) symbols.push_back(state.symbol);
    jacobian_ = sparse_jacobian(rates_, symbols, matrix);
    jacobian_pattern_.starts.assign(equations_.states.size() + 1, 0);
    for (const auto& [row, column] : jacobian_.entries) {
        jacobian_pattern_.rows.push_back(row);
        ++jacobian_pattern_.starts[column + 1];
    }
    std::partial_sum(jacobian_pattern_.starts.begin(), jacobian_pattern_.starts.end(),
                     jacobian_pattern_.starts.begin());
    guard_jacobian_ = sparse_jacobian(guard_terms_, symbols, guard_matrix);
    if (!algebraic_.empty()) {
        why_not_affine_ = fmt::format("{} is an algebraic variable", equations_.states[algebraic_.front()].name);
        return;
    }

    std::set<Term> moving{equations_.time};
    for (const auto& state : equations_.states) moving.insert(state.symbol);
    const auto moves = [&](Term term) {
        const auto found = graph.variables_of(std::span(&term, 1));
        return std::any_of(found.begin(), found.end(), [&](Term variable) { return moving.contains(variable); });
    };
    const auto check = [&](const Sparse& sparse, const std::vector<Term>& terms, const auto& name) {
        for (std::size_t i = 0; i < terms.size() && !why_not_affine_; ++i) {
            if (!moves(terms[i])) continue;
            why_not_affine_ =
                fmt::format("{} is not linear in {}: its derivative by it is {}", name(sparse.entries[i].row),
                            equations_.states[sparse.entries[i].column].name, shortened(graph.text(terms[i])));
        }
    };
    const auto rate_name = [&](std::size_t row) { return "der(" + equations_.states[row].name + ")"; };
    const auto relation_name = [&](std::size_t row) { return "the relation " + relations_[row].text; };
    // What is left of conditions that move, below no_event, has no derivative and is yet not constant.
    const auto check_jumps = [&](const std::vector<Term>& rows, const auto& name) {
        for (std::size_t row = 0; row < rows.size() && !why_not_affine_; ++row) {
            for (const Term term : graph.reachable(std::span(&rows[row], 1))) {
                const Op op = graph[term].op;
                const bool jumps = op == Op::less || op == Op::less_equal || op == Op::equal || op == Op::floor;
                const bool has_pieces = op == Op::lookup && !graph.table_of(term)->is_one_polynomial();
                const bool is_angle = op == Op::tan || op == Op::atan2; // with its jumps
                if ((!jumps && !has_pieces && !is_angle) || !moves(term)) continue;
                const std::string text = shortened(graph.text(term));
                why_not_affine_ = has_pieces ? fmt::format("{} has the table {}, of many polynomials", name(row), text)
                                  : is_angle ? fmt::format("{} has {}, which is not linear", name(row), text)
                                             : fmt::format("{} jumps with {}, which is no event", name(row), text);
                break;
            }
        }
    };
    check_jumps(rates_, rate_name);
    check_jumps(guard_terms_, relation_name);
    check(jacobian_, matrix, rate_name);
    check(guard_jacobian_, guard_matrix, relation_name);

    // What is left of them without x: polynomials in t, or not.
    const auto in_time = [&](std::vector<Term> rows, std::vector<Tape>& tapes, const auto& name) {
        for (int n = 1; n <= max_degree + 1 && !why_not_affine_; ++n) {
            rows = graph.derivatives(rows, equations_.time);
            for (std::size_t row = 0; row < rows.size() && !why_not_affine_; ++row) {
                if (graph.is_constant(rows[row], 0)) continue;
                if (n == 1) varies_ = true;
                if (n > max_degree) {
                    why_not_affine_ = fmt::format("{} is no polynomial of degree {} in t", name(row), max_degree);
                }
            }
            if (n <= max_degree) tapes.push_back(tape_of(rows));
        }
    };
    if (!why_not_affine_) in_time(rates_, rate_by_time_, rate_name);
    if (!why_not_affine_) in_time(guard_terms_, guard_by_time_, relation_name);
    if (why_not_affine_) return;

    matrix.insert(matrix.end(), guard_matrix.begin(), guard_matrix.end());
    const std::size_t first_value = 1 + equations_.states.size();
    const auto used = graph.variables_of(matrix);
    for (std::size_t i = first_value; i < inputs_.size(); ++i) {
        if (!std::binary_search(used.begin(), used.end(), inputs_[i])) continue;
        const std::size_t place = i - first_value;
        const bool is_relation = place >= value_place(0) && place < counter_value_place(0);
        (is_relation ? matrix_relations_ : matrix_values_).push_back(is_relation ? place - value_place(0) : place);
    }
}

void EquationSystem::make_blocks() {
    auto& graph = *equations_.graph;
    std::vector<Term> residuals;
    for (const std::size_t i : algebraic_) residuals.push_back(rates_[i]);
    algebraic_by_time_ = tape_of(graph.derivatives(residuals, equations_.time));
    for (const auto& places : algebraic_blocks(equations_)) {
        Block& block = blocks_.emplace_back();
        block.places = places;
        std::vector<Term> rows, columns, terms;
        for (const std::size_t i : places) {
            rows.push_back(rates_[i]);
            columns.push_back(equations_.states[i].symbol);
        }
        block.residuals = tape_of(rows);
        block.jacobian = sparse_jacobian(rows, columns, terms);
    }
}

void EquationSystem::compile(const CCompiler& compiler) {
    const std::array tapes = {&rate_, &jacobian_.tape, &guard_, &guard_jacobian_.tape, &output_, &condition_, &active_};
    std::size_t instructions = 0;
    std::string text = Tape::c_declarations();
    const auto name = [](std::size_t i) { return fmt::format("tape{}", i); };
    for (std::size_t i = 0; i < tapes.size(); ++i) {
        instructions += tapes[i]->instruction_count();
        if (instructions > max_compiled) {
            throw Error(fmt::format("{}: more than {} instructions, which a C compiler takes too long for",
                                    equations_.name, max_compiled));
        }
        text += tapes[i]->c_function(name(i));
    }
    const auto library = compiler.load(text);
    for (std::size_t i = 0; i < tapes.size(); ++i) {
        tapes[i]->use(reinterpret_cast<Tape::CFunction>(library->function(name(i))), library);
    }
}

SystemState EquationSystem::start_values(double t) const {
    auto values = std::make_unique<Memory>();
    std::vector<double> x;
    for (const auto& state : equations_.states) x.push_back(state.start);
    for (const auto& discrete : equations_.discrete) values->values.push_back(discrete.start);
    values->values.resize(before_value_place(befores_.size()));
    values->conditions.resize(conditions_.size());
    values->slack.resize(relations_.size());
    values->active.resize(relations_.size());
    return {t, std::move(x), std::move(values)};
}

SystemState EquationSystem::initial_state(double t) const {
    SystemState state = start_values(t);
    auto& memory = static_cast<Memory&>(*state.discrete);
    for (std::size_t i = 0; i < equations_.clocks.size(); ++i) {
        const auto& function = equations_.clocks[i].function;
        if (!function || !function->open) continue;
        memory.opened.resize(equations_.clocks.size());
        memory.opened[i] = function->open();
    }
    // A relation may stand in the operand of another; each pass sets one more of such a chain.
    std::vector<double> margins(relations_.size()), operands(counters_.size());
    for (std::size_t pass = 0; pass <= relations_.size(); ++pass) {
        bool changed = false;
        counted_.evaluate({std::span(&state.t, 1), state.x, memory.values}, operands);
        for (std::size_t i = 0; i < counters_.size(); ++i) {
            double& held = memory.values[counter_value_place(i)];
            changed = changed || held != std::floor(operands[i]);
            held = std::floor(operands[i]);
        }
        guard_.evaluate({std::span(&state.t, 1), state.x, memory.values}, margins);
        for (std::size_t i = 0; i < relations_.size(); ++i) {
            if (relations_[i].counter) continue; // never holds
            double& held = memory.values[value_place(i)];
            const double now = relations_[i].strict ? margins[i] > 0 : margins[i] >= 0;
            changed = changed || now != held;
            held = now;
        }
        if (!changed) break;
    }
    find_active(state);
    if (!algebraic_.empty()) {
        // So far of guesses.
        Instant& now = instant_of(state);
        take_anew(now, {});
        find_active(state);
    }
    std::vector<std::size_t> changed;
    begin_instant(state, changed);
    condition_.evaluate({std::span(&state.t, 1), state.x, memory.values}, memory.conditions);
    for (std::size_t i = 0; i < conditions_.size(); ++i) {
        if (!equations_.whens[i].at_start || memory.conditions[i] == 0) continue;
        memory.conditions[i] = 0;
        memory.unsettled = true;
    }
    return state;
}

void EquationSystem::derivative(double t, std::span<const double> x, const DiscreteState& d,
                                std::span<double> dxdt) const {
    rate_.evaluate({std::span(&t, 1), x, memory(d).values}, dxdt);
}

bool EquationSystem::rates(double t, std::span<const double> x, const DiscreteState& d, std::span<double> dxdt) const {
    derivative(t, x, d, dxdt);
    Rounding rounding;
    return algebraic_.empty() || algebraic_rates(t, x, memory(d), dxdt, rounding);
}

bool EquationSystem::jacobian(double t, std::span<const double> x, const DiscreteState& d,
                              std::span<double> matrix) const {
    WorkSpace<double, usual_size> memory(jacobian_.entries.size());
    const std::span<double> values(memory.data(), jacobian_.entries.size());
    sparse_jacobian(t, x, d, values);
    for (std::size_t i = 0; i < values.size(); ++i) {
        // An infinite slope, as that of a root at zero, would keep Newton's iteration where it is: without it, it goes on.
        const double slope = std::isfinite(values[i]) ? values[i] : 0;
        matrix[jacobian_.entries[i].column * variables_.size() + jacobian_.entries[i].row] = slope;
    }
    return true;
}

void EquationSystem::sparse_jacobian(double t, std::span<const double> x, const DiscreteState& d,
                                     std::span<double> entries) const {
    jacobian_.tape.evaluate({std::span(&t, 1), x, memory(d).values}, entries);
}

// Newton's method for the algebraic variables among x, block after block; why not, in a sentence: then x is as before.
std::optional<std::string> EquationSystem::solve_algebraic(double t, std::span<double> x, const Memory& held,
                                                           std::vector<double>& uncertain) const {
    using Eigen::Index;
    const std::vector<double> before(x.begin(), x.end());
    uncertain.resize(x.size());
    for (const Block& block : blocks_) {
        const std::size_t count = block.places.size();
        Eigen::VectorXd start(static_cast<Index>(count)), nominal(static_cast<Index>(count));
        for (std::size_t k = 0; k < count; ++k) {
            start(static_cast<Index>(k)) = x[block.places[k]];
            nominal(static_cast<Index>(k)) = variables_[block.places[k]].scale;
        }
        const auto put = [&](const Eigen::VectorXd& z) {
            for (std::size_t k = 0; k < count; ++k) x[block.places[k]] = z(static_cast<Index>(k));
        };
        const auto functions = [&](const Eigen::VectorXd& z, Eigen::VectorXd& f) {
            put(z);
            block.residuals.evaluate({std::span(&t, 1), x, held.values}, {f.data(), count});
        };
        const auto jacobian = [&](const Eigen::VectorXd& z, std::vector<double>& values) {
            put(z);
            block.jacobian.tape.evaluate({std::span(&t, 1), x, held.values}, values);
        };
        const Root root = find_root({functions, block.jacobian.entries, jacobian, nominal}, start);
        if (root.end == Root::End::found) {
            put(root.z);
            for (std::size_t k = 0; k < count; ++k) {
                double& off = uncertain[block.places[k]];
                off = std::max(off, root.uncertain(static_cast<Index>(k)));
            }
            continue;
        }
        std::vector<std::string> names;
        constexpr std::size_t most = 6;
        for (std::size_t k = 0; k < std::min(count, most); ++k) {
            const std::size_t i = block.places[k];
            names.push_back(fmt::format("{} = {:.4g}", variables_[i].name, x[i]));
        }
        if (count > most) names.emplace_back("...");
        std::copy(before.begin(), before.end(), x.begin());
        const auto& worst = equations_.states[block.places[static_cast<std::size_t>(root.worst)]];
        const std::string where = fmt::format("{}: at t = {:.9g} s", equations_.name, t);
        const std::string at = fmt::format("{}", fmt::join(names, ", "));
        switch (root.end) {
        case Root::End::not_finite:
            return fmt::format("{} {} is not a finite number at {}; other start values may help", where,
                               worst.equation_text(), at);
        case Root::End::singular:
            return fmt::format(
                "{} the algebraic equations do not determine their variables: their Jacobian is singular at {}, "
                "where {} is off by {:.3g}; other start values may help, or the system is of higher index",
                where, at, worst.equation_text(), root.residual);
        default:
            return fmt::format(
                "{} no solution of the algebraic equations is found: {} is off by {:.3g}, most of all, at "
                "{}; there may be none, or other start values may help",
                where, worst.equation_text(), root.residual, at);
        }
    }
    return std::nullopt;
}

// From dx/dt of the states those of algebraic variables, by the implicit function theorem; false: their Jacobian is singular.
bool EquationSystem::algebraic_rates(double t, std::span<const double> x, const Memory& held, std::span<double> dxdt,
                                     Rounding& rounding) const {
    using Eigen::Index;
    constexpr double relative = 1e-12; // of the terms of a rate
    std::vector<double> values(jacobian_.entries.size()), by_time(algebraic_.size());
    jacobian_.tape.evaluate({std::span(&t, 1), x, held.values}, values);
    algebraic_by_time_.evaluate({std::span(&t, 1), x, held.values}, by_time);
    rounding.value.assign(x.size(), 0);
    rounding.rate.assign(x.size(), 0);
    const auto count = static_cast<Index>(algebraic_.size());
    const auto number_of = [&](std::size_t i) {
        return static_cast<std::size_t>(std::lower_bound(algebraic_.begin(), algebraic_.end(), i) - algebraic_.begin());
    };
    Eigen::VectorXd change(count), terms(count), rounded(count), sizes(count);
    for (Index k = 0; k < count; ++k) {
        const std::size_t i = algebraic_[static_cast<std::size_t>(k)];
        change(k) = by_time[static_cast<std::size_t>(k)];
        terms(k) = std::abs(change(k));
        rounded(k) = std::abs(change(k) * t);
        sizes(k) = std::max(std::abs(x[i]), variables_[i].scale);
    }
    std::vector<MatrixPlace> places;
    std::vector<double> entries;
    for (std::size_t e = 0; e < values.size(); ++e) {
        const auto [row, column] = jacobian_.entries[e];
        if (!variables_[row].is_algebraic()) continue;
        const auto k = static_cast<Index>(number_of(row));
        rounded(k) += std::abs(values[e] * x[column]);
        if (variables_[column].is_algebraic()) {
            places.push_back({number_of(row), number_of(column)});
            entries.push_back(values[e]);
        } else {
            change(k) += values[e] * dxdt[column];
            terms(k) += std::abs(values[e] * dxdt[column]);
        }
    }
    const Factors factors(places, entries, sizes);
    if (factors.singular()) {
        for (const std::size_t i : algebraic_) {
            dxdt[i] = 0;
            rounding.value[i] = rounding.rate[i] = Interval::infinity;
        }
        return false;
    }
    const Eigen::VectorXd found = factors.solve(-change), off = factors.amplify(terms),
                          value_off = factors.amplify(rounded);
    for (Index k = 0; k < count; ++k) {
        const std::size_t i = algebraic_[static_cast<std::size_t>(k)];
        dxdt[i] = found(k);
        rounding.rate[i] = relative * off(k);
        rounding.value[i] = 2 * std::numeric_limits<double>::epsilon() * value_off(k);
    }
    return true;
}

void EquationSystem::guards(double t, std::span<const double> x, const DiscreteState& d, std::span<double> g) const {
    const Memory& held = memory(d);
    guard_.evaluate({std::span(&t, 1), x, held.values}, g.first(relations_.size()));
    const double* values = held.values.data() + equations_.discrete.size();
    for (std::size_t i = 0; i < relations_.size(); ++i) {
        const double margin = g[i], side = (values[i] != 0 ? margin : -margin) + held.slack[i];
        // A step that leaves where it has a value must not pass over it.
        g[i] = held.active[i] == 0 ? 1 : side == side ? side : -1;
    }
    if (has_endless_guard()) g.back() = held.restless || held.unsettled ? -1 : 1;
}

void EquationSystem::enclose_guards(const Enclosure& t, std::span<const Enclosure> x, const DiscreteState& d,
                                    std::span<Enclosure> g) const {
    const Memory& held = memory(d);
    guard_.enclose({{std::span(&t, 1), x}, held.values}, g.first(relations_.size()));
    const double* sides = held.values.data() + equations_.discrete.size();
    for (std::size_t i = 0; i < relations_.size(); ++i) {
        if (held.active[i] == 0) {
            g[i] = Enclosure::constant(1);
            continue;
        }
        auto& [value, rate] = g[i];
        if (sides[i] == 0) {
            value = {-value.high, -value.low};
            rate = {-rate.high, -rate.low};
        }
        value = {value.low + held.slack[i], value.high + held.slack[i]};
    }
    if (has_endless_guard()) g.back() = Enclosure::constant(held.restless ? -1 : 1);
}

void EquationSystem::find_active(SystemState& state) const {
    auto& memory = static_cast<Memory&>(*state.discrete);
    active_.evaluate({std::span(&state.t, 1), state.x, memory.values}, memory.active);
}

std::size_t EquationSystem::place_of(Term target) const {
    const auto found = std::find(inputs_.begin() + 1, inputs_.end(), target);
    if (found != inputs_.end()) return static_cast<std::size_t>(found - inputs_.begin());
    throw InputError(fmt::format("{}: {} is set, but is neither a state nor a discrete variable", equations_.name,
                                 equations_.graph->text(target)));
}

// Whether that changes anything.
bool EquationSystem::write(const std::vector<std::size_t>& places, std::span<const double> values, SystemState& state) {
    bool changed = false;
    const std::span<double> x = state.x, held = static_cast<Memory&>(*state.discrete).values;
    for (std::size_t i = 0; i < values.size(); ++i) {
        const std::size_t place = places[i] - 1;
        double& value = place < x.size() ? x[place] : held[place - x.size()];
        changed |= value != values[i];
        value = values[i];
    }
    return changed;
}

bool EquationSystem::carry_out(const Update& update, SystemState& state) const {
    if (update.targets.empty()) return false;
    WorkSpace<double, usual_size> memory_of_values(update.targets.size());
    const std::span<double> values(memory_of_values.data(), update.targets.size());
    update.tape.evaluate({std::span(&state.t, 1), state.x, memory(*state.discrete).values}, values);
    double sum = 0; // stays zero as long as all values are finite
    for (const double value : values) sum += 0 * value;
    if (sum != 0) {
        const auto i = static_cast<std::size_t>(
            std::ranges::find_if_not(values, [](double value) { return std::isfinite(value); }) - values.begin());
        throw InputError(fmt::format("{}: {} gets the value {} at t = {:.9g} s, must be finite", update.name,
                                     equations_.graph->name(inputs_[update.targets[i]]), values[i], state.t));
    }
    return write(update.targets, values, state);
}

// ---- an instant --------------------------------------------------------------------------------------------------

EquationSystem::Instant& EquationSystem::instant_of(SystemState& state) const {
    auto& memory = static_cast<Memory&>(*state.discrete);
    Instant& now = memory.instant.get();
    now.state = &state;
    now.memory = &memory;
    now.margins.resize(relations_.size());
    now.active = now.memory->active;
    now.crossed.assign(relations_.size(), Crossed::no);
    now.touched.assign(relations_.size(), false);
    now.turned.assign(relations_.size(), false);
    now.stale = everything;
    now.bounded_at.assign(relations_.size(), -1);
    now.moved = false;
    now.uncertain.assign(state.x.size(), 0);
    return now;
}

// Takes what is before the instant; the places in inputs_ of what has changed since the last one.
void EquationSystem::begin_instant(SystemState& state, std::vector<std::size_t>& changed) const {
    if (befores_.empty()) return;
    auto& values = static_cast<Memory&>(*state.discrete).values;
    WorkSpace<double, usual_size> memory_of_found(befores_.size());
    const std::span<double> found(memory_of_found.data(), befores_.size());
    before_.evaluate({std::span(&state.t, 1), state.x, values}, found);
    for (std::size_t i = 0; i < found.size(); ++i) {
        double& value = values[before_value_place(i)];
        if (value != found[i]) changed.push_back(1 + equations_.states.size() + before_value_place(i));
        value = found[i];
    }
}

void EquationSystem::mark_written(Instant& now, std::size_t place) const {
    now.stale |= seen_by_[place];
    if (moves_[place] != 0 || (seen_by_[place] & of_margins) != 0) ++now.writes;
}

void EquationSystem::look(Instant& now) const {
    const std::span time(&now.state->t, 1);
    if ((now.stale & of_margins) != 0) guard_.evaluate({time, now.state->x, now.memory->values}, now.margins);
    if ((now.stale & of_activity) != 0) active_.evaluate({time, now.state->x, now.memory->values}, now.active);
    now.stale &= of_conditions;
}

void EquationSystem::keep_active(Instant& now) const {
    look(now);
    now.memory->active = now.active;
}

// Solves for the algebraic variables with relations as they are held; how far each was off.
std::vector<double> EquationSystem::correct_algebraic(SystemState& state) const {
    std::vector<double> off(state.x.size()), uncertain;
    const std::vector<double> before = state.x;
    // Where there is no solution, a relation that is about to change may bring one.
    if (solve_algebraic(state.t, state.x, memory(*state.discrete), uncertain)) return off;
    for (const std::size_t i : algebraic_) off[i] = std::abs(state.x[i] - before[i]);
    return off;
}

// Solves for the algebraic variables. Relations that are then on the wrong side by more than is uncertain change, first all
// of them, then one at a time, the first one, which comes to an end where the solution is unique [Murty 1974]. Looks at
// margins.
void EquationSystem::make_consistent(Instant& now) const {
    if (algebraic_.empty()) return look(now);
    constexpr std::size_t together = 10;
    const std::size_t most = together + 50 + 20 * relations_.size();
    auto& list = now.list;
    const auto side_of = [&](std::size_t i) {
        return now.memory->values[value_place(i)] != 0 ? now.margins[i] : -now.margins[i];
    };
    for (std::size_t round = 0; round < most; ++round) {
        const auto problem = solve_algebraic(now.state->t, now.state->x, *now.memory, now.uncertain);
        if (problem) throw NoSolution(*problem);
        now.stale = everything;
        ++now.writes;
        look(now);
        list.clear();
        for (std::size_t i = 0; i < relations_.size(); ++i) {
            if (relations_[i].of_algebraic && now.active[i] != 0 && side_of(i) < 0) list.push_back(i);
        }
        if (list.empty()) return;
        enclose_margins(now, now.state->t, now.state->x, false, list);
        std::erase_if(list, [&](std::size_t i) {
            if (!now.bounds[i].value.contains(0)) return false;
            now.memory->slack[i] = std::max(now.memory->slack[i], -side_of(i));
            return true;
        });
        if (list.empty()) return;
        if (round >= together) list.erase(list.begin() + 1, list.end());
        for (const std::size_t i : list) {
            if (relations_[i].counter) {
                now.written.push_back(count(now, i));
                continue;
            }
            hold(now, i, now.memory->values[value_place(i)] == 0);
            now.written.push_back(held_place(i));
        }
    }
    std::vector<std::string> names;
    for (const std::size_t i : list) names.push_back(relations_[i].text);
    throw NoSolution(
        fmt::format("{}: at t = {:.9g} s the algebraic equations have no solution in any branch that was tried: "
                    "{} on the one side gives the other",
                    equations_.name, now.state->t, fmt::join(names, ", ")));
}

// dx/dt of all variables, and how far off they are by rounding.
void EquationSystem::find_rates(Instant& now, double t, std::span<const double> x) const {
    now.rates.resize(x.size());
    rate_.evaluate({std::span(&t, 1), x, now.memory->values}, now.rates);
    now.rounding.value.assign(x.size(), 0);
    now.rounding.rate.assign(x.size(), 0);
    if (!algebraic_.empty()) algebraic_rates(t, x, *now.memory, now.rates, now.rounding);
}

EquationSystem::BoundedMargin EquationSystem::make_bounded_margin(std::size_t relation) const {
    BoundedMargin bounded;
    bounded.margin = guard_.part(std::span(&relation, 1));
    const auto is_in = [&](const std::vector<std::size_t>& list) {
        return std::find(list.begin(), list.end(), relation) != list.end();
    };
    for (std::size_t j = 0; j < variables_.size(); ++j) {
        const bool is_operand = is_in(relations_of_[1 + j]);
        if (is_operand) bounded.states.push_back(j);
        if (is_operand || is_in(moved_relations_of_[1 + j])) bounded.sources.push_back(j);
    }
    bounded.rates = rate_.part(bounded.states);
    bounded.rates_of_sources = rate_.part(bounded.sources);
    return bounded;
}

const EquationSystem::BoundedMargin& EquationSystem::bounded_margin(Instant& now, std::size_t relation) const {
    if (!bounded_margins_.empty()) return bounded_margins_[relation];
    now.bounded.resize(relations_.size());
    auto& made = now.bounded[relation];
    if (!made) made = std::make_unique<const BoundedMargin>(make_bounded_margin(relation));
    return *made;
}

// The margins of these relations up to rounding of their terms, of the states and of the time: the states also move within it.
// With their rates of change, rounding of dx/dt included.
void EquationSystem::enclose_margins(Instant& now, double t, std::span<const double> x, bool with_rates,
                                     std::span<const std::size_t> relations) const {
    constexpr std::size_t few = 4; // relations: of more, all are bounded together
    const bool apart = relations.size() <= few;
    const double ulps = 2 * std::numeric_limits<double>::epsilon(), t_rounding = ulps * std::abs(t);
    const auto about = [](double value, double rounding) { return Interval{value - rounding, value + rounding}; };
    const Enclosure time = {about(t, t_rounding), {1, 1}};
    now.inputs.resize(x.size());
    now.rate_bounds.resize(x.size());
    now.bounds.resize(relations_.size());
    const auto set_input = [&](std::size_t j, double rate, double uncertain) {
        const double off = ulps * std::abs(x[j]) + t_rounding * std::abs(rate);
        now.inputs[j] = {about(x[j], off + uncertain), {0, 0}};
    };
    if (!apart || !algebraic_.empty()) {
        find_rates(now, t, x);
        for (std::size_t j = 0; j < x.size(); ++j) {
            set_input(j, now.rates[j], now.uncertain[j] + now.rounding.value[j]);
        }
    }
    const std::span states(now.inputs);
    const Tape::EnclosedInputs inputs{{std::span(&time, 1), states}, std::span<const double>(now.memory->values)};
    const auto set_rate = [&](std::size_t j, Interval rate) {
        states[j].rate = variables_[j].is_algebraic() ? about(now.rates[j], now.rounding.rate[j]) : rate;
    };
    for (const std::size_t relation : relations) now.bounded_at[relation] = now.writes;
    if (apart) {
        for (const std::size_t relation : relations) {
            const BoundedMargin& bounded = bounded_margin(now, relation);
            if (algebraic_.empty()) {
                const auto& read = with_rates ? bounded.sources : bounded.states;
                const Tape& rates = with_rates ? bounded.rates_of_sources : bounded.rates;
                WorkSpace<double, usual_size> memory_of_rates(read.size());
                const std::span<double> values(memory_of_rates.data(), read.size());
                rates.evaluate({std::span(&t, 1), x, now.memory->values}, values);
                for (std::size_t i = 0; i < read.size(); ++i) set_input(read[i], values[i], 0);
            }
            if (with_rates) bounded.rates.enclose(inputs, now.rate_bounds);
            for (std::size_t i = 0; with_rates && i < bounded.states.size(); ++i) {
                set_rate(bounded.states[i], now.rate_bounds[i].value);
            }
            bounded.margin.enclose(inputs, std::span(&now.bounds[relation], 1));
        }
        return;
    }
    if (with_rates) rate_.enclose(inputs, now.rate_bounds);
    for (std::size_t j = 0; with_rates && j < x.size(); ++j) set_rate(j, now.rate_bounds[j].value);
    guard_.enclose(inputs, now.bounds);
}

// Its guard begins at zero or above.
void EquationSystem::hold(Instant& now, std::size_t relation, bool holds) const {
    double& held = now.memory->values[value_place(relation)];
    if ((held != 0) != holds) {
        now.moved = now.moved || moves_[held_place(relation)] != 0;
        mark_written(now, held_place(relation));
    }
    held = holds;
    const double side = holds ? now.margins[relation] : -now.margins[relation];
    now.memory->slack[relation] = side < 0 ? -side : 0;
}

// A floor's operand has left the value that is held: counts on, at least by one. The place of the counter in inputs_.
std::size_t EquationSystem::count(Instant& now, std::size_t relation) const {
    const auto& [counter, step] = std::pair(*relations_[relation].counter, relations_[relation].step);
    now.operands.resize(counters_.size());
    counted_.evaluate({std::span(&now.state->t, 1), now.state->x, now.memory->values}, now.operands);
    double& value = now.memory->values[counter_value_place(counter)];
    const double below = std::floor(now.operands[counter]);
    value = step > 0 ? std::max(value + 1, below) : std::min(value - 1, below);
    const std::size_t place = 1 + equations_.states.size() + counter_value_place(counter);
    now.moved = now.moved || moves_[place] != 0;
    mark_written(now, place);
    return place;
}

// Compares anew, as they are written, the relations whose operands were changed and those that have come to matter; and
// those whose operands have a branch on one of them.
void EquationSystem::take_anew(Instant& now, std::span<const std::size_t> written) const {
    now.written.assign(written.begin(), written.end());
    for (std::size_t pass = 0; pass <= relations_.size(); ++pass) {
        now.margins_before = now.margins;
        now.active_before = now.active;
        make_consistent(now);
        auto& list = now.list;
        list.clear();
        now.counted.clear();
        for (const std::size_t place : now.written) {
            for (const std::size_t i : moved_relations_of_[place]) now.turned[i] = true;
            for (const std::size_t i : relations_of_[place]) {
                now.touched[i] = true;
                // What has crossed may have been put where it is.
                if (now.margins[i] == now.margins_before[i] && now.crossed[i] == Crossed::no) continue;
                list.push_back(i);
                now.counted.push_back(relations_[i].counter &&
                                      place == held_place(relations_.size() + *relations_[i].counter));
            }
        }
        for (std::size_t i = 0; i < relations_.size(); ++i) {
            if (now.active_before[i] == 0 && now.active[i] != 0) list.push_back(i);
        }
        now.counted.resize(list.size());
        if (list.empty()) return;
        const bool exact = std::all_of(list.begin(), list.end(), [&](std::size_t i) { return now.margins[i] == 0; });
        if (!exact) enclose_margins(now, now.state->t, now.state->x, false, list);
        now.written.clear();
        for (std::size_t n = 0; n < list.size(); ++n) {
            const std::size_t i = list[n];
            const bool is_zero = exact || now.bounds[i].value.contains(0);
            const double margin = is_zero ? 0 : now.margins[i];
            // Put onto a whole number, the operand is there; come there from below, it is still on its way.
            const bool is_put = relations_[i].step > 0 && now.counted[n] == 0;
            const bool holds = relations_[i].strict && !is_put ? margin > 0 : margin >= 0;
            if (relations_[i].counter && holds) {
                now.written.push_back(count(now, i));
                continue;
            }
            const bool held = now.memory->values[value_place(i)] != 0;
            hold(now, i, holds);
            if (holds != held) now.written.push_back(held_place(i));
        }
        if (now.written.empty()) return;
    }
}

// Carries out what has become true, one `when` after the other, until nothing does; `fired`: their places.
void EquationSystem::settle(Instant& now, std::vector<int>& fired) const {
    auto& memory = *now.memory;
    now.conditions.resize(conditions_.size());
    for (int round = 0; round < max_rounds; ++round) {
        if ((now.stale & of_conditions) != 0) {
            condition_.evaluate({std::span(&now.state->t, 1), now.state->x, memory.values}, now.conditions);
            now.stale &= of_margins | of_activity;
        }
        std::optional<std::size_t> due;
        for (std::size_t i = 0; i < now.conditions.size(); ++i) {
            if (now.conditions[i] == 0)
                memory.conditions[i] = 0;
            else if (memory.conditions[i] == 0 && !due)
                due = i;
        }
        if (!due) return;
        memory.conditions[*due] = 1;
        memory.stopped = memory.stopped || equations_.whens[*due].stop;
        const Update& update = when_updates_[*due];
        if (carry_out(update, *now.state)) {
            now.moved = now.moved || update.moves;
            now.stale |= update.seen_by;
            ++now.writes;
        }
        fired.push_back(static_cast<int>(*due));
        take_anew(now, update.targets);
    }
    memory.restless = true;
    memory.fired.assign(fired.end() - std::min<std::ptrdiff_t>(std::ssize(fired), 3), fired.end());
}

// The rate of change of a margin a little later, where it is zero now.
Interval EquationSystem::rate_ahead(Instant& now, std::size_t relation) const {
    constexpr double part = 1e-6; // of the states, or of what they are nominally
    const auto& x = now.state->x;
    find_rates(now, now.state->t, x);
    double time = Interval::infinity;
    for (std::size_t j = 0; j < x.size(); ++j) {
        if (now.rates[j] == 0) continue;
        time = std::min(time, part * (std::abs(x[j]) + variables_[j].scale) / std::abs(now.rates[j]));
    }
    if (!(time < Interval::infinity)) return {0, 0};
    now.ahead = x;
    for (std::size_t j = 0; j < x.size(); ++j) now.ahead[j] += time * now.rates[j];
    enclose_margins(now, now.state->t + time, now.ahead, true, std::span(&relation, 1));
    return now.bounds[relation].rate;
}

// Relations that have just crossed and which the motion now leaves again are held on the side they came from, and so are
// those on which it rests under a push, where that is what has been carried out. Whether there are such.
bool EquationSystem::turn_back(Instant& now, std::span<const GuardId> guards) const {
    bool any = false;
    look(now);
    auto& list = now.list;
    list.clear();
    for (const GuardId i : guards) {
        if (now.crossed[i] == Crossed::no || now.active[i] == 0 || !(now.touched[i] || now.turned[i])) continue;
        // Mostly what has been carried out has put it elsewhere, which was seen when it was taken anew.
        const bool known = now.bounded_at[i] == now.writes;
        if (known && now.touched[i] && !now.bounds[i].value.contains(0)) continue;
        list.push_back(i);
    }
    if (list.empty()) return false;
    enclose_margins(now, now.state->t, now.state->x, true, list);
    now.after = now.bounds;
    for (const GuardId i : list) {
        if (now.touched[i] && !now.after[i].value.contains(0)) continue;
        const bool holds = now.crossed[i] == Crossed::to_hold;
        const auto inward = [&](Interval rate) { return holds ? rate : Interval{-rate.high, -rate.low}; };
        const Interval rate = inward(now.after[i].rate);
        const bool leaves = rate.high < 0;
        const bool rests = rate.contains(0) && rate.high < Interval::infinity;
        if (!leaves && !(rests && inward(rate_ahead(now, i)).low > 0)) continue;
        hold(now, i, !holds);
        any = true;
    }
    if (any && !algebraic_.empty()) take_anew(now, {});
    return any;
}

EventEffect EquationSystem::on_crossing(GuardId guard, SystemState& state, EventLog& log) const {
    return on_crossings(std::span(&guard, 1), state, log);
}

// The instant of a crossing is known to rounding only, and conditions that are read as they are written must be those of after it:
// the state moves on, by rounding, until its guards are below zero, or as many of them as come there.
void EquationSystem::move_beyond(std::span<const GuardId> guards, SystemState& state) const {
    using limits = std::numeric_limits<double>;
    constexpr double most = 4096; // units in the last place of the time
    const double t = state.t, unit = limits::epsilon() * std::abs(t) + limits::min();
    const std::vector<double> x = state.x;
    std::vector<double> rate(x.size()), margins(guard_count());
    if (!rates(t, x, *state.discrete, rate)) return;
    const auto move = [&](double later) {
        state.t = t + later;
        for (std::size_t i = 0; i < x.size(); ++i) state.x[i] = x[i] + later * rate[i];
    };
    double best = 0;
    std::ptrdiff_t most_below = 0;
    for (double ulps = 0; ulps <= most && most_below < std::ssize(guards); ulps = std::max(1.0, 2 * ulps)) {
        move(ulps * unit);
        this->guards(state.t, state.x, *state.discrete, margins);
        const auto below = std::ranges::count_if(guards, [&](GuardId guard) { return margins[guard] < 0; });
        if (below <= most_below) continue;
        most_below = below;
        best = ulps * unit;
    }
    move(best);
}

EventEffect EquationSystem::on_crossings(std::span<const GuardId> guards, SystemState& state, EventLog& log) const {
    if (reads_conditions_) move_beyond(guards, state);
    if (equations_.sensitivities.empty()) return carry_out_crossings(guards, state, log);
    // The derivatives of the state at the event, whose time moves too, change as what is set; dx/dp = D x/dp - dx/dt dt/dp.
    const std::size_t n = equations_.own_states(), fired = log.size();
    auto& values = static_cast<Memory&>(*state.discrete).values;
    std::vector<double> before(state.x.size()), after(state.x.size());
    rates(state.t, state.x, *state.discrete, before);
    const EventShift shift = shift_of(guards, state, before);
    const std::vector<double> x = state.x;
    const auto move = [&](const std::vector<double>& rate, double sign) {
        for (std::size_t p = 0; p < shift.by.size(); ++p) {
            double* s = state.x.data() + equations_.sensitivities[p].states;
            for (std::size_t i = 0; i < n && shift.by[p] != 0; ++i) s[i] += sign * rate[i] * shift.by[p];
        }
    };
    const auto set_instant = [&](bool moving) {
        for (std::size_t p = 0; p < shift.by.size(); ++p) {
            values[equations_.sensitivities[p].instant] = moving ? shift.by[p] : 0;
        }
    };
    move(before, 1);
    set_instant(true);
    const EventEffect effect = carry_out_crossings(guards, state, log);
    set_instant(false);
    rates(state.t, state.x, *state.discrete, after);
    const auto own = [&](const std::vector<double>& all) { return std::span(all).first(n); };
    if (log.size() == fired && std::ranges::equal(own(before), own(after)) &&
        std::ranges::equal(own(x), own(state.x))) {
        std::copy(x.begin() + static_cast<std::ptrdiff_t>(n), x.end(),
                  state.x.begin() + static_cast<std::ptrdiff_t>(n));
        return effect;
    }
    if (!shift.problem.empty()) throw NoSolution(shift.problem);
    move(after, -1);
    if (!algebraic_.empty()) {
        std::vector<double> uncertain;
        if (const auto problem = solve_algebraic(state.t, state.x, memory(*state.discrete), uncertain)) {
            throw NoSolution(*problem);
        }
    }
    return EventEffect::restart;
}

// How the instant at which the relations cross moves with each parameter.
EquationSystem::EventShift EquationSystem::shift_of(std::span<const GuardId> guards, const SystemState& state,
                                                    std::span<const double> rates) const {
    constexpr double rounding = 64 * std::numeric_limits<double>::epsilon();
    constexpr double same = 1e-6; // relative: of one instant, for which conditions are written in several ways
    const auto& all = equations_.sensitivities;
    EventShift shift{std::vector<double>(all.size()), {}};
    const Memory& held = memory(*state.discrete);
    std::optional<GuardId> first;
    std::vector<double> values;
    for (const GuardId guard : guards) {
        if (guard >= relations_.size()) continue;
        const RelationRate& relation = relation_rates_[guard];
        values.resize(relation.tape.output_count());
        relation.tape.evaluate({std::span(&state.t, 1), state.x, held.values}, values);
        double rate = values[0], size = std::abs(values[0]);
        for (std::size_t i = 0; i < relation.states.size(); ++i) {
            const double part = values[1 + i] * rates[relation.states[i]];
            rate += part;
            size += std::abs(part);
        }
        // The guard falls.
        const bool crosses = (held.values[value_place(guard)] != 0 ? -rate : rate) > rounding * size;
        const double* moved = values.data() + 1 + relation.states.size();
        for (std::size_t p = 0; p < all.size(); ++p) {
            const double by = moved[p] == 0 ? 0 : -moved[p] / rate;
            if (moved[p] != 0 && !crosses) {
                shift.problem = fmt::format(
                    "{} touches zero at t = {:.9g} s without crossing it, which changes the motion: there the run has "
                    "no derivative by {}",
                    guard_name(guard, state), state.t, all[p].name);
                continue;
            }
            if (first && std::abs(by - shift.by[p]) > same * std::max(std::abs(by), std::abs(shift.by[p]))) {
                shift.problem = fmt::format("{} and {} change at one instant, t = {:.9g} s, and come apart with {}: "
                                            "there the run has no derivative by it",
                                            guard_name(*first, state), guard_name(guard, state), state.t, all[p].name);
            }
            if (!first) shift.by[p] = by;
        }
        if (!first) first = guard;
    }
    return shift;
}

EventEffect EquationSystem::carry_out_crossings(std::span<const GuardId> guards, SystemState& state,
                                                EventLog& log) const {
    Instant& now = instant_of(state);
    const bool of_relations = guards.empty() || guards.back() < relations_.size();
    if (!of_relations && !now.memory->unsettled) return EventEffect::none; // restless: the run ends
    now.memory->unsettled = false;
    if (!of_relations) guards = guards.first(guards.size() - 1);
    auto& fired = now.fired;
    auto& places = now.places;
    fired.clear();
    places.clear();
    if (!algebraic_.empty()) {
        now.uncertain = correct_algebraic(state);
        now.moved = true;
    }
    const bool may_turn = std::any_of(guards.begin(), guards.end(), [&](GuardId i) { return may_turn_[i] != 0; });
    look(now);
    if (may_turn) enclose_margins(now, state.t, state.x, true, guards);
    begin_instant(state, places);
    for (const std::size_t place : places) mark_written(now, place);
    for (const GuardId i : guards) {
        const bool holds = now.memory->values[value_place(i)] == 0;
        // Below zero by rounding, while the motion leads away: that is no crossing.
        const double zero = (holds ? 1 : -1) * now.memory->slack[i]; // of the guard
        if (may_turn_[i] != 0 && now.bounds[i].value.contains(zero) &&
            (holds ? now.bounds[i].rate.high < 0 : now.bounds[i].rate.low > 0)) {
            hold(now, i, !holds);
            continue;
        }
        if (relations_[i].counter) {
            places.push_back(count(now, i));
            continue;
        }
        hold(now, i, holds);
        now.crossed[i] = holds ? Crossed::to_hold : Crossed::to_fail;
        places.push_back(held_place(i));
    }
    // They may be in the operands of others, or open branches with relations of their own.
    take_anew(now, places);
    settle(now, fired);
    if (may_turn && !fired.empty() && turn_back(now, guards)) settle(now, fired);
    for (const int when : fired) log.push_back({state.t, when, 0});
    keep_active(now);
    return now.moved ? EventEffect::restart : EventEffect::guards;
}

EventEffect EquationSystem::on_sample(ClockId clock, long k, SystemState& state) const {
    auto& memory = static_cast<Memory&>(*state.discrete);
    const bool to_events = reach_[clock].events;
    // A function that is called may run systems of its own, so what is kept meanwhile is this sample's.
    std::vector<double> before, uncertain; // of algebraic variables
    if (to_events && !algebraic_.empty()) {
        before = state.x;
        uncertain = correct_algebraic(state);
    }
    std::vector<double> looked(to_events ? relations_.size() : 0);
    if (to_events) guard_.evaluate({std::span(&state.t, 1), state.x, memory.values}, looked);
    std::vector<std::size_t> targets;
    if (to_events) begin_instant(state, targets);
    const Update& update = clock_updates_[clock];
    bool changed = carry_out(update, state);
    const auto& call = calls_[clock];
    if (call) {
        WorkSpace<double, usual_size> memory_of_read(call->reads.output_count()),
            memory_of_written(call->targets.size());
        const std::span<double> read(memory_of_read.data(), call->reads.output_count()),
            written(memory_of_written.data(), call->targets.size());
        std::ranges::fill(written, 0.0);
        if (!read.empty()) call->reads.evaluate({std::span(&state.t, 1), state.x, memory.values}, read);
        const auto& function = *equations_.clocks[clock].function;
        (function.open ? memory.opened[clock] : function.call)(k, read, written);
        changed = write(call->targets, written, state) || changed;
    }
    memory.fired.clear();
    if (to_events) {
        Instant& now = instant_of(state);
        now.margins = looked;
        if (!uncertain.empty()) now.uncertain = uncertain;
        targets.insert(targets.end(), update.targets.begin(), update.targets.end());
        if (call) targets.insert(targets.end(), call->targets.begin(), call->targets.end());
        take_anew(now, targets);
        settle(now, memory.fired);
        keep_active(now);
        changed = changed || !memory.fired.empty() || memory.restless;
    }
    if (!changed) {
        if (!before.empty()) state.x = before; // algebraic variables as the solver has them
        return EventEffect::none;
    }
    if (to_events) return EventEffect::restart;
    return reach_[clock].motion ? EventEffect::derivative : EventEffect::none;
}

// The entries of A and G are constant between events: any state gives them.
AffineForm EquationSystem::affine_form(const DiscreteState& d) const {
    const std::size_t n = variables_.size();
    AffineForm form{std::vector<double>(n * n), std::vector<double>(guard_count() * n), {}, {}};
    put_matrix(jacobian_, n, memory(d), form.a);
    put_matrix(guard_jacobian_, guard_count(), memory(d), form.g);
    return form;
}

void EquationSystem::put_matrix(const Sparse& sparse, std::size_t rows, const Memory& held,
                                std::span<double> matrix) const {
    const double t = 0;
    const std::vector<double> x(variables_.size());
    std::vector<double> values(sparse.entries.size());
    sparse.tape.evaluate({std::span(&t, 1), x, held.values}, values);
    for (std::size_t i = 0; i < values.size(); ++i) {
        matrix[sparse.entries[i].column * rows + sparse.entries[i].row] = values[i];
    }
}

// A relation that does not matter is the same, whatever its value is: two bits each.
void EquationSystem::append_affine_key(const DiscreteState& d, AffineKey& key) const {
    const Memory& held = memory(d);
    for (const std::size_t place : matrix_values_) key.push_back(std::bit_cast<std::uint64_t>(held.values[place]));
    constexpr std::size_t in_a_word = 32;
    std::uint64_t word = 0;
    for (std::size_t i = 0; i < matrix_relations_.size(); ++i) {
        const std::size_t relation = matrix_relations_[i];
        const bool holds = held.values[value_place(relation)] != 0;
        word = 4 * word + (held.active[relation] == 0 ? 0 : holds ? 2 : 1);
        if (i % in_a_word == in_a_word - 1 || i + 1 == matrix_relations_.size()) key.push_back(std::exchange(word, 0));
    }
}

void EquationSystem::rate_coefficient(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                                      std::span<double> coefficient) const {
    affine_coefficient(jacobian_, rate_by_time_, n, t0, h, c, d, coefficient);
}

void EquationSystem::guard_coefficient(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                                       std::span<double> coefficient) const {
    if (has_endless_guard()) coefficient.back() = 0;
    affine_coefficient(guard_jacobian_, guard_by_time_, n, t0, h, c, d, coefficient.first(relations_.size()));
}

// A c + b^(n)(t0) h^n/n!.
void EquationSystem::affine_coefficient(const Sparse& matrix, const std::vector<Tape>& by_time, int n, double t0,
                                        double h, std::span<const double> c, const DiscreteState& d,
                                        std::span<double> coefficient) const {
    std::fill(coefficient.begin(), coefficient.end(), 0.0);
    if (n <= max_degree) {
        by_time[static_cast<std::size_t>(n) - 1].evaluate({std::span(&t0, 1), c, memory(d).values}, coefficient);
        double factor = 1;
        for (int i = 1; i <= n; ++i) factor *= h / i;
        for (double& value : coefficient) value *= factor;
    }
    WorkSpace<double, usual_size> memory_of_values(matrix.entries.size());
    const std::span<double> values(memory_of_values.data(), matrix.entries.size());
    matrix.tape.evaluate({std::span(&t0, 1), c, memory(d).values}, values);
    for (std::size_t i = 0; i < values.size(); ++i) {
        coefficient[matrix.entries[i].row] += values[i] * c[matrix.entries[i].column];
    }
}

std::string EquationSystem::guard_name(GuardId guard, const SystemState& state) const {
    const auto names = [&](const auto& whens) {
        std::string list;
        for (const auto w : whens) list += (list.empty() ? "" : ", ") + when_updates_[static_cast<std::size_t>(w)].name;
        return list;
    };
    if (guard >= relations_.size()) {
        return fmt::format("the cascade of events ({}) at one instant", names(memory(*state.discrete).fired));
    }
    const auto& relation = relations_[guard];
    std::vector<double> margins(relations_.size());
    guard_.evaluate({std::span(&state.t, 1), state.x, memory(*state.discrete).values}, margins);
    if (std::isnan(margins[guard])) return fmt::format("the relation {}, which has no value there,", relation.text);
    return fmt::format("the relation {}{}", relation.text,
                       relation.whens.empty() ? "" : fmt::format(" ({})", names(relation.whens)));
}

void EquationSystem::outputs(const SystemState& state, std::span<double> y) const {
    output_.evaluate({std::span(&state.t, 1), state.x, memory(*state.discrete).values}, y);
}

std::span<const double> EquationSystem::discrete(const SystemState& state) const {
    return std::span(memory(*state.discrete).values).first(equations_.discrete.size());
}

std::span<double> EquationSystem::discrete_values(SystemState& state) const {
    return std::span(static_cast<Memory&>(*state.discrete).values).first(equations_.discrete.size());
}

std::vector<std::pair<const char*, std::vector<double>*>> EquationSystem::lists_of(Memory& memory) {
    return {{"values", &memory.values}, {"conditions", &memory.conditions}, {"slack", &memory.slack}};
}

EquationSystem::Snapshot EquationSystem::snapshot(const SystemState& state) const {
    SystemState copy = state;
    Snapshot made{{"t", {state.t}}, {"x", state.x}, {"samples", {}}};
    for (const long k : state.next_sample) made["samples"].push_back(static_cast<double>(k));
    for (const auto& [name, list] : lists_of(static_cast<Memory&>(*copy.discrete))) made[name] = *list;
    return made;
}

SystemState EquationSystem::restored(const Snapshot& snapshot) const {
    const auto read = [&](const char* name, std::vector<double>& list) {
        const auto found = snapshot.find(name);
        const std::size_t count = found == snapshot.end() ? 0 : found->second.size();
        if (count != list.size()) {
            throw InputError(fmt::format("{}: the state of the run has {} numbers in {}, must have {}", equations_.name,
                                         count, name, list.size()));
        }
        if (count > 0) list = found->second;
    };
    for (const auto& clock : equations_.clocks) {
        if (!clock.function || !clock.function->open) continue;
        throw InputError(
            fmt::format("{}: a run cannot be continued where a block has memory of its own, as that of {} has",
                        equations_.name, clock.name));
    }
    SystemState state = start_values(0);
    std::vector<double> time(1), samples(clocks_.size());
    read("t", time);
    read("x", state.x);
    read("samples", samples);
    state.t = time[0];
    const bool finite = std::isfinite(state.t) &&
                        std::all_of(state.x.begin(), state.x.end(), [](double x) { return std::isfinite(x); });
    if (!finite) {
        throw InputError(
            fmt::format("{}: the state of the run is not finite, so it cannot be continued", equations_.name));
    }
    for (const double k : samples) state.next_sample.push_back(std::lround(k));
    for (const auto& [name, list] : lists_of(static_cast<Memory&>(*state.discrete))) read(name, *list);
    find_active(state);
    return state;
}

} // namespace tribode
