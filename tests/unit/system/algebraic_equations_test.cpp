#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"
#include "tribode/solver/simulator.hpp"
#include "tribode/system/algebraic_equations.hpp"
#include "unit/system/small_systems.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct AlgebraicWriter : Writer {
    Term algebraic(const std::string& name, double start) {
        const Term symbol = state(name, start);
        equations.states.back().equation = "of " + name;
        return symbol;
    }
    Term sum(const std::vector<std::pair<double, Term>>& parts) {
        Term made = number(0);
        for (const auto& [factor, term] : parts) made = add(made, multiply(number(factor), term));
        return made;
    }
};

SolverOptions sharp(Method method) {
    return {.method = method, .relative_tolerance = 1e-10, .absolute_tolerance = 1e-12};
}

double random_number(std::uint64_t draw, std::uint64_t& place) { return 2 * uniform(11, draw, place++) - 1; }

std::string refusal(const Equations& equations) {
    try {
        const EquationSystem system(equations);
    } catch (const InputError& problem) {
        return problem.what();
    }
    return "";
}

// A triangular system whose equations are shuffled has one assignment, and is solved one variable at a time.
TEST(AssignEquations, FindsTheOnlyAssignmentOfATriangle) {
    constexpr std::size_t count = 40;
    for (std::uint64_t draw = 0; draw < 20; ++draw) {
        AlgebraicWriter w;
        std::vector<Term> z, residuals;
        for (std::size_t i = 0; i < count; ++i) z.push_back(w.algebraic("z" + std::to_string(i), 0));
        for (std::size_t i = 0; i < count; ++i) {
            std::vector<std::pair<double, Term>> parts = {{1, z[i]}};
            for (std::size_t j = 0; j < i; ++j) {
                if (uniform(1, draw, i * count + j) < 0.3) parts.emplace_back(2, z[j]);
            }
            residuals.push_back(w.sum(parts));
        }
        std::vector<std::size_t> order(count);
        for (std::size_t i = 0; i < count; ++i) order[i] = i;
        for (std::size_t i = count; i-- > 1;) {
            std::swap(order[i], order[static_cast<std::size_t>(uniform(2, draw, i) * static_cast<double>(i + 1))]);
        }
        for (std::size_t i = 0; i < count; ++i) w.rate(i, residuals[order[i]]);
        assign_equations(w.equations);
        for (std::size_t i = 0; i < count; ++i) EXPECT_EQ(w.equations.states[i].rate, residuals[i]);
        const auto blocks = algebraic_blocks(w.equations);
        ASSERT_EQ(blocks.size(), count);
        std::vector<char> solved(count, false);
        for (const auto& block : blocks) {
            ASSERT_EQ(block.size(), 1u);
            for (const Term variable : w.graph.variables_of(std::span(&w.equations.states[block[0]].rate, 1))) {
                const auto i = static_cast<std::size_t>(std::find(z.begin(), z.end(), variable) - z.begin());
                EXPECT_TRUE(i == block[0] || solved[i]) << "needs what is not yet known";
            }
            solved[block[0]] = true;
        }
    }
}

// Every variable needs the next one, and the last the first: one block, found without recursion.
TEST(AssignEquations, TakesALongRingAsOneBlock) {
    constexpr std::size_t count = 20'000;
    AlgebraicWriter w;
    std::vector<Term> z;
    for (std::size_t i = 0; i < count; ++i) z.push_back(w.algebraic("z", 0));
    for (std::size_t i = 0; i < count; ++i) w.rate(i, w.add(z[(i + 1) % count], w.multiply(w.number(2), z[i])));
    assign_equations(w.equations);
    const auto blocks = algebraic_blocks(w.equations);
    ASSERT_EQ(blocks.size(), 1u);
    EXPECT_EQ(blocks[0].size(), count);
}

