#include "tribode/system/steady_state.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/system/tape.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int max_iterations = 200;
constexpr double at_rest = 1e-9;   // Newton's step over the variables, below which the point rests
constexpr double rounding = 1e-14; // of a derivative over the sizes of its terms

// The derivatives, their Jacobian and the conditions as functions of the free variables, all of them over their nominal
// values.
class Problem {
  public:
    Problem(const Equations& equations, const OperatingPoint& point, const std::vector<Term>& free)
        : equations_(equations),
          rows_(equations.states.size()),
          columns_(free.size()) {
        auto& graph = *equations.graph;
        std::vector<Term> symbols;
        const auto add = [&](Term symbol, double value, double nominal) {
            const auto place = std::find(free.begin(), free.end(), symbol);
            if (place != free.end()) {
                const auto column = static_cast<std::size_t>(place - free.begin());
                places_[column] = symbols.size();
                scale_[column] = nominal;
            }
            symbols.push_back(symbol);
            values_.push_back(value);
        };
        places_.resize(columns_);
        scale_.resize(columns_);
        add(equations.time, point.t, 1);
        for (std::size_t i = 0; i < rows_; ++i) {
            add(equations.states[i].symbol, point.states[i], equations.states[i].nominal);
        }
        for (std::size_t i = 0; i < point.discrete.size(); ++i) {
            add(equations.discrete[i].symbol, point.discrete[i], 1);
        }
        const auto size = [](double value) { return value == 0 ? 1 : std::abs(value); };
        for (const auto& input : equations.inputs) add(input.symbol, input.value, size(input.value));
        for (const auto& parameter : equations.parameters) {
            add(parameter.symbol, parameter.value, size(parameter.value));
        }
        std::vector<Term> rates, conditions, entries;
        for (const auto& state : equations.states) rates.push_back(state.rate);
        for (const auto& when : equations.whens) conditions.push_back(when.condition);
        rates_ = Tape(graph, symbols, rates);
        conditions_ = Tape(graph, symbols, conditions);
        for (const Term variable : free) {
            const auto column = graph.derivatives(rates, variable);
            entries.insert(entries.end(), column.begin(), column.end());
        }
        jacobian_ = Tape(graph, symbols, entries);
        find_terms(symbols, rates);
    }

    std::size_t rows() const { return rows_; }
    std::size_t columns() const { return columns_; }

    VectorXd start() const {
        VectorXd z(static_cast<Index>(columns_));
        for (std::size_t j = 0; j < columns_; ++j) z(static_cast<Index>(j)) = values_[places_[j]] / scale_[j];
        return z;
    }
    std::vector<double> values_at(const VectorXd& z) const {
        std::vector<double> values(columns_);
        for (std::size_t j = 0; j < columns_; ++j) values[j] = z(static_cast<Index>(j)) * scale_[j];
        return values;
    }
    VectorXd rates(const VectorXd& z) const {
        VectorXd result(static_cast<Index>(rows_));
        rates_.evaluate({point(z)}, {result.data(), rows_});
        for (std::size_t i = 0; i < rows_; ++i) result(static_cast<Index>(i)) /= equations_.states[i].nominal;
        return result;
    }
    MatrixXd jacobian(const VectorXd& z) const {
        MatrixXd result(static_cast<Index>(rows_), static_cast<Index>(columns_));
        jacobian_.evaluate({point(z)}, {result.data(), rows_ * columns_});
        for (std::size_t i = 0; i < rows_; ++i) {
            for (std::size_t j = 0; j < columns_; ++j) {
                result(static_cast<Index>(i), static_cast<Index>(j)) *= scale_[j] / equations_.states[i].nominal;
            }
        }
        return result;
    }
    // Of the parts of each derivative that cancel at rest: its slopes times the values of the states and free variables. One
    // where it depends on none of them.
    VectorXd sizes(const VectorXd& z) const {
        const auto values = point(z);
        std::vector<double> slopes(terms_.size());
        slopes_.evaluate({values}, slopes);
        VectorXd result = VectorXd::Ones(static_cast<Index>(rows_));
        for (const auto& term : terms_) result(static_cast<Index>(term.row)) = 0;
        for (std::size_t k = 0; k < terms_.size(); ++k) {
            const auto& [row, place, least] = terms_[k];
            result(static_cast<Index>(row)) +=
                std::abs(slopes[k]) * std::max(std::abs(values[place]), least) / equations_.states[row].nominal;
        }
        return result;
    }
    std::vector<double> conditions(const VectorXd& z) const {
        std::vector<double> result(equations_.whens.size());
        conditions_.evaluate({point(z)}, result);
        return result;
    }

