#include "solver/cvode_integrator.hpp"

#include <algorithm>
#include <cvode/cvode.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunlinsol/sunlinsol_klu.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunmatrix/sunmatrix_sparse.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

namespace tribode {

namespace {

// Where KLU is faster than dense factors, measured on the grids of tests/problems.
constexpr std::size_t sparse_from = 20; // states
constexpr double sparse_below = 0.2;    // of the entries

} // namespace

CvodeIntegrator::CvodeIntegrator(const HybridSystem& system, const SolverOptions& options)
    : SundialsIntegrator(system, options) {
    memory_ = CVodeCreate(options.method == Method::bdf ? CV_BDF : CV_ADAMS, context_);
    check(memory_ ? 0 : -1, "CVodeCreate");
    check(CVodeSetErrHandlerFn(memory_, message_callback, this), "CVodeSetErrHandlerFn");
    check(CVodeInit(memory_, derivative_callback, 0.0, vector_.get()), "CVodeInit");
    check(CVodeSetUserData(memory_, this), "CVodeSetUserData");
    check(CVodeSVtolerances(memory_, options.relative_tolerance, tolerance_.get()), "CVodeSVtolerances");
    if (options.method == Method::bdf) {
        const SparsityPattern* pattern = system.jacobian_pattern();
        if (pattern && size_ >= sparse_from &&
            pattern->rows.size() < sparse_below * static_cast<double>(size_ * size_)) {
            use_sparse_jacobian(*pattern);
        } else {
            use_dense_jacobian();
        }
    } else {
        nonlinear_solver_.reset(SUNNonlinSol_FixedPoint(vector_.get(), 0, context_));
        check(CVodeSetNonlinearSolver(memory_, nonlinear_solver_.get()), "CVodeSetNonlinearSolver");
    }
    derivative_.reset(N_VClone(vector_.get()));
    if (options.max_step > 0) check(CVodeSetMaxStep(memory_, options.max_step), "CVodeSetMaxStep");
    // A solution may need steps of a few roundings of the time; whether they get on is seen in SundialsIntegrator.
    check(CVodeSetMaxHnilWarns(memory_, -1), "CVodeSetMaxHnilWarns");
}

void CvodeIntegrator::use_dense_jacobian() {
    const sunindextype n = N_VGetLength(vector_.get());
    matrix_.reset(SUNDenseMatrix(n, n, context_));
    linear_solver_.reset(SUNLinSol_Dense(vector_.get(), matrix_.get(), context_));
    check(CVodeSetLinearSolver(memory_, linear_solver_.get(), matrix_.get()), "CVodeSetLinearSolver");
    // Whether there is an analytic Jacobian does not depend on the state.
    const SystemState start = system_.initial_state();
    if (system_.jacobian(0.0, start.x, *start.discrete, {SM_DATA_D(matrix_.get()), size_ * size_})) {
        check(CVodeSetJacFn(memory_, dense_jacobian), "CVodeSetJacFn");
    }
}

void CvodeIntegrator::use_sparse_jacobian(const SparsityPattern& pattern) {
    for (std::size_t j = 0; j < size_; ++j) {
        starts_.push_back(static_cast<sunindextype>(rows_.size()));
        bool diagonal = false; // whether it is in
        for (std::size_t i = pattern.starts[j]; i < pattern.starts[j + 1]; ++i) {
            const std::size_t row = pattern.rows[i];
            if (row > j && !diagonal) rows_.push_back(static_cast<sunindextype>(j));
            diagonal = diagonal || row >= j;
            places_.push_back(static_cast<sunindextype>(rows_.size()));
            rows_.push_back(static_cast<sunindextype>(row));
        }
        if (!diagonal) rows_.push_back(static_cast<sunindextype>(j));
    }
    starts_.push_back(static_cast<sunindextype>(rows_.size()));
    entries_.resize(places_.size());
    const auto n = static_cast<sunindextype>(size_);
    matrix_.reset(SUNSparseMatrix(n, n, starts_.back(), CSC_MAT, context_));
    linear_solver_.reset(SUNLinSol_KLU(vector_.get(), matrix_.get(), context_));
    check(CVodeSetLinearSolver(memory_, linear_solver_.get(), matrix_.get()), "CVodeSetLinearSolver");
    check(CVodeSetJacFn(memory_, sparse_jacobian), "CVodeSetJacFn");
}

int CvodeIntegrator::dense_jacobian(double t, N_Vector x, N_Vector, SUNMatrix matrix, void* self, N_Vector, N_Vector,
                                    N_Vector) {
    auto& me = *static_cast<CvodeIntegrator*>(self);
    ++me.counts_.jacobian_evaluations;
    SUNMatZero(matrix);
    me.system_.jacobian(t, me.values(x), *me.state_->discrete, {SM_DATA_D(matrix), me.size_ * me.size_});
    return 0;
}

int CvodeIntegrator::sparse_jacobian(double t, N_Vector x, N_Vector, SUNMatrix matrix, void* self, N_Vector, N_Vector,
                                     N_Vector) {
    auto& me = *static_cast<CvodeIntegrator*>(self);
    ++me.counts_.jacobian_evaluations;
    me.system_.sparse_jacobian(t, me.values(x), *me.state_->discrete, me.entries_);
    std::copy(me.starts_.begin(), me.starts_.end(), SM_INDEXPTRS_S(matrix));
    std::copy(me.rows_.begin(), me.rows_.end(), SM_INDEXVALS_S(matrix));
    double* data = SM_DATA_S(matrix);
    std::fill_n(data, me.rows_.size(), 0.0);
    for (std::size_t i = 0; i < me.places_.size(); ++i) data[me.places_[i]] = me.entries_[i];
    return 0;
}

CvodeIntegrator::~CvodeIntegrator() { CVodeFree(&memory_); }

void CvodeIntegrator::native_restart(double t, double h) {
    check(CVodeReInit(memory_, t, vector_.get()), "CVodeReInit");
    check(CVodeSetInitStep(memory_, h), "CVodeSetInitStep");
}

SundialsIntegrator::Native CvodeIntegrator::native_step(double t_stop, double& t) {
    check(CVodeSetStopTime(memory_, t_stop), "CVodeSetStopTime");
    switch (CVode(memory_, t_stop, vector_.get(), &t, CV_ONE_STEP)) {
    case CV_SUCCESS: return t == t_stop ? Native::stopped : Native::stepped;
    case CV_TSTOP_RETURN: t = t_stop; return Native::stopped;
    default: return Native::failed;
    }
}

long CvodeIntegrator::native_rejected_steps() const {
    long failures = 0;
    CVodeGetNumErrTestFails(memory_, &failures);
    return failures;
}

double CvodeIntegrator::kept_step(bool first, bool cut) const {
    // After the first step the controller still works at order one: the size it proposes suits the next restart.
    if (!first) return kept_step_;
    double next = 0;
    CVodeGetCurrentStep(memory_, &next);
    return cut ? std::max(next, kept_step_) : next;
}

// The derivatives of the polynomial that the method's history is, and the ends as they are: a state may move by more than
// its rounding within the rounding of the time.
void CvodeIntegrator::native_polynomial(std::span<const double> x0, StepPolynomial& polynomial) {
    int order = 0;
    check(CVodeGetLastOrder(memory_, &order), "CVodeGetLastOrder");
    polynomial.resize(size_, order);
    double factor = 1;
    for (int k = 0; k <= order; ++k) {
        if (k > 0) factor *= polynomial.h / k;
        check(CVodeGetDky(memory_, polynomial.t0, k, derivative_.get()), "CVodeGetDky");
        const double* derivative = N_VGetArrayPointer(derivative_.get());
        for (std::size_t i = 0; i < size_; ++i) polynomial.term(k)[i] = factor * derivative[i];
    }
    const std::span<const double> x1 = values(vector_.get());
    for (std::size_t i = 0; i < size_; ++i) {
        double end = 0;
        for (int k = order; k >= 0; --k) end += polynomial.term(k)[i];
        const double shift = x0[i] - polynomial.term(0)[i];
        polynomial.term(0)[i] = x0[i];
        polynomial.term(1)[i] += x1[i] - end - shift;
    }
}

} // namespace tribode
