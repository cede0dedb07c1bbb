#include "tribode/system/linearization.hpp"
#include "tribode/base/error.hpp"
#include "tribode/system/equation_system.hpp"
#include "tribode/system/input_delays.hpp"
#include "tribode/system/message_text.hpp"
#include "tribode/system/tape.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>
#include <set>
#include <unsupported/Eigen/MatrixFunctions>

namespace tribode {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// Values and derivatives of terms at one point.
class Local {
  public:
    Local(const Equations& equations, const OperatingPoint& point) : name_(equations.name), graph_(*equations.graph) {
        const auto add = [&](Term symbol, double value) {
            symbols_.push_back(symbol);
            values_.push_back(value);
        };
        add(equations.time, point.t);
        for (std::size_t i = 0; i < point.states.size(); ++i) add(equations.states[i].symbol, point.states[i]);
        for (std::size_t i = 0; i < point.discrete.size(); ++i) add(equations.discrete[i].symbol, point.discrete[i]);
        for (const auto& input : equations.inputs) add(input.symbol, input.value);
        for (const auto& parameter : equations.parameters) add(parameter.symbol, parameter.value);
    }

    std::vector<double> values(const std::vector<Term>& terms) const {
        std::vector<double> result(terms.size());
        Tape(graph_, symbols_, terms).evaluate({values_}, result);
        return result;
    }

    // (terms x variables); what rounds is taken by its mean slope, a remainder by that between its jumps. Throws InputError
    // where a slope is not a finite number.
    MatrixXd jacobian(std::vector<Term> terms, const std::vector<Term>& variables) const {
        while (true) {
            Expressions::Replacement operands;
            const auto remainders = in_remainders(terms);
            for (const Term term : roundings(terms)) {
                if (!remainders.contains(term)) operands[term] = graph_[term].a;
            }
            if (operands.empty()) break;
            terms = graph_.substitute(terms, operands);
        }
        MatrixXd matrix(static_cast<Index>(terms.size()), static_cast<Index>(variables.size()));
        for (std::size_t j = 0; j < variables.size(); ++j) {
            const auto column = values(graph_.derivatives(terms, variables[j]));
            for (std::size_t i = 0; i < column.size(); ++i) {
                matrix(static_cast<Index>(i), static_cast<Index>(j)) = column[i];
                if (std::isfinite(column[i])) continue;
                throw InputError(fmt::format("{}: the slope of {} by {} is not a finite number at this point", name_,
                                             shortened(graph_.text(terms[i])), graph_.name(variables[j])));
            }
        }
        return matrix;
    }

    std::vector<Term> roundings(const std::vector<Term>& terms) const { return all_of(terms, {Op::floor}); }

    // The floors in a % b = a - floor(a/b) b, or in what it is with the other sign.
    std::set<Term> in_remainders(const std::vector<Term>& terms) const {
        std::set<Term> found;
        const auto look = [&](Term a, Term whole) {
            const auto is_quotient = [&](Term floor, std::optional<Term> b) {
                if (graph_[floor].op != Op::floor) return false;
                const auto& of = graph_[graph_[floor].a];
                return b ? of.op == Op::divide && of.a == a && of.b == *b : graph_[floor].a == a;
            };
            const auto& product = graph_[whole];
            if (is_quotient(whole, std::nullopt)) found.insert(whole);
            if (product.op == Op::multiply && is_quotient(product.a, product.b)) found.insert(product.a);
            if (product.op == Op::multiply && is_quotient(product.b, product.a)) found.insert(product.b);
        };
        for (const Term term : all_of(terms, {Op::subtract})) {
            look(graph_[term].a, graph_[term].b);
            look(graph_[term].b, graph_[term].a);
        }
        return found;
    }

    // The relations in the terms on whose edge the point lies.
    std::vector<Term> edges(const std::vector<Term>& terms) const {
        std::vector<Term> list = all_of(terms, {Op::less, Op::less_equal});
        std::erase_if(list, [&](Term relation) {
            const auto sides = values({graph_[relation].a, graph_[relation].b});
            return sides[0] != sides[1];
        });
        return list;
    }

  private:
    std::vector<Term> all_of(const std::vector<Term>& terms, std::initializer_list<Op> kinds) const {
        std::vector<Term> found = graph_.reachable(terms);
        std::erase_if(found,
                      [&](Term term) { return std::find(kinds.begin(), kinds.end(), graph_[term].op) == kinds.end(); });
        return found;
    }