  private:
    void find_terms(const std::vector<Term>& symbols, const std::vector<Term>& rates) {
        std::vector<Term> variables, slopes;
        std::vector<Slope> of; // its row is to come
        const auto add = [&](std::size_t place, double least) {
            variables.push_back(symbols[place]);
            of.push_back({0, place, least});
        };
        for (std::size_t i = 0; i < rows_; ++i) add(1 + i, equations_.states[i].nominal); // behind the time
        for (std::size_t j = 0; j < columns_; ++j) {
            if (places_[j] > rows_) add(places_[j], scale_[j]);
        }
        for (const auto& [row, column, term] : equations_.graph->jacobian(rates, variables)) {
            terms_.push_back({row, of[column].place, of[column].least});
            slopes.push_back(term);
        }
        slopes_ = Tape(*equations_.graph, symbols, slopes);
    }

    std::vector<double> point(const VectorXd& z) const {
        std::vector<double> values = values_;
        for (std::size_t j = 0; j < columns_; ++j) values[places_[j]] = z(static_cast<Index>(j)) * scale_[j];
        return values;
    }

    // Of a derivative by a variable, which counts as `least` at least.
    struct Slope {
        std::size_t row, place;
        double least;
    };

    const Equations& equations_;
    std::size_t rows_, columns_;
    std::vector<double> values_, scale_;
    std::vector<std::size_t> places_; // of the free variables among all values
    std::vector<Slope> terms_;
    Tape rates_, conditions_, jacobian_, slopes_;
};

} // namespace

