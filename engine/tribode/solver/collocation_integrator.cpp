#include "tribode/solver/collocation_integrator.hpp"
#include "tribode/base/error.hpp"
#include "tribode/solver/exact_integrator.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace tribode {

namespace {

constexpr double half_ulp = 0x1p-54; // relative
constexpr double none = 2;           // no fall in [0, 1]
constexpr std::size_t block_size = 8;

// Besides s = 0. Quadrature at these nodes is of order 6, so that the step gains over the cubics.
const double inner = 1 / std::sqrt(5.0);
const std::array<double, 3> node = {(1 - inner) / 2, (1 + inner) / 2, 1};

// Coefficients of s, s^2, s^3 of the cubics that are one at one node and zero at the others and at s = 0.
using Basis = std::array<std::array<double, 4>, 3>;
const Basis basis = [] {
    Basis made{};
    for (std::size_t l = 0; l < 3; ++l) {
        const double a = node[(l + 1) % 3], b = node[(l + 2) % 3];
        const double scale = 1 / (node[l] * (node[l] - a) * (node[l] - b));
        made[l] = {0, scale * a * b, -scale * (a + b), scale};
    }
    return made;
}();
// |w - w0| within the step over its largest value at the nodes: the sum of the |L_l(s)| stays below.
constexpr double largest_between = 1.7;
// |x^3 less the parabola through three of the nodes| on [0, 1], of which the effect on x(1) is at most this.
constexpr double cubic_remainder = 0.05;

using Block = double __attribute__((vector_size(64), aligned(8), may_alias));
const Block& block(const double* at) { return *reinterpret_cast<const Block*>(at); }
Block& block(double* at) { return *reinterpret_cast<Block*>(at); }

// sum = start + matrix x
template <std::size_t Fixed>
[[gnu::always_inline]] inline void add_product(const double* start, const double* matrix, std::size_t columns,
                                               std::size_t any_height, const double* x, double* sum) {
    const std::size_t height = Fixed ? Fixed : any_height;
    for (std::size_t row = 0; row < height; row += block_size) {
        Block even = block(start + row), odd{};
        std::size_t j = 0;
        for (; j + 1 < columns; j += 2) {
            even += block(matrix + j * height + row) * x[j];
            odd += block(matrix + (j + 1) * height + row) * x[j + 1];
        }
        if (j < columns) even += block(matrix + j * height + row) * x[j];
        block(sum + row) = even + odd;
    }
}

[[gnu::target_clones("avx512f", "avx2", "default")]] void add_columns(const double* start, const double* matrix,
                                                                      std::size_t columns, std::size_t height,
                                                                      const double* x, double* sum) {
    if (height == 8) return add_product<8>(start, matrix, columns, 8, x, sum);
    add_product<0>(start, matrix, columns, height, x, sum);
}

double dot(const std::vector<double>& row, const double* x) {
    double sum = 0;
    for (std::size_t i = 0; i < row.size(); ++i) sum += row[i] * x[i];
    return sum;
}

} // namespace

CollocationIntegrator::CollocationIntegrator(const HybridSystem& system, const SolverOptions& options)
    : system_(system),
      size_(system.states().size()),
      height_((size_ + block_size - 1) / block_size * block_size),
      guard_count_(system.guard_count()),
      forcing_count_(system.forcing_count()),
      relative_tolerance_(options.relative_tolerance),
      longest_(std::numeric_limits<double>::infinity()),
      terms_((max_terms + 1) * height_),
      slope_(height_),
      w0_(forcing_count_),
      w_(forcing_count_),
      dw_(nodes * forcing_count_),
      before_(nodes * forcing_count_),
      cubics_(forcing_count_),
      work_(height_),
      largest_(height_),
      tolerance_(height_),
      guards0_(guard_count_),
      guard_terms_((max_terms + 1) * guard_count_),
      polynomial_(max_terms + 1) {
    if (const auto reason = system.why_not_nearly_affine()) {
        throw InputError(fmt::format("solver \"collocation\" cannot be used: {}; choose erk, adams or cvode", *reason));
    }
    for (const auto& state : system.states()) absolute_tolerance_.push_back(options.absolute_tolerance * state.scale);
    for (auto& x : free_) x.resize(height_);
    for (auto& x : at_) x.resize(height_);
}

void CollocationIntegrator::restart(SystemState& state) {
    state_ = &state;
    varies_ = !system_.affine_pattern(*state.discrete);
    const AffinePattern key = system_.forced_pattern(*state.discrete);
    if (pattern_ && key == key_) return;
    key_ = key;
    auto known = patterns_.find(key_);
    if (known == patterns_.end()) {
        // Patterns that never come again must not fill the memory.
        if (patterns_.size() == max_patterns) patterns_.clear();
        known = patterns_.emplace(key_, make_pattern()).first;
    }
    pattern_ = &known->second;
}

