#include "tribode/solver/event_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace tribode {

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();
constexpr std::size_t tightened_from = 2; // halvings of a step: most guards need less

// Times nearer than this are not told apart [s].
double time_resolution(double t) { return 2 * epsilon * std::abs(t) + std::numeric_limits<double>::min(); }

double binomial(int n, int k) {
    double value = 1;
    for (int i = 1; i <= k; ++i) value = value * (n - k + i) / i;
    return value;
}

} // namespace

void StepPolynomial::resize(std::size_t state_count, int new_degree) {
    states = state_count;
    degree = new_degree;
    terms.resize(states * (static_cast<std::size_t>(degree) + 1));
}

void StepPolynomial::evaluate(double s, std::span<double> x) const {
    std::copy_n(term(degree), states, x.begin());
    for (int k = degree - 1; k >= 0; --k) {
        const double* c = term(k);
        for (std::size_t i = 0; i < states; ++i) x[i] = x[i] * s + c[i];
    }
}

void StepPolynomial::begin_at(double t) {
    const double end = t0 + h, from = (t - t0) / h, part = 1 - from;
    // Horner's scheme, again and again, gives the coefficients about `from`.
    for (int k = 0; k < degree; ++k) {
        for (int n = degree - 1; n >= k; --n) {
            for (std::size_t i = 0; i < states; ++i) term(n)[i] += from * term(n + 1)[i];
        }
    }
    double factor = 1;
    for (int k = 1; k <= degree; ++k) {
        factor *= part;
        for (std::size_t i = 0; i < states; ++i) term(k)[i] *= factor;
    }
    t0 = t;
    h = end - t;
}

EventSearch::EventSearch(const HybridSystem& system)
    : system_(system),
      guard_count_(system.guard_count()),
      encloses_(system.encloses_guards()),
      states_(system.states().size()),
      bounds_(guard_count_),
      x_(states_.size()),
      g_(guard_count_),
      samples_(guard_count_ * (nodes + 1)) {
    for (GuardId guard = 0; encloses_ && guard < guard_count_; ++guard) {
        if (system.depends_on_time_alone(guard)) time_guards_.push_back(guard);
    }
}

EventSearch::Piece& EventSearch::piece(std::size_t level) {
    if (level >= pieces_.size()) pieces_.resize(level + 1);
    return pieces_[level];
}

EventSearch::Found EventSearch::first_crossing(const StepPolynomial& step, const DiscreteState& d,
                                               std::vector<GuardId>& crossed) {
    crossed.clear();
    step_ = &step;
    only_time_ = false;
    pieces_left_ = max_pieces;
    guards_at(0, d);
    Piece& whole = piece(0);
    whole.open.clear();
    for (GuardId guard = 0; guard < guard_count_; ++guard) {
        if (g_[guard] < 0) crossed.push_back(guard);
        whole.open.push_back(guard);
    }
    if (!crossed.empty()) return {0, true};
    searched_to_ = 0;
    if (encloses_) {
        // b_i = sum_{k <= i} C(i,k)/C(n,k) c_k
        const int n = step.degree;
        whole.control.assign(step.terms.size(), 0.0);
        for (int i = 0; i <= n; ++i) {
            double* b = whole.control.data() + static_cast<std::size_t>(i) * step.states;
            for (int k = 0; k <= i; ++k) {
                const double factor = binomial(i, k) / binomial(n, k);
                const double* c = step.term(k);
                for (std::size_t j = 0; j < step.states; ++j) b[j] += factor * c[j];
            }
        }
    }
    if (encloses_) {
        pieces_left_ = few_pieces;
        if (const auto s = search(0, 0, 1, d, crossed)) return {*s, true};
        if (pieces_left_ > 0) return {1, false};
        leave_out_zeros(d);
        searched_to_ = 0;
    }
    pieces_left_ = patience_;
    if (const auto s = search(0, 0, 1, d, crossed)) return {*s, true};
    if (pieces_left_ > 0) {
        patience_ = max_pieces;
        return {1, false};
    }
    constexpr double min_part = 1e-3;
    if (searched_to_ > min_part) return {searched_to_, false};
    // A guard that stays within rounding of zero is followed no further than that, and less far each time.
    patience_ = std::max(few_pieces, patience_ / 4);
    if (const auto s = look_at_points(d, crossed)) return {*s, true};
    return {1, false};
}