    const std::string& name_;
    Expressions& graph_;
    std::vector<Term> symbols_;
    std::vector<double> values_;
};

// The derivative of a function from outside by what it reads, by central differences.
MatrixXd differences(const Equations::Function& function, std::vector<double> read) {
    MatrixXd matrix(static_cast<Index>(function.writes.size()), static_cast<Index>(read.size()));
    std::vector<double> above(function.writes.size()), below(function.writes.size());
    for (std::size_t j = 0; j < read.size(); ++j) {
        // The cube root of rounding, where the error of the difference and that of the function are alike.
        const double center = read[j], h = 6e-6 * std::max(1.0, std::abs(center));
        read[j] = center + h;
        function.call(0, read, above);
        read[j] = center - h;
        function.call(0, read, below);
        read[j] = center;
        for (std::size_t i = 0; i < above.size(); ++i) {
            matrix(static_cast<Index>(i), static_cast<Index>(j)) = (above[i] - below[i]) / (2 * h);
        }
    }
    return matrix;
}

// The states, with the algebraic variables that belong to them.
std::vector<double> consistent_states(const Equations& equations, const OperatingPoint& point) {
    const auto& states = equations.states;
    if (std::none_of(states.begin(), states.end(), [](const auto& state) { return state.is_algebraic(); })) {
        return point.states;
    }
    Equations copy = equations;
    for (const auto& delayed : take_out_delays(copy)) copy.replace({{delayed.symbol, delayed.input}});
    for (std::size_t i = 0; i < states.size(); ++i) copy.states[i].start = point.states[i];
    for (std::size_t i = 0; i < copy.discrete.size(); ++i) copy.discrete[i].start = point.discrete[i];
    return EquationSystem(std::move(copy)).initial_state(point.t).x;
}

// The least time that all periods divide.
double common_period(const Equations& equations) {
    constexpr int most = 1000;
    double longest = 0;
    for (const auto& clock : equations.clocks) longest = std::max(longest, clock.period);
    for (int m = 1; m <= most; ++m) {
        const double period = m * longest;
        const bool fits = std::all_of(equations.clocks.begin(), equations.clocks.end(), [&](const auto& clock) {
            const double ratio = period / clock.period;
            return std::abs(ratio - std::round(ratio)) < 1e-9 * ratio;
        });
        if (fits) return period;
    }
    throw InputError(fmt::format("{}: the sample clocks have no common period of up to {} times the longest, {} s",
                                 equations.name, most, longest));
}

struct Firing {
    double at; // in the period [s]
    std::size_t clock;
};

// In the order in which they fire in a period.
std::vector<Firing> firings_of(const Equations& equations, double period) {
    std::vector<Firing> list;
    for (std::size_t i = 0; i < equations.clocks.size(); ++i) {
        const auto& clock = equations.clocks[i];
        const long count = std::lround(period / clock.period);
        for (long k = 0; k < count; ++k) {
            double at = std::fmod(clock.offset + static_cast<double>(k) * clock.period, period);
            if (at > period * (1 - 1e-9)) at = 0;
            list.push_back({at, i});
        }
    }
    std::sort(list.begin(), list.end(), [&](const Firing& a, const Firing& b) {
        if (std::abs(a.at - b.at) > 1e-9 * period) return a.at < b.at;
        return a.clock < b.clock;
    });
    return list;
}

// What is no part of the linear system, in words.
std::vector<std::string> left_out(const Equations& equations, const OperatingPoint& point, const Local& local) {
    auto& graph = *equations.graph;
    std::vector<std::string> list;
    Expressions::Replacement modes; // the events of other modes are none here
    for (std::size_t i = 0; i < equations.discrete.size(); ++i) {
        if (equations.discrete[i].modes.empty()) continue;
        modes[equations.discrete[i].symbol] = graph.constant(point.discrete[i]);
    }
    for (const auto& when : equations.whens) {
        const Term here = graph.substitute(std::vector{when.condition}, modes)[0];
        if (!graph.is_constant(here, 0)) list.push_back(fmt::format("the event {}", when.name));
    }
    std::vector<Term> terms;
    for (const auto& state : equations.states) terms.push_back(state.rate);
    for (const auto& output : equations.outputs) terms.push_back(output.value);
    for (const auto& clock : equations.clocks) {
        for (const auto& [target, value] : clock.set) terms.push_back(value);
        if (clock.function) terms.insert(terms.end(), clock.function->reads.begin(), clock.function->reads.end());
    }
    terms = graph.substitute(terms, modes);
    for (const Term term : graph.reachable(terms)) {
        if (graph[term].op == Op::delay) list.push_back(fmt::format("the time that {} takes", graph.text(term)));
    }
    for (const Term term : local.roundings(terms)) list.push_back(fmt::format("the steps of {}", graph.text(term)));
    for (const Term term : local.edges(terms)) list.push_back(fmt::format("the other side of {}", graph.text(term)));
    return list;
}

} // namespace

