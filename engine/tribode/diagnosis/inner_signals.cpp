#include "tribode/diagnosis/inner_signals.hpp"
#include "tribode/base/error.hpp"
#include "tribode/system/units.hpp"

#include <algorithm>
#include <map>
#include <set>

namespace tribode {

namespace {

constexpr std::size_t max_signals = 8; // of either kind
constexpr std::size_t max_text = 60;   // of a name

class Finder {
  public:
    explicit Finder(SystemModel& model)
        : model_(model),
          e_(model.equations),
          graph_(*model.equations.graph),
          units_(graph_) {
        for (const auto& state : e_.states) moving_.insert(state.symbol);
        for (const auto& input : e_.inputs) moving_.insert(input.symbol);
        const auto set_units = [&](const auto& variables) {
            for (const auto& one : variables) {
                if (!one.unit.empty()) units_.set(one.symbol, one.unit);
            }
        };
        set_units(e_.states);
        set_units(e_.inputs);
        set_units(e_.parameters);
    }

    void add_differences() {
        // What is multiplied, or the argument of a function; and what such a sum adds up first, as the force of a controller to which
        // that of friction is added.
        std::vector<Term> found, partial;
        std::vector<Term> roots = rates();
        for (const auto& output : e_.outputs) roots.push_back(output.value);
        for (const Term term : graph_.reachable(roots)) {
            const auto node = graph_[term];
            if (node.op == Op::select || is_condition(node.op)) continue;
            const int count = operand_count(node.op);
            for (const Term operand : {node.a, node.b}) {
                const bool is_operand = operand == node.a ? count > 0 : count > 1;
                if (is_operand && is_combination(operand)) (is_sum(term) ? partial : found).push_back(operand);
            }
        }
        for (auto* list : {&found, &partial}) {
            std::ranges::sort(*list);
            for (const Term term : *list) {
                if (added_.size() < max_signals && added_.insert(term).second) {
                    add(term, SystemModel::InnerSignal::Kind::difference);
                }
            }
        }
    }

    void add_shared() {
        // Of each term, in which rates it is.
        std::map<Term, std::set<std::size_t>> in;
        for (std::size_t i = 0; i < e_.states.size(); ++i) {
            const Term rate = e_.states[i].rate;
            const Op op = graph_[rate].op;
            if (e_.states[i].is_algebraic() || op == Op::variable || op == Op::constant) continue;
            for (const Term term : graph_.reachable(std::span(&rate, 1))) in[term].insert(i);
        }
        // The largest ones: no part of a larger one that as many share.
        std::set<Term> parts;
        for (const auto& [term, rates] : in) {
            const auto node = graph_[term];
            const int count = operand_count(node.op);
            const Term operands[] = {node.a, node.b, node.c};
            for (int i = 0; i < count; ++i) {
                if (in[operands[i]].size() == rates.size()) parts.insert(operands[i]);
            }
        }
        std::size_t count = 0;
        for (const auto& [term, rates] : in) {
            if (rates.size() < 2 || parts.contains(term) || operand_count(graph_[term].op) == 0) continue;
            if (is_condition(graph_[term].op) || !moves(term) || count++ == max_signals) continue;
            add(term, SystemModel::InnerSignal::Kind::shared, rates);
        }
    }

  private:
    std::vector<Term> rates() const {
        std::vector<Term> list;
        for (const auto& state : e_.states) list.push_back(state.rate);
        return list;
    }

    bool moves(Term term) const {
        const auto variables = graph_.variables_of(std::span(&term, 1));
        return std::any_of(variables.begin(), variables.end(), [&](Term v) { return moving_.contains(v); });
    }

    // A sum or difference of at least two states or inputs, each of them by itself or times what does not move.
    bool is_combination(Term term) const {
        std::size_t parts = 0;
        return is_sum(term) && is_linear(term, parts) && parts >= 2;
    }
    bool is_sum(Term term) const { return graph_[term].op == Op::add || graph_[term].op == Op::subtract; }
    bool is_linear(Term term, std::size_t& parts) const {
        const auto& node = graph_[term];
        if (!moves(term)) return true;
        switch (node.op) {
        case Op::variable: ++parts; return true;
        case Op::add:
        case Op::subtract: return is_linear(node.a, parts) && is_linear(node.b, parts);
        case Op::negate: return is_linear(node.a, parts);
        case Op::multiply:
            return (!moves(node.a) && is_linear(node.b, parts)) || (!moves(node.b) && is_linear(node.a, parts));
        case Op::divide: return !moves(node.b) && is_linear(node.a, parts);
        default: return false;
        }
    }

    // Of a sum of states theirs, as it is written; else what follows from the units of all that is in it.
    std::string unit_of(Term term) {
        const auto& node = graph_[term];
        for (const auto& state : e_.states) {
            if (is_sum(term) && (state.symbol == node.a || state.symbol == node.b)) return state.unit;
        }
        try {
            const Dimension dimension = units_.of(term);
            return !dimension || dimension->empty() ? "" : to_readable_text(dimension);
        } catch (const InputError&) { // the model's author left some out
            return "";
        }
    }

    void add(Term term, SystemModel::InnerSignal::Kind kind, const std::set<std::size_t>& rates = {}) {
        std::string name = graph_.text(term);
        if (kind == SystemModel::InnerSignal::Kind::shared) {
            name = "what ";
            for (const std::size_t i : rates) {
                name += (i == *rates.begin()    ? ""
                         : i == *rates.rbegin() ? " and "
                                                : ", ") +
                        ("der(" + e_.states[i].name + ")");
            }
            name += " share";
        }
        if (name.size() > max_text) name.resize(max_text);
        const std::string first = name;
        for (int n = 2; is_taken(name); ++n) name = first + " (" + std::to_string(n) + ")";
        model_.inner.push_back({e_.outputs.size(), term, kind});
        e_.outputs.push_back({name, unit_of(term), term});
    }

    bool is_taken(const std::string& name) const {
        return std::any_of(e_.outputs.begin(), e_.outputs.end(), [&](const auto& one) { return one.name == name; });
    }

    SystemModel& model_;
    Equations& e_;
    Expressions& graph_;
    Units units_;
    std::set<Term> moving_;
    std::set<Term> added_; // differences
};

} // namespace

SystemModel with_inner_signals(SystemModel model) {
    // Of a script with many systems the graph has all of these, and each hypothesis is a copy.
    model.equations = model.equations.with_own_graph();
    Finder finder(model);
    finder.add_differences();
    finder.add_shared();
    return model;
}

Equations without_inner_signals(const SystemModel& model) {
    Equations equations = model.equations;
    if (!model.inner.empty()) equations.outputs.resize(model.inner.front().output);
    return equations;
}

} // namespace tribode
