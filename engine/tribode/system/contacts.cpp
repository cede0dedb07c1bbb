#include "tribode/system/contacts.hpp"
#include "tribode/base/error.hpp"
#include "tribode/system/message_text.hpp"
#include "tribode/system/tape.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace tribode {

namespace {

// How a term changes by time, along the equations.
Term rate_of(const Equations& equations, Term term) {
    auto& graph = *equations.graph;
    Term sum = graph.derivatives(std::span(&term, 1), equations.time)[0];
    for (const auto& state : equations.states) {
        const Term slope = graph.derivatives(std::span(&term, 1), state.symbol)[0];
        if (state.is_algebraic() && !graph.is_constant(slope, 0)) {
            throw InputError(fmt::format("{}: a ready part acts on the algebraic variable {}, must act on states alone",
                                         equations.name, state.name));
        }
        sum = graph.make(Op::add, sum, graph.make(Op::multiply, slope, state.rate));
    }
    return sum;
}

// Puts in what the rates of change are, which may be of terms with rates of change themselves.
void take_out_rates(Equations& equations) {
    auto& graph = *equations.graph;
    for (std::size_t round = 0;; ++round) {
        Expressions::Replacement known;
        for (const Term term : graph.reachable(equations.terms())) {
            const auto node = graph[term];
            if (node.op != Op::rate) continue;
            const auto below = graph.reachable(std::span(&node.a, 1));
            const bool is_innermost =
                std::ranges::none_of(below, [&](Term other) { return graph[other].op == Op::rate; });
            if (is_innermost) known[term] = rate_of(equations, node.a);
        }
        if (known.empty()) return;
        // One that is that of a state's rate of change, and so on, has as many states above it at most.
        if (round > equations.states.size()) {
            throw InputError(fmt::format("{}: {} needs itself: a ready part acts on what its rate of change depends on",
                                         equations.name, shortened(graph.text(known.begin()->first))));
        }
        equations.replace(known);
    }
}

using Contact = Equations::Contact;

class Closing {
  public:
    explicit Closing(Equations& equations)
        : equations_(equations),
          graph_(*equations.graph),
          contacts_(std::exchange(equations.contacts, {})) {
        // Normal forces before the friction that they make.
        std::stable_partition(contacts_.begin(), contacts_.end(),
                              [](const auto& contact) { return contact.law == Contact::Law::impact; });
    }

    void close() {
        for (const auto& contact : contacts_) add_motion(contact);
        solve();
        choose_pivots();
        add_events();
        equations_.replace(forces_);
        hold();
    }

  private:
    static constexpr double resolved = 1e-11; // of a velocity or a gap: above it something has made it jump

    // What the forces do to a contact's velocity.
    struct Motion {
        Term velocity = 0, acceleration = 0;
        std::vector<Term> by_force;       // the derivatives of the acceleration by each force
        Term active = 0;                  // a condition: stick, or rest
        std::vector<Term> state_by_force; // the derivatives of the rates of all states by this force
        double scale = 1, gap_scale = 1;  // of the velocity and the gap, by nominal values
        std::optional<std::size_t> pivot; // a state that the velocity depends on with a constant factor
        std::optional<std::size_t> gap_pivot;
    };

    Term number(double value) { return graph_.constant(value); }
    Term derivative(Term term, Term by) { return graph_.derivatives(std::span(&term, 1), by)[0]; }
    Term substituted(Term term, const Expressions::Replacement& by) {
        return graph_.substitute(std::span(&term, 1), by)[0];
    }
    Term in_mode(const Contact& contact, double mode) { return graph_.make(Op::equal, contact.mode, number(mode)); }
    bool depends_on_forces(Term term) const {
        const auto variables = graph_.variables_of(std::span(&term, 1));
        return std::any_of(contacts_.begin(), contacts_.end(), [&](const auto& contact) {
            return std::binary_search(variables.begin(), variables.end(), contact.force);
        });
    }

    double value_at_start(Term term) const {
        std::vector<Term> forces;
        for (const auto& contact : contacts_) forces.push_back(contact.force);
        return equations_.value_at_start(term, forces);
    }

