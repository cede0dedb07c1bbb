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
constexpr std::size_t most_coefficients = 31;

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

void ExactIntegrator::restart(SystemState& state) {
    state_ = &state;
    const auto key = system_.affine_pattern(*state.discrete);
    if (!key) {
        pattern_ = nullptr;
        return;
    }
    if (pattern_ && *key == key_) return;
    key_ = *key;
    auto known = patterns_.find(key_);
    if (known == patterns_.end()) {
        // Patterns that never come again must not fill the memory.
        if (patterns_.size() == most_patterns) patterns_.clear();
        known = patterns_.emplace(key_, make_pattern()).first;
    }
    pattern_ = &known->second;
}

// A and G column by column, as the images of the unit vectors.
ExactIntegrator::Pattern ExactIntegrator::make_pattern() const {
    Pattern pattern;
    pattern.a.resize(size_ * size_);
    pattern.g.resize(guard_count_ * size_);
    std::vector<double> unit(size_), column(guard_count_);
    for (std::size_t j = 0; j < size_; ++j) {
        unit[j] = 1;
        system_.affine_derivative(1, 0, 1, unit, *state_->discrete, {pattern.a.data() + j * size_, size_});
        system_.affine_guards(1, 0, 1, unit, *state_->discrete, column);
        for (std::size_t i = 0; i < guard_count_; ++i) pattern.g[i * size_ + j] = column[i];
        unit[j] = 0;
    }
    return pattern;
}

// Series of Psi: h sum (hA)^n/(n+1)!, and of the guards along it.
ExactIntegrator::Prepared ExactIntegrator::prepare(const Pattern& pattern, double h) const {
    Prepared made{h, std::vector<double>(size_ * size_), std::vector<double>(guard_count_ * size_),
                  std::vector<double>(guard_count_ * size_), std::vector<double>(guard_count_ * size_)};
    std::vector<double> term(size_), next(size_);
    for (std::size_t j = 0; j < size_; ++j) {
        // The response to f = e_j: terms h^{n+1}/(n+1)! A^n e_j.
        std::fill(term.begin(), term.end(), 0.0);
        term[j] = h;
        for (int n = 0; n < most_terms; ++n) {
            for (std::size_t i = 0; i < size_; ++i) made.psi[j * size_ + i] += term[i];
            for (std::size_t guard = 0; guard < guard_count_; ++guard) {
                double g = 0;
                for (std::size_t i = 0; i < size_; ++i) g += pattern.g[guard * size_ + i] * term[i];
                const std::size_t at = guard * size_ + j;
                if (n == 0) made.first[at] = g;
                if (n == 1) made.second[at] = g;
                if (n > 1) made.rest[at] += std::abs(g);
            }
            std::fill(next.begin(), next.end(), 0.0);
            for (std::size_t k = 0; k < size_; ++k) {
                for (std::size_t i = 0; i < size_; ++i) next[i] += pattern.a[k * size_ + i] * term[k];
            }
            for (std::size_t i = 0; i < size_; ++i) term[i] = next[i] * h / (n + 2);
        }
    }
    return made;
}

// Sample instants are rounded, so equal lengths differ by that much.
bool ExactIntegrator::same_length(double a, double b) const {
    return std::abs(a - b) <= 0x1p-50 * (std::abs(state_->t) + std::abs(a));
}

const ExactIntegrator::Prepared* ExactIntegrator::prepared_for(double h) const {
    if (!pattern_) return nullptr;
    for (const auto& prepared : pattern_->prepared) {
        if (same_length(prepared.h, h)) return &prepared;
    }
    return nullptr;
}

// A length met for the second time in a pattern will be met again.
void ExactIntegrator::remember(double h) {
    if (!pattern_ || pattern_->prepared.size() == most_lengths) return;
    auto& lengths = pattern_->lengths;
    const bool again = std::any_of(lengths.begin(), lengths.end(), [&](double l) { return same_length(l, h); });
    if (again) {
        pattern_->prepared.push_back(prepare(*pattern_, h));
    } else if (lengths.size() < 2 * most_lengths) {
        lengths.push_back(h);
    }
}

