#include "tribode/solver/exact_integrator.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace tribode {

namespace {

constexpr double half_ulp = 0x1p-54; // relative
constexpr double none = no_fall;

// The work of the integrator, on columns of `height` numbers, a multiple of eight, in blocks of eight. Without fused
// operations the results are the same bits whichever instructions the processor has. With a size known (Fixed > 0) the
// loops unroll and matrices stay in registers. Matrices have a column of zeros for each number that pads a column.
using Block __attribute__((vector_size(64), aligned(8), may_alias)) = double;
using Bits = long long __attribute__((vector_size(64)));
constexpr std::size_t block_size = 8;
constexpr long long not_sign = std::numeric_limits<long long>::max(); // all bits of a number but that of its sign

const Block& block(const double* at) { return *reinterpret_cast<const Block*>(at); }
Block& block(double* at) { return *reinterpret_cast<Block*>(at); }

// product = factor matrix x; four columns at a time, which do not wait for one another.
template <std::size_t FixedHeight, std::size_t FixedColumns>
[[gnu::always_inline]] inline void multiply(const double* matrix, std::size_t any_height, std::size_t any_columns,
                                            const double* x, double factor, double* product) {
    const std::size_t height = FixedHeight ? FixedHeight : any_height;
    const std::size_t columns = FixedColumns ? FixedColumns : any_columns; // a multiple of four
    for (std::size_t row = 0; row < height; row += block_size) {
        const auto column = [&](std::size_t j) -> const Block& { return block(matrix + j * height + row); };
        Block a = column(0) * x[0], b = column(1) * x[1], c = column(2) * x[2], d = column(3) * x[3];
        for (std::size_t j = 4; j < columns; j += 4) {
            a += column(j) * x[j];
            b += column(j + 1) * x[j + 1];
            c += column(j + 2) * x[j + 2];
            d += column(j + 3) * x[j + 3];
        }
        block(product + row) = ((a + b) + (c + d)) * factor;
    }
}

// 1/((n+1)(n+2))
constexpr auto reciprocals = [] {
    std::array<double, max_polynomial_terms> values{};
    for (std::size_t n = 0; n < values.size(); ++n) values[n] = 1 / static_cast<double>((n + 1) * (n + 2));
    return values;
}();

// From c_0 and c_1 on, c_{n+1} = h/(n+1) A c_n, until two terms in a row are below half a unit in the last place of
// the largest, as a rule one of the first five, `least` at least. Returns the last n, or 0 where max_terms, an even
// number, do not do. Even and odd terms go each their own way by the square of A, c_{n+2} = h^2/((n+1)(n+2)) A^2 c_n: two
// chains that do not wait for one another. Where nothing is left of two terms but an eigenvector of A, of eigenvalue
// `rate`, numbers take its place.
template <std::size_t Fixed>
[[gnu::always_inline]] inline int expand(const double* a, const double* square, double rate, const double* least,
                                         std::size_t states, std::size_t any_height, double h, int max_terms,
                                         double* terms, double* limit) {
    const std::size_t height = Fixed ? Fixed : any_height;
    const auto term = [&](int n) { return terms + static_cast<std::size_t>(n) * height; };
    const auto scale = [&](int from, double factor, int to) {
        for (std::size_t row = 0; row < height; row += block_size) {
            block(term(to) + row) = block(term(from) + row) * factor;
        }
    };
    // From the last state on: the amplifier's, where there is one, which is slow to end.
    const auto small = [&](int n) {
        std::size_t state = states;
        while (state > 0 && std::abs(term(n)[state - 1]) <= limit[state - 1]) --state;
        return state == 0;
    };
    const auto decays = [&](int n, double factor) {
        std::size_t state = 0;
        while (state < states && std::abs(term(n + 2)[state] - factor * term(n)[state]) <= limit[state]) ++state;
        return state == states;
    };
    const auto set_limits = [&](int last) {
        for (std::size_t row = 0; row < height; row += block_size) {
            Block largest = block(least + row);
            for (int n = 0; n <= last; ++n) {
                const Block size = (Block)((Bits)block(term(n) + row) & not_sign);
                largest = size > largest ? size : largest;
            }
            block(limit + row) = half_ulp * largest;
        }
    };
    multiply<Fixed, Fixed>(a, height, height, term(1), h / 2, term(2));
    bool only_decay = false;
    for (int n = 1; n + 3 <= max_terms; n += 2) {
        const double even = h * h * reciprocals[static_cast<std::size_t>(n)];
        const double odd = h * h * reciprocals[static_cast<std::size_t>(n) + 1];
        if (only_decay) {
            scale(n, rate * rate * even, n + 2);
            scale(n + 1, rate * rate * odd, n + 3);
        } else {
            multiply<Fixed, Fixed>(square, height, height, term(n), even, term(n + 2));
            multiply<Fixed, Fixed>(square, height, height, term(n + 1), odd, term(n + 3));
        }
        if (n == 1) {
            set_limits(n + 3);
            continue;
        }
        if (small(n + 2) && small(n + 3)) return n + 3;
        if (!only_decay && rate != 0) only_decay = decays(n, rate * rate * even) && decays(n + 1, rate * rate * odd);
    }
    // States at the end of a long chain have their largest terms later.
    set_limits(max_terms);
    return small(max_terms - 1) && small(max_terms) ? max_terms : 0;
}

// The sum of all terms, x at the step's end, and of the sizes of those after the first; small ones come first.
template <std::size_t Fixed>
[[gnu::always_inline]] inline void sum_up(const double* terms, int order, std::size_t any_height, double* end,
                                          double* travel) {
    const std::size_t height = Fixed ? Fixed : any_height;
    for (std::size_t row = 0; row < height; row += block_size) {
        const auto term = [&](int n) -> const Block& {
            return block(terms + static_cast<std::size_t>(n) * height + row);
        };
        Block even{}, odd{}, even_sizes{}, odd_sizes{};
        int n = order;
        if (n % 2 == 0) {
            even = term(n--);
            even_sizes = (Block)((Bits)even & not_sign);
        }
        for (; n > 1; n -= 2) {
            const Block a = term(n), b = term(n - 1);
            odd += a;
            even += b;
            odd_sizes += (Block)((Bits)a & not_sign);
            even_sizes += (Block)((Bits)b & not_sign);
        }
        const Block first = term(1);
        block(travel + row) = odd_sizes + even_sizes + (Block)((Bits)first & not_sign);
        block(end + row) = term(0) + (odd + even + first);
    }
}

// sum c_n s^n, even and odd powers apart
template <std::size_t Fixed>
[[gnu::always_inline]] inline void evaluate(const double* terms, int order, std::size_t any_height, double s,
                                            double* x) {
    const std::size_t height = Fixed ? Fixed : any_height;
    const double square = s * s;
    for (std::size_t row = 0; row < height; row += block_size) {
        const auto term = [&](int n) -> const Block& {
            return block(terms + static_cast<std::size_t>(n) * height + row);
        };
        Block even{}, odd{};
        int n = order;
        if (n % 2 == 0) even = term(n--);
        for (; n > 0; n -= 2) {
            odd = odd * square + term(n);
            even = even * square + term(n - 1);
        }
        block(x + row) = even + odd * s;
    }
}

[[gnu::target_clones("avx512f", "avx2", "default")]] void
multiply_columns(const double* matrix, std::size_t height, std::size_t columns, const double* x, double* product) {
    if (columns != 8) return multiply<0, 0>(matrix, height, columns, x, 1, product);
    switch (height) {
    case 8: return multiply<8, 8>(matrix, 8, 8, x, 1, product);
    case 16: return multiply<16, 8>(matrix, 16, 8, x, 1, product);
    default: return multiply<0, 8>(matrix, height, 8, x, 1, product);
    }
}

[[gnu::target_clones("avx512f", "avx2", "default")]] int
expand_columns(const double* a, const double* square, double rate, const double* least, std::size_t states,
               std::size_t height, double h, int max_terms, double* terms, double* limit) {
    switch (height) {
    case 8: return expand<8>(a, square, rate, least, states, 8, h, max_terms, terms, limit);
    default: return expand<0>(a, square, rate, least, states, height, h, max_terms, terms, limit);
    }
}

[[gnu::target_clones("avx512f", "avx2", "default")]] void sum_columns(const double* terms, int order,
                                                                      std::size_t height, double* end, double* travel) {
    switch (height) {
    case 8: return sum_up<8>(terms, order, 8, end, travel);
    default: return sum_up<0>(terms, order, height, end, travel);
    }
}

[[gnu::target_clones("avx512f", "avx2", "default")]] void evaluate_columns(const double* terms, int order,
                                                                           std::size_t height, double s, double* x) {
    switch (height) {
    case 8: return evaluate<8>(terms, order, 8, s, x);
    default: return evaluate<0>(terms, order, height, s, x);
    }
}

std::size_t padded(std::size_t size) { return (size + block_size - 1) / block_size * block_size; }

} // namespace