    void add_motion(const Contact& contact) {
        const bool is_impact = contact.law == Contact::Law::impact;
        const char* what = is_impact ? "gap" : "velocity";
        Motion motion;
        motion.velocity = is_impact ? rate_of(equations_, contact.quantity) : contact.quantity;
        if (depends_on_forces(motion.velocity)) {
            throw InputError(fmt::format("tb.system: parts.{}: its {} must not depend on forces{}", contact.name, what,
                                         is_impact ? " in its first rate of change" : ""));
        }
        motion.acceleration = rate_of(equations_, motion.velocity);
        for (const auto& other : contacts_) {
            motion.by_force.push_back(derivative(motion.acceleration, other.force));
            if (!depends_on_forces(motion.by_force.back())) continue;
            throw InputError(fmt::format("tb.system: parts.{}: how its {} changes is not linear in {}.force",
                                         contact.name, what, other.name));
        }
        motion.active = in_mode(contact, is_impact ? 1 : 0);
        double scale = 0, gap_scale = 0;
        for (const auto& state : equations_.states) {
            motion.state_by_force.push_back(derivative(state.rate, contact.force));
            scale += std::abs(value_at_start(derivative(motion.velocity, state.symbol))) * state.nominal;
            gap_scale += std::abs(value_at_start(derivative(contact.quantity, state.symbol))) * state.nominal;
        }
        if (gap_scale > 0 && std::isfinite(gap_scale)) motion.gap_scale = gap_scale;
        if (scale > 0 && std::isfinite(scale)) motion.scale = scale;
        const double own = value_at_start(motion.by_force[motions_.size()]);
        if (is_impact ? !(own > 0) : !(own < 0)) {
            throw InputError(fmt::format(
                "tb.system: parts.{}: {}.force must {} of its {}, but changes it by {:.6g}", contact.name, contact.name,
                is_impact ? "raise the rate of change of the rate of change" : "lower the rate of change", what, own));
        }
        motions_.push_back(std::move(motion));
    }

    // Gaussian elimination, for terms: of a chain of masses each pivot is that of its part alone.
    void solve() {
        const std::size_t n = contacts_.size();
        Expressions::Replacement none;
        for (const auto& contact : contacts_) none[contact.force] = number(0);
        std::vector<std::vector<Term>> matrix(n, std::vector<Term>(n));
        std::vector<Term> right(n);
        for (std::size_t i = 0; i < n; ++i) {
            const Contact& contact = contacts_[i];
            const Motion& motion = motions_[i];
            const bool is_impact = contact.law == Contact::Law::impact;
            Term law = number(0);
            if (!is_impact) {
                law =
                    graph_.make(Op::select, in_mode(contact, 1), contact.level, graph_.make(Op::negate, contact.level));
            }
            for (std::size_t j = 0; j < n; ++j) {
                const Term by = derivative(law, contacts_[j].force);
                if (depends_on_forces(by)) {
                    throw InputError(fmt::format("tb.system: parts.{}: its level is not linear in {}.force",
                                                 contact.name, contacts_[j].name));
                }
                const Term slip = graph_.make(Op::subtract, number(i == j), by);
                matrix[i][j] = graph_.make(Op::select, motion.active, motion.by_force[j], slip);
            }
            right[i] =
                graph_.make(Op::select, motion.active, graph_.make(Op::negate, substituted(motion.acceleration, none)),
                            substituted(law, none));
        }
        for (std::size_t k = 0; k < n; ++k) {
            if (k > 0) take_none_where_held(k, matrix[k], right[k]);
            for (std::size_t i = k + 1; i < n; ++i) {
                if (graph_.is_constant(matrix[i][k], 0)) continue;
                const Term factor = graph_.make(Op::divide, matrix[i][k], matrix[k][k]);
                const auto reduce = [&](Term& term, Term by) {
                    term = graph_.make(Op::subtract, term, graph_.make(Op::multiply, factor, by));
                };
                for (std::size_t j = k + 1; j < n; ++j) reduce(matrix[i][j], matrix[k][j]);
                reduce(right[i], right[k]);
            }
        }
        for (std::size_t i = n; i-- > 0;) {
            Term sum = right[i];
            for (std::size_t j = i + 1; j < n; ++j) {
                sum = graph_.make(Op::subtract, sum,
                                  graph_.make(Op::multiply, matrix[i][j], forces_.at(contacts_[j].force)));
            }
            forces_[contacts_[i].force] = graph_.make(Op::divide, sum, matrix[i][i]);
        }
    }

