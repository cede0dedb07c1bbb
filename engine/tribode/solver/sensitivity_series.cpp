#include "tribode/solver/sensitivity_series.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tribode {

namespace {

constexpr int max_order = 32;
// How often a pattern meets a length before it is prepared for: preparing takes as many series as there are states.
constexpr int worth_preparing = 8;

} // namespace

SensitivitySeries::SensitivitySeries(std::size_t states, std::size_t parameters)
    : states_(states),
      parameters_(parameters),
      height_(padded(states)),
      size_(height_ + height_ / lane_count),
      rates_(height_),
      sums_(size_) {}

SensitivityMatrices SensitivitySeries::matrices(const Pattern& pattern) const {
    return {.states = states_,
            .height = height_,
            .parameters = parameters_,
            .a = pattern.a.data(),
            .full = pattern.full.data(),
            .full_row = pattern.full_row.data(),
            .full_rows = pattern.full_row.size(),
            .single = pattern.single.data(),
            .single_rows = pattern.single.size(),
            .layers = pattern.left.size() / height_,
            .left = numbers(pattern.left.data()),
            .right = numbers(pattern.right.data()),
            .rate = pattern.decay};
}

void SensitivitySeries::set_matrices(Pattern& pattern, std::span<const double> a,
                                     std::span<const Lanes> partial) const {
    pattern = {};
    pattern.a.assign(height_ * height_, 0.0);
    for (std::size_t j = 0; j < states_; ++j) {
        for (std::size_t i = 0; i < states_; ++i) pattern.a[j * height_ + i] = a[j * states_ + i];
    }
    for (std::size_t i = 0; i < states_; ++i) {
        const auto entry = [&](std::size_t j) { return a[j * states_ + i]; };
        std::size_t entries = 0, last = i;
        for (std::size_t j = 0; j < states_; ++j) {
            if (entry(j) == 0) continue;
            ++entries;
            last = j;
        }
        if (entries < 2) {
            pattern.single.push_back({i, last, entry(last)});
            if (last == i) pattern.decay = std::min(pattern.decay, entry(i));
            continue;
        }
        pattern.full_row.push_back(i);
        for (std::size_t j = 0; j < height_; ++j) pattern.full.push_back(j < states_ ? entry(j) : 0);
    }
    // Of each A_p column after column, with all that are multiples of it.
    constexpr double rounding = 4 * std::numeric_limits<double>::epsilon();
    pattern.left.resize(height_);
    pattern.right.resize(height_);
    std::vector<Lanes> rest(partial.begin(), partial.end());
    for (std::size_t p = 0; p < lane_count; ++p) {
        const auto entry = [&](std::size_t i, std::size_t j) -> double& {
            return numbers(rest.data() + j * states_ + i)[p];
        };
        std::size_t layer = 0;
        std::vector<double> u(states_);
        for (std::size_t j = 0; j < states_; ++j) {
            std::size_t greatest = 0;
            for (std::size_t i = 0; i < states_; ++i) {
                u[i] = entry(i, j);
                if (std::abs(u[i]) > std::abs(u[greatest])) greatest = i;
            }
            if (u[greatest] == 0) continue;
            const std::size_t begin = layer++ * height_;
            if (pattern.left.size() == begin) {
                pattern.left.resize(begin + height_);
                pattern.right.resize(begin + height_);
            }
            for (std::size_t i = 0; i < states_; ++i) pattern.left[begin + i][p] = u[i];
            for (std::size_t k = j; k < states_; ++k) {
                const double multiple = entry(greatest, k) / u[greatest];
                bool is_multiple = true;
                for (std::size_t i = 0; i < states_; ++i) {
                    const double part = multiple * u[i];
                    is_multiple = is_multiple && std::abs(entry(i, k) - part) <= rounding * std::abs(part);
                }
                if (!is_multiple) continue;
                pattern.right[begin + k][p] = multiple;
                for (std::size_t i = 0; i < states_; ++i) entry(i, k) = 0;
            }
        }
    }
}

void SensitivitySeries::rates(const Pattern& pattern, std::span<const Lanes> q, std::span<const Lanes> s,
                              std::span<Lanes> rates) const {
    sensitivity_rates(matrices(pattern), numbers(s.data()), numbers(q.data()), numbers(rates.data()));
}

