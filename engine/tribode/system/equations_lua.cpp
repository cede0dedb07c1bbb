#include "tribode/system/equations_lua.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/system/contacts.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <set>

namespace tribode {

namespace {

// Names of variables as fields of Lua: letters, digits and "_" alone, each once.
class Names {
  public:
    std::string of(const std::string& name) {
        if (const auto found = names_.find(name); found != names_.end()) return found->second;
        std::string plain;
        for (const char c : name) plain += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
        while (!plain.empty() && plain.back() == '_') plain.pop_back();
        if (plain.empty() || std::isdigit(static_cast<unsigned char>(plain.front()))) plain = "v" + plain;
        static const std::set<std::string> words = {
            "and",   "break", "do",  "else", "elseif", "end",    "false", "for",  "function", "goto",  "if", "in",
            "local", "nil",   "not", "or",   "repeat", "return", "then",  "true", "until",    "while", "t",  "mode"};
        while (words.contains(plain) || taken_.contains(plain)) plain += "_";
        taken_.insert(plain);
        return names_[name] = plain;
    }

  private:
    std::map<std::string, std::string> names_;
    std::set<std::string> taken_;
};

std::string number(double value) {
    if (std::isinf(value)) return value > 0 ? "math.huge" : "-math.huge";
    if (std::isnan(value)) return "(0 / 0)";
    return to_text(value);
}

// The body of a function of `s` that returns something made of these terms: first the subexpressions that several share.
class Body {
  public:
    Body(const Expressions& graph, const std::map<Term, std::string>& variables, const std::vector<Term>& roots)
        : graph_(graph),
          variables_(variables) {
        std::map<Term, int> uses;
        for (const Term root : roots) ++uses[root];
        const auto order = graph.reachable(roots);
        for (const Term term : order) {
            const auto& node = graph[term];
            const int operands = operand_count(node.op);
            if (operands > 0) ++uses[node.a];
            if (operands > 1) ++uses[node.b];
            if (operands > 2) ++uses[node.c];
        }
        int count = 0;
        for (const Term term : order) {
            const Op op = graph[term].op;
            if (op == Op::constant || op == Op::variable || uses[term] < 2 || is_condition(op)) continue;
            if (count >= 150) break; // Lua has no more than 200 local variables
            const std::string text = of(term);
            shared_[term] = fmt::format("a{}", ++count);
            locals_ += fmt::format("    local {} = {}\n", shared_[term], text);
        }
    }

    const std::string& locals() const { return locals_; }

    std::string of(Term term) const {
        if (const auto found = shared_.find(term); found != shared_.end()) return found->second;
        const auto& node = graph_[term];
        const auto a = [&] { return of(node.a); };
        const auto b = [&] { return of(node.b); };
        const auto call = [&](const char* name) { return fmt::format("{}({})", name, a()); };
        const auto call2 = [&](const char* name) { return fmt::format("{}({}, {})", name, a(), b()); };
        const auto infix = [&](const char* sign) { return fmt::format("({} {} {})", a(), sign, b()); };
        switch (node.op) {
        case Op::constant: return node.value < 0 ? fmt::format("({})", number(node.value)) : number(node.value);
        case Op::variable: {
            const auto found = variables_.find(term);
            if (found == variables_.end()) {
                throw InputError(fmt::format("the variable {} has no text in Lua", graph_.name(term)));
            }
            return found->second;
        }
        case Op::add: return infix("+");
        case Op::subtract: return infix("-");
        case Op::multiply: return infix("*");
        case Op::divide: return infix("/");
        case Op::negate: return fmt::format("(-{})", a());
        case Op::power: return infix("^");
        case Op::sin: return call("math.sin");
        case Op::cos: return call("math.cos");
        case Op::tan: return call("math.tan");
        case Op::asin: return call("math.asin");
        case Op::acos: return call("math.acos");
        case Op::atan: return call("math.atan");
        case Op::atan2: return call2("math.atan");
        case Op::tanh: return call("tb.tanh");
        case Op::exp: return call("math.exp");
        case Op::log: return call("math.log");
        case Op::sqrt: return call("math.sqrt");
        case Op::floor: return call("math.floor");
        case Op::delay: return call2("tb.delay");
        case Op::less: return call2("tb.less");
        case Op::less_equal: return call2("tb.less_equal");
        case Op::equal: return fmt::format("tb.all(tb.less_equal({0}, {1}), tb.less_equal({1}, {0}))", a(), b());
        case Op::all: return call2("tb.all");
        case Op::any: return call2("tb.any");
        case Op::logical_not: return call("tb.negation");
        case Op::select: return fmt::format("tb.where({}, {}, {})", a(), b(), of(node.c));
        case Op::before: return call("tb.before");
        case Op::no_event: return call("tb.no_event");
        case Op::rate:
        case Op::lookup: break;
        }
        throw InputError("a table of values in an equation has no text in Lua yet");
    }