// A and G column by column, as the images of the unit vectors: at a time without end no input is left that varies.
CollocationIntegrator::Pattern CollocationIntegrator::make_pattern() const {
    Pattern pattern;
    const DiscreteState& d = *state_->discrete;
    std::vector<double> unit(size_), column(size_), guard_column(guard_count_);
    pattern.a.resize(size_ * height_);
    pattern.g.assign(guard_count_, std::vector<double>(size_));
    // A coefficient beyond those of any input.
    constexpr int far = max_terms;
    for (std::size_t j = 0; j < size_; ++j) {
        unit[j] = 1;
        system_.affine_derivative(far, 0, 1, unit, d, {pattern.a.data() + j * height_, size_});
        system_.affine_guards(far, 0, 1, unit, d, guard_column);
        for (std::size_t guard = 0; guard < guard_count_; ++guard) pattern.g[guard][j] = guard_column[guard];
        unit[j] = 0;
    }
    std::vector<double> b(size_ * forcing_count_);
    pattern.c.resize(guard_count_ * forcing_count_);
    if (forcing_count_ > 0) system_.forcing_columns(d, b, pattern.c);
    pattern.b.resize(height_ * forcing_count_);
    pattern.size.resize(2 * height_ * forcing_count_);
    const auto present = [](double value) { return value != 0; };
    pattern.forced =
        std::any_of(b.begin(), b.end(), present) || std::any_of(pattern.c.begin(), pattern.c.end(), present);
    const Columns zero(height_);
    for (std::size_t j = 0; j < forcing_count_; ++j) {
        double* own = pattern.b.data() + j * height_;
        double* size = pattern.size.data() + 2 * j * height_;
        std::copy_n(b.data() + j * size_, size_, own);
        add_columns(zero.data(), pattern.a.data(), size_, height_, own, size + height_);
        for (std::size_t i = 0; i < height_; ++i) {
            size[i] = std::abs(own[i]);
            size[height_ + i] = std::abs(size[height_ + i]);
        }
    }
    return pattern;
}

// The responses of x at the nodes to f and to the values of w, by their series.
void CollocationIntegrator::prepare(double h) {
    const Columns x0(term(0), term(0) + height_), slope = slope_;
    const std::vector<Cubic> cubics = cubics_;
    Prepared made{h, {}, {}, {}};
    made.reach.resize(guard_count_);
    for (auto& psi : made.psi) psi.resize(size_ * height_);
    for (auto& response : made.response) response.resize(forcing_count_ * nodes * height_);
    for (std::size_t guard = 0; guard < guard_count_; ++guard) {
        Reach& reach = made.reach[guard];
        reach.first.resize(size_);
        reach.second.resize(size_);
        reach.rest.resize(size_);
        reach.forced.resize(forcing_count_);
        const auto present = [](double value) { return value != 0; };
        reach.moves = std::any_of(pattern_->g[guard].begin(), pattern_->g[guard].end(), present);
        for (std::size_t j = 0; j < forcing_count_; ++j) {
            reach.moves = reach.moves || pattern_->c[j * guard_count_ + guard] != 0;
        }
    }
    bool ends = true;
    std::fill_n(term(0), height_, 0.0);
    for (auto& cubic : cubics_) cubic = {};
    std::fill(slope_.begin(), slope_.end(), 0.0);
    for (std::size_t j = 0; j < size_ && ends; ++j) {
        slope_[j] = 1;
        ends = expand(h);
        slope_[j] = 0;
        for (std::size_t k = 0; k < nodes; ++k) evaluate(node[k], made.psi[k].data() + j * height_);
        for (std::size_t guard = 0; guard < guard_count_; ++guard) {
            Reach& reach = made.reach[guard];
            reach.first[j] = dot(pattern_->g[guard], term(1));
            reach.second[j] = dot(pattern_->g[guard], term(2));
            for (int n = 3; n <= order_; ++n) reach.rest[j] += std::abs(dot(pattern_->g[guard], term(n)));
        }
    }
    for (std::size_t j = 0; j < forcing_count_ && ends; ++j) {
        slope_.assign(pattern_->b.begin() + static_cast<std::ptrdiff_t>(j * height_),
                      pattern_->b.begin() + static_cast<std::ptrdiff_t>((j + 1) * height_));
        ends = expand(h);
        for (std::size_t guard = 0; guard < guard_count_; ++guard) {
            double& forced = made.reach[guard].forced[j];
            forced = std::abs(pattern_->c[j * guard_count_ + guard]);
            for (int n = 1; n <= order_; ++n) forced += std::abs(dot(pattern_->g[guard], term(n)));
        }
        std::fill(slope_.begin(), slope_.end(), 0.0);
        for (std::size_t l = 0; l < nodes && ends; ++l) {
            cubics_[j] = basis[l];
            ends = expand(h);
            for (std::size_t k = 0; k < nodes; ++k) {
                evaluate(node[k], made.response[k].data() + (j * nodes + l) * height_);
            }
        }
        cubics_[j] = {};
    }
    if (!ends) made.psi[0].clear();
    pattern_->prepared.push_back(std::move(made));
    std::copy(x0.begin(), x0.end(), term(0));
    slope_ = slope;
    cubics_ = cubics;
    order_ = 0;
}

