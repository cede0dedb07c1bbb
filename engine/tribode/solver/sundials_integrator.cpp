#include "tribode/solver/sundials_integrator.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <utility>

namespace tribode {

namespace {

constexpr long max_creeping_steps = 100'000;

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

SundialsIntegrator::SundialsIntegrator(const HybridSystem& system, const SolverOptions& options,
                                       const SundialsLibrary& library)
    : system_(system),
      size_(system.states().size()),
      library_(library),
      memory_(nullptr, {&library}),
      search_(system),
      has_guards_(system.guard_count() > 0),
      x_before_(size_) {
    SUNContext context = nullptr;
    check(SUNContext_Create(nullptr, &context), "SUNContext_Create");
    context_.reset(context);
    // A system of clocks alone has no states, which the library does not allow: it gets one that rests.
    const auto length = static_cast<sunindextype>(std::max<std::size_t>(size_, 1));
    vector_ = own(N_VNew_Serial(length, context), "N_VNew_Serial");
    // Sums of many vectors in one call: with few states the calls are the work. The library's own vectors are copies.
    check(N_VEnableFusedOps_Serial(vector_.get(), SUNTRUE), "N_VEnableFusedOps_Serial");
    if (size_ > 0 && size_ <= combine_few.size()) vector_->ops->nvlinearcombination = combine_few[size_ - 1];
    tolerance_ = own(N_VNew_Serial(length, context), "N_VNew_Serial");
    N_VConst(0.0, vector_.get());
    N_VConst(1.0, tolerance_.get());
    for (std::size_t i = 0; i < size_; ++i) {
        N_VGetArrayPointer(tolerance_.get())[i] = options.absolute_tolerance * system.states()[i].scale;
    }
}

void SundialsIntegrator::take_memory(void* memory, const char* function) {
    check(memory ? 0 : -1, function);
    memory_.reset(memory);
}

void SundialsIntegrator::set_up(const SolverOptions& options) {
    check(library_.set_error_handler(memory(), message_callback, this), "SetErrHandlerFn");
    check(library_.set_user_data(memory(), this), "SetUserData");
    check(library_.set_tolerances(memory(), options.relative_tolerance, tolerance_.get()), "SVtolerances");
    set_max_step(options.max_step);
}

int SundialsIntegrator::derivative_callback(double t, N_Vector x, N_Vector dxdt, void* self) {
    auto& me = *static_cast<SundialsIntegrator*>(self);
    ++me.counts_.derivative_evaluations;
    const std::span<double> slope(N_VGetArrayPointer(dxdt), me.size_);
    if (me.size_ == 0) N_VConst(0.0, dxdt);
    try {
        me.system_.derivative(t, me.values(x), *me.state_->discrete, slope);
        me.derivative_seen(slope);
    } catch (...) {
        me.thrown_ = std::current_exception();
        return -1; // the library ends its step
    }
    const auto not_finite = not_finite_in(slope, t);
    if (!not_finite) return 0;
    me.not_finite_ = not_finite;
    me.met_non_finite_ = true;
    return 1; // recoverable: a shorter step may do
}

void SundialsIntegrator::message_callback(int code, const char*, const char*, char* text, void* self) {
    // Warnings have positive codes; what matters of them is seen in the outcome.
    if (code >= 0) return;
    auto& me = *static_cast<SundialsIntegrator*>(self);
    try {
        me.last_message_ = text;
    } catch (...) {
        me.thrown_ = std::current_exception();
    }
}

void SundialsIntegrator::restart(SystemState& state) {
    state_ = &state;
    std::copy(state.x.begin(), state.x.end(), N_VGetArrayPointer(vector_.get()));
    if (counters_restart()) rejected_before_ += native_rejected_steps();
    if (crossing_ && !keeps_step_at_events()) kept_step_ = 0;
    native_restart(state.t);
    // 0: the method's own estimate.
    check(library_.set_initial_step(memory(), kept_step_), "SetInitStep");
    first_step_ = true;
    ahead_ = crossing_ = false;
    t_native_ = clear_to_ = state.t;
    polynomial_made_ = false;
}

// The rest of the step is valid, and is searched for zero crossings of the new guards.
void SundialsIntegrator::change_guards(SystemState& state) {
    crossing_ = false;
    clear_to_ = state.t;
}

// Up to where the library may go: no further than the next zero crossing of a guard of the time alone.
double SundialsIntegrator::next_stop(double t_stop) {
    if (!search_.has_time_guards()) return t_stop;
    if (clear_to_ <= state_->t) {
        clear_to_ = search_.next_time_event(state_->t, t_stop, state_->x, *state_->discrete).at;
    }
    return clear_to_ > state_->t ? std::min(clear_to_, t_stop) : t_stop;
}

Integrator::Progress SundialsIntegrator::step(double t_stop) {
    if (ahead_ && t_native_ <= t_stop) {
        // It begins at the state, to the bit: the new guards are at zero or above there.
        polynomial_.begin_at(state_->t);
        std::copy(state_->x.begin(), state_->x.end(), polynomial_.term(0));
        return look_for_crossings(t_stop);
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
    return look_for_crossings(t_stop);
}

SundialsIntegrator::Native SundialsIntegrator::take_native_step(double t_stop, double& t) {
    const Native result = native_step(t_stop, t);
    if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
    return result;
}

// 0: the step is done; 1: it has ended at the stop time; the other flags are of failures.
SundialsIntegrator::Native SundialsIntegrator::outcome_of(int flag, double t_stop, double& t) {
    constexpr int success = 0, at_stop_time = 1;
    if (flag != success && flag != at_stop_time) return Native::failed;
    if (flag == at_stop_time) t = t_stop;
    return t == t_stop ? Native::stopped : Native::stepped;
}

long SundialsIntegrator::native_rejected_steps() const {
    long count = 0;
    library_.get_rejected_steps(memory(), &count);
    return count;
}

// Takes the state to the first zero crossing in what there is of the library's step, or to its end.
Integrator::Progress SundialsIntegrator::look_for_crossings(double t_stop) {
    state_->t = t_native_;
    const auto x = values(vector_.get());
    std::copy(x.begin(), x.end(), state_->x.begin());
    ahead_ = false;
    if (has_guards_ && t_native_ > t_before_) {
        const auto found = search_.first_crossing(polynomial(), *state_->discrete, crossed_);
        // A crossing within rounding of the step's end is one at its end.
        const double at = polynomial_.time(found.at);
        ahead_ = found.at < 1 && at < t_native_;
        if (ahead_) {
            state_->t = at;
            polynomial_.evaluate(found.at, state_->x);
        }
        crossing_ = found.crosses;
        if (crossing_) return Progress::crossing;
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
