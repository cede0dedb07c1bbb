#include "tribode/solver/exact_integrator.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

const HybridSystem& ExactIntegrator::checked(const HybridSystem& system) {
    const auto reason = why_not_affine(system);
    if (!reason) return system;
    throw InputError(fmt::format("solver \"exact\" cannot be used: {}; choose erk, adams or bdf", *reason));
}

ExactIntegrator::ExactIntegrator(const HybridSystem& system)
    : SeriesIntegrator(checked(system), 4),
      propagator_height_(height_ + padded(2 * guard_count_)),
      rest_height_(padded(guard_count_)),
      work_(height_),
      least_(height_),
      limit_(height_),
      end_(height_),
      travel_(height_),
      response_(terms_.size()),
      f_(height_),
      moved_(propagator_height_),
      speed_(height_),
      rest_(rest_height_) {
    // At the end of a long chain a state has no term before many are taken. Sizes below this are not worth one.
    constexpr double least = 1e-25;
    std::transform(system.states().begin(), system.states().end(), least_.begin(),
                   [](const StateVariable& state) { return least * state.scale; });
}

void ExactIntegrator::restart(SystemState& state) {
    state_ = &state;
    if (affine_.has_varying_input(*state.discrete)) {
        pattern_ = nullptr;
        return;
    }
    const bool is_new = is_new_pattern(*state.discrete);
    if (pattern_ && !is_new) return;
    pattern_ = &patterns_.find(key_, [this](AffinePattern& pattern) { make_pattern(pattern); });
}

void ExactIntegrator::make_pattern(AffinePattern& pattern) const {
    const AffineForm form = affine_.affine_form(*state_->discrete);
    pattern.a.assign(height_ * height_, 0.0);
    pattern.entries.clear();
    pattern.first = {0};
    for (std::size_t guard = 0; guard < guard_count_; ++guard) {
        for (std::size_t j = 0; j < size_; ++j) {
            const double value = form.g[j * guard_count_ + guard];
            if (value != 0) pattern.entries.push_back({j, value});
        }
        pattern.first.push_back(pattern.entries.size());
    }
    pattern.prepared.clear();
    pattern.series = 0;
    for (std::size_t j = 0; j < size_; ++j) {
        std::copy_n(form.a.data() + j * size_, size_, pattern.a.data() + j * height_);
    }
    pattern.square.resize(height_ * height_);
    for (std::size_t j = 0; j < size_; ++j) {
        multiply_columns(pattern.a.data(), height_, height_, pattern.a.data() + j * height_,
                         pattern.square.data() + j * height_);
    }
    pattern.decay = fastest_decay(pattern.a);
}

// Of the states that decay by themselves, dx_j/dt = rate x_j, such as the lag of a thrust: 1/s, 0 where there is none.
double ExactIntegrator::fastest_decay(const Columns& a) const {
    double rate = 0;
    for (std::size_t j = 0; j < size_; ++j) {
        bool alone = true;
        for (std::size_t k = 0; k < size_; ++k) alone = alone && (k == j || a[k * height_ + j] == 0);
        if (alone) rate = std::min(rate, a[j * height_ + j]);
    }
    return rate;
}

// Column by column, as the responses to f = e_j: a step's series from zero with that slope.
ExactIntegrator::Prepared ExactIntegrator::prepare(const AffinePattern& pattern, double h) {
    Prepared made{h, Columns(height_ * propagator_height_), Columns(height_ * rest_height_)};
    Columns& terms = response_; // those of the last step stay
    const Columns none(height_);
    for (std::size_t j = 0; j < size_; ++j) {
        std::fill_n(terms.begin() + static_cast<std::ptrdiff_t>(height_), height_, 0.0);
        terms[height_ + j] = h;
        const int order = expand_columns(pattern.a.data(), pattern.square.data(), pattern.decay, none.data(), height_,
                                         h, max_terms, terms.data(), limit_.data());
        // From rest any length comes to an end at once; from elsewhere this one does not.
        if (order == 0) {
            made.propagator.clear();
            return made;
        }
        double* column = made.propagator.data() + j * propagator_height_;
        sum_columns(terms.data(), order, height_, column, travel_.data());
        for (std::size_t guard = 0; guard < guard_count_; ++guard) {
            const auto along = [&](int n) {
                double g = 0;
                for (const auto& [state, value] : pattern.row(guard)) {
                    g += value * terms[static_cast<std::size_t>(n) * height_ + state];
                }
                return g;
            };
            column[height_ + 2 * guard] = along(1);
            column[height_ + 2 * guard + 1] = along(2);
            for (int n = 3; n <= order; ++n) made.rest[j * rest_height_ + guard] += std::abs(along(n));
        }
    }
    return made;
}

