#include "tribode/system/equations_json.hpp"
#include "tribode/base/error.hpp"

#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace tribode {

namespace {

constexpr std::array op_names = {"constant", "variable", "add",        "subtract", "multiply", "divide", "negate",
                                 "power",    "sin",      "cos",        "tan",      "asin",     "acos",   "atan",
                                 "atan2",    "tanh",     "exp",        "log",      "sqrt",     "floor",  "lookup",
                                 "delay",    "less",     "less_equal", "equal",    "all",      "any",    "not",
                                 "select",   "no_event", "rate",       "before"};
static_assert(op_names.size() == static_cast<std::size_t>(Op::before) + 1);

Op op_named(const std::string& name) {
    for (std::size_t i = 0; i < op_names.size(); ++i) {
        if (name == op_names[i]) return static_cast<Op>(i);
    }
    throw InputError(fmt::format("equations: \"{}\" is no operation", name));
}

// JSON has no infinity.
Json number_json(double value) {
    if (std::isnan(value)) return "nan";
    if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
    return value;
}

double number_from(const Json& json) {
    if (json.is_number()) return json.get<double>();
    const auto text = json.get<std::string>();
    if (text == "nan") return std::numeric_limits<double>::quiet_NaN();
    return (text == "-inf" ? -1 : 1) * std::numeric_limits<double>::infinity();
}

Json points_json(const LookupTable::Points& points) {
    return {{"name", points.name},
            {"x", points.x},
            {"y", points.y},
            {"values", points.values},
            {"interpolation", static_cast<int>(points.interpolation)},
            {"extrapolation", static_cast<int>(points.extrapolation)},
            {"units", {points.x_unit, points.y_unit, points.unit}}};
}

LookupTable::Points points_from(const Json& json) {
    LookupTable::Points points;
    points.name = json.at("name");
    points.x = json.at("x").get<std::vector<double>>();
    points.y = json.at("y").get<std::vector<double>>();
    points.values = json.at("values").get<std::vector<double>>();
    points.interpolation = static_cast<LookupTable::Interpolation>(json.at("interpolation").get<int>());
    points.extrapolation = static_cast<LookupTable::Extrapolation>(json.at("extrapolation").get<int>());
    points.x_unit = json.at("units").at(0);
    points.y_unit = json.at("units").at(1);
    points.unit = json.at("units").at(2);
    return points;
}

// All that is named or evaluated.
std::vector<Term> roots_of(const Equations& equations) {
    std::vector<Term> roots = equations.terms();
    roots.push_back(equations.time);
    const auto add_symbols = [&](const auto& variables) {
        for (const auto& variable : variables) roots.push_back(variable.symbol);
    };
    add_symbols(equations.states);
    add_symbols(equations.discrete);
    add_symbols(equations.parameters);
    add_symbols(equations.inputs);
    for (const auto& when : equations.whens) {
        for (const auto& [target, value] : when.set) roots.push_back(target);
    }
    for (const auto& clock : equations.clocks) {
        for (const auto& [target, value] : clock.set) roots.push_back(target);
    }
    for (const auto& contact : equations.contacts) roots.insert(roots.end(), {contact.force, contact.mode});
    return roots;
}

} // namespace