    // What others hold already takes no force of this one. However they share it, the motion is the same.
    void take_none_where_held(std::size_t k, std::vector<Term>& row, Term& right) {
        const Term own = motions_[k].by_force[k];
        if (graph_.make(Op::select, motions_[k].active, own, number(1)) == row[k]) return; // no other acts there
        constexpr double rounding = 1e-10;
        const auto size = [&](Term term) {
            return graph_.make(Op::select, graph_.make(Op::less, term, number(0)), graph_.make(Op::negate, term), term);
        };
        const Term is_small =
            graph_.make(Op::less_equal, size(row[k]), graph_.make(Op::multiply, number(rounding), size(own)));
        const Term is_held = graph_.make(Op::all, motions_[k].active, graph_.make(Op::no_event, is_small));
        for (std::size_t j = k; j < row.size(); ++j) {
            row[j] = graph_.make(Op::select, is_held, number(j == k), row[j]);
        }
        right = graph_.make(Op::select, is_held, number(0), right);
    }

    // For each contact a state of its own that can be put, and kept, where the velocity is zero to the last bit. Those that
    // have but one to choose from choose first.
    void choose_pivots() {
        const auto candidates = [&](Term of, const std::vector<Term>* acted_on) {
            std::vector<std::size_t> list;
            for (std::size_t i = 0; i < equations_.states.size(); ++i) {
                const auto& slope = graph_[derivative(of, equations_.states[i].symbol)];
                if (slope.op != Op::constant || slope.value == 0) continue;
                if (acted_on && graph_.is_constant((*acted_on)[i], 0)) continue;
                list.push_back(i);
            }
            return list;
        };
        std::vector<std::size_t> order(contacts_.size());
        std::vector<std::vector<std::size_t>> choice;
        for (std::size_t i = 0; i < order.size(); ++i) {
            order[i] = i;
            choice.push_back(candidates(motions_[i].velocity, &motions_[i].state_by_force));
        }
        std::ranges::stable_sort(order, {}, [&](std::size_t i) { return choice[i].size(); });
        std::vector<char> taken(equations_.states.size());
        for (const std::size_t i : order) {
            const auto found = std::ranges::find_if(choice[i], [&](std::size_t state) { return !taken[state]; });
            if (found == choice[i].end()) continue;
            motions_[i].pivot = *found;
            taken[*found] = true;
            held_.push_back(i);
            if (contacts_[i].law != Contact::Law::impact) continue;
            // The place that belongs to that velocity.
            for (const std::size_t place : candidates(contacts_[i].quantity, nullptr)) {
                if (equations_.states[place].rate == equations_.states[*found].symbol) motions_[i].gap_pivot = place;
            }
        }
    }

    // The value of a state at which a term, which depends on it with a constant factor, has a value; other states are `after`.
    Term solved(Term term, std::size_t state, Term value, Expressions::Replacement after) {
        const Term symbol = equations_.states[state].symbol;
        after[symbol] = number(0);
        const Term rest = substituted(term, after);
        return graph_.make(Op::divide, graph_.make(Op::subtract, value, rest), derivative(term, symbol));
    }

    // What an impulse of the force sets: the velocity to a value. What else is held, and moves by rounding only then, is put
    // to rest too; as the rest of a velocity comes to zero in stick, it takes along whatever is held.
    Equations::Assignments impulse(std::size_t i, Term to, bool takes_along = false) {
        const Motion& motion = motions_[i];
        const Term size = graph_.make(Op::divide, graph_.make(Op::subtract, to, motion.velocity), motion.by_force[i]);
        Expressions::Replacement after;
        for (std::size_t j = 0; j < equations_.states.size(); ++j) {
            if (graph_.is_constant(motion.state_by_force[j], 0)) continue;
            const Term symbol = equations_.states[j].symbol;
            after[symbol] = graph_.make(Op::add, symbol, graph_.make(Op::multiply, motion.state_by_force[j], size));
        }
        if (motion.pivot) {
            const Term symbol = equations_.states[*motion.pivot].symbol;
            after.erase(symbol);
            after[symbol] = solved(motion.velocity, *motion.pivot, to, after);
        }
        if (motion.gap_pivot) {
            const Term symbol = equations_.states[*motion.gap_pivot].symbol;
            if (!after.contains(symbol))
                after[symbol] = solved(contacts_[i].quantity, *motion.gap_pivot, number(0), {});
        }
        for (const std::size_t k : held_) {
            if (k == i) continue;
            const Motion& other = motions_[k];
            const Term symbol = equations_.states[*other.pivot].symbol;
            const Term value = substituted(symbol, after), left = substituted(other.velocity, after);
            const Term bound = number(resolved * other.scale);
            const Term is_small = graph_.make(Op::all, graph_.make(Op::less_equal, left, bound),
                                              graph_.make(Op::less_equal, graph_.make(Op::negate, bound), left));
            after[symbol] =
                graph_.make(Op::select, takes_along ? other.active : graph_.make(Op::all, other.active, is_small),
                            solved(other.velocity, *other.pivot, number(0), after), value);
        }
        Equations::Assignments set(after.begin(), after.end());
        std::ranges::sort(set);
        return set;
    }

