#include "tribode/solver/collocation_integrator.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace tribode {

namespace {

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
// Change of x(1) in a round over the tolerance, at its end alone, below which the round is left out.
constexpr double unchanged = 0.02;

double dot(const std::vector<double>& row, const double* x) {
    double sum = 0;
    for (std::size_t i = 0; i < row.size(); ++i) sum += row[i] * x[i];
    return sum;
}

} // namespace

const HybridSystem& CollocationIntegrator::checked(const HybridSystem& system) {
    const auto reason = why_not_nearly_affine(system);
    if (!reason) return system;
    throw InputError(fmt::format("solver \"collocation\" cannot be used: {}; choose erk, adams or bdf", *reason));
}

CollocationIntegrator::CollocationIntegrator(const HybridSystem& system, const SolverOptions& options)
    : SeriesIntegrator(checked(system), 12),
      forcing_count_(affine_.forcing_count()),
      relative_tolerance_(options.relative_tolerance),
      longest_(std::numeric_limits<double>::infinity()),
      slope_(height_),
      w0_(forcing_count_),
      w_(forcing_count_),
      dw_(nodes * forcing_count_),
      before_(nodes * forcing_count_),
      cubics_(forcing_count_),
      work_(height_),
      largest_(height_),
      tolerance_(height_) {
    for (const auto& state : system.states()) absolute_tolerance_.push_back(options.absolute_tolerance * state.scale);
    for (auto& x : free_) x.resize(height_);
    for (auto& x : at_) x.resize(height_);
}

void CollocationIntegrator::restart(SystemState& state) {
    state_ = &state;
    varies_ = affine_.has_varying_input(*state.discrete);
    const bool is_new = is_new_pattern(*state.discrete);
    if (pattern_ && !is_new) return;
    pattern_ = &patterns_.find(key_, [this](ForcedPattern& pattern) { pattern = make_pattern(); });
}

