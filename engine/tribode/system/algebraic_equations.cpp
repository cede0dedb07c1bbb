#include "tribode/system/algebraic_equations.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <optional>

namespace tribode {

namespace {

// Of the algebraic variables: their places, and in which equations, by number, each stands.
struct Incidence {
    std::vector<std::size_t> places;
    std::vector<std::vector<std::size_t>> columns_of; // of each equation
};

Incidence incidence_of(const Equations& equations) {
    Incidence made;
    std::vector<Term> residuals, symbols;
    for (std::size_t i = 0; i < equations.states.size(); ++i) {
        if (!equations.states[i].is_algebraic()) continue;
        made.places.push_back(i);
        residuals.push_back(equations.states[i].rate);
        symbols.push_back(equations.states[i].symbol);
    }
    made.columns_of.resize(residuals.size());
    for (const auto& entry : equations.graph->jacobian(residuals, symbols)) {
        made.columns_of[entry.row].push_back(entry.column);
    }
    return made;
}

std::string joined(const std::vector<std::string>& names) {
    constexpr std::size_t most = 5;
    if (names.size() <= most) return fmt::format("{}", fmt::join(names, ", "));
    return fmt::format("{} and {} more", fmt::join(names.begin(), names.begin() + most, ", "), names.size() - most);
}

} // namespace

void assign_equations(Equations& equations) {
    const auto [places, columns_of] = incidence_of(equations);
    const std::size_t count = places.size();
    constexpr auto none = static_cast<std::size_t>(-1);
    std::vector<std::size_t> column_of(count, none), row_of(count, none);
    // A variable's own equation first, so that what has been assigned stays.
    for (std::size_t row = 0; row < count; ++row) {
        const auto& columns = columns_of[row];
        if (std::find(columns.begin(), columns.end(), row) != columns.end()) column_of[row] = row_of[row] = row;
    }
    for (std::size_t start = 0; start < count; ++start) {
        if (column_of[start] != none) continue;
        // Alternating paths, breadth first, to a variable that is free.
        std::vector<std::size_t> rows = {start}, reached_by(count, none);
        std::optional<std::size_t> free;
        for (std::size_t next = 0; next < rows.size() && !free; ++next) {
            for (const std::size_t column : columns_of[rows[next]]) {
                if (reached_by[column] != none) continue;
                reached_by[column] = rows[next];
                if (row_of[column] == none) {
                    free = column;
                    break;
                }
                rows.push_back(row_of[column]);
            }
        }
        if (free) {
            for (std::size_t column = *free; column != none;) {
                const std::size_t row = reached_by[column];
                row_of[column] = row;
                std::swap(column_of[row], column);
            }
            continue;
        }
        std::vector<std::string> names, determined, open;
        for (const std::size_t row : rows) names.push_back(equations.states[places[row]].equation_text());
        for (std::size_t column = 0; column < count; ++column) {
            if (reached_by[column] != none) determined.push_back(equations.states[places[column]].name);
            if (row_of[column] == none) open.push_back(equations.states[places[column]].name);
        }
        if (determined.empty()) {
            throw InputError(fmt::format(
                "{}: {} depends on no algebraic variable, so nothing determines {}; where it ties states together, the "
                "system is of higher index, and its derivative by time belongs in its place",
                equations.name, names.front(), joined(open)));
        }
        throw InputError(fmt::format(
            "{}: the system is structurally singular: {} have only the algebraic variable{} {} in "
            "them, one too few, and nothing determines {}",
            equations.name, joined(names), determined.size() == 1 ? "" : "s", joined(determined), joined(open)));
    }
    const Equations before = equations;
    for (std::size_t row = 0; row < count; ++row) {
        const auto& from = before.states[places[row]];
        auto& to = equations.states[places[column_of[row]]];
        to.rate = from.rate;
        to.equation = from.equation;
        to.where = from.where;
    }
}

std::vector<std::vector<std::size_t>> algebraic_blocks(const Equations& equations) {
    // Tarjan's strongly connected components of "needs", which come out in the order wanted; no recursion.
    const auto [places, needs] = incidence_of(equations);
    const std::size_t count = places.size();
    constexpr std::size_t unseen = 0;
    std::vector<std::size_t> number(count, unseen), lowest(count), next(count, 0), stack, path;
    std::vector<char> on_stack(count, false);
    std::vector<std::vector<std::size_t>> components;
    std::size_t seen = 0;
    for (std::size_t root = 0; root < count; ++root) {
        if (number[root] != unseen) continue;
        path.push_back(root);
        while (!path.empty()) {
            const std::size_t here = path.back();
            if (number[here] == unseen) {
                number[here] = lowest[here] = ++seen;
                stack.push_back(here);
                on_stack[here] = true;
            }
            if (next[here] < needs[here].size()) {
                const std::size_t other = needs[here][next[here]++];
                if (number[other] == unseen) {
                    path.push_back(other);
                } else if (on_stack[other]) {
                    lowest[here] = std::min(lowest[here], number[other]);
                }
                continue;
            }
            path.pop_back();
            if (!path.empty()) lowest[path.back()] = std::min(lowest[path.back()], lowest[here]);
            if (lowest[here] != number[here]) continue;
            auto& component = components.emplace_back();
            do {
                component.push_back(places[stack.back()]);
                on_stack[static_cast<std::size_t>(stack.back())] = false;
                stack.pop_back();
            } while (component.back() != places[here]);
        }
    }
    // Very many small ones are taken together: each costs a tape of its own.
    constexpr std::size_t most = 64;
    const std::size_t min_size = components.size() <= most ? 1 : count / most;
    std::vector<std::vector<std::size_t>> blocks;
    for (auto& component : components) {
        if (!blocks.empty() && blocks.back().size() < min_size) {
            blocks.back().insert(blocks.back().end(), component.begin(), component.end());
        } else {
            blocks.push_back(std::move(component));
        }
    }
    return blocks;
}

} // namespace tribode
