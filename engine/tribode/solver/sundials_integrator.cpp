#include "tribode/solver/sundials_integrator.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunlinsol/sunlinsol_klu.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunmatrix/sunmatrix_sparse.h>
#include <utility>

namespace tribode {

namespace {

constexpr long max_creeping_steps = 100'000;
// Where KLU is faster than dense factors, measured on the grids of tests/problems.
constexpr std::size_t sparse_from = 20; // states
constexpr double sparse_below = 0.2;    // of the entries

// z = sum c_k x_k, in the order of the library's own function, but in registers: half the work of a method with few
// states are such sums.
template <std::size_t Size>
int combine(int count, realtype* c, N_Vector* x, N_Vector z) {
    std::array<double, Size> sum{};
    for (int k = 0; k < count; ++k) {
        const double* values = NV_DATA_S(x[k]);
        for (std::size_t i = 0; i < Size; ++i) sum[i] += c[k] * values[i];
    }
    std::copy(sum.begin(), sum.end(), NV_DATA_S(z));
    return 0;
}

template <std::size_t... Before>
constexpr auto combinations(std::index_sequence<Before...>) {
    return std::array{combine<Before + 1>...};
}
constexpr auto combine_few = combinations(std::make_index_sequence<12>()); // of 1 state, 2 states, ...

} // namespace

void SundialsIntegrator::check(int flag, const char* function) {
    if (flag < 0) throw Error(fmt::format("{} failed with flag {}", function, flag));
}

SundialsIntegrator::SundialsIntegrator(const HybridSystem& system, const SolverOptions& options)
    : system_(system),
      size_(system.states().size()),
      search_(system),
      has_guards_(system.guard_count() > 0),
      x_before_(size_) {
    check(SUNContext_Create(nullptr, &context_), "SUNContext_Create");
    // A system of clocks alone has no states, which the library does not allow: it gets one that rests.
    const auto length = static_cast<sunindextype>(std::max<std::size_t>(size_, 1));
    vector_.reset(N_VNew_Serial(length, context_));
    // Sums of many vectors in one call: with few states the calls are the work. The library's own vectors are copies.
    check(N_VEnableFusedOps_Serial(vector_.get(), SUNTRUE), "N_VEnableFusedOps_Serial");
    if (size_ > 0 && size_ <= combine_few.size()) vector_->ops->nvlinearcombination = combine_few[size_ - 1];
    tolerance_.reset(N_VNew_Serial(length, context_));
    N_VConst(0.0, vector_.get());
    N_VConst(1.0, tolerance_.get());
    for (std::size_t i = 0; i < size_; ++i) {
        N_VGetArrayPointer(tolerance_.get())[i] = options.absolute_tolerance * system.states()[i].scale;
    }
}

SundialsIntegrator::~SundialsIntegrator() {
    linear_solver_.reset();
    matrix_.reset();
    vector_.reset();
    tolerance_.reset();
    SUNContext_Free(&context_);
}

bool SundialsIntegrator::make_jacobian() {
    const SparsityPattern* pattern = system_.jacobian_pattern();
    if (pattern && size_ >= sparse_from &&
        static_cast<double>(pattern->rows.size()) < sparse_below * static_cast<double>(size_ * size_)) {
        make_sparse_jacobian(*pattern);
        return true;
    }
    const sunindextype n = N_VGetLength(vector_.get());
    matrix_.reset(SUNDenseMatrix(n, n, context_));
    linear_solver_.reset(SUNLinSol_Dense(vector_.get(), matrix_.get(), context_));
    if (pattern) return true;
    // Whether there is an analytic Jacobian does not depend on the state.
    const SystemState start = system_.initial_state();
    return system_.jacobian(0.0, start.x, *start.discrete, {SM_DATA_D(matrix_.get()), size_ * size_});
}

void SundialsIntegrator::make_sparse_jacobian(const SparsityPattern& pattern) {
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
    matrix_.reset(SUNSparseMatrix(n, n, starts_.back(), CSC_MAT, context_));
    linear_solver_.reset(SUNLinSol_KLU(vector_.get(), matrix_.get(), context_));
}

int SundialsIntegrator::put_jacobian(double t, N_Vector x, SUNMatrix matrix) {
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

int SundialsIntegrator::derivative_callback(double t, N_Vector x, N_Vector dxdt, void* self) {
    auto& me = *static_cast<SundialsIntegrator*>(self);
    ++me.counts_.derivative_evaluations;
    const std::span<double> slope(N_VGetArrayPointer(dxdt), me.size_);
    if (me.size_ == 0) N_VConst(0.0, dxdt);
    try {
        me.system_.derivative(t, me.values(x), *me.state_->discrete, slope);
    } catch (...) {
        me.thrown_ = std::current_exception();
        return -1; // the library ends its step
    }
    me.derivative_seen(slope);
    const auto not_finite = not_finite_in(slope, t);
    if (!not_finite) return 0;
    me.not_finite_ = not_finite;
    me.met_non_finite_ = true;
    return 1; // recoverable: a shorter step may do
}

void SundialsIntegrator::message_callback(int code, const char*, const char*, char* text, void* self) {
    // Warnings have positive codes; what matters of them is seen in the outcome.
    if (code < 0) static_cast<SundialsIntegrator*>(self)->last_message_ = text;
}

void SundialsIntegrator::restart(SystemState& state) {
    state_ = &state;
    std::copy(state.x.begin(), state.x.end(), N_VGetArrayPointer(vector_.get()));
    if (counters_restart()) rejected_before_ += native_rejected_steps();
    if (fell_ && !keeps_step_at_events()) kept_step_ = 0;
    native_restart(state.t, kept_step_);
    first_step_ = true;
    ahead_ = fell_ = false;
    t_native_ = clear_to_ = state.t;
    polynomial_made_ = false;
}

// The rest of the step stands, and is searched for falls of the new guards.
void SundialsIntegrator::change_guards(SystemState& state) {
    fell_ = false;
    clear_to_ = state.t;
}

// Up to where the library may go: no further than the next fall of a guard of the time alone.
double SundialsIntegrator::next_stop(double t_stop) {
    if (!search_.has_time_guards()) return t_stop;
    if (clear_to_ <= state_->t) {
        clear_to_ = search_.next_time_event(state_->t, t_stop, state_->x, *state_->discrete).at;
    }
    return clear_to_ > state_->t ? std::min(clear_to_, t_stop) : t_stop;
}

Integrator::Progress SundialsIntegrator::step(double t_stop) {
    if (ahead_ && t_native_ <= t_stop) {
        // It begins where the state stands, to the bit: the new guards are at zero or above there.
        polynomial_.begin_at(state_->t);
        std::copy(state_->x.begin(), state_->x.end(), polynomial_.term(0));
        return look_for_falls(t_stop);
    }
    if (ahead_) restart(*state_);
    const double t_start = state_->t;
    const double t_goal = next_stop(t_stop);
    double t = t_start;
    met_non_finite_ = false;
    Native result = take_native_step(t_goal, t);
    // The size that was good before an event may be far too long after it: then the method's own estimate.
    if (result == Native::failed && first_step_ && kept_step_ > 0 && !met_non_finite_) {
        kept_step_ = 0;
        restart(*state_);
        result = take_native_step(t_goal, t);
    }
    // ERKStep gives up at the first derivative that is not finite, where a shorter step may do.
    for (double h = (t_goal - t_start) / 10; result == Native::failed && met_non_finite_ && t_start + h > t_start;
         h /= 10) {
        kept_step_ = h;
        restart(*state_);
        result = take_native_step(t_goal, t);
    }
    // Steps of a few roundings of the time may be what a solution needs; but not without end, and where the derivative
    // ceases to be finite a method would creep up to there.
    const bool creeps =
        result != Native::stopped && t - t_start <= 100 * std::numeric_limits<double>::epsilon() * std::abs(t);
    const long weight = met_non_finite_ || t == t_start ? max_creeping_steps / 100 : 1;
    creeping_steps_ = creeps ? creeping_steps_ + weight : 0;
    if (result == Native::failed || creeping_steps_ > max_creeping_steps) {
        record_failure(t);
        return Progress::failed;
    }
    ++counts_.steps;
    kept_step_ = kept_step(first_step_, result == Native::stopped);
    first_step_ = false;
    t_before_ = t_start;
    t_native_ = t;
    polynomial_made_ = false;
    std::copy(state_->x.begin(), state_->x.end(), x_before_.begin());
    return look_for_falls(t_stop);
}

// An exception does not pass through the library, which is C: it waits here.
SundialsIntegrator::Native SundialsIntegrator::take_native_step(double t_stop, double& t) {
    const Native result = native_step(t_stop, t);
    if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
    return result;
}

// Takes the state to the first fall in what there is of the library's step, or to its end.
Integrator::Progress SundialsIntegrator::look_for_falls(double t_stop) {
    state_->t = t_native_;
    const auto x = values(vector_.get());
    std::copy(x.begin(), x.end(), state_->x.begin());
    ahead_ = false;
    if (has_guards_ && t_native_ > t_before_) {
        const auto found = search_.first_crossing(polynomial(), *state_->discrete, crossed_);
        // A fall within rounding of the step's end is one at its end.
        const double at = polynomial_.time(found.at);
        ahead_ = found.at < 1 && at < t_native_;
        if (ahead_) {
            state_->t = at;
            polynomial_.evaluate(found.at, state_->x);
        }
        fell_ = found.falls;
        if (fell_) return Progress::crossing;
        if (ahead_) return Progress::stepped;
    }
    return t_native_ == t_stop ? Progress::stopped : Progress::stepped;
}

const StepPolynomial& SundialsIntegrator::polynomial() {
    if (polynomial_made_) return polynomial_;
    polynomial_.t0 = t_before_;
    polynomial_.h = t_native_ - t_before_;
    native_polynomial(x_before_, polynomial_);
    polynomial_made_ = true;
    return polynomial_;
}

void SundialsIntegrator::interpolate(double t, std::span<double> x) {
    polynomial().evaluate((t - polynomial_.t0) / polynomial_.h, x);
}

// The ends are taken as they are: a state may move by more than its rounding within the rounding of the time.
void SundialsIntegrator::polynomial_of_derivatives(int order,
                                                   const std::function<std::span<const double>(int)>& derivative,
                                                   std::span<const double> x0, std::span<const double> x1,
                                                   StepPolynomial& polynomial) {
    polynomial.resize(x0.size(), order);
    double factor = 1;
    for (int k = 0; k <= order; ++k) {
        if (k > 0) factor *= polynomial.h / k;
        const auto values = derivative(k);
        for (std::size_t i = 0; i < x0.size(); ++i) polynomial.term(k)[i] = factor * values[i];
    }
    for (std::size_t i = 0; i < x0.size(); ++i) {
        double end = 0;
        for (int k = order; k >= 0; --k) end += polynomial.term(k)[i];
        const double shift = x0[i] - polynomial.term(0)[i];
        polynomial.term(0)[i] = x0[i];
        polynomial.term(1)[i] += x1[i] - end - shift;
    }
}

void SundialsIntegrator::record_failure(double t) {
    if (met_non_finite_) {
        failure_ = {RunEnd::non_finite, t,
                    fmt::format("the derivative is not finite near t = {:.9g} s: the loop may be unstable", t)};
    } else {
        // The state that moves most, for its size.
        std::vector<double> rates(size_);
        const bool determined = system_.rates(state_->t, state_->x, *state_->discrete, rates);
        ++counts_.derivative_evaluations;
        const auto pace = [&](std::size_t i) {
            return std::abs(rates[i]) / (std::abs(state_->x[i]) + system_.states()[i].scale);
        };
        std::size_t fastest = 0;
        for (std::size_t i = 1; i < size_; ++i) {
            if (pace(i) > pace(fastest)) fastest = i;
        }
        std::string culprit;
        if (!determined) {
            culprit = ": the algebraic equations do not determine their variables there any longer";
        } else if (size_ > 0) {
            const auto& variable = system_.states()[fastest];
            culprit = fmt::format(": {} = {:.3g} changes by {:.3g} in a second; {} may have no solution beyond{}",
                                  variable.name, state_->x[fastest], rates[fastest],
                                  variable.is_algebraic() ? variable.equation : "it",
                                  variable.is_algebraic() ? "" : ", or be stiff for this solver");
        }
        failure_ = {RunEnd::step_too_small, t,
                    fmt::format("no step is short enough at t = {:.9g} s{}{}", t, culprit,
                                last_message_.empty() ? "" : fmt::format(" ({})", last_message_))};
    }
    // Methods of several steps may also give up before it, for a step that comes to nothing.
    if (not_finite_ && not_finite_->t >= t) failure_.not_finite = not_finite_;
}

RunStatistics SundialsIntegrator::statistics() const {
    RunStatistics all = counts_;
    all.guard_evaluations = search_.guard_evaluations();
    all.rejected_steps = rejected_before_ + native_rejected_steps();
    return all;
}

} // namespace tribode
