#include "tribode/solver/fixed_step_integrator.hpp"
#include "tribode/hybrid/piecewise_affine.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

using Matrix = std::vector<double>; // column-major, square

Matrix product(const Matrix& a, const Matrix& b, std::size_t n) {
    Matrix c(n * n);
    for (std::size_t j = 0; j < n; ++j) {
        for (std::size_t k = 0; k < n; ++k) {
            for (std::size_t i = 0; i < n; ++i) c[j * n + i] += a[k * n + i] * b[j * n + k];
        }
    }
    return c;
}

} // namespace

std::vector<double> integral_of_exponential(const Matrix& l, std::size_t n, double h) {
    double size = 0; // largest column sum
    for (std::size_t j = 0; j < n; ++j) {
        double sum = 0;
        for (std::size_t i = 0; i < n; ++i) sum += std::abs(l[j * n + i]);
        size = std::max(size, sum);
    }
    const int doublings = std::max(0, static_cast<int>(std::ceil(std::log2(std::max(size * h, 1.0)))));
    const double part = std::ldexp(h, -doublings);
    // Psi = part sum (part L)^k/(k+1)!, with part |L| <= 1: 20 terms reach 1/21! < 2^-64.
    Matrix psi(n * n), term(n * n);
    for (std::size_t i = 0; i < n; ++i) term[i * n + i] = part;
    for (int k = 0; k < 20; ++k) {
        for (std::size_t i = 0; i < n * n; ++i) psi[i] += term[i];
        term = product(l, term, n);
        for (double& value : term) value *= part / (k + 2);
    }
    // Psi(2h) = Psi(h) + exp(Lh) Psi(h), exp(Lh) = I + L Psi(h).
    for (int round = 0; round < doublings; ++round) {
        Matrix exponential = product(l, psi, n);
        for (std::size_t i = 0; i < n; ++i) exponential[i * n + i] += 1;
        const Matrix second = product(exponential, psi, n);
        for (std::size_t i = 0; i < n * n; ++i) psi[i] += second[i];
    }
    return psi;
}

FixedStepIntegrator::FixedStepIntegrator(const HybridSystem& system, Method method, double step)
    : system_(system),
      method_(method),
      step_(step) {
    const std::size_t n = system.states().size();
    for (auto* v : {&x_before_, &next_, &k1_, &k2_, &k3_, &k4_}) v->resize(n);
    guards_.resize(system.guard_count());
    if (method == Method::zoh) {
        linear_.resize(n * n);
        if (const PiecewiseAffine* affine = system.piecewise_affine()) affine->linear_part(linear_);
    }
}

void FixedStepIntegrator::slope(double t, const std::vector<double>& x, std::vector<double>& dxdt) {
    ++counts_.derivative_evaluations;
    system_.derivative(t, x, *state_->discrete, dxdt);
}

void FixedStepIntegrator::runge_kutta(double h) {
    const auto stage = [&](const std::vector<double>& k, double part) {
        for (std::size_t i = 0; i < next_.size(); ++i) next_[i] = x_before_[i] + part * h * k[i];
    };
    stage(k1_, 0.5);
    slope(t_before_ + h / 2, next_, k2_);
    stage(k2_, 0.5);
    slope(t_before_ + h / 2, next_, k3_);
    stage(k3_, 1.0);
    slope(t_before_ + h, next_, k4_);
    for (std::size_t i = 0; i < next_.size(); ++i) {
        next_[i] = x_before_[i] + h / 6 * (k1_[i] + 2 * k2_[i] + 2 * k3_[i] + k4_[i]);
    }
}

void FixedStepIntegrator::semi_implicit_euler(double h) {
    const auto& states = system_.states();
    for (std::size_t i = 0; i < next_.size(); ++i) next_[i] = x_before_[i] + h * k1_[i];
    for (std::size_t i = 0; i < next_.size(); ++i) {
        if (states[i].rate) next_[i] = x_before_[i] + h * next_[*states[i].rate];
    }
}

const std::vector<double>& FixedStepIntegrator::propagator(double h) {
    // Sample instants are rounded, so lengths that should be equal differ by that much.
    for (const auto& known : propagators_) {
        if (std::abs(known.h - h) <= 1e-9 * h) return known.psi;
    }
    constexpr std::size_t max_lengths = 16;
    if (propagators_.size() == max_lengths) propagators_.clear();
    return propagators_.emplace_back(Propagator{h, integral_of_exponential(linear_, next_.size(), h)}).psi;
}

void FixedStepIntegrator::zero_order_hold(double h) {
    const auto& psi = propagator(h);
    const std::size_t n = next_.size();
    next_ = x_before_;
    for (std::size_t j = 0; j < n; ++j) {
        for (std::size_t i = 0; i < n; ++i) next_[i] += psi[j * n + i] * k1_[j];
    }
}

Integrator::Progress FixedStepIntegrator::step(double t_stop) {
    t_before_ = state_->t;
    x_before_ = state_->x;
    // The last step before t_stop takes up what rounding leaves over.
    const bool last = t_stop - t_before_ <= step_ * (1 + 1e-9);
    const double h = last ? t_stop - t_before_ : step_;
    slope(t_before_, x_before_, k1_);
    switch (method_) {
    case Method::euler:
        for (std::size_t i = 0; i < next_.size(); ++i) next_[i] = x_before_[i] + h * k1_[i];
        break;
    case Method::semi_implicit_euler: semi_implicit_euler(h); break;
    case Method::zoh: zero_order_hold(h); break;
    default: runge_kutta(h);
    }
    if (!std::all_of(next_.begin(), next_.end(), [](double x) { return std::isfinite(x); })) {
        failure_ = {RunEnd::non_finite, t_before_,
                    fmt::format("the state is not finite after t = {:.9g} s: the fixed step of {:g} s may be too long",
                                t_before_, step_)};
        const std::pair<const std::vector<double>*, double> slopes[] = {
            {&k1_, 0}, {&k2_, h / 2}, {&k3_, h / 2}, {&k4_, h}};
        for (const auto& [k, after] : slopes) {
            if (!failure_.not_finite) failure_.not_finite = not_finite_in(*k, t_before_ + after);
        }
        return Progress::failed;
    }
    ++counts_.steps;
    state_->x = next_;
    state_->t = last ? t_stop : t_before_ + h;

    system_.guards(state_->t, state_->x, *state_->discrete, guards_);
    ++counts_.guard_evaluations;
    crossed_.clear();
    for (GuardId guard = 0; guard < guards_.size(); ++guard) {
        if (guards_[guard] < 0) crossed_.push_back(guard);
    }
    if (!crossed_.empty()) return Progress::crossing;
    return last ? Progress::stopped : Progress::stepped;
}

void FixedStepIntegrator::interpolate(double t, std::span<double> x) {
    const double h = state_->t - t_before_, s = (t - t_before_) / h;
    const bool cubic = method_ == Method::fixed;
    for (std::size_t i = 0; i < x.size(); ++i) {
        const double a = x_before_[i], b = state_->x[i];
        x[i] = a + s * (b - a);
        if (cubic) x[i] += s * (s - 1) * ((1 - 2 * s) * (b - a) + h * ((s - 1) * k1_[i] + s * k4_[i]));
    }
}

} // namespace tribode