TEST(AssignEquations, NamesWhatIsSingularOrOfHigherIndex) {
    AlgebraicWriter w;
    const Term x = w.state("x", 1), a = w.algebraic("a", 0), b = w.algebraic("b", 0), c = w.algebraic("c", 0);
    w.rate(1, w.subtract(a, x)).rate(2, w.add(a, x)).rate(3, w.add(a, w.add(b, c)));
    EXPECT_NE(refusal(w.equations).find("have only the algebraic variable a in them, one too few"), std::string::npos)
        << refusal(w.equations);
    w.rate(1, w.subtract(x, w.number(1))).rate(2, w.add(a, b));
    EXPECT_NE(refusal(w.equations).find("depends on no algebraic variable"), std::string::npos);
}

// dx/dt = A x + B z + e, 0 = C x + D z: against z = -D^-1 C x in the exact solver, with an event whenever z1 changes its sign
// that reverses what drives the states.
TEST(AlgebraicVariables, RandomLinearSystemsAgreeWithTheirEliminatedForm) {
    constexpr Index n = 3, m = 4;
    int events = 0;
    for (std::uint64_t draw = 0; draw < 60; ++draw) {
        std::uint64_t place = 0;
        const auto random = [&](Index rows, Index columns) {
            MatrixXd matrix(rows, columns);
            for (Index i = 0; i < rows * columns; ++i) matrix(i) = random_number(draw, place);
            return matrix;
        };
        MatrixXd a = random(n, n), b = random(n, m), c = random(m, n), d = random(m, m);
        d += 2 * MatrixXd::Identity(m, m);
        for (Index i = 0; i < n; ++i) a(i, (i + 1) % n) += 4, a((i + 1) % n, i) -= 4; // it oscillates
        const VectorXd start = random(n, 1);
        const MatrixXd by_x = -d.partialPivLu().solve(c);
        const VectorXd drive = random(n, 1);
        const auto with_event = [&](AlgebraicWriter& w, Term watched) {
            const Term side = w.discrete("side", 1);
            for (Index i = 0; i < n; ++i) {
                auto& state = w.equations.states[static_cast<std::size_t>(i)];
                state.rate = w.add(state.rate, w.multiply(w.number(drive(i)), side));
            }
            for (const bool rising : {false, true}) {
                w.when(rising ? w.less(w.number(0), watched) : w.less(watched, w.number(0)),
                       {{side, w.multiply(w.number(-1), side)}});
            }
        };
        AlgebraicWriter implicit, eliminated;
        std::vector<Term> x, z, y;
        for (Index i = 0; i < n; ++i) {
            x.push_back(implicit.state("x" + std::to_string(i), start(i)));
            y.push_back(eliminated.state("x" + std::to_string(i), start(i)));
        }
        for (Index i = 0; i < m; ++i) z.push_back(implicit.algebraic("z" + std::to_string(i), 0));
        const auto row = [&](AlgebraicWriter& w, const MatrixXd& matrix, Index i, const std::vector<Term>& of) {
            std::vector<std::pair<double, Term>> parts;
            for (Index j = 0; j < matrix.cols(); ++j) parts.emplace_back(matrix(i, j), of[static_cast<std::size_t>(j)]);
            return w.sum(parts);
        };
        for (Index i = 0; i < n; ++i) {
            implicit.rate(static_cast<std::size_t>(i), implicit.add(row(implicit, a, i, x), row(implicit, b, i, z)));
            eliminated.rate(static_cast<std::size_t>(i), row(eliminated, a + b * by_x, i, y));
        }
        for (Index i = 0; i < m; ++i) {
            implicit.rate(static_cast<std::size_t>(n + i),
                          implicit.add(row(implicit, c, i, x), row(implicit, d, i, z)));
        }
        with_event(implicit, z[0]);
        with_event(eliminated, row(eliminated, by_x, 0, y));
        const EquationSystem dae(implicit.equations), ode(eliminated.equations);
        EXPECT_EQ(resolved(Method::automatic, dae), Method::ida);
        Simulator run(dae, sharp(Method::automatic)), reference(ode, sharp(Method::exact));
        const RunOutcome outcome = run.advance_to(2), wanted = reference.advance_to(2);
        ASSERT_EQ(wanted.ok(), outcome.ok()) << draw << " " << outcome.message << wanted.message;
        if (!wanted.ok()) continue;
        ASSERT_EQ(run.events().size(), reference.events().size()) << draw;
        double size = 1;
        for (const double value : reference.state().x) size = std::max(size, std::abs(value));
        for (std::size_t e = 0; e < run.events().size(); ++e) {
            EXPECT_NEAR(run.events()[e].t, reference.events()[e].t, 1e-6) << draw;
            EXPECT_EQ(run.events()[e].subject, reference.events()[e].subject) << draw;
            ++events;
        }
        const VectorXd at_end = Eigen::Map<const VectorXd>(run.state().x.data(), n);
        for (Index i = 0; i < n; ++i) {
            EXPECT_NEAR(at_end(i), reference.state().x[static_cast<std::size_t>(i)], 1e-6 * size) << draw;
        }
        const VectorXd z_end = by_x * at_end;
        for (Index i = 0; i < m; ++i) {
            EXPECT_NEAR(run.state().x[static_cast<std::size_t>(n + i)], z_end(i), 1e-8 * size) << draw;
        }
    }
    EXPECT_GT(events, 50) << "they are to have events";
}