    // What sets velocities says which way friction goes then, so that this is no event of its own.
    void slip_on(Equations::Assignments& set) {
        const Expressions::Replacement after(set.begin(), set.end());
        for (std::size_t i = 0; i < contacts_.size(); ++i) {
            const Contact& contact = contacts_[i];
            if (contact.law != Contact::Law::friction || after.contains(contact.mode)) continue;
            const Term v = substituted(motions_[i].velocity, after);
            if (v == motions_[i].velocity) continue;
            const auto mode = [&](double value) { return number(value); };
            const Term bound = number(resolved * motions_[i].scale);
            const Term backward = graph_.make(Op::select, graph_.make(Op::less, v, graph_.make(Op::negate, bound)),
                                              mode(2), contact.mode);
            set.emplace_back(contact.mode, graph_.make(Op::select, graph_.make(Op::less, bound, v), mode(1), backward));
        }
    }

    void add_events() {
        std::vector<Equations::When> whens;
        const auto add = [&](const Contact& contact, const char* name, Term condition, Equations::Assignments set,
                             double mode) {
            set.emplace_back(contact.mode, number(mode));
            if (contact.law == Contact::Law::impact) slip_on(set);
            whens.push_back({contact.name + "." + name, condition, std::move(set), true, false});
        };
        const auto all = [&](Term a, Term b) { return graph_.make(Op::all, a, b); };
        const auto less = [&](Term a, Term b) { return graph_.make(Op::less, a, b); };
        const auto negative = [&](Term a) { return graph_.make(Op::negate, a); };
        // Looked at where something jumps, and not on the way.
        const auto jumped = [&](Term a, Term b) { return graph_.make(Op::no_event, less(a, b)); };
        constexpr double closed = 1e-12; // of a gap and a velocity: rounding
        constexpr double slow = 1e-3;    // of a velocity, where no rest_speed is given
        for (std::size_t i = 0; i < contacts_.size(); ++i) {
            const Contact& contact = contacts_[i];
            const Motion& motion = motions_[i];
            const Term v = motion.velocity, zero = number(0), struck = number(resolved * motion.scale);
            if (contact.law == Contact::Law::friction) {
                const Term stick = in_mode(contact, 0), before = graph_.make(Op::before, v);
                // What has come to the other side by a jump, of whatever, slips on there and has not stopped.
                const Term back = graph_.make(Op::subtract, before, v);
                add(contact, "slips", all(in_mode(contact, 1), all(jumped(v, negative(struck)), jumped(struck, back))),
                    {}, 2);
                add(contact, "slips", all(in_mode(contact, 2), all(jumped(struck, v), jumped(back, negative(struck)))),
                    {}, 1);
                // Where more parts hold a motion than it has freedoms, one of them may slip while the others hold.
                const Term still = number(held_.size() < contacts_.size() ? closed * motion.scale : 0);
                add(contact, "sticks", all(in_mode(contact, 1), less(v, negative(still))), impulse(i, zero, true), 0);
                add(contact, "sticks", all(in_mode(contact, 2), less(still, v)), impulse(i, zero, true), 0);
                add(contact, "slips", all(stick, jumped(struck, v)), {}, 1);
                add(contact, "slips", all(stick, jumped(v, negative(struck))), {}, 2);
                // A little beyond, so that rounding does not make it stick again at once.
                const Term beyond = graph_.make(Op::multiply, number(1 + 1e-14), contact.release);
                add(contact, "slips", all(stick, less(beyond, contact.force)), {}, 1);
                add(contact, "slips", all(stick, less(contact.force, negative(beyond))), {}, 2);
                continue;
            }
            const Term free = in_mode(contact, 0), rest = in_mode(contact, 1);
            const Term into = graph_.make(Op::select, less(v, zero), v, zero);
            const Term back = negative(graph_.make(Op::multiply, contact.restitution, into));
            const Term rest_speed = contact.rest_speed.value_or(number(slow * motion.scale));
            const Term stays =
                all(jumped(back, rest_speed), jumped(substituted(motion.acceleration, {{contact.force, zero}}), zero));
            // By rounding alone, as just after it was left, a gap does not close.
            const Term approach = number(-closed * motion.scale);
            // Or it is closed already, and something of this instant drives it on.
            const Term driven =
                all(jumped(contact.quantity, number(closed * motion.gap_scale)), jumped(v, negative(struck)));
            const Term closes =
                all(free, graph_.make(Op::any, all(less(contact.quantity, zero), less(v, approach)), driven));
            const Term hit = all(rest, jumped(v, negative(struck)));
            add(contact, "rests", all(closes, stays), impulse(i, zero), 1);
            add(contact, "impact", closes, impulse(i, back), 0);
            add(contact, "impact", all(hit, graph_.make(Op::logical_not, jumped(back, rest_speed))), impulse(i, back),
                0);
            add(contact, "rests", hit, impulse(i, zero), 1);
            // The gap is closed, up to rounding and the tolerances, unless something has made it jump.
            const Term gap = contact.quantity, far = number(resolved * motion.gap_scale);
            const Term opened = graph_.make(Op::subtract, gap, graph_.make(Op::before, gap));
            add(contact, "leaves", all(rest, all(jumped(far, gap), jumped(far, opened))), {}, 0);
            add(contact, "rests", all(rest, all(jumped(gap, negative(far)), jumped(opened, negative(far)))),
                impulse(i, zero), 1);
            add(contact, "leaves", all(rest, jumped(struck, v)), {}, 0);
            add(contact, "leaves", all(rest, less(contact.force, zero)), {}, 0);
        }
        for (auto& when : equations_.whens) slip_on(when.set);
        for (auto& clock : equations_.clocks) slip_on(clock.set);
        equations_.whens.insert(equations_.whens.begin(), std::make_move_iterator(whens.begin()),
                                std::make_move_iterator(whens.end()));
    }