  private:
    const Expressions& graph_;
    const std::map<Term, std::string>& variables_;
    std::map<Term, std::string> shared_;
    std::string locals_;
};

std::string with_unit(const char* key, double value, const std::string& unit) {
    if (unit.empty()) return number(value);
    return fmt::format("{{ {} = {}, unit = \"{}\" }}", key, number(value), unit);
}

} // namespace

std::string equations_lua(const Equations& given, const std::string& heading) {
    Equations e = given;
    e.graph = std::make_shared<Expressions>(*given.graph);
    close_contacts(e);
    const Expressions& graph = *e.graph;
    Names names;
    std::map<Term, std::string> variables = {{e.time, "s.t"}};
    for (const auto& one : e.states) variables[one.symbol] = "s." + names.of(one.name);
    for (const auto& one : e.discrete) variables[one.symbol] = "s." + names.of(one.name);
    for (const auto& one : e.parameters) variables[one.symbol] = "s." + names.of(one.name);
    for (const auto& one : e.inputs) variables[one.symbol] = "s." + names.of(one.name);

    std::string text = heading + "local tb = require \"tribode\"\n\nreturn tb.system {\n";
    if (!e.name.empty()) text += fmt::format("  name = \"{}\",\n", printable(e.name));
    const auto section = [&](const char* key, const auto& list, const auto& line) {
        std::string lines;
        for (const auto& one : list) lines += line(one);
        if (!lines.empty()) text += fmt::format("  {} = {{\n{}  }},\n", key, lines);
    };
    section("parameters", e.parameters, [&](const auto& p) {
        return fmt::format("    {} = {},\n", names.of(p.name), with_unit("value", p.value, p.unit));
    });
    section("inputs", e.inputs, [&](const auto& u) {
        return fmt::format("    {} = {},\n", names.of(u.name), with_unit("value", u.value, u.unit));
    });
    const auto state = [&](const auto& x) {
        std::string fields = fmt::format("start = {}", number(x.start));
        if (!x.unit.empty()) fields += fmt::format(", unit = \"{}\"", x.unit);
        if (x.nominal != 1) fields += fmt::format(", nominal = {}", number(x.nominal));
        return fmt::format("    {} = {{ {} }},\n", names.of(x.name), fields);
    };
    section("states", e.states, [&](const auto& x) { return x.is_algebraic() ? std::string() : state(x); });
    section("algebraic", e.states, [&](const auto& x) { return x.is_algebraic() ? state(x) : std::string(); });
    section("discrete", e.discrete, [&](const auto& d) {
        return fmt::format("    {} = {},\n", names.of(d.name), with_unit("start", d.start, d.unit));
    });
    if (!e.free.empty()) {
        std::string list;
        for (const auto& name : e.free) {
            const bool start = name.ends_with(".start");
            const std::string own = start ? name.substr(0, name.size() - 6) : name;
            list += fmt::format("{}\"{}{}\"", list.empty() ? "" : ", ", names.of(own), start ? ".start" : "");
        }
        text += fmt::format("  free = {{ {} }},\n", list);
    }
    const auto function = [&](const char* key, const std::vector<std::pair<std::string, Term>>& values) {
        if (values.empty()) return;
        std::vector<Term> roots;
        for (const auto& [name, term] : values) roots.push_back(term);
        const Body body(graph, variables, roots);
        text += fmt::format("  {} = function(s)\n{}    return {{\n", key, body.locals());
        for (const auto& [name, term] : values) text += fmt::format("      {} = {},\n", name, body.of(term));
        text += "    }\n  end,\n";
    };
    std::vector<std::pair<std::string, Term>> rates, equations, outputs;
    for (const auto& x : e.states) {
        if (x.is_algebraic()) {
            equations.emplace_back(names.of(x.equation + "_equation"), x.rate);
        } else {
            rates.emplace_back(names.of(x.name), x.rate);
        }
    }
    // An output of the same name as a variable is that variable, which is a column already.
    Names output_names;
    for (const auto& y : e.outputs) {
        const bool is_variable = variables.contains(y.value) && variables.at(y.value) == "s." + names.of(y.name);
        if (!is_variable) outputs.emplace_back(output_names.of(y.name), y.value);
    }
    function("der", rates);
    function("equations", equations);
    function("outputs", outputs);
    const auto assignments = [&](const Equations::Assignments& set, const std::vector<Term>& with, std::string& locals,
                                 std::vector<std::string>& extra) {
        std::vector<Term> roots = with;
        for (const auto& [target, value] : set) roots.push_back(value);
        const Body body(graph, variables, roots);
        locals = body.locals();
        std::string fields;
        for (const auto& [target, value] : set) {
            fields +=
                fmt::format("{}{} = {}", fields.empty() ? "" : ", ", variables.at(target).substr(2), body.of(value));
        }
        for (const Term term : with) extra.push_back(body.of(term));
        return fields;
    };
    section("when", e.whens, [&](const auto& when) {
        std::string locals;
        std::vector<std::string> nothing, condition;
        assignments({}, {when.condition}, locals, condition);
        std::string line = fmt::format("    {{ name = \"{}\",\n      condition = function(s)\n{}    return {} end,\n",
                                       printable(when.name), locals, condition[0]);
        if (!when.set.empty()) {
            const std::string fields = assignments(when.set, {}, locals, nothing);
            line += fmt::format("      set = function(s)\n{}    return {{ {} }} end,\n", locals, fields);
        }
        if (when.at_start) line += "      at_start = true,\n";
        if (when.stop) line += "      stop = true,\n";
        return line + "    },\n";
    });
    section("sample", e.clocks, [&](const auto& clock) {
        if (clock.function) {
            throw InputError(fmt::format("the clock {} calls a function of the script, which has no text", clock.name));
        }
        std::string locals;
        std::vector<std::string> nothing;
        const std::string fields = assignments(clock.set, {}, locals, nothing);
        return fmt::format(
            "    {{ name = \"{}\", period_s = {}, offset_s = {},\n      set = function(s)\n{}    return {{ {} "
            "}} end }},\n",
            printable(clock.name), number(clock.period), number(clock.offset), locals, fields);
    });
    return text + "}\n";
}

} // namespace tribode