ExactIntegrator::ExactIntegrator(const HybridSystem& system)
    : system_(system),
      size_(system.states().size()),
      height_(padded(size_)),
      guard_count_(system.guard_count()),
      propagator_height_(height_ + padded(2 * guard_count_)),
      rest_height_(padded(guard_count_)),
      terms_((max_terms + 1) * height_),
      work_(height_),
      least_(height_),
      limit_(height_),
      end_(height_),
      travel_(height_),
      moved_(propagator_height_),
      speed_(height_),
      rest_(rest_height_),
      guard_terms_((max_terms + 1) * guard_count_),
      polynomial_(max_terms + 1) {
    if (const auto reason = system.why_not_affine()) {
        throw InputError(fmt::format("solver \"exact\" cannot be used: {}; choose erk, adams or cvode", *reason));
    }
    // At the end of a long chain a state has no term before many are taken. Sizes below this are not worth one.
    constexpr double least = 1e-25;
    std::transform(system.states().begin(), system.states().end(), least_.begin(),
                   [](const StateVariable& state) { return least * state.scale; });
}

void ExactIntegrator::restart(SystemState& state) {
    state_ = &state;
    const auto numbers = system_.affine_pattern(*state.discrete);
    if (!numbers) {
        pattern_ = nullptr;
        return;
    }
    const auto key = std::bit_cast<Key>(*numbers); // by bits each number is like itself, one that is none too
    if (pattern_ && key == key_) return;
    key_ = key;
    auto known = patterns_.find(key_);
    if (known == patterns_.end()) {
        if (patterns_.size() < max_patterns) {
            known = patterns_.try_emplace(key_).first;
            oldest_.push_back(key_);
        } else {
            // Patterns that never come again must not fill the memory, nor keep it busy: the oldest gives its place.
            Key& oldest = oldest_[replaced_++ % max_patterns];
            auto node = patterns_.extract(oldest);
            node.key() = oldest = key_;
            known = patterns_.insert(std::move(node)).position;
        }
        make_pattern(known->second);
    }
    pattern_ = &known->second;
}

