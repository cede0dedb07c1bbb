#include "solver/sundials_integrator.hpp"
#include "base/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <sunmatrix/sunmatrix_dense.h>

namespace tribode {

namespace {

constexpr int most_steps_without_progress = 100;

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

// To which the library locates a guard's zero [s].
double time_resolution(double t) { return 100 * std::numeric_limits<double>::epsilon() * std::abs(t); }

} // namespace

void SundialsIntegrator::check(int flag, const char* function) {
    if (flag < 0) throw Error(fmt::format("{} failed with flag {}", function, flag));
}

SundialsIntegrator::SundialsIntegrator(const HybridSystem& system, const SolverOptions& options)
    : system_(system),
      size_(system.states().size()),
      found_(system.guard_count()),
      guard_values_(system.guard_count()),
      x_between_(size_) {
    check(SUNContext_Create(nullptr, &context_), "SUNContext_Create");
    // A system of clocks alone has no states, which the library does not allow: it gets one that rests.
    const auto length = static_cast<sunindextype>(std::max<std::size_t>(size_, 1));
    vector_.reset(N_VNew_Serial(length, context_));
    // Sums of many vectors in one call: with few states the calls are the work. The library's own vectors are copies.
    check(N_VEnableFusedOps_Serial(vector_.get(), SUNTRUE), "N_VEnableFusedOps_Serial");
    if (size_ > 0 && size_ <= combine_few.size()) vector_->ops->nvlinearcombination = combine_few[size_ - 1];
    tolerance_.reset(N_VNew_Serial(length, context_));
    dense_.reset(N_VNew_Serial(length, context_));
    N_VConst(0.0, vector_.get());
    N_VConst(1.0, tolerance_.get());
    for (std::size_t i = 0; i < size_; ++i) {
        N_VGetArrayPointer(tolerance_.get())[i] = options.absolute_tolerance * system.states()[i].scale;
    }
    // Whether there is an analytic Jacobian does not depend on the state.
    const SystemState start = system.initial_state();
    std::vector<double> matrix(size_ * size_);
    has_jacobian_ = system.jacobian(0.0, start.x, *start.discrete, matrix);
}

SundialsIntegrator::~SundialsIntegrator() {
    vector_.reset();
    tolerance_.reset();
    dense_.reset();
    SUNContext_Free(&context_);
}

int SundialsIntegrator::derivative_callback(double t, N_Vector x, N_Vector dxdt, void* self) {
    auto& me = *static_cast<SundialsIntegrator*>(self);
    ++me.counts_.derivative_evaluations;
    const std::span<double> slope(N_VGetArrayPointer(dxdt), me.size_);
    if (me.size_ == 0) N_VConst(0.0, dxdt);
    me.system_.derivative(t, me.values(x), *me.state_->discrete, slope);
    const auto not_finite = not_finite_in(slope, t);
    if (!not_finite) return 0;
    me.not_finite_ = not_finite;
    me.met_non_finite_ = true;
    return 1; // recoverable: a shorter step may do
}

int SundialsIntegrator::guard_callback(double t, N_Vector x, double* g, void* self) {
    auto& me = *static_cast<SundialsIntegrator*>(self);
    ++me.counts_.guard_evaluations;
    me.system_.guards(t, me.values(x), *me.state_->discrete, {g, me.found_.size()});
    return 0;
}

int SundialsIntegrator::jacobian_callback(double t, N_Vector x, N_Vector, SUNMatrix matrix, void* self, N_Vector,
                                          N_Vector, N_Vector) {
    auto& me = *static_cast<SundialsIntegrator*>(self);
    ++me.counts_.jacobian_evaluations;
    SUNMatZero(matrix);
    me.system_.jacobian(t, me.values(x), *me.state_->discrete, {SM_DATA_D(matrix), me.size_ * me.size_});
    return 0;
}

void SundialsIntegrator::message_callback(int code, const char*, const char*, char* text, void* self) {
    // Warnings have positive codes; what matters of them is seen in the outcome.
    if (code < 0) static_cast<SundialsIntegrator*>(self)->last_message_ = text;
}

void SundialsIntegrator::restart(SystemState& state) {
    state_ = &state;
    std::copy(state.x.begin(), state.x.end(), N_VGetArrayPointer(vector_.get()));
    if (counters_restart()) rejected_before_ += native_rejected_steps();
    native_restart(state.t, kept_step_);
    first_step_ = true;
}

Integrator::Progress SundialsIntegrator::step(double t_stop) {
    const double t_before = state_->t;
    double t = t_before;
    met_non_finite_ = false;
    Native result = native_step(t_stop, t);
    // The size that was good before an event may be far too long after it: then the method's own estimate.
    if (result == Native::failed && first_step_ && kept_step_ > 0 && !met_non_finite_) {
        kept_step_ = 0;
        restart(*state_);
        result = native_step(t_stop, t);
    }
    // ERKStep gives up at the first derivative that is not finite, where a shorter step may do.
    for (double h = (t_stop - t_before) / 10;
         result == Native::failed && met_non_finite_ && h > time_resolution(t_before); h /= 10) {
        kept_step_ = h;
        restart(*state_);
        result = native_step(t_stop, t);
    }
    // Some methods would creep on for ever where the derivative ceases to be finite.
    const bool advances = result == Native::stopped || t - t_before > time_resolution(t);
    steps_without_progress_ = advances ? 0 : steps_without_progress_ + 1;
    if (result == Native::failed || steps_without_progress_ > most_steps_without_progress) {
        record_failure(t);
        return Progress::failed;
    }
    ++counts_.steps;
    kept_step_ = kept_step(first_step_, result == Native::stopped);
    first_step_ = false;
    state_->t = t;
    const auto x = values(vector_.get());
    std::copy(x.begin(), x.end(), state_->x.begin());
    if (result == Native::root) {
        native_roots(found_.data());
        fallen_.clear();
        for (GuardId guard = 0; guard < found_.size(); ++guard) {
            if (found_[guard] != 0) fallen_.push_back(guard);
        }
        return Progress::guard_fell;
    }
    if (look_for_missed_fall(t_before)) return Progress::guard_fell;
    return result == Native::stopped ? Progress::stopped : Progress::stepped;
}

// The library takes a guard that is zero at a restart as it finds it a tenth of the first step later: one
// that leaves zero downwards, or is back below it by then, is not reported. Such a fall is looked for by
// bisection in the step.
bool SundialsIntegrator::look_for_missed_fall(double t_before) {
    const auto look_at_guards = [&](double t, std::span<const double> x) {
        ++counts_.guard_evaluations;
        system_.guards(t, x, *state_->discrete, guard_values_);
    };
    const auto below_zero = [&](GuardId guard) { return guard_values_[guard] < 0; };
    look_at_guards(state_->t, state_->x);
    fallen_.clear();
    for (GuardId guard = 0; guard < guard_values_.size(); ++guard) {
        if (below_zero(guard)) fallen_.push_back(guard);
    }
    if (fallen_.empty()) return false;

    double calm = t_before, after = state_->t;
    while (after - calm > time_resolution(after)) {
        const double middle = calm + (after - calm) / 2;
        interpolate(middle, x_between_);
        look_at_guards(middle, x_between_);
        if (std::none_of(fallen_.begin(), fallen_.end(), below_zero)) {
            calm = middle;
            continue;
        }
        after = middle;
        state_->x = x_between_;
        // Those that fall later are left to the next step.
        std::erase_if(fallen_, [&](GuardId guard) { return !below_zero(guard); });
    }
    state_->t = after;
    return true;
}

void SundialsIntegrator::record_failure(double t) {
    if (met_non_finite_) {
        failure_ = {RunEnd::non_finite, t,
                    fmt::format("the derivative is not finite near t = {:.9g} s: the loop may be unstable", t)};
    } else {
        failure_ = {RunEnd::step_too_small, t,
                    fmt::format("the integrator cannot go on at t = {:.9g} s ({}); loosen the tolerances or choose "
                                "another solver",
                                t, last_message_.empty() ? "no step gets on in time" : last_message_)};
    }
    // Methods of several steps may also give up before it, for a step that comes to nothing.
    if (not_finite_ && not_finite_->t >= t) failure_.not_finite = not_finite_;
}

RunStatistics SundialsIntegrator::statistics() const {
    RunStatistics all = counts_;
    all.rejected_steps = rejected_before_ + native_rejected_steps();
    return all;
}

} // namespace tribode
