#include "solver/exact_integrator.hpp"
#include "base/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

constexpr double half_ulp = 0x1p-54; // relative
constexpr double none = 2;           // no fall in [0, 1]
constexpr std::size_t most_coefficients = 41;

using Bernstein = std::array<double, most_coefficients>;

// b_i = sum_{k <= i} C(i,k)/C(N,k) p_k: the polynomial on [0, 1] lies within the range of the b_i.
Bernstein bernstein(std::span<const double> p) {
    Bernstein b{};
    const std::size_t degree = p.size() - 1;
    // p_k/C(N,k), then the sums with C(i,k) as repeated additions.
    double binomial = 1;
    b[0] = p[0];
    for (std::size_t k = 1; k <= degree; ++k) {
        binomial *= static_cast<double>(degree - k + 1) / static_cast<double>(k);
        b[k] = p[k] / binomial;
    }
    for (std::size_t round = 1; round <= degree; ++round) {
        for (std::size_t i = degree; i >= round; --i) b[i] += b[i - 1];
    }
    return b;
}

// One root in [low, high], the polynomial positive before and negative after it.
double close_in(std::span<const double> p, double low, double high) {
    double s = 0.5 * (low + high);
    for (int round = 0; round < 100; ++round) {
        double value = 0, slope = 0;
        for (std::size_t n = p.size(); n-- > 0;) {
            slope = slope * s + value;
            value = value * s + p[n];
        }
        (value >= 0 ? low : high) = s;
        double next = slope < 0 ? s - value / slope : low;
        if (!(next > low && next < high)) next = 0.5 * (low + high);
        if (std::abs(next - s) <= half_ulp || next == low || next == high) return next;
        s = next;
    }
    return s;
}

// The first fall in [low, high], at whose beginning the polynomial is zero or above; b: its Bernstein coefficients there.
double search(std::span<const double> p, const Bernstein& b, double low, double high) {
    const std::size_t degree = p.size() - 1;
    int changes = 0; // of sign, zeros passed over: as many as roots inside, or more by an even number (Descartes)
    double sign = 0; // of the last coefficient that is not zero
    for (std::size_t i = 0; i <= degree; ++i) {
        if (b[i] == 0) continue;
        if (sign * b[i] < 0) ++changes;
        sign = b[i] > 0 ? 1 : -1;
    }
    if (changes == 0) return sign < 0 ? low : none;
    if (changes == 1) return sign < 0 ? close_in(p, low, high) : low;
    // Two roots nearer than rounding can tell apart: the polynomial touches zero.
    if (high - low < 0x1p-50) return none;
    // de Casteljau: the coefficients on the two halves.
    Bernstein left{}, right = b;
    for (std::size_t round = 0; round <= degree; ++round) {
        left[round] = right[0];
        for (std::size_t i = 0; i + round < degree; ++i) right[i] = 0.5 * (right[i] + right[i + 1]);
    }
    const double middle = 0.5 * (low + high);
    const double first = search(p, left, low, middle);
    return first != none ? first : search(p, right, middle, high);
}

} // namespace

double first_fall_below_zero(std::span<const double> p) {
    // On [0, 1] the polynomial is at least this.
    double least = p[0];
    for (std::size_t n = 1; n < p.size(); ++n) least -= std::abs(p[n]);
    if (least > 0) return none;
    if (p[0] < 0) return 0;
    return search(p, bernstein(p), 0, 1);
}

ExactIntegrator::ExactIntegrator(const HybridSystem& system)
    : system_(system), size_(system.states().size()), guard_count_(system.guard_count()),
      terms_((most_terms + 1) * size_), guard_terms_((most_terms + 1) * guard_count_), slope_(size_),
      largest_(size_), polynomial_(most_terms + 1) {
    if (const auto reason = system.why_not_affine()) {
        throw InputError(fmt::format("solver \"exact\" cannot be used: {}; choose erk, adams or cvode", *reason));
    }
}

// Fills terms_ for the step h from the present state; false where they do not come to an end.
bool ExactIntegrator::expand(double h) {
    t0_ = state_->t;
    h_ = h;
    std::copy(state_->x.begin(), state_->x.end(), terms_.begin());
    for (std::size_t i = 0; i < size_; ++i) largest_[i] = std::abs(terms_[i]);
    bool last_was_small = false;
    for (int n = 0; n < most_terms; ++n) {
        system_.affine_derivative(n, t0_, h, {term(n), size_}, *state_->discrete, slope_);
        double* next = term(n + 1);
        const double factor = h / (n + 1);
        bool small = true;
        for (std::size_t i = 0; i < size_; ++i) {
            next[i] = factor * slope_[i];
            const double magnitude = std::abs(next[i]);
            largest_[i] = std::max(largest_[i], magnitude);
            small = small && magnitude <= half_ulp * largest_[i];
        }
        ++counts_.derivative_evaluations;
        if (small && last_was_small) {
            order_ = n + 1;
            return true;
        }
        last_was_small = small;
    }
    return false;
}

// The earliest fall of a guard within the step; which ones fall there goes to fallen_.
double ExactIntegrator::first_fall() {
    for (int n = 0; n <= order_; ++n) {
        system_.affine_guards(n, t0_, h_, {term(n), size_}, *state_->discrete,
                              {guard_terms_.data() + static_cast<std::size_t>(n) * guard_count_, guard_count_});
    }
    ++counts_.guard_evaluations;
    fallen_.clear();
    double first = none;
    const std::span<double> polynomial(polynomial_.data(), static_cast<std::size_t>(order_) + 1);
    for (GuardId guard = 0; guard < guard_count_; ++guard) {
        for (std::size_t n = 0; n < polynomial.size(); ++n) polynomial[n] = guard_terms_[n * guard_count_ + guard];
        const double s = first_fall_below_zero(polynomial);
        if (s == none || s > first) continue;
        if (s < first) fallen_.clear();
        first = s;
        fallen_.push_back(guard);
    }
    return first;
}

void ExactIntegrator::evaluate(double s, std::span<double> x) const {
    std::copy_n(term(order_), size_, x.begin());
    for (int n = order_ - 1; n >= 0; --n) {
        const double* c = term(n);
        for (std::size_t i = 0; i < size_; ++i) x[i] = x[i] * s + c[i];
    }
}

Integrator::Progress ExactIntegrator::step(double t_stop) {
    const double whole = t_stop - state_->t;
    double h = whole;
    while (!expand(h)) {
        h /= 2;
        if (h > 1e-9 * whole) continue;
        failure_ = {RunEnd::non_finite, state_->t,
                    fmt::format("the state is not finite near t = {:.9g} s: the loop may be unstable", state_->t)};
        return Progress::failed;
    }
    ++counts_.steps;
    const double s = first_fall();
    if (s != none) {
        evaluate(s, state_->x);
        state_->t = s == 1 && h == whole ? t_stop : t0_ + s * h;
        return Progress::guard_fell;
    }
    evaluate(1, state_->x);
    state_->t = h == whole ? t_stop : t0_ + h;
    return h == whole ? Progress::stopped : Progress::stepped;
}

void ExactIntegrator::interpolate(double t, std::span<double> x) const { evaluate((t - t0_) / h_, x); }

} // namespace tribode
