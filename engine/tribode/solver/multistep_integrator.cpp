#include "tribode/solver/multistep_integrator.hpp"

#include <algorithm>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunlinsol/sunlinsol_klu.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunmatrix/sunmatrix_sparse.h>

namespace tribode {

namespace {

// Where KLU is faster than dense factors, measured on the grids of tests/problems.
constexpr std::size_t sparse_from = 20; // states
constexpr double sparse_below = 0.2;    // of the entries

} // namespace

MultistepIntegrator::MultistepIntegrator(const HybridSystem& system, const SolverOptions& options,
                                         const MultistepLibrary& library)
    : SundialsIntegrator(system, options, library),
      library_(library),
      derivative_(own(N_VClone(vector_.get()), "N_VClone")) {}

int MultistepIntegrator::last_order() const {
    int order = 0;
    check(library_.get_last_order(memory(), &order), "GetLastOrder");
    return order;
}

double MultistepIntegrator::kept_step(bool first, bool cut) const {
    // After the first step the controller still works at order one: the size it proposes suits the next restart.
    if (!first) return kept_step_;
    double next = 0;
    library_.get_current_step(memory(), &next);
    return cut ? std::max(next, kept_step_) : next;
}

bool MultistepIntegrator::make_jacobian() {
    const SparsityPattern* pattern = system_.jacobian_pattern();
    if (pattern && size_ >= sparse_from &&
        static_cast<double>(pattern->rows.size()) < sparse_below * static_cast<double>(size_ * size_)) {
        make_sparse_jacobian(*pattern);
        return true;
    }
    const sunindextype n = N_VGetLength(vector_.get());
    matrix_ = own(SUNDenseMatrix(n, n, context_.get()), "SUNDenseMatrix");
    linear_solver_ = own(SUNLinSol_Dense(vector_.get(), matrix_.get(), context_.get()), "SUNLinSol_Dense");
    if (pattern) return true;
    // Whether there is an analytic Jacobian does not depend on the state.
    const SystemState start = system_.initial_state();
    return system_.jacobian(0.0, start.x, *start.discrete, {SM_DATA_D(matrix_.get()), size_ * size_});
}

void MultistepIntegrator::make_sparse_jacobian(const SparsityPattern& pattern) {
    for (std::size_t j = 0; j < size_; ++j) {
        starts_.push_back(static_cast<sunindextype>(rows_.size()));
        bool diagonal = false; // whether it is in
        const auto add_diagonal = [&] {
            if (!diagonal) rows_.push_back(static_cast<sunindextype>(j));
            if (!diagonal) diagonal_.push_back(static_cast<sunindextype>(rows_.size()) - 1);
            diagonal = true;
        };
        for (std::size_t i = pattern.starts[j]; i < pattern.starts[j + 1]; ++i) {
            const std::size_t row = pattern.rows[i];
            if (row >= j) add_diagonal();
            if (row != j) rows_.push_back(static_cast<sunindextype>(row));
            places_.push_back(static_cast<sunindextype>(rows_.size()) - 1);
        }
        add_diagonal();
    }
    starts_.push_back(static_cast<sunindextype>(rows_.size()));
    entries_.resize(places_.size());
    const auto n = static_cast<sunindextype>(size_);
    matrix_ = own(SUNSparseMatrix(n, n, starts_.back(), CSC_MAT, context_.get()), "SUNSparseMatrix");
    linear_solver_ = own(SUNLinSol_KLU(vector_.get(), matrix_.get(), context_.get()), "SUNLinSol_KLU");
}

int MultistepIntegrator::put_jacobian(double t, N_Vector x, SUNMatrix matrix) {
    ++counts_.jacobian_evaluations;
    try {
        if (!has_sparse_jacobian()) {
            SUNMatZero(matrix);
            system_.jacobian(t, values(x), *state_->discrete, {SM_DATA_D(matrix), size_ * size_});
            return 0;
        }
        system_.sparse_jacobian(t, values(x), *state_->discrete, entries_);
    } catch (...) {
        thrown_ = std::current_exception();
        return -1;
    }
    std::copy(starts_.begin(), starts_.end(), SM_INDEXPTRS_S(matrix));
    std::copy(rows_.begin(), rows_.end(), SM_INDEXVALS_S(matrix));
    double* data = SM_DATA_S(matrix);
    std::fill_n(data, rows_.size(), 0.0);
    for (std::size_t i = 0; i < places_.size(); ++i) data[places_[i]] = entries_[i];
    return 0;
}

// From the derivatives of the method's polynomial at the step's beginning. The ends are taken as they are: a state may move
// by more than its rounding within the rounding of the time.
void MultistepIntegrator::native_polynomial(std::span<const double> x0, StepPolynomial& polynomial) {
    const std::span<const double> x1 = values(vector_.get());
    const int order = last_order();
    polynomial.resize(size_, order);
    double factor = 1;
    for (int k = 0; k <= order; ++k) {
        if (k > 0) factor *= polynomial.h / k;
        check(library_.get_derivative(memory(), polynomial.t0, k, derivative_.get()), "GetDky");
        const auto derivative = values(derivative_.get());
        for (std::size_t i = 0; i < size_; ++i) polynomial.term(k)[i] = factor * derivative[i];
    }
    for (std::size_t i = 0; i < size_; ++i) {
        double end = 0;
        for (int k = order; k >= 0; --k) end += polynomial.term(k)[i];
        const double shift = x0[i] - polynomial.term(0)[i];
        polynomial.term(0)[i] = x0[i];
        polynomial.term(1)[i] += x1[i] - end - shift;
    }
}

} // namespace tribode