void SensitivitySeries::propagate(Pattern& pattern, double t, double h, std::span<const double> f,
                                  std::span<const Lanes> q, std::span<Lanes> s) {
    sensitivity_rates(matrices(pattern), numbers(s.data()), numbers(q.data()), numbers(rates_.data()));
    if (const Prepared* prepared = prepared_for(pattern, t, h)) {
        propagate_sensitivities(prepared->psi.data(), numbers(prepared->psi_p.data()), f.data(), numbers(rates_.data()),
                                height_, numbers(s.data()));
    } else {
        expand(pattern, h, f, rates_, s);
    }
}

const SensitivitySeries::Prepared* SensitivitySeries::prepared_for(Pattern& pattern, double t, double h) {
    for (const auto& prepared : pattern.prepared) {
        if (same_length(prepared.h, h, t)) return &prepared;
    }
    if (!recurring_.met(h, t)) return nullptr;
    std::size_t i = 0;
    while (i < pattern.met.size() && !same_length(pattern.met[i], h, t)) ++i;
    if (i == pattern.met.size()) {
        pattern.met.push_back(h);
        pattern.times.push_back(0);
    }
    if (++pattern.times[i] < worth_preparing) return nullptr;
    return &pattern.prepared.emplace_back(prepare(pattern, h));
}

// rates: A s + q where the step begins. Leaves in sums_ what s and x have moved by.
void SensitivitySeries::expand(const Pattern& pattern, double h, std::span<const double> f,
                               std::span<const Lanes> rates, std::span<Lanes> s) {
    const SensitivityMatrices m = matrices(pattern);
    if (room_.size() < 4 * size_ + m.layers) room_.resize(4 * size_ + m.layers);
    for (std::size_t i = 0; i < height_; ++i) room_[i] = h * rates[i];
    for (std::size_t i = 0; i < height_; ++i) value(room_)[i] = h * f[i];
    const bool ends = expand_sensitivities(m, h, max_order, numbers(room_.data()), numbers(sums_.data()));
    // What is not finite stays so.
    if (ends || !std::all_of(numbers(sums_.data()), numbers(sums_.data() + size_),
                             [](double sum) { return std::isfinite(sum); })) {
        for (std::size_t i = 0; i < height_; ++i) s[i] += sums_[i];
        return;
    }
    // In halves; the second begins where x has moved by the first's sum.
    const std::vector<double> f_first(f.begin(), f.end());
    const std::vector<Lanes> rates_first(rates.begin(), rates.end());
    expand(pattern, h / 2, f_first, rates_first, s);
    const std::vector<Lanes> moved = sums_;
    const double* travel = numbers(moved.data() + height_);
    std::vector<double> f_now = f_first;
    std::vector<Lanes> rates_now = rates_first;
    for (std::size_t j = 0; j < states_; ++j) {
        for (std::size_t i = 0; i < states_; ++i) {
            f_now[i] += pattern.a[j * height_ + i] * travel[j];
            rates_now[i] += pattern.a[j * height_ + i] * moved[j];
        }
    }
    for (std::size_t begin = 0; begin < pattern.left.size(); begin += height_) {
        Lanes along;
        for (std::size_t j = 0; j < states_; ++j) along += pattern.right[begin + j] * travel[j];
        for (std::size_t i = 0; i < states_; ++i) rates_now[i] += pattern.left[begin + i] * along;
    }
    expand(pattern, h / 2, f_now, rates_now, s);
    // Of the whole step, for a caller that halves too.
    for (std::size_t i = 0; i < size_; ++i) sums_[i] += moved[i];
}

// Column by column, as the responses to f = e_j.
SensitivitySeries::Prepared SensitivitySeries::prepare(const Pattern& pattern, double h) {
    Prepared made{h, std::vector<double>(height_ * height_), std::vector<Lanes>(height_ * height_)};
    std::vector<double> f(height_);
    const std::vector<Lanes> rest(height_);
    std::vector<Lanes> s(height_);
    for (std::size_t j = 0; j < states_; ++j) {
        f[j] = 1;
        std::fill(s.begin(), s.end(), Lanes{});
        expand(pattern, h, f, rest, s);
        for (std::size_t i = 0; i < states_; ++i) {
            made.psi[i * height_ + j] = value(sums_)[i];
            made.psi_p[i * height_ + j] = s[i];
        }
        f[j] = 0;
    }
    return made;
}

} // namespace tribode
