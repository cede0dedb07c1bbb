#include "tribode/system/equations.hpp"
#include "tribode/base/text.hpp"
#include "tribode/system/tape.hpp"

#include <bit>
#include <fmt/format.h>

namespace tribode {

std::string Equations::State::equation_text() const {
    const std::string line = where.empty() ? "" : fmt::format(" ({})", where);
    return is_algebraic() ? fmt::format("the equation {}{}", equation, line) : fmt::format("der({}){}", name, line);
}

double Equations::value_at_start(Term term, std::span<const Term> unknown) const {
    std::vector<Term> symbols{time};
    std::vector<double> values{0};
    const auto add = [&](Term symbol, double value) {
        symbols.push_back(symbol);
        values.push_back(value);
    };
    for (const auto& v : states) add(v.symbol, v.start);
    for (const auto& v : discrete) add(v.symbol, v.start);
    for (const auto& v : parameters) add(v.symbol, v.value);
    for (const auto& v : inputs) add(v.symbol, v.value);
    for (const Term symbol : unknown) add(symbol, 0);
    double value = 0;
    Tape(*graph, symbols, {term}).evaluate({values}, {&value, 1});
    return value;
}

void Equations::replace(const Expressions::Replacement& replacement) {
    std::vector<Term*> places;
    const auto add_set = [&](Assignments& set) {
        for (auto& [target, value] : set) places.push_back(&value);
    };
    for (auto& state : states) places.push_back(&state.rate);
    for (auto& output : outputs) places.push_back(&output.value);
    for (auto& when : whens) {
        places.push_back(&when.condition);
        add_set(when.set);
    }
    for (auto& clock : clocks) {
        add_set(clock.set);
        if (!clock.function) continue;
        for (auto& term : clock.function->reads) places.push_back(&term);
    }
    for (auto& contact : contacts) {
        for (Term* term : {&contact.quantity, &contact.level, &contact.release, &contact.restitution}) {
            places.push_back(term);
        }
        if (contact.rest_speed) places.push_back(&*contact.rest_speed);
    }
    // All at once: what they share is replaced once.
    std::vector<Term> terms;
    for (const Term* place : places) terms.push_back(*place);
    const auto made = graph->substitute(terms, replacement);
    for (std::size_t i = 0; i < places.size(); ++i) *places[i] = made[i];
}

std::vector<Term> Equations::terms() const {
    std::vector<Term> list;
    const auto add_set = [&](const Assignments& set) {
        for (const auto& [target, value] : set) list.push_back(value);
    };
    for (const auto& state : states) list.push_back(state.rate);
    for (const auto& output : outputs) list.push_back(output.value);
    for (const auto& when : whens) {
        list.push_back(when.condition);
        add_set(when.set);
    }
    for (const auto& clock : clocks) {
        add_set(clock.set);
        if (clock.function) list.insert(list.end(), clock.function->reads.begin(), clock.function->reads.end());
    }
    for (const auto& contact : contacts) {
        list.insert(list.end(), {contact.quantity, contact.level, contact.release, contact.restitution});
        if (contact.rest_speed) list.push_back(*contact.rest_speed);
    }
    return list;
}

Equations Equations::with_own_graph() const {
    Equations made = *this;
    std::vector<Term*> all{&made.time};
    const auto add_set = [&](Assignments& set) {
        for (auto& [target, value] : set) all.insert(all.end(), {&target, &value});
    };
    for (auto& state : made.states) all.insert(all.end(), {&state.symbol, &state.rate});
    for (auto& one : made.discrete) all.push_back(&one.symbol);
    for (auto& parameter : made.parameters) all.push_back(&parameter.symbol);
    for (auto& input : made.inputs) all.push_back(&input.symbol);
    for (auto& output : made.outputs) all.push_back(&output.value);
    for (auto& when : made.whens) {
        all.push_back(&when.condition);
        add_set(when.set);
    }
    for (auto& clock : made.clocks) {
        add_set(clock.set);
        if (!clock.function) continue;
        for (auto* list : {&clock.function->reads, &clock.function->writes}) {
            for (Term& term : *list) all.push_back(&term);
        }
    }
    for (auto& contact : made.contacts) {
        all.insert(all.end(), {&contact.force, &contact.mode, &contact.quantity, &contact.level, &contact.release,
                               &contact.restitution});
        if (contact.rest_speed) all.push_back(&*contact.rest_speed);
    }
    for (auto& one : made.sensitivities) all.push_back(&one.parameter);
    std::vector<Term> roots;
    for (const Term* term : all) roots.push_back(*term);
    auto [own, place] = graph->part(roots);
    made.graph = std::make_shared<Expressions>(std::move(own));
    for (Term* term : all) *term = place[*term];
    return made;
}

namespace {

std::uint64_t mixed(std::uint64_t hash, std::uint64_t part) {
    hash = (hash ^ part) * 0x9E3779B97F4A7C15ull;
    return hash ^ (hash >> 29);
}

std::uint64_t hash_of(std::string_view text) {
    std::uint64_t hash = 0xCBF29CE484222325ull;
    for (const unsigned char c : text) hash = mixed(hash, c);
    return hash;
}

} // namespace

std::string Equations::fingerprint() const {
    std::vector<Term> roots;
    const auto add_set = [&](const Assignments& set) {
        for (const auto& [target, value] : set) roots.insert(roots.end(), {target, value});
    };
    for (const auto& state : states) roots.insert(roots.end(), {state.symbol, state.rate});
    for (const auto& variable : discrete) roots.push_back(variable.symbol);
    for (const auto& output : outputs) roots.push_back(output.value);
    for (const auto& when : whens) {
        roots.push_back(when.condition);
        add_set(when.set);
    }
    for (const auto& clock : clocks) {
        add_set(clock.set);
        if (!clock.function) continue;
        roots.insert(roots.end(), clock.function->reads.begin(), clock.function->reads.end());
        roots.insert(roots.end(), clock.function->writes.begin(), clock.function->writes.end());
    }
    // The numbers of terms depend on what else was recorded before, so the order of operands that commute does, too.
    std::unordered_map<Term, std::uint64_t> hashes;
    for (const Term term : graph->reachable(roots)) {
        const auto& node = (*graph)[term];
        std::uint64_t hash = mixed(1, static_cast<std::uint64_t>(node.op));
        const int count = operand_count(node.op);
        if (node.op == Op::constant) {
            hash = mixed(hash, std::bit_cast<std::uint64_t>(node.value));
        } else if (node.op == Op::lookup) {
            hash = mixed(hash, graph->table_of(term)->hash());
            for (const Term operand : {node.a, node.b, node.c}) hash = mixed(hash, hashes[operand]);
        } else if (node.op == Op::variable) {
            hash = mixed(hash, hash_of(graph->name(term)));
        } else if (node.op == Op::add || node.op == Op::multiply || node.op == Op::equal) {
            hash = mixed(hash, hashes[node.a] + hashes[node.b]);
        } else {
            hash = mixed(hash, hashes[node.a]);
            if (count > 1) hash = mixed(hash, hashes[node.b]);
            if (count > 2) hash = mixed(hash, hashes[node.c]);
        }
        hashes[term] = hash;
    }
    std::string all = name;
    for (const auto& state : states) {
        all += fmt::format("\n{} {} [{}]", state.is_algebraic() ? "algebraic" : "state", state.name, state.unit);
    }
    for (const auto& variable : discrete) {
        all += fmt::format("\ndiscrete {} [{}] {}", variable.name, variable.unit, fmt::join(variable.modes, ","));
    }
    for (const auto& parameter : parameters) all += fmt::format("\n{} {}", parameter.name, to_text(parameter.value));
    for (const auto& input : inputs) all += fmt::format("\n{} {}", input.name, to_text(input.value));
    for (const auto& when : whens) {
        all += fmt::format("\nwhen {} {}{}{}", when.name, when.set.size(), when.at_start ? " at start" : "",
                           when.stop ? " stop" : "");
    }
    for (const auto& clock : clocks) {
        all += fmt::format("\nclock {} {} {} {}", clock.name, to_text(clock.period), to_text(clock.offset),
                           clock.set.size());
    }
    for (const Term root : roots) all += fmt::format("\n{:x}", hashes[root]);
    return sha256(all);
}

} // namespace tribode
