#include "solver/rk4_integrator.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

Rk4Integrator::Rk4Integrator(const HybridSystem& system, double step) : system_(system), step_(step) {
    for (auto* v : {&x_before_, &k1_, &k2_, &k3_, &k4_, &stage_}) v->resize(system.states().size());
    guards_.resize(system.guard_count());
}

void Rk4Integrator::restart(SystemState& state) { state_ = &state; }

void Rk4Integrator::slope(double t, const std::vector<double>& x, std::vector<double>& dxdt) {
    ++counts_.derivative_evaluations;
    system_.derivative(t, x, *state_->discrete, dxdt);
}

Integrator::Progress Rk4Integrator::step(double t_stop) {
    t_before_ = state_->t;
    x_before_ = state_->x;
    // The last step before t_stop takes up what rounding leaves over.
    const bool last = t_stop - t_before_ <= step_ * (1 + 1e-9);
    const double h = last ? t_stop - t_before_ : step_;
    const auto stage = [&](const std::vector<double>& k, double part) {
        for (std::size_t i = 0; i < stage_.size(); ++i) stage_[i] = x_before_[i] + part * h * k[i];
    };
    slope(t_before_, x_before_, k1_);
    stage(k1_, 0.5);
    slope(t_before_ + h / 2, stage_, k2_);
    stage(k2_, 0.5);
    slope(t_before_ + h / 2, stage_, k3_);
    stage(k3_, 1.0);
    slope(t_before_ + h, stage_, k4_);
    bool finite = true;
    for (std::size_t i = 0; i < stage_.size(); ++i) {
        stage_[i] = x_before_[i] + h / 6 * (k1_[i] + 2 * k2_[i] + 2 * k3_[i] + k4_[i]);
        finite = finite && std::isfinite(stage_[i]);
    }
    if (!finite) {
        failure_ = {RunEnd::non_finite, t_before_,
                    fmt::format("the state is not finite after t = {:.9g} s: the fixed step of {:g} s may be too long",
                                t_before_, step_)};
        return Progress::failed;
    }
    ++counts_.steps;
    state_->x = stage_;
    state_->t = last ? t_stop : t_before_ + h;

    system_.guards(state_->t, state_->x, *state_->discrete, guards_);
    ++counts_.guard_evaluations;
    fallen_.clear();
    for (GuardId guard = 0; guard < guards_.size(); ++guard) {
        if (guards_[guard] < 0) fallen_.push_back(guard);
    }
    // At t_stop the simulator looks at the guards itself.
    if (last) return Progress::stopped;
    return fallen_.empty() ? Progress::stepped : Progress::guard_fell;
}

void Rk4Integrator::interpolate(double t, std::span<double> x) {
    const double h = state_->t - t_before_, s = (t - t_before_) / h;
    for (std::size_t i = 0; i < x.size(); ++i) {
        const double a = x_before_[i], b = state_->x[i];
        x[i] = a + s * (b - a) + s * (s - 1) * ((1 - 2 * s) * (b - a) + h * ((s - 1) * k1_[i] + s * k4_[i]));
    }
}

} // namespace tribode