// Bounds take the states for independent of one another. So a guard that is zero throughout, as the difference of two states that move
// alike, would be halved down to rounding. Where its gradient is the same on the whole step, its own polynomial is known. One that is
// not below zero for certain does not cross.
void EventSearch::leave_out_zeros(const DiscreteState& d) {
    Piece& whole = pieces_[0];
    const std::size_t count = states_.size(), points = static_cast<std::size_t>(step_->degree) + 1;
    const auto control = [&](std::size_t i, std::size_t j) { return whole.control[i * count + j]; };
    std::vector<Interval> ranges(count);
    for (std::size_t j = 0; j < count; ++j) {
        ranges[j] = Interval::point(control(0, j));
        for (std::size_t i = 1; i < points; ++i) {
            ranges[j] = {std::min(ranges[j].low, control(i, j)), std::max(ranges[j].high, control(i, j))};
        }
    }
    const Interval times = {step_->t0, step_->time(1)};
    // Of each guard: its coefficients less the first one, by how much they may be off, and their rounding alone.
    std::vector<double> change(guard_count_ * points), error(guard_count_), rounding(guard_count_);
    for (std::size_t j = 0; j <= count; ++j) { // the last one is the time
        for (std::size_t i = 0; i < count; ++i) states_[i] = {ranges[i], Interval::point(i == j ? 1 : 0)};
        system_.enclose_guards({times, Interval::point(j == count ? 1 : 0)}, states_, d, bounds_);
        const Interval range = j == count ? times : ranges[j];
        const double size = std::max(std::abs(range.low), std::abs(range.high));
        for (const GuardId guard : whole.open) {
            const Interval slope = bounds_[guard].rate;
            const double middle = 0.5 * (slope.low + slope.high), own = 8 * epsilon * std::abs(middle) * size;
            for (std::size_t i = 0; i < points; ++i) {
                const double way = j == count ? step_->h * static_cast<double>(i) / static_cast<double>(points - 1)
                                              : control(i, j) - control(0, j);
                change[guard * points + i] += middle * way;
            }
            error[guard] += 0.5 * (slope.high - slope.low) * (range.high - range.low) + own;
            rounding[guard] += own;
        }
    }
    step_->evaluate(0, x_);
    for (std::size_t j = 0; j < count; ++j) states_[j] = {Interval::point(x_[j]), {0, 0}};
    system_.enclose_guards({Interval::point(step_->t0), {0, 0}}, states_, d, bounds_);
    std::erase_if(whole.open, [&](GuardId guard) {
        const Interval first = bounds_[guard].value;
        const double* own = &change[guard * points];
        const double least = first.low + *std::min_element(own, own + points) - error[guard];
        constexpr double few = 4;
        return least >= -few * (rounding[guard] + first.high - first.low);
    });
}

// By signs at equal distances.
std::optional<double> EventSearch::look_at_points(const DiscreteState& d, std::vector<GuardId>& crossed) {
    constexpr int points = 64;
    for (int i = 1; i <= points; ++i) {
        const double high = static_cast<double>(i) / points, low = static_cast<double>(i - 1) / points;
        guards_at(high, d);
        const auto below = std::find_if(g_.begin(), g_.end(), [](double g) { return g < 0; });
        if (below == g_.end()) continue;
        crossed.push_back(static_cast<GuardId>(below - g_.begin()));
        return locate(crossed.front(), low, high, d);
    }
    return std::nullopt;
}

EventSearch::Found EventSearch::next_time_event(double t, double t_end, std::span<const double> x,
                                                const DiscreteState& d) {
    constexpr int usual_pieces = 200; // looking far ahead costs more than stopping once too often
    StepPolynomial ahead;
    ahead.t0 = t;
    ahead.h = t_end - t;
    ahead.resize(x.size(), 0);
    std::copy(x.begin(), x.end(), ahead.terms.begin());
    std::vector<GuardId> crossed; // the step that ends there finds them again
    step_ = &ahead;
    only_time_ = true;
    pieces_left_ = usual_pieces;
    searched_to_ = 0;
    piece(0).open = time_guards_;
    const auto s = search(0, 0, 1, d, crossed);
    if (s) return {std::min(ahead.time(*s), t_end), true};
    if (pieces_left_ > 0) return {t_end, false};
    return {ahead.time(searched_to_), false};
}

void EventSearch::guards_at(double s, const DiscreteState& d) {
    step_->evaluate(s, x_);
    system_.guards(step_->time(s), x_, d, g_);
    ++guard_evaluations_;
}

// Bounds of all guards and of their rates of change over [low, high].
void EventSearch::bound(const Piece& piece, double low, double high, const DiscreteState& d) {
    if (!encloses_) return bound_by_samples(low, high, d);
    const int n = step_->degree;
    const double rate_factor = n / ((high - low) * step_->h);
    for (std::size_t j = 0; j < states_.size(); ++j) {
        if (only_time_) {
            states_[j] = Enclosure::unknown();
            continue;
        }
        const auto control = [&](int i) { return piece.control[static_cast<std::size_t>(i) * step_->states + j]; };
        Interval value = Interval::point(control(0)), rate{0, 0};
        for (int i = 1; i <= n; ++i) {
            value = {std::min(value.low, control(i)), std::max(value.high, control(i))};
            const double slope = (control(i) - control(i - 1)) * rate_factor;
            rate = i == 1 ? Interval::point(slope) : Interval{std::min(rate.low, slope), std::max(rate.high, slope)};
        }
        states_[j] = {value, rate};
    }
    const Enclosure time = {{step_->time(low), step_->time(high)}, {1, 1}};
    system_.enclose_guards(time, states_, d, bounds_);
}