SteadyState find_steady_state(const Equations& equations, const OperatingPoint& point, const std::vector<Term>& free) {
    const auto& graph = *equations.graph;
    const auto fail = [&](const std::string& text) { throw InputError(fmt::format("{}: {}", equations.name, text)); };
    if (free.size() > equations.states.size()) {
        fail(fmt::format("{} variables are free, must be at most as many as there are states, {}", free.size(),
                         equations.states.size()));
    }
    if (free.empty() && !equations.states.empty()) fail("no variable is free, must be one at least");
    const Problem problem(equations, point, free);
    VectorXd z = problem.start(), rates = problem.rates(z);
    const auto unit_of = [](const Equations::State& state) -> std::string {
        if (state.is_algebraic()) return "";
        return state.unit.empty() ? " 1/s" : " " + state.unit + "/s";
    };
    for (Index i = 0; i < rates.size(); ++i) {
        if (std::isfinite(rates(i))) continue;
        fail(fmt::format("{} is not a finite number at the start of the search for a steady state; begin elsewhere",
                         equations.states[static_cast<std::size_t>(i)].equation_text()));
    }
    SteadyState found;
    double damping = 0;
    MatrixXd jacobian = problem.jacobian(z);
    // Down to rounding: as long as the derivatives fall.
    for (int rejected = 0; found.iterations < max_iterations && rejected < 60 && rates.norm() > 0;) {
        ++found.iterations;
        if (!jacobian.allFinite()) break;
        VectorXd step;
        if (damping == 0) {
            step = jacobian.completeOrthogonalDecomposition().solve(-rates);
        } else {
            const VectorXd square = jacobian.colwise().squaredNorm().transpose();
            const VectorXd weight = square.cwiseMax(1e-12 * square.maxCoeff());
            const MatrixXd normal = jacobian.transpose() * jacobian + MatrixXd((damping * weight).asDiagonal());
            step = normal.ldlt().solve(-jacobian.transpose() * rates);
        }
        const VectorXd next = z + step;
        const VectorXd there = next.allFinite() ? problem.rates(next) : VectorXd();
        if (there.size() == 0 || !there.allFinite() || !(there.norm() < rates.norm())) {
            damping = damping == 0 ? 1e-6 : 10 * damping;
            ++rejected;
            continue;
        }
        const bool settled = step.norm() <= 1e-14 * (z.norm() + step.norm());
        z = next;
        rates = there;
        rejected = 0;
        damping = damping < 1e-6 ? 0 : damping / 10;
        if (settled) break;
        jacobian = problem.jacobian(z);
    }
    // At rest Newton's step vanishes beside the variables. That the derivatives are small does not say so: those of a slow
    // system are everywhere, those of one that creeps on for ever become so.
    jacobian = problem.jacobian(z);
    for (Index i = 0; i < rates.size(); ++i) found.residual = std::max(found.residual, std::abs(rates(i)));
    VectorXd step = VectorXd::Zero(z.size()), blur = step, left = rates, size = VectorXd::Zero(rates.size());
    if (jacobian.size() > 0 && jacobian.allFinite()) {
        const auto decomposition = jacobian.completeOrthogonalDecomposition();
        step = decomposition.solve(-rates);
        left += jacobian * step; // what no step takes away
        size = problem.sizes(z);
        blur = decomposition.pseudoInverse().cwiseAbs() * rounding * size;
    }
    const auto fail_to_rest = [&](Index row, const std::string& why) {
        const auto& state = equations.states[static_cast<std::size_t>(row)];
        fail(fmt::format("no steady state is found from these values: {} = {:.4g}{} remains{}, after {} iterations",
                         state.equation_text(), rates(row) * state.nominal, unit_of(state), why, found.iterations));
    };
    if (left.size() > 0) {
        Index worst = 0;
        if ((left.cwiseAbs() - at_rest * size).maxCoeff(&worst) > 0) fail_to_rest(worst, ", most of all equations");
    }
    for (Index j = 0; j < step.size(); ++j) {
        if (std::abs(step(j)) <= at_rest * std::max(1.0, std::abs(z(j))) + blur(j)) continue;
        Index row = 0;
        jacobian.col(j).cwiseAbs().maxCoeff(&row);
        fail_to_rest(row, fmt::format(" and would move {} by {:.4g} yet", graph.name(free[static_cast<std::size_t>(j)]),
                                      problem.values_at(step)[static_cast<std::size_t>(j)]));
    }
    // Only where every free variable has its place is the point one of its own.
    if (jacobian.cols() > 0) {
        MatrixXd scaled = jacobian;
        for (Index j = 0; j < scaled.cols(); ++j) {
            const double norm = scaled.col(j).norm();
            if (!(norm > 0)) {
                fail(fmt::format("the steady state is not unique: no derivative depends on {} there; leave it out of "
                                 "`free`, which holds it at its value",
                                 graph.name(free[static_cast<std::size_t>(j)])));
            }
            scaled.col(j) /= norm;
        }
        Eigen::ColPivHouseholderQR<MatrixXd> decomposition(scaled);
        decomposition.setThreshold(1e-12);
        if (decomposition.rank() < scaled.cols()) {
            const auto last = decomposition.colsPermutation().indices()(scaled.cols() - 1);
            fail(fmt::format("the steady state is not unique: the Jacobian is singular there, and {} can be moved "
                             "together with others; leave one out of `free`, which holds it at its value",
                             graph.name(free[static_cast<std::size_t>(last)])));
        }
    }
    const auto before = problem.conditions(problem.start()), now = problem.conditions(z);
    for (std::size_t i = 0; i < now.size(); ++i) {
        if (now[i] == 0) continue;
        const std::string& name = equations.whens[i].name;
        if (before[i] == 0) {
            fail(fmt::format(
                "the steady state lies beyond the event {}, whose condition holds there and does not at the "
                "start; begin with the values and the mode that are right behind it",
                name));
        }
        if (equations.whens[i].at_start) {
            fail(
                fmt::format("the steady state is none, as the event {} happens there at once; begin with what it leads "
                            "to, such as its mode",
                            name));
        }
        found.conditions.push_back(name);
    }
    found.values = problem.values_at(z);
    return found;
}

} // namespace tribode