// Sample instants are rounded, so equal lengths differ by that much.
bool CollocationIntegrator::same_length(double a, double b) const {
    return std::abs(a - b) <= 0x1p-51 * (std::abs(state_->t) + std::abs(a));
}

const CollocationIntegrator::Prepared* CollocationIntegrator::prepared_for(double h) const {
    if (varies_) return nullptr;
    for (const auto& prepared : pattern_->prepared) {
        if (same_length(prepared.h, h)) return &prepared;
    }
    return nullptr;
}

// Whether steps of this length come again: those from sample to sample do, those between events do not.
bool CollocationIntegrator::is_regular(double h) {
    const auto same = [&](double length) { return same_length(length, h); };
    if (std::any_of(regular_.begin(), regular_.end(), same)) return true;
    if (regular_.size() == max_regular) return false;
    if (std::any_of(recent_.begin(), recent_.end(), same)) {
        regular_.push_back(h);
        return true;
    }
    if (recent_.size() < most_recent) {
        recent_.push_back(h);
    } else {
        recent_[next_recent_++ % most_recent] = h;
    }
    return false;
}

// Of an interval in 1, 2, 4, ... equal pieces, so that their lengths come again, that of the next piece.
double CollocationIntegrator::first_length(double t_stop) {
    const double whole = t_stop - t0_ + lag_;
    if (piece_end_ != t_stop || piece_ > longest_) {
        piece_ = whole;
        while (piece_ > longest_ * (1 + 1e-9)) piece_ /= 2;
        piece_end_ = t_stop;
    }
    return whole < 1.5 * piece_ ? whole : piece_;
}

void CollocationIntegrator::fit_cubics() {
    for (std::size_t j = 0; j < forcing_count_; ++j) {
        for (std::size_t n = 1; n <= nodes; ++n) {
            double sum = 0;
            for (std::size_t l = 0; l < nodes; ++l) sum += basis[l][n] * dw_[j * nodes + l];
            cubics_[j][n] = sum;
        }
    }
}

// Finds the values of w at the nodes of a step h, and x there. error: that of x(1) over the tolerance. False where they
// do not settle.
bool CollocationIntegrator::settle(double h, const Prepared* prepared, double& error) {
    h_ = h;
    order_ = 0;
    error = 0;
    std::fill(dw_.begin(), dw_.end(), 0.0);
    for (auto& cubic : cubics_) cubic = {};
    const auto by_series = [&] {
        if (!expand(h)) return false;
        for (std::size_t k = 0; k < nodes; ++k) evaluate(node[k], at_[k].data());
        return true;
    };
    if (prepared) {
        for (std::size_t k = 0; k < nodes; ++k) {
            add_columns(term(0), prepared->psi[k].data(), size_, height_, slope_.data(), free_[k].data());
        }
        at_ = free_;
    } else if (!by_series()) {
        return false;
    }
    if (!pattern_->forced) return true;

    double last_change = 0;
    for (int round = 0; round < max_rounds; ++round) {
        before_.swap(dw_);
        double change = 0, bend = 0; // effect on x(1) over the tolerance
        for (std::size_t k = 0; k < nodes; ++k) {
            system_.forcing(t0_ + node[k] * h, {at_[k].data(), size_}, *state_->discrete, w_);
            for (std::size_t j = 0; j < forcing_count_; ++j) dw_[j * nodes + k] = w_[j] - w0_[j];
        }
        counts_.derivative_evaluations += nodes;
        for (std::size_t j = 0; j < forcing_count_; ++j) {
            double largest = 0, third = 0;
            for (std::size_t l = 0; l < nodes; ++l) {
                largest = std::max(largest, std::abs(dw_[j * nodes + l] - before_[j * nodes + l]));
                third += basis[l][3] * dw_[j * nodes + l];
            }
            // A step that is left without a number must fail, and std::max would lose it.
            if (!std::isfinite(third)) return false;
            double gain = 0;
            const double* size = pattern_->size.data() + 2 * j * height_;
            for (std::size_t i = 0; i < size_; ++i) {
                gain = std::max(gain, h * (size[i] + 0.5 * h * size[height_ + i]) * tolerance_[i]);
            }
            change = std::max(change, gain * largest);
            bend = std::max(bend, gain * cubic_remainder * std::abs(third));
        }
        if (prepared) {
            for (std::size_t k = 0; k < nodes; ++k) {
                add_columns(free_[k].data(), prepared->response[k].data(), nodes * forcing_count_, height_, dw_.data(),
                            at_[k].data());
            }
        } else {
            fit_cubics();
            if (!by_series()) return false;
        }
        // Of a change, as much is left after the next round as this one left of the last.
        const double ratio = round > 0 ? change / last_change : 1;
        const double left = change <= 1e-3 ? change : round > 0 ? change * ratio / std::max(1 - ratio, 0.1) : change;
        error = std::max(left, bend);
        if (h > 1e-9) {
            if (bend > 1) return false;
            if (round > 1 && ratio > 0.5 && left > 1) return false;
        }
        if (left <= 1) return true;
        last_change = change;
    }
    return h <= 1e-9;
}