void EventSearch::bound_by_samples(double low, double high, const DiscreteState& d) {
    // Coefficients of the Chebyshev series from values at cos(pi j/n).
    static const auto transform = [] {
        std::array<std::array<double, nodes + 1>, nodes + 1> matrix{};
        for (int k = 0; k <= nodes; ++k) {
            for (int j = 0; j <= nodes; ++j) {
                double factor = 2.0 / nodes * std::cos(std::numbers::pi * j * k / nodes);
                if (j == 0 || j == nodes) factor /= 2;
                if (k == 0 || k == nodes) factor /= 2;
                matrix[static_cast<std::size_t>(k)][static_cast<std::size_t>(j)] = factor;
            }
        }
        return matrix;
    }();
    static const auto place = [] {
        std::array<double, nodes + 1> values{};
        for (int j = 0; j <= nodes; ++j) {
            values[static_cast<std::size_t>(j)] = 0.5 * (1 + std::cos(std::numbers::pi * j / nodes));
        }
        return values;
    }();
    for (std::size_t j = 0; j <= nodes; ++j) {
        guards_at(low + (high - low) * place[j], d);
        for (GuardId guard = 0; guard < guard_count_; ++guard) samples_[guard * (nodes + 1) + j] = g_[guard];
    }
    for (GuardId guard = 0; guard < guard_count_; ++guard) {
        const double* values = &samples_[guard * (nodes + 1)];
        const auto [least, largest] = std::minmax_element(values, values + nodes + 1);
        if (*least == *largest) { // one that does not matter at present, as a rule
            bounds_[guard] = Enclosure::constant(values[0]);
            continue;
        }
        std::array<double, nodes + 2> c{}, slope{};
        for (std::size_t k = 0; k <= nodes; ++k) {
            for (std::size_t j = 0; j <= nodes; ++j) c[k] += transform[k][j] * values[j];
        }
        // What the series lacks is about as large as what its last terms add; below that is rounding.
        const double size = std::max(std::abs(*least), std::abs(*largest));
        const double lacking = 2 * (std::abs(c[nodes]) + std::abs(c[nodes - 1])) + 16 * epsilon * size;
        double reach = lacking;
        for (std::size_t k = 1; k <= nodes; ++k) reach += std::abs(c[k]);
        for (std::size_t k = nodes; k >= 1; --k) {
            slope[k - 1] = (k + 1 <= nodes ? slope[k + 1] : 0) + 2 * static_cast<double>(k) * c[k];
        }
        slope[0] /= 2;
        double slope_reach = lacking > 32 * epsilon * size ? lacking * nodes * nodes : 0;
        for (std::size_t k = 1; k < nodes; ++k) slope_reach += std::abs(slope[k]);
        const double factor = 2 / ((high - low) * step_->h);
        bounds_[guard] = {{c[0] - reach, c[0] + reach},
                          {factor * (slope[0] - slope_reach), factor * (slope[0] + slope_reach)}};
        if (std::isnan(c[0])) bounds_[guard] = Enclosure::unknown();
    }
}

