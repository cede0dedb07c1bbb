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

ExactIntegrator::ExactIntegrator(const HybridSystem& system, PreparedSteps* shared)
    : SeriesIntegrator(checked(system), 4),
      shared_(shared),
      work_(height_),
      least_(height_),
      limit_(height_),
      end_(height_),
      travel_(height_),
      response_(terms_.size()),
      f_(height_),
      moved_(height_),
      moving_guards_(guard_count_ + guard_group) {
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
    pattern_ = &patterns_.find(key_, [this](AffinePattern& pattern) {
        pattern.series = 0;
        pattern.prepared.clear();
        const AffineForm form = affine_.affine_form(*state_->discrete);
        const auto make = [&] { return make_matrices(form); };
        pattern.known = shared_ ? shared_->pattern(key_, form, make) : std::make_shared<PreparedSteps::Pattern>(make());
    });
    matrices_ = &pattern_->known->matrices;
}

PreparedSteps::Matrices ExactIntegrator::make_matrices(const AffineForm& form) const {
    const std::size_t size = height_ * height_, count = power_count(height_);
    Matrices made{Columns(count * size), 0, {}, {0}, {}};
    for (std::size_t guard = 0; guard < guard_count_; ++guard) {
        for (std::size_t j = 0; j < size_; ++j) {
            const double value = form.g[j * guard_count_ + guard];
            if (value == 0) continue;
            made.entries.push_back({j, value});
        }
        if (made.entries.size() > made.first.back()) made.moving.push_back(guard);
        made.first.push_back(made.entries.size());
    }
    double* const a = made.powers.data();
    for (std::size_t j = 0; j < size_; ++j) std::copy_n(form.a.data() + j * size_, size_, a + j * height_);
    // Each is the square of the one before.
    for (std::size_t i = 0; i < (count - 1) * size; i += height_) {
        multiply_columns(a + i / size * size, height_, height_, a + i, a + size + i);
    }
    made.decay = fastest_decay(made.powers);
    return made;
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
PreparedSteps::Propagation ExactIntegrator::prepare(double h) {
    const std::size_t guard_room = matrices_->groups() * guard_group, rows = height_ + 2 * guard_room;
    Propagation made{Columns(height_ * rows), Columns(height_ * guard_room)};
    Columns& terms = response_; // those of the last step stay
    const Columns none(height_);
    Columns unit(height_);
    for (std::size_t j = 0; j < size_; ++j) {
        unit[j] = 1;
        const int order = expand_columns(matrices_->powers.data(), matrices_->decay, none.data(), height_, unit.data(),
                                         h, max_terms, terms.data(), limit_.data());
        unit[j] = 0;
        // From rest any length comes to an end at once; from elsewhere this one does not.
        if (order == 0) {
            made.propagator.clear();
            return made;
        }
        double* column = made.propagator.data() + j * rows;
        sum_columns(terms.data(), order, height_, column, travel_.data());
        for (std::size_t guard = 0; guard < matrices_->moving.size(); ++guard) {
            const auto along = [&](int n) {
                double g = 0;
                for (const auto& [state, value] : matrices_->row(matrices_->moving[guard])) {
                    g += value * terms[static_cast<std::size_t>(n) * height_ + state];
                }
                return g;
            };
            double* both = column + height_ + guard + guard / guard_group * guard_group;
            both[0] = along(1);
            both[guard_group] = along(2);
            for (int n = 3; n <= order; ++n) made.rest[j * guard_room + guard] += std::abs(along(n));
        }
    }
    return made;
}

// Propagates the whole step, if no guard can cross zero in it.
bool ExactIntegrator::propagate(const Propagation& step) {
    if (step.propagator.empty()) return false;
    known_at_start_ = true;
    std::vector<double>& x = state_->x;
    system_.guards(t0_, x, *state_->discrete, {guard_terms_.data(), guard_count_});
    system_.derivative(t0_, x, *state_->discrete, {f_.data(), size_});
    ++counts_.derivative_evaluations;
    ++counts_.guard_evaluations;
    const std::vector<GuardId>& moving = matrices_->moving;
    const std::size_t groups = matrices_->groups();
    for (std::size_t i = 0; i < moving.size(); ++i) moving_guards_[i] = guard_terms_[moving[i]];
    for (std::size_t i = moving.size(); i < groups * guard_group; ++i) moving_guards_[i] = 1;
    if (!propagate_columns(step.propagator.data(), step.rest.data(), moving_guards_.data(), height_, groups, f_.data(),
                           moved_.data())) {
        return false;
    }
    double zero = 0; // unless one of x is not finite
    for (std::size_t i = 0; i < size_; ++i) {
        x[i] += moved_[i];
        zero += 0 * x[i];
    }
    // A machine without guards that move would propagate on and on where its loop is unstable.
    if (zero == 0) return true;
    std::copy_n(term(0), size_, x.begin());
    return false;
}

// Fills terms_ for a step h from where it began; false where they do not come to an end.
bool ExactIntegrator::expand(double h) {
    h_ = h;
    if (!known_at_start_) {
        system_.derivative(t0_, {term(0), size_}, *state_->discrete, {f_.data(), size_});
        ++counts_.derivative_evaluations;
    }
    if (pattern_) {
        order_ = expand_columns(matrices_->powers.data(), matrices_->decay, least_.data(), height_, f_.data(), h,
                                max_terms, terms_.data(), limit_.data());
        // A comparison with what is not a number hides it; in the last term it still shows.
        return order_ > 0 && std::all_of(term(order_), term(order_) + size_, [](double c) { return std::isfinite(c); });
    }
    for (std::size_t i = 0; i < size_; ++i) term(1)[i] = h * f_[i];
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
        const auto row = matrices_->row(guard);
        if (row.empty()) return std::nullopt; // it does not move
        polynomial_[0] = guard_terms_[guard];
        // Mostly it is so far above zero that it cannot get there, up to rounding of the sums.
        double reach = 0;
        for (const auto& [column, value] : row) reach += std::abs(value) * travel_[column];
        if (polynomial_[0] > (1 + 1e-12) * reach) return std::nullopt;
        auto last = static_cast<std::size_t>(order_);
        const auto along = [&](const PreparedSteps::Entry& entry, std::size_t n) {
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
    if (prepared && propagate(*prepared->step)) return stop(whole, whole, t_stop, whole - prepared->h);
    double h = whole;
    // Down to rounding: a first step may be as short as the fastest decay, those that are prepared after it are not.
    while (!expand(h)) {
        h /= 2;
        if (h > 0x1p-60 * whole) continue;
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
        pattern_->prepared.push_back({whole, pattern_->known->propagation(whole, [&] { return prepare(whole); })});
    }
    return progress;
}

void ExactIntegrator::interpolate(double t, std::span<double> x) {
    // A propagated step left no series; it converges, because Psi was made of the same terms.
    if (order_ == 0) expand(h_);
    evaluate((t - t0_ + lag_) / h_, x);
}

} // namespace tribode