// Whether no guard can fall in the step; else its series will tell.
bool CollocationIntegrator::clear_of_guards(const Prepared& prepared) const {
    for (GuardId guard = 0; guard < guard_count_; ++guard) {
        const Reach& reach = prepared.reach[guard];
        if (!reach.moves) continue;
        double first = 0, second = 0, rest = 0;
        for (std::size_t i = 0; i < size_; ++i) {
            first += reach.first[i] * slope_[i];
            second += reach.second[i] * slope_[i];
            rest += reach.rest[i] * std::abs(slope_[i]);
        }
        for (std::size_t j = 0; j < forcing_count_; ++j) {
            double largest = 0;
            for (std::size_t l = 0; l < nodes; ++l) largest = std::max(largest, std::abs(dw_[j * nodes + l]));
            rest += reach.forced[j] * largest * largest_between;
        }
        const double least = guards0_[guard] + std::min(0.0, first + std::min(0.0, second)) - rest;
        const double margin = 1e-12 * (std::abs(first) + std::abs(second) + rest);
        if (!(least > margin)) return false;
    }
    return true;
}

// Fills terms_ for a step h from term(0), slope_ and the cubics; false where they do not come to an end.
bool CollocationIntegrator::expand(double h) {
    for (std::size_t i = 0; i < height_; ++i) {
        term(1)[i] = h * slope_[i];
        largest_[i] = std::max(std::abs(term(0)[i]), std::abs(term(1)[i]));
    }
    const Columns& zero = work_;
    std::fill(work_.begin(), work_.end(), 0.0);
    bool last_was_small = false;
    for (int n = 1; n < max_terms; ++n) {
        double* next = term(n + 1);
        if (varies_) {
            system_.affine_derivative(n, t0_, h, {term(n), size_}, *state_->discrete, {next, size_});
        } else {
            add_columns(zero.data(), pattern_->a.data(), size_, height_, term(n), next);
        }
        if (n <= static_cast<int>(nodes)) {
            for (std::size_t j = 0; j < forcing_count_; ++j) {
                const double* b = pattern_->b.data() + j * height_;
                for (std::size_t i = 0; i < size_; ++i) next[i] += b[i] * cubics_[j][static_cast<std::size_t>(n)];
            }
        }
        bool small = true;
        for (std::size_t i = 0; i < height_; ++i) {
            next[i] *= h / (n + 1);
            const double size = std::abs(next[i]);
            largest_[i] = std::max(largest_[i], size);
            small = small && size <= half_ulp * largest_[i];
        }
        if (small && last_was_small && n > 5) {
            order_ = n + 1;
            return std::all_of(next, next + size_, [](double c) { return std::isfinite(c); });
        }
        last_was_small = small;
    }
    return false;
}