// The first crossing in [low, high] of the guards that are open there; they are not below zero at low.
std::optional<double> EventSearch::search(std::size_t level, double low, double high, const DiscreteState& d,
                                          std::vector<GuardId>& crossed) {
    if (--pieces_left_ <= 0) return std::nullopt;
    Piece& here = piece(level);
    bound(here, low, high, d);
    auto& open = here.open;
    // A guard that is above zero, or that does not decrease, does not cross.
    std::erase_if(open, [&](GuardId guard) { return bounds_[guard].value.low > 0 || bounds_[guard].rate.low >= 0; });
    if (!open.empty() && level >= tightened_from) tighten(open, low, high, d);
    if (!open.empty()) {
        const auto decreases_throughout = [&](GuardId guard) { return bounds_[guard].rate.high <= 0; };
        const bool decided = std::all_of(open.begin(), open.end(), decreases_throughout) ||
                             (high - low) * step_->h <= 4 * time_resolution(step_->time(high));
        if (decided) {
            // One that is still decreasing where it is zero at the very end has crossed there.
            guards_at(high, d);
            std::erase_if(open, [&](GuardId guard) {
                return g_[guard] > 0 || (g_[guard] == 0 && !(high == 1 && bounds_[guard].rate.high < 0));
            });
        }
        if (decided && !open.empty()) {
            // Those that cross later than the first by no more than rounding cross with it.
            std::vector<double> instants;
            for (const GuardId guard : open) instants.push_back(locate(guard, low, high, d));
            const double first = *std::min_element(instants.begin(), instants.end());
            const double together = step_->time(first) + 2 * time_resolution(step_->time(first));
            for (std::size_t i = 0; i < open.size(); ++i) {
                if (step_->time(instants[i]) <= together) crossed.push_back(open[i]);
            }
            return first;
        }
        if (!decided) {
            // de Casteljau's scheme gives the coefficients on both halves.
            const double middle = 0.5 * (low + high);
            piece(level + 2); // may move the others
            Piece& parent = pieces_[level];
            std::vector<double> right = parent.control;
            pieces_[level + 1].open = parent.open;
            auto& left = pieces_[level + 1].control;
            left.resize(right.size());
            if (encloses_ && !only_time_) {
                const std::size_t n = step_->states;
                const auto degree = static_cast<std::size_t>(step_->degree);
                for (std::size_t round = 0; round <= degree; ++round) {
                    std::copy_n(right.begin(), n, left.begin() + static_cast<std::ptrdiff_t>(round * n));
                    for (std::size_t i = 0; i + round < degree; ++i) {
                        for (std::size_t j = 0; j < n; ++j) {
                            right[i * n + j] = 0.5 * (right[i * n + j] + right[(i + 1) * n + j]);
                        }
                    }
                }
            }
            if (const auto found = search(level + 1, low, middle, d, crossed)) return found;
            if (pieces_left_ > 0) {
                pieces_[level + 1].open = pieces_[level].open;
                pieces_[level + 1].control = std::move(right);
                return search(level + 1, middle, high, d, crossed);
            }
            return std::nullopt;
        }
    }
    searched_to_ = high;
    return std::nullopt;
}

// The mean value form: the value in the middle, and as far as the rate of change leads from there; it is much narrower where
// large terms cancel. What is left of the width may be rounding, which gets no narrower on shorter pieces: then a guard that
// is not below zero for certain is taken for zero, and left out.
void EventSearch::tighten(std::vector<GuardId>& open, double low, double high, const DiscreteState& d) {
    if (!encloses_) return;
    enclosed_ = bounds_;
    const double middle = 0.5 * (low + high), t = step_->time(middle), reach = 0.5 * (high - low) * step_->h;
    step_->evaluate(middle, x_);
    constexpr double roundings = 4 * epsilon; // of the interpolation
    for (std::size_t j = 0; j < x_.size() && !only_time_; ++j) {
        const double rounding = roundings * std::abs(x_[j]);
        states_[j] = {{x_[j] - rounding, x_[j] + rounding}, {0, 0}};
    }
    const double time_rounding = epsilon * std::abs(t);
    system_.enclose_guards({{t - time_rounding, t + time_rounding}, {0, 0}}, states_, d, bounds_);
    std::erase_if(open, [&](GuardId guard) {
        const Interval there = bounds_[guard].value, rate = enclosed_[guard].rate;
        const double change = std::max(std::abs(rate.low), std::abs(rate.high)) * reach;
        if (!std::isfinite(change) || !std::isfinite(there.high - there.low)) return false;
        if (there.low - change > 0) return true;
        constexpr double few = 4; // of the rounding itself
        return 2 * change <= few * (there.high - there.low) && there.high >= 0;
    });
    bounds_.swap(enclosed_);
}

// The guard is below zero at high and was not at low: the first instant at which it is, to the resolution of the time.
double EventSearch::locate(GuardId guard, double low, double high, const DiscreteState& d) {
    const auto at = [&](double s) {
        guards_at(s, d);
        return g_[guard];
    };
    double above = at(low), below = at(high);
    if (above <= 0) return low;
    if (below == 0) return high;
    // The Illinois method: a secant, pulled over where one end stays; bisection where that gains too little.
    bool low_moved = false, high_moved = false;
    for (int round = 0; (high - low) * step_->h > 0.5 * time_resolution(step_->time(high)); ++round) {
        double s = high - below * (high - low) / (below - above);
        if (round % 4 == 3 || !(s > low && s < high)) s = 0.5 * (low + high);
        if (s <= low || s >= high) break; // neighbors
        const double value = at(s);
        if (value < 0) {
            high = s;
            below = value;
            if (high_moved) above *= 0.5;
        } else {
            low = s;
            above = value;
            if (low_moved) below *= 0.5;
        }
        high_moved = value < 0;
        low_moved = !high_moved;
    }
    return high;
}

} // namespace tribode
