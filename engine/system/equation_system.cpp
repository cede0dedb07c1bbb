#include "system/equation_system.hpp"
#include "base/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

// The end of a chain, for messages: long expressions are cut.
std::string shortened(std::string text) {
    constexpr std::size_t longest = 60;
    return text.size() <= longest ? text : text.substr(0, longest - 3) + "...";
}

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
    put_in_parameters();
    hold_relations();
    mark_active();
    join_clocks();
    make_tapes();
    recognize_affine();
}

// From here on the equations hold no parameters and no inputs.
void EquationSystem::put_in_parameters() {
    auto& graph = *equations_.graph;
    Expressions::Replacement numbers;
    for (const auto& parameter : equations_.parameters) numbers[parameter.symbol] = graph.constant(parameter.value);
    for (const auto& input : equations_.inputs) numbers[input.symbol] = graph.constant(input.value);
    equations_.replace(numbers);
}

// Finds the relations that are events and puts a held value in the place of each.
void EquationSystem::hold_relations() {
    auto& graph = *equations_.graph;
    std::vector<Term> roots;
    for (const auto& state : equations_.states) roots.push_back(state.rate);
    for (const auto& when : equations_.whens) roots.push_back(when.condition);

    const auto order = graph.reachable(roots, false);
    const auto moving = moving_terms(order);
    for (std::size_t i = 0; i < roots.size(); ++i) {
        for (const Term term : graph.reachable(std::span(&roots[i], 1), false)) {
            if (graph[term].op != Op::floor || !moving.contains(term)) continue;
            const bool is_rate = i < equations_.states.size();
            const auto& state = equations_.states[is_rate ? i : 0];
            throw InputError(fmt::format(
                "{}: {} has {}, which jumps between events; count in a discrete variable that a `when` or a sample "
                "clock changes, or put it below tb.no_event",
                equations_.name,
                is_rate ? "der(" + state.name + ")" + (state.where.empty() ? "" : " (" + state.where + ")")
                        : "the condition of " + equations_.whens[i - equations_.states.size()].name,
                shortened(graph.text(term))));
        }
    }
    // The same relation may stand below no_event and elsewhere; there it stays as it is.
    Expressions::Replacement held;
    for (const Term term : order) {
        const auto node = graph[term];
        if (node.op == Op::no_event) held[term] = term;
        const bool relation = node.op == Op::less || node.op == Op::less_equal;
        if (!relation || !moving.contains(term)) continue;
        Relation made;
        made.text = shortened(graph.text(term));
        made.held = graph.variable("(" + made.text + ")");
        made.margin = graph.make(Op::subtract, node.b, node.a);
        made.strict = node.op == Op::less;
        held[term] = made.held;
        relations_.push_back(std::move(made));
    }
    roots = graph.substitute(roots, held);
    rates_.assign(roots.begin(), roots.begin() + static_cast<std::ptrdiff_t>(equations_.states.size()));
    conditions_.assign(roots.begin() + static_cast<std::ptrdiff_t>(equations_.states.size()), roots.end());
    // An operand may itself have a branch.
    std::vector<Term> margins;
    for (const auto& relation : relations_) margins.push_back(relation.margin);
    margins = graph.substitute(margins, held);
    for (std::size_t i = 0; i < relations_.size(); ++i) relations_[i].margin = margins[i];
    for (auto& relation : relations_) {
        const Term opposite = graph.make(Op::negate, relation.margin);
        for (std::size_t i = 0; i < relations_.size(); ++i) {
            if (&relations_[i] == &relation) continue;
            if (margins[i] == relation.margin) relation.twins.emplace_back(i, true);
            if (margins[i] == opposite) relation.twins.emplace_back(i, false);
        }
    }
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
            open(node.c, graph.make(Op::all, here, graph.make(Op::no, node.a)));
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

EquationSystem::Sparse EquationSystem::sparse_jacobian(const std::vector<Term>& rows, std::vector<Term>& terms) {
    auto& graph = *equations_.graph;
    Sparse sparse;
    terms.clear();
    for (std::size_t column = 0; column < equations_.states.size(); ++column) {
        const auto derivatives = graph.derivatives(rows, equations_.states[column].symbol);
        for (std::size_t row = 0; row < rows.size(); ++row) {
            if (graph.is_constant(derivatives[row], 0)) continue;
            sparse.entries.push_back({row, column});
            terms.push_back(derivatives[row]);
        }
    }
    sparse.tape = tape_of(terms);
    return sparse;
}

EquationSystem::Update EquationSystem::update_of(const std::string& name, const Equations::Assignments& set) const {
    Update update{name, {}, {}};
    std::vector<Term> values;
    for (const auto& [target, value] : set) {
        update.targets.push_back(place_of(target));
        values.push_back(value);
    }
    update.tape = tape_of(values);
    return update;
}

// What each clock can change; and neighbours that always meet and cause no event become one.
void EquationSystem::join_clocks() {
    auto& graph = *equations_.graph;
    std::vector<Term> moving = rates_, watched = conditions_;
    for (const auto& relation : relations_) {
        watched.push_back(relation.margin);
        watched.push_back(relation.active);
    }
    const auto of_motion = graph.variables_of(moving), of_events = graph.variables_of(watched);
    const auto of_conditions = graph.variables_of(conditions_);
    const auto is_in = [](const std::vector<Term>& variables, Term term) {
        return std::binary_search(variables.begin(), variables.end(), term);
    };
    const auto is_state = [&](Term term) {
        return std::any_of(equations_.states.begin(), equations_.states.end(),
                           [&](const auto& state) { return state.symbol == term; });
    };
    // A condition below no_event is looked at whenever it can be.
    const bool polled = std::any_of(of_conditions.begin(), of_conditions.end(),
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
            std::erase_if(first.set, [&](const auto& set) { return set.first == target; });
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
        // Where a rate is a state itself, as a velocity is.
        for (std::size_t i = 0; i < equations_.states.size(); ++i) {
            if (equations_.states[i].symbol == state.rate) variable.rate = i;
        }
        variables_.push_back(std::move(variable));
    }
    for (const auto& discrete : equations_.discrete) inputs_.push_back(discrete.symbol);
    for (const auto& relation : relations_) inputs_.push_back(relation.held);

    rate_ = tape_of(rates_);
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
    terms.insert(terms.end(), active.begin(), active.end());
    margin_ = tape_of(terms);
    for (const auto& when : equations_.whens) when_updates_.push_back(update_of(when.name, when.set));
    for (const auto& clock : equations_.clocks) {
        clock_updates_.push_back(update_of(clock.name, clock.set));
        auto& call = calls_.emplace_back();
        if (!clock.function) continue;
        call.emplace();
        for (const Term target : clock.function->writes) call->targets.push_back(place_of(target));
        call->reads = tape_of(clock.function->reads);
    }
}

void EquationSystem::recognize_affine() {
    auto& graph = *equations_.graph;
    std::vector<Term> matrix, guard_matrix;
    jacobian_ = sparse_jacobian(rates_, matrix);
    guard_jacobian_ = sparse_jacobian(guard_terms_, guard_matrix);

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
                if (!jumps || !moves(term)) continue;
                why_not_affine_ =
                    fmt::format("{} jumps with {}, which is no event", name(row), shortened(graph.text(term)));
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
        for (int n = 1; n <= most_degree + 1 && !why_not_affine_; ++n) {
            rows = graph.derivatives(rows, equations_.time);
            for (std::size_t row = 0; row < rows.size() && !why_not_affine_; ++row) {
                if (graph.is_constant(rows[row], 0)) continue;
                if (n == 1) varies_ = true;
                if (n > most_degree) {
                    why_not_affine_ = fmt::format("{} is no polynomial of degree {} in t", name(row), most_degree);
                }
            }
            if (n <= most_degree) tapes.push_back(tape_of(rows));
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
        const bool is_relation = place >= equations_.discrete.size();
        const auto modes = is_relation ? 0 : static_cast<double>(equations_.discrete[place].modes.size());
        pattern_.push_back({place, is_relation ? 3 : modes, is_relation});
    }
    // A value has a number of its own, base 0; relations and modes are digits of as many others as they need.
    constexpr double most = 0x1p53; // up to which whole numbers are exact
    std::ranges::stable_sort(pattern_, {}, [](const Digit& digit) { return digit.base > 0; });
    double reach = most; // none is begun yet
    std::size_t numbers = 0;
    for (Digit& digit : pattern_) {
        if (digit.base == 0 || reach * digit.base > most) {
            ++numbers;
            reach = digit.base == 0 ? most : 1;
        }
        reach *= digit.base == 0 ? 1 : digit.base;
        digit.number = numbers - 1;
    }
    has_pattern_ = !varies_ && numbers <= AffinePattern{}.size();
}

void EquationSystem::compile(const CCompiler& compiler) {
    const std::array tapes = {&rate_, &jacobian_.tape, &guard_, &guard_jacobian_.tape, &output_, &condition_, &margin_};
    std::size_t instructions = 0;
    std::string text = Tape::c_declarations();
    const auto name = [](std::size_t i) { return fmt::format("tape{}", i); };
    for (std::size_t i = 0; i < tapes.size(); ++i) {
        instructions += tapes[i]->instruction_count();
        if (instructions > most_compiled) {
            throw Error(fmt::format("{}: more than {} instructions, which a C compiler takes too long for",
                                    equations_.name, most_compiled));
        }
        text += tapes[i]->c_function(name(i));
    }
    const auto library = compiler.load(text);
    for (std::size_t i = 0; i < tapes.size(); ++i) {
        tapes[i]->use(reinterpret_cast<Tape::CFunction>(library->function(name(i))), library);
    }
}

SystemState EquationSystem::initial_state() const {
    auto values = std::make_unique<Memory>();
    std::vector<double> x;
    for (const auto& state : equations_.states) x.push_back(state.start);
    for (const auto& discrete : equations_.discrete) values->values.push_back(discrete.start);
    values->values.resize(equations_.discrete.size() + relations_.size());
    values->conditions.resize(conditions_.size());
    values->taken.assign(relations_.size(), -1.0); // no instant of a run
    values->taken_margin.resize(relations_.size());
    SystemState state(0.0, std::move(x), std::move(values));
    auto& memory = static_cast<Memory&>(*state.discrete);
    // A relation may stand in the operand of another; each pass sets one more of such a chain.
    std::vector<double> margins(2 * relations_.size());
    for (std::size_t pass = 0; pass <= relations_.size(); ++pass) {
        bool changed = false;
        margins_of(state, margins);
        for (std::size_t i = 0; i < relations_.size(); ++i) {
            double& held = memory.values[equations_.discrete.size() + i];
            const double now = relations_[i].strict ? margins[i] > 0 : margins[i] >= 0;
            changed = changed || now != held;
            held = now;
        }
        if (!changed) break;
    }
    condition_.evaluate({std::span(&state.t, 1), state.x, memory.values}, memory.conditions);
    memory.active.resize(relations_.size());
    find_active(state);
    return state;
}

void EquationSystem::derivative(double t, std::span<const double> x, const DiscreteState& d,
                                std::span<double> dxdt) const {
    rate_.evaluate({std::span(&t, 1), x, memory(d).values}, dxdt);
}

bool EquationSystem::jacobian(double t, std::span<const double> x, const DiscreteState& d,
                              std::span<double> matrix) const {
    thread_local std::vector<double> values;
    values.resize(jacobian_.entries.size());
    jacobian_.tape.evaluate({std::span(&t, 1), x, memory(d).values}, values);
    for (std::size_t i = 0; i < values.size(); ++i) {
        matrix[jacobian_.entries[i].column * variables_.size() + jacobian_.entries[i].row] = values[i];
    }
    return true;
}

void EquationSystem::guards(double t, std::span<const double> x, const DiscreteState& d, std::span<double> g) const {
    const Memory& held = memory(d);
    guard_.evaluate({std::span(&t, 1), x, held.values}, g.first(relations_.size()));
    const double* values = held.values.data() + equations_.discrete.size();
    for (std::size_t i = 0; i < relations_.size(); ++i) {
        g[i] = held.active[i] == 0 ? 1 : values[i] != 0 ? g[i] : -g[i];
        if (std::isnan(g[i])) g[i] = -1; // a step that leaves where it has a value must not pass over its fall
        if (g[i] < 0 && held.taken[i] == t && std::abs(held.taken_margin[i]) == -g[i]) g[i] = 0;
    }
    g.back() = held.restless ? -1 : 1;
}

void EquationSystem::margins_of(const SystemState& state, std::vector<double>& margins) const {
    margin_.evaluate({std::span(&state.t, 1), state.x, memory(*state.discrete).values}, margins);
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
    auto& held = static_cast<Memory&>(*state.discrete).values;
    for (std::size_t i = 0; i < values.size(); ++i) {
        const std::size_t place = places[i] - 1;
        double& value = place < state.x.size() ? state.x[place] : held[place - state.x.size()];
        changed = changed || value != values[i];
        value = values[i];
    }
    return changed;
}

bool EquationSystem::carry_out(const Update& update, SystemState& state) const {
    if (update.targets.empty()) return false;
    thread_local std::vector<double> values;
    values.resize(update.targets.size());
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

// Takes anew what was changed or has come to matter since the margins `before`. At the instant at which a relation has
// crossed, its margin is zero but for rounding, and so is that of its twins: they follow it.
void EquationSystem::refresh_relations(const std::vector<double>& before, SystemState& state,
                                       std::optional<std::size_t> crossed) const {
    auto& memory = static_cast<Memory&>(*state.discrete);
    thread_local std::vector<double> now;
    now.resize(before.size());
    margins_of(state, now);
    const std::size_t count = relations_.size(), first = equations_.discrete.size();
    const auto take = [&](std::size_t i, bool holds) {
        memory.values[first + i] = holds;
        memory.taken[i] = state.t;
        memory.taken_margin[i] = now[i];
    };
    for (std::size_t i = 0; i < count; ++i) {
        const bool came = before[count + i] == 0 && now[count + i] != 0;
        if (now[i] == before[i] && !came) continue;
        take(i, relations_[i].strict ? now[i] > 0 : now[i] >= 0);
    }
    if (!crossed) return;
    for (const auto& [i, same_side] : relations_[*crossed].twins) {
        const bool came = before[count + i] == 0 && now[count + i] != 0;
        if (now[i] == before[i] && came) take(i, (memory.values[first + *crossed] != 0) == same_side);
    }
}

// Carries out what has become true, until nothing does. Returns the places of what was carried out.
void EquationSystem::settle(SystemState& state, std::vector<int>& fired, std::optional<std::size_t> crossed) const {
    auto& memory = static_cast<Memory&>(*state.discrete);
    thread_local std::vector<double> now, before;
    thread_local std::vector<std::size_t> due;
    now.resize(conditions_.size());
    before.resize(2 * relations_.size());
    fired.clear();
    for (int round = 0; round < most_rounds; ++round) {
        condition_.evaluate({std::span(&state.t, 1), state.x, memory.values}, now);
        due.clear();
        for (std::size_t i = 0; i < now.size(); ++i) {
            if (now[i] != 0 && memory.conditions[i] == 0) due.push_back(i);
        }
        memory.conditions = now;
        if (due.empty()) return;
        margins_of(state, before);
        for (const std::size_t i : due) {
            carry_out(when_updates_[i], state);
            fired.push_back(static_cast<int>(i));
        }
        refresh_relations(before, state, crossed);
    }
    memory.restless = true;
}

EventEffect EquationSystem::on_crossing(GuardId guard, SystemState& state, EventLog& log) const {
    if (guard == relations_.size()) return EventEffect::none; // restless: the run ends
    auto& memory = static_cast<Memory&>(*state.discrete);
    thread_local std::vector<double> before;
    before.resize(2 * relations_.size());
    margins_of(state, before);
    double& held = memory.values[equations_.discrete.size() + guard];
    // It fell together with another whose event has moved it since: what it is now was taken exactly.
    const bool unmoved = memory.taken[guard] == state.t && memory.taken_margin[guard] == before[guard];
    if (unmoved && (held != 0 ? before[guard] : -before[guard]) > 0) return EventEffect::none;
    held = held == 0;
    memory.taken[guard] = state.t;
    memory.taken_margin[guard] = before[guard];
    // It may open a branch with relations of its own.
    refresh_relations(before, state, guard);
    thread_local std::vector<int> fired;
    settle(state, fired, guard);
    for (const int when : fired) log.push_back({state.t, when, 0});
    find_active(state);
    return EventEffect::restart;
}

EventEffect EquationSystem::on_sample(ClockId clock, long k, SystemState& state) const {
    auto& memory = static_cast<Memory&>(*state.discrete);
    const bool to_events = reach_[clock].events;
    std::vector<double> before(to_events ? 2 * relations_.size() : 0);
    if (to_events) margins_of(state, before);
    bool changed = carry_out(clock_updates_[clock], state);
    if (const auto& call = calls_[clock]) {
        std::vector<double> read(call->reads.output_count()), written(call->targets.size());
        if (!read.empty()) call->reads.evaluate({std::span(&state.t, 1), state.x, memory.values}, read);
        equations_.clocks[clock].function->call(k, read, written);
        changed = write(call->targets, written, state) || changed;
    }
    memory.fired.clear();
    if (to_events) {
        refresh_relations(before, state);
        settle(state, memory.fired);
        find_active(state);
        changed = changed || !memory.fired.empty() || memory.restless;
    }
    if (!changed) return EventEffect::none;
    if (to_events) return EventEffect::restart;
    return reach_[clock].motion ? EventEffect::derivative : EventEffect::none;
}

void EquationSystem::affine_derivative(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                                       std::span<double> coefficient) const {
    if (n == 0) return derivative(t0, c, d, coefficient);
    affine_coefficient(jacobian_, rate_by_time_, n, t0, h, c, d, coefficient);
}

void EquationSystem::affine_guards(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                                   std::span<double> coefficient) const {
    if (n == 0) return guards(t0, c, d, coefficient);
    coefficient.back() = 0;
    affine_coefficient(guard_jacobian_, guard_by_time_, n, t0, h, c, d, coefficient.first(relations_.size()));
}

// A c + b^(n)(t0) h^n/n!.
void EquationSystem::affine_coefficient(const Sparse& matrix, const std::vector<Tape>& by_time, int n, double t0,
                                        double h, std::span<const double> c, const DiscreteState& d,
                                        std::span<double> coefficient) const {
    thread_local std::vector<double> values;
    std::fill(coefficient.begin(), coefficient.end(), 0.0);
    if (varies_ && n <= most_degree) {
        by_time[static_cast<std::size_t>(n) - 1].evaluate({std::span(&t0, 1), c, memory(d).values}, coefficient);
        double factor = 1;
        for (int i = 1; i <= n; ++i) factor *= h / i;
        for (double& value : coefficient) value *= factor;
    }
    values.resize(matrix.entries.size());
    matrix.tape.evaluate({std::span(&t0, 1), c, memory(d).values}, values);
    for (std::size_t i = 0; i < values.size(); ++i) {
        coefficient[matrix.entries[i].row] += values[i] * c[matrix.entries[i].column];
    }
}

std::optional<AffinePattern> EquationSystem::affine_pattern(const DiscreteState& d) const {
    if (!has_pattern_) return std::nullopt;
    const auto& values = memory(d).values;
    const auto& active = memory(d).active;
    AffinePattern pattern{};
    for (const Digit& digit : pattern_) {
        double value = values[digit.place];
        // One that does not matter is the same, whatever it is.
        if (digit.is_relation) value = active[digit.place - equations_.discrete.size()] != 0 ? 1 + value : 0;
        pattern[digit.number] = digit.base * pattern[digit.number] + value;
    }
    return pattern;
}

std::string EquationSystem::guard_name(GuardId guard, const SystemState& state) const {
    if (guard >= relations_.size()) return "the list of `when` conditions";
    std::vector<double> margins(2 * relations_.size());
    margins_of(state, margins);
    return fmt::format("the relation {}{}", relations_[guard].text,
                       std::isnan(margins[guard]) ? ", which has no value there," : "");
}

void EquationSystem::outputs(const SystemState& state, std::span<double> y) const {
    output_.evaluate({std::span(&state.t, 1), state.x, memory(*state.discrete).values}, y);
}

std::span<const double> EquationSystem::discrete(const SystemState& state) const {
    return std::span(memory(*state.discrete).values).first(equations_.discrete.size());
}

} // namespace tribode