    // What is held has no acceleration, to the last bit.
    void hold() {
        for (const std::size_t i : held_) {
            auto& pivot = equations_.states[*motions_[i].pivot];
            const Term factor = derivative(motions_[i].velocity, pivot.symbol);
            const Term before = pivot.rate;
            pivot.rate = number(0);
            const Term others = rate_of(equations_, motions_[i].velocity);
            const Term held = graph_.make(Op::divide, graph_.make(Op::negate, others), factor);
            pivot.rate = graph_.make(Op::select, motions_[i].active, held, before);
        }
    }

    Equations& equations_;
    Expressions& graph_;
    std::vector<Contact> contacts_;
    std::vector<Motion> motions_;
    std::vector<std::size_t> held_; // the contacts with a pivot
    Expressions::Replacement forces_;
};

} // namespace

void close_contacts(Equations& equations) {
    take_out_rates(equations);
    if (equations.contacts.empty()) return;
    // How an algebraic variable goes with a force is not known here.
    const auto depends = [&](Term term, Term variable) {
        const auto all = equations.graph->variables_of(std::span(&term, 1));
        return std::binary_search(all.begin(), all.end(), variable);
    };
    for (const auto& contact : equations.contacts) {
        for (const auto& state : equations.states) {
            if (!state.is_algebraic()) continue;
            if (!depends(contact.quantity, state.symbol) && !depends(state.rate, contact.force)) continue;
            throw InputError(
                fmt::format("{}: the ready part {} acts on the algebraic variable {}, must act on states alone",
                            equations.name, contact.name, state.name));
        }
    }
    Closing(equations).close();
}

} // namespace tribode