// Linear complementarity problems, networks of ideal diodes for one: 0 = min(s, 0) + M max(s, 0) + q with M positive definite
// has one solution for each q, whatever branches it begins in. q turns with the time, so that branches change, some at once.
TEST(AlgebraicVariables, ManyBranchesSettleTogether) {
    constexpr std::size_t count = 7;
    long events = 0;
    for (std::uint64_t draw = 0; draw < 40; ++draw) {
        std::uint64_t place = 1000;
        MatrixXd root(count, count);
        for (Index i = 0; i < root.size(); ++i) root(i) = random_number(draw, place);
        const MatrixXd m = root * root.transpose() + 0.05 * MatrixXd::Identity(count, count);
        AlgebraicWriter w;
        const Term x = w.state("x", 0);
        w.rate(0, w.number(1));
        std::vector<Term> s, plus, minus, q;
        for (std::size_t i = 0; i < count; ++i) s.push_back(w.algebraic("s" + std::to_string(i), 0));
        for (const Term term : s) {
            plus.push_back(w.where(w.less(term, w.number(0)), w.number(0), term));
            minus.push_back(w.where(w.less(term, w.number(0)), term, w.number(0)));
        }
        for (std::size_t i = 0; i < count; ++i) {
            // Every other draw has equal q, which change sign at the same instants.
            const double phase = draw % 2 == 0 ? 6 * random_number(draw, place) : 0;
            q.push_back(w.graph.make(Op::sin, w.add(w.multiply(w.number(5), x), w.number(phase))));
            std::vector<std::pair<double, Term>> parts = {{1, minus[i]}, {1, q[i]}};
            for (std::size_t j = 0; j < count; ++j) {
                parts.emplace_back(m(static_cast<Index>(i), static_cast<Index>(j)), plus[j]);
            }
            w.rate(1 + i, w.sum(parts));
        }
        const Term turns = w.discrete("turns", 0);
        w.when(w.less(s[0], w.number(0)), {{turns, w.add(turns, w.number(1))}});
        const EquationSystem system(w.equations);
        Simulator run(system, sharp(Method::ida));
        for (int k = 0; k <= 30; ++k) {
            const RunOutcome outcome = run.advance_to(0.1 * k);
            ASSERT_TRUE(outcome.ok()) << draw << " " << outcome.message;
            // The problem itself, without any branch that is held.
            VectorXd up(count), down(count), q_now(count);
            std::vector<double> q_values(count);
            Tape(w.graph, {x}, q).evaluate({std::span(run.state().x).first(1)}, q_values);
            for (std::size_t i = 0; i < count; ++i) {
                const auto row = static_cast<Index>(i);
                up(row) = std::max(run.state().x[1 + i], 0.0);
                down(row) = std::min(run.state().x[1 + i], 0.0);
                q_now(row) = q_values[i];
            }
            EXPECT_LT((down + m * up + q_now).cwiseAbs().maxCoeff(), 1e-7) << draw << " at " << 0.1 * k;
        }
        events += static_cast<long>(run.events().size());
        EXPECT_NEAR(run.state().x[0], 3, 1e-12);
    }
    EXPECT_GT(events, 40);
}