Json equations_json(const Equations& equations) {
    for (const auto& clock : equations.clocks) {
        if (!clock.function) continue;
        throw InputError(
            fmt::format("{}: the clock {} calls a function of the script, which equations cannot hold; give "
                        "it a set function",
                        equations.name, clock.name));
    }
    const auto& graph = *equations.graph;
    std::unordered_map<Term, std::size_t> place;
    std::unordered_map<const LookupTable::Points*, std::size_t> points;
    std::unordered_map<const LookupTable*, std::size_t> tables;
    Json nodes = Json::array(), point_list = Json::array(), table_list = Json::array();
    const auto table_place = [&](const LookupTable* table) {
        const auto [known, is_new] = tables.try_emplace(table, tables.size());
        if (!is_new) return known->second;
        const auto [first, is_first] = points.try_emplace(&table->points(), points.size());
        if (is_first) point_list.push_back(points_json(table->points()));
        table_list.push_back({first->second, table->derivation()});
        return known->second;
    };
    for (const Term term : graph.reachable(roots_of(equations))) {
        place.emplace(term, place.size());
        const auto& node = graph[term];
        Json entry = {op_names[static_cast<std::size_t>(node.op)]};
        const std::array operands = {node.a, node.b, node.c};
        if (node.op == Op::constant) entry.push_back(number_json(node.value));
        if (node.op == Op::variable) entry.push_back(graph.name(term));
        if (node.op == Op::lookup) entry.push_back(table_place(graph.table_of(term).get()));
        for (std::size_t i = 0; i < static_cast<std::size_t>(operand_count(node.op)); ++i) {
            entry.push_back(place.at(operands[i]));
        }
        nodes.push_back(std::move(entry));
    }
    const auto set_json = [&](const Equations::Assignments& set) {
        Json list = Json::array();
        for (const auto& [target, value] : set) list.push_back({place.at(target), place.at(value)});
        return list;
    };
    Json json{{"name", equations.name}, {"nodes", nodes}, {"points", point_list}, {"tables", table_list}};
    json["time"] = place.at(equations.time);
    for (const char* list : {"states", "discrete", "parameters", "inputs", "outputs", "whens", "clocks", "contacts"}) {
        json[list] = Json::array();
    }
    for (const auto& v : equations.states) {
        json["states"].push_back({{"name", v.name},
                                  {"unit", v.unit},
                                  {"start", v.start},
                                  {"nominal", v.nominal},
                                  {"symbol", place.at(v.symbol)},
                                  {"rate", place.at(v.rate)},
                                  {"where", v.where},
                                  {"equation", v.equation}});
    }
    for (const auto& v : equations.discrete) {
        json["discrete"].push_back({{"name", v.name},
                                    {"unit", v.unit},
                                    {"start", v.start},
                                    {"symbol", place.at(v.symbol)},
                                    {"modes", v.modes}});
    }
    for (const auto& v : equations.parameters) {
        json["parameters"].push_back(
            {{"name", v.name}, {"unit", v.unit}, {"value", v.value}, {"symbol", place.at(v.symbol)}});
    }
    for (const auto& v : equations.inputs) {
        json["inputs"].push_back(
            {{"name", v.name}, {"unit", v.unit}, {"value", v.value}, {"symbol", place.at(v.symbol)}});
    }
    for (const auto& v : equations.outputs) {
        json["outputs"].push_back({{"name", v.name}, {"unit", v.unit}, {"value", place.at(v.value)}});
    }
    for (const auto& w : equations.whens) {
        json["whens"].push_back({{"name", w.name},
                                 {"condition", place.at(w.condition)},
                                 {"set", set_json(w.set)},
                                 {"at_start", w.at_start},
                                 {"stop", w.stop}});
    }
    for (const auto& c : equations.clocks) {
        json["clocks"].push_back(
            {{"name", c.name}, {"period", c.period}, {"offset", c.offset}, {"set", set_json(c.set)}});
    }
    for (const auto& c : equations.contacts) {
        json["contacts"].push_back({{"friction", c.law == Equations::Contact::Law::friction},
                                    {"name", c.name},
                                    {"force", place.at(c.force)},
                                    {"mode", place.at(c.mode)},
                                    {"quantity", place.at(c.quantity)},
                                    {"level", place.at(c.level)},
                                    {"release", place.at(c.release)},
                                    {"restitution", place.at(c.restitution)},
                                    {"rest_speed", c.rest_speed ? Json(place.at(*c.rest_speed)) : Json()}});
    }
    return json;
}