Linearization linearize(const Equations& equations, const OperatingPoint& given) {
    OperatingPoint point = given;
    point.states = consistent_states(equations, given);
    const Local local(equations, point);
    Linearization made;
    std::vector<Term> conditions;
    for (const auto& when : equations.whens) {
        conditions.push_back(when.condition);
        if (!when.at_start || local.values({when.condition})[0] == 0) continue;
        throw InputError(
            fmt::format("{}: there is no linear system at this point, as the event {} happens there at once; "
                        "begin `at` with what it leads to, such as its mode",
                        equations.name, when.name));
    }
    std::vector<Term> states, discrete, inputs, rates, outputs;
    std::vector<Term> algebraic, residuals;
    std::vector<std::size_t> places; // of the states
    for (std::size_t i = 0; i < equations.states.size(); ++i) {
        const auto& state = equations.states[i];
        (state.is_algebraic() ? algebraic : states).push_back(state.symbol);
        (state.is_algebraic() ? residuals : rates).push_back(state.rate);
        if (state.is_algebraic()) continue;
        places.push_back(i);
        made.states.push_back(state.name);
    }
    // Algebraic variables go with what their equations depend on.
    Eigen::FullPivLU<MatrixXd> of_algebraic;
    if (!algebraic.empty()) of_algebraic.compute(local.jacobian(residuals, algebraic));
    if (!algebraic.empty() && !of_algebraic.isInvertible()) {
        throw InputError(
            fmt::format("{}: the algebraic equations do not determine their variables at this point", equations.name));
    }
    const auto jacobian = [&](const std::vector<Term>& terms, const std::vector<Term>& variables) -> MatrixXd {
        MatrixXd direct = local.jacobian(terms, variables);
        if (algebraic.empty()) return direct;
        return direct - local.jacobian(terms, algebraic) * of_algebraic.solve(local.jacobian(residuals, variables));
    };
    for (const auto& variable : equations.discrete) discrete.push_back(variable.symbol);
    for (const auto& input : equations.inputs) {
        inputs.push_back(input.symbol);
        made.inputs.push_back(input.name);
    }
    for (const auto& output : equations.outputs) {
        outputs.push_back(output.value);
        made.outputs.push_back(output.name);
    }
    const auto rate = local.values(rates);
    for (std::size_t i = 0; i < rate.size(); ++i) {
        if (!std::isfinite(rate[i])) {
            throw InputError(fmt::format("{}: der({}) is not a finite number at this point", equations.name,
                                         equations.states[places[i]].name));
        }
        made.rate_left = std::max(made.rate_left, std::abs(rate[i]) / equations.states[places[i]].nominal);
    }
    made.left_out = left_out(equations, point, local);
    const MatrixXd a = jacobian(rates, states), b = jacobian(rates, inputs);
    made.d = jacobian(outputs, inputs);
    if (equations.clocks.empty()) {
        made.a = a;
        made.b = b;
        made.c = jacobian(outputs, states);
        return made;
    }

    // z = (x, d), and beside it u, which lasts.
    for (const auto& variable : equations.discrete) made.states.push_back(variable.name);
    const auto n = static_cast<Index>(states.size()), m = static_cast<Index>(discrete.size()),
               r = static_cast<Index>(inputs.size());
    MatrixXd flow = MatrixXd::Zero(n + m + r, n + m + r);
    flow.topLeftCorner(n, n) = a;
    flow.block(0, n, n, m) = jacobian(rates, discrete);
    flow.topRightCorner(n, r) = b;

    std::vector<Term> all = states;
    all.insert(all.end(), discrete.begin(), discrete.end());
    all.insert(all.end(), inputs.begin(), inputs.end());
    std::vector<double> now;
    for (const std::size_t i : places) now.push_back(point.states[i]);
    now.insert(now.end(), point.discrete.begin(), point.discrete.end());
    const auto place_of = [&](Term symbol) {
        return static_cast<Index>(std::find(all.begin(), all.end(), symbol) - all.begin());
    };
    MatrixXd whole = MatrixXd::Identity(n + m + r, n + m + r);
    // What the clocks of the period set at the point, one after another, and whether that is an event.
    OperatingPoint after = point;
    auto held = local.values(conditions);
    const auto look_for_events = [&](const std::vector<Term>& targets, const std::vector<double>& values) {
        for (std::size_t i = 0; i < targets.size(); ++i) {
            const auto place = static_cast<std::size_t>(place_of(targets[i]));
            (place < states.size() ? after.states[places[place]] : after.discrete[place - states.size()]) = values[i];
        }
        after.states = consistent_states(equations, after);
        const auto holds = Local(equations, after).values(conditions);
        for (std::size_t i = 0; i < holds.size(); ++i) {
            if (held[i] != 0 || holds[i] == 0) continue;
            throw InputError(fmt::format("{}: a sample at this point makes the event {} happen, which no linear system "
                                         "has; choose a point at rest",
                                         equations.name, equations.whens[i].name));
        }
        held = holds;
    };
    const auto jump = [&](const std::vector<Term>& targets, const MatrixXd& by_all, const std::vector<double>& values) {
        look_for_events(targets, values);
        MatrixXd map = MatrixXd::Identity(n + m + r, n + m + r);
        for (std::size_t i = 0; i < targets.size(); ++i) {
            const Index place = place_of(targets[i]);
            map.row(place) = by_all.row(static_cast<Index>(i));
            const double nominal = place < n ? equations.states[places[static_cast<std::size_t>(place)]].nominal : 1;
            made.jump_left =
                std::max(made.jump_left, std::abs(values[i] - now[static_cast<std::size_t>(place)]) / nominal);
        }
        whole = map * whole;
    };
    made.sample_time = common_period(equations);
    double at = 0;
    const auto advance = [&](double to) {
        if (to > at) whole = MatrixXd((flow * (to - at)).exp()) * whole;
        at = to;
    };
    for (const auto& firing : firings_of(equations, made.sample_time)) {
        advance(firing.at);
        const auto& clock = equations.clocks[firing.clock];
        std::vector<Term> targets, values;
        for (const auto& [target, value] : clock.set) {
            targets.push_back(target);
            values.push_back(value);
        }
        jump(targets, jacobian(values, all), local.values(values));
        if (!clock.function) continue;
        if (clock.function->open) {
            throw InputError(
                fmt::format("{}: the block of {} has memory of its own, as a functional mock-up unit has, and "
                            "cannot be linearized",
                            equations.name, clock.name));
        }
        const auto read = local.values(clock.function->reads);
        std::vector<double> written(clock.function->writes.size());
        clock.function->call(0, read, written);
        jump(clock.function->writes, differences(*clock.function, read) * jacobian(clock.function->reads, all),
             written);
    }
    advance(made.sample_time);
    made.a = whole.topLeftCorner(n + m, n + m);
    made.b = whole.topRightCorner(n + m, r);
    all.resize(static_cast<std::size_t>(n + m));
    made.c = jacobian(outputs, all);
    return made;
}