std::size_t ExactIntegrator::Hash::operator()(const Key& key) const {
    std::uint64_t hash = 0;
    for (const std::uint64_t part : key) hash = 31 * hash + part;
    return hash;
}

// A and G column by column, as the images of the unit vectors.
void ExactIntegrator::make_pattern(Pattern& pattern) {
    pattern.a.assign(height_ * height_, 0.0);
    pattern.g.resize(guard_count_);
    for (auto& row : pattern.g) row.clear();
    pattern.prepared.clear();
    pattern.series = 0;
    const std::span<double> unit(work_.data(), size_), column(guard_terms_.data(), guard_count_);
    std::fill(unit.begin(), unit.end(), 0.0);
    for (std::size_t j = 0; j < size_; ++j) {
        unit[j] = 1;
        system_.affine_derivative(1, 0, 1, unit, *state_->discrete, {pattern.a.data() + j * height_, size_});
        system_.affine_guards(1, 0, 1, unit, *state_->discrete, column);
        for (std::size_t guard = 0; guard < guard_count_; ++guard) {
            if (column[guard] != 0) pattern.g[guard].push_back({j, column[guard]});
        }
        unit[j] = 0;
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
ExactIntegrator::Prepared ExactIntegrator::prepare(const Pattern& pattern, double h) const {
    Prepared made{h, Columns(height_ * propagator_height_), Columns(height_ * rest_height_)};
    Columns terms(terms_.size()), none(height_), limit(height_), end(height_), travel(height_); // the last step's stay
    for (std::size_t j = 0; j < size_; ++j) {
        std::fill_n(terms.begin() + static_cast<std::ptrdiff_t>(height_), height_, 0.0);
        terms[height_ + j] = h;
        const int order = expand_columns(pattern.a.data(), pattern.square.data(), pattern.decay, none.data(), size_,
                                         height_, h, max_terms, terms.data(), limit.data());
        // From rest any length comes to an end at once; from elsewhere this one does not.
        if (order == 0) {
            made.propagator.clear();
            return made;
        }
        double* column = made.propagator.data() + j * propagator_height_;
        sum_columns(terms.data(), order, height_, column, travel.data());
        for (std::size_t guard = 0; guard < guard_count_; ++guard) {
            const auto along = [&](int n) {
                double g = 0;
                for (const auto& [state, value] : pattern.g[guard]) {
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

// Sample instants are rounded, so equal lengths differ by that much.
bool ExactIntegrator::same_length(double a, double b) const {
    return std::abs(a - b) <= 0x1p-51 * (std::abs(state_->t) + std::abs(a));
}

const ExactIntegrator::Prepared* ExactIntegrator::prepared_for(double h) const {
    if (!pattern_) return nullptr;
    for (const auto& prepared : pattern_->prepared) {
        if (same_length(prepared.h, h)) return &prepared;
    }
    return nullptr;
}

// Whether steps of this length come again: those from sample to sample do, those between events do not.
bool ExactIntegrator::is_regular(double h) {
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

// A pattern that has met a regular length for the second time will meet it again: that pays for preparing.
void ExactIntegrator::learn(double h) {
    if (!pattern_ || !is_regular(h)) return;
    if (++pattern_->series > 1) pattern_->prepared.push_back(prepare(*pattern_, h));
}

// Where a step begins. Returns its whole length.
double ExactIntegrator::begin(double t_stop) {
    t0_ = state_->t;
    lag_ = behind_;
    h_ = t_stop - t0_ + lag_;
    order_ = 0;
    std::copy(state_->x.begin(), state_->x.end(), term(0));
    return h_;
}

// Where its series ends, x being that of t0_ + span: at a fall at once, time does not run back by the lag.
void ExactIntegrator::end(double span) {
    state_->t = t0_ + std::max(span, 0.0);
    behind_ = std::max(-span, 0.0);
}

// Goes over the whole step at once, if no guard can fall in it.
bool ExactIntegrator::propagate(const Prepared& prepared) {
    if (prepared.propagator.empty()) return false;
    auto& x = state_->x;
    const std::span<double> f(work_.data(), size_);
    system_.derivative(t0_, x, *state_->discrete, f);
    system_.guards(t0_, x, *state_->discrete, {guard_terms_.data(), guard_count_});
    ++counts_.derivative_evaluations;
    ++counts_.guard_evaluations;
    for (std::size_t i = 0; i < size_; ++i) speed_[i] = std::abs(f[i]);
    multiply_columns(prepared.propagator.data(), propagator_height_, height_, f.data(), moved_.data());
    multiply_columns(prepared.rest.data(), rest_height_, height_, speed_.data(), rest_.data());
    for (std::size_t guard = 0; guard < guard_count_; ++guard) {
        if (pattern_->g[guard].empty()) continue; // it does not move
        const double* row = moved_.data() + height_ + 2 * guard;
        const double first = row[0], second = row[1], rest = rest_[guard];
        // s and s^2 lie between 0 and 1, so the guard is at least this, up to rounding, which the margin covers.
        const double least = guard_terms_[guard] + std::min(0.0, first + std::min(0.0, second)) - rest;
        const double margin = 1e-12 * (std::abs(first) + std::abs(second) + rest);
        if (!(least > margin)) return false;
    }
    // A machine without guards that move would propagate on and on where its loop is unstable.
    for (std::size_t i = 0; i < size_; ++i) {
        if (!std::isfinite(x[i] + moved_[i])) return false;
    }
    for (std::size_t i = 0; i < size_; ++i) x[i] += moved_[i];
    return true;
}

// Fills terms_ for a step h from where it began; false where they do not come to an end.
bool ExactIntegrator::expand(double h) {
    h_ = h;
    const DiscreteState& d = *state_->discrete;
    const auto derive = [&](int n) { // c_{n+1} from c_n and b_n
        system_.affine_derivative(n, t0_, h, {term(n), size_}, d, {term(n + 1), size_});
        for (std::size_t i = 0; i < size_; ++i) term(n + 1)[i] *= h / (n + 1);
        ++counts_.derivative_evaluations;
    };
    derive(0);
    if (pattern_) {
        order_ = expand_columns(pattern_->a.data(), pattern_->square.data(), pattern_->decay, least_.data(), size_,
                                height_, h, max_terms, terms_.data(), limit_.data());
        // A comparison with what is not a number hides it; in the last term it still stands.
        return order_ > 0 && std::all_of(term(order_), term(order_) + size_, [](double c) { return std::isfinite(c); });
    }
    work_ = least_;
    bool last_was_small = false;
    for (int n = 1; n < max_terms; ++n) {
        derive(n);
        bool small = true;
        for (std::size_t i = 0; i < size_; ++i) {
            const double size = std::abs(term(n + 1)[i]);
            if (n == 1) work_[i] = std::max({work_[i], std::abs(term(0)[i]), std::abs(term(1)[i])});
            work_[i] = std::max(work_[i], size);
            small = small && size <= half_ulp * work_[i] && std::isfinite(size);
        }
        // b is a polynomial of degree 3 at most in what there is; its terms have all come by then.
        if (small && last_was_small && n > 5) {
            order_ = n + 1;
            return true;
        }
        last_was_small = small;
    }
    return false;
}

// The earliest fall of a guard within the step; which ones fall there goes to crossed_.
double ExactIntegrator::first_crossing() {
    const DiscreteState& d = *state_->discrete;
    const auto row = [&](int n) { return guard_terms_.data() + static_cast<std::size_t>(n) * guard_count_; };
    system_.guards(t0_, {term(0), size_}, d, {row(0), guard_count_});
    for (int n = 1; n <= order_ && !pattern_; ++n) {
        system_.affine_guards(n, t0_, h_, {term(n), size_}, d, {row(n), guard_count_});
    }
    ++counts_.guard_evaluations;
    crossed_.clear();
    double first = none;
    for (GuardId guard = 0; guard < guard_count_; ++guard) {
        if (pattern_ && pattern_->g[guard].empty()) continue; // it does not move
        std::size_t last = static_cast<std::size_t>(order_);
        polynomial_[0] = guard_terms_[guard];
        if (pattern_) {
            // Mostly it is so far above zero that it cannot get there.
            double reach = 0;
            for (const auto& [column, value] : pattern_->g[guard]) reach += std::abs(value) * travel_[column];
            if (polynomial_[0] > reach) continue;
            std::fill_n(polynomial_.begin() + 1, last, 0.0);
            for (const auto& [column, value] : pattern_->g[guard]) {
                for (std::size_t n = 1; n <= last; ++n) polynomial_[n] += value * terms_[n * height_ + column];
            }
            // A position's terms end before the thrust's.
            while (last > 1 && std::abs(polynomial_[last]) < 0x1p-60 * reach) --last;
        } else {
            for (std::size_t n = 1; n <= last; ++n) polynomial_[n] = guard_terms_[n * guard_count_ + guard];
        }
        const double s = first_crossing_below_zero({polynomial_.data(), last + 1});
        if (s == none || s > first) continue;
        if (s < first) crossed_.clear();
        first = s;
        crossed_.push_back(guard);
    }
    return first;
}

void ExactIntegrator::evaluate(double s, std::span<double> x) {
    evaluate_columns(terms_.data(), order_, height_, s, work_.data());
    std::copy_n(work_.begin(), size_, x.begin());
}

Integrator::Progress ExactIntegrator::step(double t_stop) {
    const double whole = begin(t_stop);
    ++counts_.steps;
    const Prepared* prepared = prepared_for(whole);
    if (prepared && propagate(*prepared)) {
        state_->t = t_stop;
        behind_ = whole - prepared->h;
        return Progress::stopped;
    }
    double h = whole;
    while (!expand(h)) {
        h /= 2;
        if (h > 1e-9 * whole) continue;
        failure_ = {RunEnd::non_finite, t0_,
                    fmt::format("the state is not finite near t = {:.9g} s: the loop may be unstable", t0_),
                    not_finite_in({term(1), size_}, t0_)};
        return Progress::failed;
    }
    sum_columns(terms_.data(), order_, height_, end_.data(), travel_.data());
    const double s = first_crossing();
    if (s != none) {
        evaluate(s, state_->x);
        end(s * h - lag_);
        if (s == 1 && h == whole) state_->t = t_stop;
        return Progress::crossing;
    }
    std::copy_n(end_.begin(), size_, state_->x.begin());
    end(h - lag_);
    if (h != whole) return Progress::stepped;
    state_->t = t_stop;
    if (!prepared) learn(whole);
    return Progress::stopped;
}

void ExactIntegrator::interpolate(double t, std::span<double> x) {
    // A propagated step left no series; it converges, because Psi was made of the same terms.
    if (order_ == 0) expand(h_);
    evaluate((t - t0_ + lag_) / h_, x);
}

} // namespace tribode