static Equations read_equations(const Json& json) {
    Equations made;
    made.name = json.at("name");
    made.graph = std::make_shared<Expressions>();
    auto& graph = *made.graph;
    std::vector<std::shared_ptr<const LookupTable>> roots, tables;
    for (const auto& points : json.at("points")) roots.push_back(std::make_shared<LookupTable>(points_from(points)));
    for (const auto& table : json.at("tables")) {
        tables.push_back(
            LookupTable::derived(roots.at(table.at(0).get<std::size_t>()), table.at(1).get<std::string>()));
        if (!tables.back()) throw InputError("equations: a table has no such derivation");
    }
    std::vector<Term> terms;
    for (const auto& node : json.at("nodes")) {
        const Op op = op_named(node.at(0).get<std::string>());
        if (op == Op::constant) {
            terms.push_back(graph.constant(number_from(node.at(1))));
            continue;
        }
        if (op == Op::variable) {
            terms.push_back(graph.variable(node.at(1).get<std::string>()));
            continue;
        }
        const std::size_t first = op == Op::lookup ? 2 : 1;
        std::array<Term, 3> operands{};
        for (std::size_t i = 0; i < static_cast<std::size_t>(operand_count(op)); ++i) {
            operands[i] = terms.at(node.at(first + i).get<std::size_t>());
        }
        const auto [a, b, c] = operands;
        terms.push_back(op == Op::lookup ? graph.look_up(tables.at(node.at(1).get<std::size_t>()), a, b, c)
                                         : graph.make(op, a, b, c));
    }
    const auto term = [&](const Json& place) { return terms.at(place.get<std::size_t>()); };
    const auto set_from = [&](const Json& list) {
        Equations::Assignments set;
        for (const auto& entry : list) set.emplace_back(term(entry.at(0)), term(entry.at(1)));
        return set;
    };
    made.time = term(json.at("time"));
    for (const auto& v : json.at("states")) {
        made.states.push_back({v.at("name"), v.at("unit"), v.at("start"), v.at("nominal"), term(v.at("symbol")),
                               term(v.at("rate")), v.at("where"), v.at("equation")});
    }
    for (const auto& v : json.at("discrete")) {
        made.discrete.push_back({v.at("name"), v.at("unit"), v.at("start"), term(v.at("symbol")),
                                 v.at("modes").get<std::vector<std::string>>()});
    }
    for (const auto& v : json.at("parameters")) {
        made.parameters.push_back({v.at("name"), v.at("unit"), v.at("value"), term(v.at("symbol"))});
    }
    for (const auto& v : json.at("inputs")) {
        made.inputs.push_back({v.at("name"), v.at("unit"), v.at("value"), term(v.at("symbol"))});
    }
    for (const auto& v : json.at("outputs")) made.outputs.push_back({v.at("name"), v.at("unit"), term(v.at("value"))});
    for (const auto& w : json.at("whens")) {
        made.whens.push_back(
            {w.at("name"), term(w.at("condition")), set_from(w.at("set")), w.at("at_start"), w.at("stop")});
    }
    for (const auto& c : json.at("clocks")) {
        made.clocks.push_back({c.at("name"), c.at("period"), c.at("offset"), set_from(c.at("set")), std::nullopt});
    }
    for (const auto& c : json.at("contacts")) {
        using Law = Equations::Contact::Law;
        const Json& speed = c.at("rest_speed");
        made.contacts.push_back({c.at("friction").get<bool>() ? Law::friction : Law::impact, c.at("name"),
                                 term(c.at("force")), term(c.at("mode")), term(c.at("quantity")), term(c.at("level")),
                                 term(c.at("release")), term(c.at("restitution")),
                                 speed.is_null() ? std::nullopt : std::optional(term(speed))});
    }
    return made;
}

Equations equations_from(const Json& json) {
    try {
        return read_equations(json);
    } catch (const Json::exception& problem) {
        throw InputError(fmt::format("equations: {}", problem.what()));
    } catch (const std::out_of_range&) {
        throw InputError("equations: a term stands before its operands");
    }
}

} // namespace tribode