std::vector<std::complex<double>> Linearization::poles() const {
    if (a.rows() == 0) return {};
    const Eigen::VectorXcd values = a.eigenvalues();
    std::vector<std::complex<double>> list(values.begin(), values.end());
    std::sort(list.begin(), list.end(), [](const auto& p, const auto& q) {
        return p.real() != q.real() ? p.real() < q.real() : p.imag() < q.imag();
    });
    return list;
}

bool Linearization::is_stable() const {
    const auto all = poles();
    return std::all_of(all.begin(), all.end(),
                       [&](const auto& pole) { return sample_time > 0 ? std::abs(pole) < 1 : pole.real() < 0; });
}

std::complex<double> Linearization::response(double frequency_hz, std::size_t input, std::size_t output) const {
    const std::complex<double> s(0, 2 * std::numbers::pi * frequency_hz);
    const std::complex<double> place = sample_time > 0 ? std::exp(s * sample_time) : s;
    const auto in = static_cast<Index>(input), out = static_cast<Index>(output);
    if (a.rows() == 0) return d(out, in);
    const Eigen::MatrixXcd matrix =
        place * Eigen::MatrixXcd::Identity(a.rows(), a.cols()) - a.cast<std::complex<double>>();
    const Eigen::VectorXcd z = matrix.partialPivLu().solve(b.col(in).cast<std::complex<double>>());
    return (c.row(out).cast<std::complex<double>>() * z)(0) + d(out, in);
}

} // namespace tribode