// Propagates the whole step, if no guard can cross zero in it.
bool ExactIntegrator::propagate(const Prepared& prepared) {
    if (prepared.propagator.empty()) return false;
    known_at_start_ = true;
    auto& x = state_->x;
    const std::span<double> f(f_.data(), size_);
    system_.derivative(t0_, x, *state_->discrete, f);
    system_.guards(t0_, x, *state_->discrete, {guard_terms_.data(), guard_count_});
    ++counts_.derivative_evaluations;
    ++counts_.guard_evaluations;
    for (std::size_t i = 0; i < size_; ++i) speed_[i] = std::abs(f[i]);
    multiply_columns(prepared.propagator.data(), propagator_height_, height_, f.data(), moved_.data());
    multiply_columns(prepared.rest.data(), rest_height_, height_, speed_.data(), rest_.data());
    for (std::size_t guard = 0; guard < guard_count_; ++guard) {
        if (pattern_->row(guard).empty()) continue; // it does not move
        const double* row = moved_.data() + height_ + 2 * guard;
        if (!stays_positive(guard_terms_[guard], row[0], row[1], rest_[guard])) return false;
    }
    // A machine without guards that move would propagate on and on where its loop is unstable.
    bool finite = true;
    for (std::size_t i = 0; i < size_; ++i) {
        x[i] += moved_[i];
        finite = finite && std::isfinite(x[i]);
    }
    if (!finite) std::copy_n(term(0), size_, x.begin());
    return finite;
}

// Fills terms_ for a step h from where it began; false where they do not come to an end.
bool ExactIntegrator::expand(double h) {
    h_ = h;
    const std::span<double> first(term(1), size_);
    if (known_at_start_) {
        std::copy_n(f_.begin(), size_, first.begin());
    } else {
        system_.derivative(t0_, {term(0), size_}, *state_->discrete, first);
        ++counts_.derivative_evaluations;
    }
    for (double& c : first) c *= h;
    if (pattern_) {
        order_ = expand_columns(pattern_->a.data(), pattern_->square.data(), pattern_->decay, least_.data(), height_, h,
                                max_terms, terms_.data(), limit_.data());
        // A comparison with what is not a number hides it; in the last term it still shows.
        return order_ > 0 && std::all_of(term(order_), term(order_) + size_, [](double c) { return std::isfinite(c); });
    }
    work_ = least_;
    return add_terms(h, work_, [&](int n) {
        affine_.rate_coefficient(n, t0_, h, {term(n), size_}, *state_->discrete, {term(n + 1), size_});
        ++counts_.derivative_evaluations;
    });
}

double ExactIntegrator::find_crossing() {
    if (!known_at_start_) {
        system_.guards(t0_, {term(0), size_}, *state_->discrete, {guard_term(0), guard_count_});
        ++counts_.guard_evaluations;
    }
    if (!pattern_) {
        find_guard_terms();
        return first_crossing([&](GuardId guard) -> std::optional<std::size_t> {
            const auto last = static_cast<std::size_t>(order_);
            for (std::size_t n = 0; n <= last; ++n) polynomial_[n] = guard_term(n)[guard];
            return last;
        });
    }
    return first_crossing([&](GuardId guard) -> std::optional<std::size_t> {
        const auto row = pattern_->row(guard);
        if (row.empty()) return std::nullopt; // it does not move
        polynomial_[0] = guard_terms_[guard];
        // Mostly it is so far above zero that it cannot get there.
        double reach = 0;
        for (const auto& [column, value] : row) reach += std::abs(value) * travel_[column];
        if (polynomial_[0] > reach) return std::nullopt;
        auto last = static_cast<std::size_t>(order_);
        const auto along = [&](const Entry& entry, std::size_t n) {
            return entry.value * terms_[n * height_ + entry.column];
        };
        for (std::size_t n = 1; n <= last; ++n) polynomial_[n] = along(row.front(), n);
        for (std::size_t i = 1; i < row.size(); ++i) {
            for (std::size_t n = 1; n <= last; ++n) polynomial_[n] += along(row[i], n);
        }
        // A position's terms end before the thrust's.
        while (last > 1 && std::abs(polynomial_[last]) < 0x1p-60 * reach) --last;
        return last;
    });
}

void ExactIntegrator::evaluate(double s, std::span<double> x) {
    evaluate_columns(terms_.data(), order_, height_, s, work_.data());
    std::copy_n(work_.begin(), size_, x.begin());
}

Integrator::Progress ExactIntegrator::step(double t_stop) {
    const double whole = begin(t_stop);
    h_ = whole;
    ++counts_.steps;
    known_at_start_ = false;
    const Prepared* prepared = pattern_ ? prepared_for(*pattern_, whole) : nullptr;
    if (prepared && propagate(*prepared)) return stop(whole, whole, t_stop, whole - prepared->h);
    double h = whole;
    while (!expand(h)) {
        h /= 2;
        if (h > 1e-9 * whole) continue;
        return fail(not_finite_in({term(1), size_}, t0_));
    }
    sum_columns(terms_.data(), order_, height_, end_.data(), travel_.data());
    const double s = find_crossing();
    if (s != no_crossing) {
        evaluate(s, state_->x);
        return cross(s, h, whole, t_stop);
    }
    std::copy_n(end_.begin(), size_, state_->x.begin());
    const Progress progress = stop(h, whole, t_stop, 0);
    if (progress == Progress::stopped && !prepared && pattern_ && is_worth_preparing(*pattern_, whole)) {
        pattern_->prepared.push_back(prepare(*pattern_, whole));
    }
    return progress;
}

void ExactIntegrator::interpolate(double t, std::span<double> x) {
    // A propagated step left no series; it converges, because Psi was made of the same terms.
    if (order_ == 0) expand(h_);
    evaluate((t - t0_ + lag_) / h_, x);
}

} // namespace tribode