// The earliest fall of a guard within the step; which ones fall there goes to crossed_.
double CollocationIntegrator::first_crossing() {
    const auto row = [&](int n) { return guard_terms_.data() + static_cast<std::size_t>(n) * guard_count_; };
    for (int n = 1; n <= order_ && varies_; ++n) {
        system_.affine_guards(n, t0_, h_, {term(n), size_}, *state_->discrete, {row(n), guard_count_});
    }
    crossed_.clear();
    double first = none;
    for (GuardId guard = 0; guard < guard_count_; ++guard) {
        polynomial_[0] = guards0_[guard];
        for (int n = 1; n <= order_; ++n) {
            double g = varies_ ? row(n)[guard] : dot(pattern_->g[guard], term(n));
            if (n <= static_cast<int>(nodes)) {
                for (std::size_t j = 0; j < forcing_count_; ++j) {
                    g += pattern_->c[j * guard_count_ + guard] * cubics_[j][static_cast<std::size_t>(n)];
                }
            }
            polynomial_[static_cast<std::size_t>(n)] = g;
        }
        const double s = first_crossing_below_zero({polynomial_.data(), static_cast<std::size_t>(order_) + 1});
        if (s == none || s > first) continue;
        if (s < first) crossed_.clear();
        first = s;
        crossed_.push_back(guard);
    }
    return first;
}

// sum c_n s^n
void CollocationIntegrator::evaluate(double s, double* x) const {
    for (std::size_t i = 0; i < height_; ++i) {
        double sum = term(order_)[i];
        for (int n = order_; n-- > 0;) sum = sum * s + term(n)[i];
        x[i] = sum;
    }
}

Integrator::Progress CollocationIntegrator::step(double t_stop) {
    t0_ = state_->t;
    lag_ = behind_;
    auto& x = state_->x;
    const DiscreteState& d = *state_->discrete;
    const double whole = t_stop - t0_ + lag_;
    std::copy(x.begin(), x.end(), term(0));
    system_.derivative(t0_, x, d, {slope_.data(), size_});
    system_.guards(t0_, x, d, guards0_);
    if (forcing_count_ > 0) system_.forcing(t0_, x, d, w0_);
    for (std::size_t i = 0; i < size_; ++i) {
        tolerance_[i] = 1 / (absolute_tolerance_[i] + relative_tolerance_ * std::abs(x[i]));
    }
    ++counts_.derivative_evaluations;
    ++counts_.guard_evaluations;
    ++counts_.steps;

    double h = first_length(t_stop), error = 0;
    const Prepared* prepared = nullptr;
    for (;;) {
        prepared = prepared_for(h);
        const Prepared* usable = prepared && !prepared->psi[0].empty() ? prepared : nullptr;
        if (settle(h, usable, error)) {
            prepared = usable;
            break;
        }
        ++counts_.rejected_steps;
        h /= 2;
        longest_ = piece_ = h;
        piece_end_ = t_stop;
        if (h > 1e-15 * std::max(1.0, t0_) && h > 1e-12 * whole) continue;
        failure_ = {RunEnd::non_finite, t0_,
                    fmt::format("the state is not finite near t = {:.9g} s: the loop may be unstable", t0_)};
        return Progress::failed;
    }
    // The estimates go with the fourth power of h.
    if (error < 1.0 / 40 && h >= 0.99 * longest_) longest_ = 2 * h;
    const bool whole_way = h == whole;

    fit_cubics();
    if (!(prepared && clear_of_guards(*prepared))) {
        if (order_ == 0 && !expand(h)) order_ = 0; // cannot be: the response was made of the same terms
        const double s = first_crossing();
        if (s != none) {
            evaluate(s, work_.data());
            std::copy_n(work_.begin(), size_, x.begin());
            const double span = s * h - lag_;
            state_->t = t0_ + std::max(span, 0.0);
            behind_ = std::max(-span, 0.0);
            if (s == 1 && whole_way) state_->t = t_stop;
            return Progress::crossing;
        }
    }
    std::copy_n(at_[nodes - 1].begin(), size_, x.begin());
    if (!std::all_of(x.begin(), x.end(), [](double value) { return std::isfinite(value); })) {
        std::copy_n(term(0), size_, x.begin());
        failure_ = {RunEnd::non_finite, t0_,
                    fmt::format("the state is not finite near t = {:.9g} s: the loop may be unstable", t0_)};
        return Progress::failed;
    }
    if (!prepared_for(h) && !varies_ && is_regular(h) && ++pattern_->series > 1) prepare(h);
    if (!whole_way) {
        const double span = h - lag_;
        state_->t = t0_ + std::max(span, 0.0);
        behind_ = std::max(-span, 0.0);
        return Progress::stepped;
    }
    state_->t = t_stop;
    behind_ = prepared ? whole - prepared->h : 0;
    return Progress::stopped;
}

void CollocationIntegrator::interpolate(double t, std::span<double> x) {
    // A prepared step left no series; it converges, because the response was made of the same terms.
    if (order_ == 0) expand(h_);
    evaluate((t - t0_ + lag_) / h_, work_.data());
    std::copy_n(work_.begin(), size_, x.begin());
}

} // namespace tribode