TEST(AlgebraicVariables, ARunGoesOnFromItsSnapshot) {
    AlgebraicWriter w;
    const Term x = w.state("x", 1), z = w.algebraic("z", 1);
    w.rate(0, w.multiply(w.number(-1), z)).rate(1, w.subtract(w.add(w.multiply(z, w.multiply(z, z)), z), x));
    const EquationSystem system(w.equations);
    Simulator whole(system, sharp(Method::ida)), first(system, sharp(Method::ida));
    ASSERT_TRUE(whole.advance_to(2).ok());
    ASSERT_TRUE(first.advance_to(0.7).ok());
    Simulator second(system, sharp(Method::ida), system.restored(system.snapshot(first.state())));
    ASSERT_TRUE(second.advance_to(2).ok());
    EXPECT_NEAR(second.state().x[0], whole.state().x[0], 1e-8);
    EXPECT_NEAR(second.state().x[1], whole.state().x[1], 1e-8);
}

// Of a system that has no solution at t = 0 only a later start asks.
TEST(AlgebraicVariables, AreSolvedForAtTheStartTime) {
    AlgebraicWriter w;
    w.state("x", 1);
    const Term z = w.algebraic("z", 1);
    w.rate(1, w.subtract(w.multiply(z, z), w.subtract(w.equations.time, w.number(1))));
    const EquationSystem system(w.equations);
    EXPECT_THROW(system.initial_state(0), NoSolution);
    Simulator run(system, sharp(Method::ida), system.initial_state(5));
    EXPECT_NEAR(run.state().x[1], 2, 1e-15);
    ASSERT_TRUE(run.advance_to(10).ok());
    EXPECT_NEAR(run.state().x[1], 3, 1e-8);
}

TEST(AlgebraicVariables, WithoutASolutionTheRunEndsWithTimeAndEquation) {
    AlgebraicWriter w;
    const Term x = w.state("x", 1), z = w.algebraic("z", 1), d = w.discrete("d", 1);
    w.rate(0, w.number(-1)).rate(1, w.subtract(w.multiply(z, z), d));
    w.when(w.less(x, w.number(0.5)), {{d, w.number(-1)}});
    const EquationSystem system(w.equations);
    Simulator run(system, sharp(Method::ida));
    const RunOutcome outcome = run.advance_to(1);
    EXPECT_EQ(outcome.end, RunEnd::no_solution);
    EXPECT_NEAR(outcome.t, 0.5, 1e-9);
    EXPECT_NE(outcome.message.find("the equation of z"), std::string::npos) << outcome.message;
    EXPECT_EQ(run.advance_to(2).end, RunEnd::no_solution) << "it stays where it is";
    for (const double value : run.state().x) EXPECT_TRUE(std::isfinite(value));
}

TEST(AlgebraicVariables, OtherSolversRefuse) {
    AlgebraicWriter w;
    const Term x = w.state("x", 1), z = w.algebraic("z", 1);
    w.rate(0, z).rate(1, w.add(z, x));
    const EquationSystem system(w.equations);
    for (const Method method : {Method::exact, Method::collocation, Method::erk, Method::adams, Method::bdf,
                                Method::fixed, Method::euler, Method::semi_implicit_euler, Method::zoh}) {
        EXPECT_THROW(Simulator(system, sharp(method)), InputError) << name_of(method);
    }
}

} // namespace
} // namespace tribode