CollocationIntegrator::ForcedPattern CollocationIntegrator::make_pattern() const {
    ForcedPattern pattern;
    const AffineForm form = affine_.affine_form(*state_->discrete);
    pattern.a.resize(size_ * height_);
    pattern.g.assign(guard_count_, std::vector<double>(size_));
    for (std::size_t j = 0; j < size_; ++j) {
        std::copy_n(form.a.data() + j * size_, size_, pattern.a.data() + j * height_);
        for (std::size_t guard = 0; guard < guard_count_; ++guard) {
            pattern.g[guard][j] = form.g[j * guard_count_ + guard];
        }
    }
    pattern.c = form.c;
    pattern.b.resize(height_ * forcing_count_);
    pattern.size.resize(2 * height_ * forcing_count_);
    const auto present = [](double value) { return value != 0; };
    pattern.forced =
        std::any_of(form.b.begin(), form.b.end(), present) || std::any_of(pattern.c.begin(), pattern.c.end(), present);
    const Columns zero(height_);
    for (std::size_t j = 0; j < forcing_count_; ++j) {
        double* own = pattern.b.data() + j * height_;
        double* size = pattern.size.data() + 2 * j * height_;
        std::copy_n(form.b.data() + j * size_, size_, own);
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

// Of an interval in 1, 2, 4, ... equal pieces, so that their lengths come again, that of the next piece.
double CollocationIntegrator::first_length(double whole, double t_stop) {
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

    // Of an error of w j, its effect on x(1) over the tolerance.
    const auto gain_of = [&](std::size_t j) {
        double gain = 0;
        const double* size = pattern_->size.data() + 2 * j * height_;
        for (std::size_t i = 0; i < size_; ++i) {
            gain = std::max(gain, h * (size[i] + 0.5 * h * size[height_ + i]) * tolerance_[i]);
        }
        return gain;
    };
    double last_change = 0;
    for (int round = 0; round < max_rounds; ++round) {
        before_.swap(dw_);
        double change = 0, bend = 0; // effect on x(1) over the tolerance
        for (std::size_t k = 0; k < nodes; ++k) {
            affine_.forcing(t0_ + node[k] * h, {at_[k].data(), size_}, *state_->discrete, w_);
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
            const double gain = gain_of(j);
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
        if (round == 0) {
            // Mostly the next round would change next to nothing: its value where x has moved farthest tells.
            affine_.forcing(t0_ + h, {at_[nodes - 1].data(), size_}, *state_->discrete, w_);
            ++counts_.derivative_evaluations;
            double rest = 0;
            for (std::size_t j = 0; j < forcing_count_; ++j) {
                rest += gain_of(j) * std::abs(w_[j] - w0_[j] - dw_[j * nodes + nodes - 1]);
            }
            error = std::max(rest, bend);
            if (rest <= unchanged) return true; // never where one of w is no number
        }
        last_change = change;
    }
    return h <= 1e-9;
}

// Whether no guard can cross zero in the step; else its series will tell.
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
        if (!stays_positive(guard_terms_[guard], first, second, rest)) return false;
    }
    return true;
}

// Fills terms_ for a step h from term(0), slope_ and the cubics; false where they do not come to an end.
bool CollocationIntegrator::expand(double h) {
    for (std::size_t i = 0; i < height_; ++i) term(1)[i] = h * slope_[i];
    std::fill(largest_.begin(), largest_.end(), 0.0);
    std::fill(work_.begin(), work_.end(), 0.0);
    const Columns& zero = work_;
    return add_terms(h, largest_, [&](int n) {
        double* next = term(n + 1);
        if (varies_) {
            affine_.rate_coefficient(n, t0_, h, {term(n), size_}, *state_->discrete, {next, size_});
        } else {
            add_columns(zero.data(), pattern_->a.data(), size_, height_, term(n), next);
        }
        if (n > static_cast<int>(nodes)) return;
        for (std::size_t j = 0; j < forcing_count_; ++j) {
            const double* b = pattern_->b.data() + j * height_;
            for (std::size_t i = 0; i < size_; ++i) next[i] += b[i] * cubics_[j][static_cast<std::size_t>(n)];
        }
    });
}

double CollocationIntegrator::find_crossing() {
    if (varies_) find_guard_terms();
    return first_crossing([&](GuardId guard) -> std::optional<std::size_t> {
        const auto last = static_cast<std::size_t>(order_);
        polynomial_[0] = guard_terms_[guard];
        for (std::size_t n = 1; n <= last; ++n) {
            double g = varies_ ? guard_term(n)[guard] : dot(pattern_->g[guard], term(static_cast<int>(n)));
            if (n <= nodes) {
                for (std::size_t j = 0; j < forcing_count_; ++j) {
                    g += pattern_->c[j * guard_count_ + guard] * cubics_[j][n];
                }
            }
            polynomial_[n] = g;
        }
        return last;
    });
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
    const double whole = begin(t_stop);
    auto& x = state_->x;
    const DiscreteState& d = *state_->discrete;
    system_.derivative(t0_, x, d, {slope_.data(), size_});
    system_.guards(t0_, x, d, {guard_term(0), guard_count_});
    if (forcing_count_ > 0) affine_.forcing(t0_, x, d, w0_);
    for (std::size_t i = 0; i < size_; ++i) {
        tolerance_[i] = 1 / (absolute_tolerance_[i] + relative_tolerance_ * std::abs(x[i]));
    }
    ++counts_.derivative_evaluations;
    ++counts_.guard_evaluations;
    ++counts_.steps;

    double h = first_length(whole, t_stop), error = 0;
    const Prepared* prepared = nullptr;
    for (;;) {
        prepared = prepared_for_length(h);
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
        return fail(std::nullopt);
    }
    // The estimates go with the fourth power of h.
    if (error < 1.0 / 40 && h >= 0.99 * longest_) longest_ = 2 * h;

    fit_cubics();
    if (!(prepared && clear_of_guards(*prepared))) {
        if (order_ == 0 && !expand(h)) order_ = 0; // cannot be: the response was made of the same terms
        const double s = find_crossing();
        if (s != no_crossing) {
            evaluate(s, work_.data());
            std::copy_n(work_.begin(), size_, x.begin());
            return cross(s, h, whole, t_stop);
        }
    }
    std::copy_n(at_[nodes - 1].begin(), size_, x.begin());
    if (!std::all_of(x.begin(), x.end(), [](double value) { return std::isfinite(value); })) {
        std::copy_n(term(0), size_, x.begin());
        return fail(std::nullopt);
    }
    const double behind = prepared ? whole - prepared->h : 0;
    if (!varies_ && !prepared_for_length(h) && is_worth_preparing(*pattern_, h)) prepare(h);
    return stop(h, whole, t_stop, behind);
}

void CollocationIntegrator::interpolate(double t, std::span<double> x) {
    // A prepared step left no series; it converges, because the response was made of the same terms.
    if (order_ == 0) expand(h_);
    evaluate((t - t0_ + lag_) / h_, work_.data());
    std::copy_n(work_.begin(), size_, x.begin());
}

} // namespace tribode