// Goes over the whole step at once, if no guard can fall in it.
bool ExactIntegrator::leap(const Prepared& prepared) {
    auto& x = state_->x;
    system_.derivative(state_->t, x, *state_->discrete, slope_);
    system_.guards(state_->t, x, *state_->discrete, {guard_terms_.data(), guard_count_});
    ++counts_.derivative_evaluations;
    ++counts_.guard_evaluations;
    for (std::size_t guard = 0; guard < guard_count_; ++guard) {
        const double* first_row = prepared.first.data() + guard * size_;
        const double* second_row = prepared.second.data() + guard * size_;
        const double* rest_row = prepared.rest.data() + guard * size_;
        double first = 0, second = 0, rest = 0;
        for (std::size_t i = 0; i < size_; ++i) {
            first += first_row[i] * slope_[i];
            second += second_row[i] * slope_[i];
            rest += rest_row[i] * std::abs(slope_[i]);
        }
        // s and s^2 lie between 0 and 1, so the guard is at least this, up to rounding, which the margin covers.
        const double least = guard_terms_[guard] + std::min(0.0, first + std::min(0.0, second)) - rest;
        const double margin = 1e-12 * (std::abs(first) + std::abs(second) + rest);
        if (!(least > margin)) return false;
    }
    for (std::size_t j = 0; j < size_; ++j) {
        const double* column = prepared.psi.data() + j * size_;
        for (std::size_t i = 0; i < size_; ++i) x[i] += column[i] * slope_[j];
    }
    return true;
}

// Where a step begins.
void ExactIntegrator::begin(double h) {
    t0_ = state_->t;
    h_ = h;
    order_ = 0;
    std::copy(state_->x.begin(), state_->x.end(), terms_.begin());
}

// Fills terms_ for a step h from where it began; false where they do not come to an end.
bool ExactIntegrator::expand(double h) {
    h_ = h;
    const DiscreteState& d = *state_->discrete;
    for (std::size_t i = 0; i < size_; ++i) largest_[i] = std::abs(terms_[i]);
    bool last_was_small = false;
    for (int n = 0; n < most_terms; ++n) {
        const double* c = term(n);
        if (pattern_ && n > 0) {
            std::fill(slope_.begin(), slope_.end(), 0.0);
            for (std::size_t j = 0; j < size_; ++j) {
                const double* column = pattern_->a.data() + j * size_;
                for (std::size_t i = 0; i < size_; ++i) slope_[i] += column[i] * c[j];
            }
        } else {
            system_.affine_derivative(n, t0_, h, {c, size_}, d, slope_);
            ++counts_.derivative_evaluations;
        }
        double* next = term(n + 1);
        const double factor = h / (n + 1);
        bool small = true;
        for (std::size_t i = 0; i < size_; ++i) {
            next[i] = factor * slope_[i];
            const double magnitude = std::abs(next[i]);
            largest_[i] = std::max(largest_[i], magnitude);
            small = small && magnitude <= half_ulp * largest_[i];
        }
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
    const DiscreteState& d = *state_->discrete;
    const auto row = [&](int n) { return guard_terms_.data() + static_cast<std::size_t>(n) * guard_count_; };
    system_.affine_guards(0, t0_, h_, {term(0), size_}, d, {row(0), guard_count_});
    for (int n = 1; n <= order_; ++n) {
        if (!pattern_) {
            system_.affine_guards(n, t0_, h_, {term(n), size_}, d, {row(n), guard_count_});
            continue;
        }
        for (std::size_t guard = 0; guard < guard_count_; ++guard) {
            double g = 0;
            for (std::size_t i = 0; i < size_; ++i) g += pattern_->g[guard * size_ + i] * term(n)[i];
            row(n)[guard] = g;
        }
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
    ++counts_.steps;
    begin(whole);
    const Prepared* prepared = prepared_for(whole);
    if (prepared && leap(*prepared)) {
        state_->t = t_stop;
        return Progress::stopped;
    }
    double h = whole;
    while (!expand(h)) {
        h /= 2;
        if (h > 1e-9 * whole) continue;
        failure_ = {RunEnd::non_finite, state_->t,
                    fmt::format("the state is not finite near t = {:.9g} s: the loop may be unstable", state_->t)};
        return Progress::failed;
    }
    const double s = first_fall();
    if (s != none) {
        evaluate(s, state_->x);
        state_->t = s == 1 && h == whole ? t_stop : t0_ + s * h;
        return Progress::guard_fell;
    }
    evaluate(1, state_->x);
    state_->t = h == whole ? t_stop : t0_ + h;
    if (h != whole) return Progress::stepped;
    if (!prepared) remember(whole);
    return Progress::stopped;
}

void ExactIntegrator::interpolate(double t, std::span<double> x) {
    // A leap left no series; it converges, because Psi was made of the same terms.
    if (order_ == 0) expand(h_);
    evaluate((t - t0_) / h_, x);
}

} // namespace tribode
