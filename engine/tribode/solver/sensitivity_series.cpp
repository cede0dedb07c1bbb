#include "tribode/solver/sensitivity_series.hpp"
#include "tribode/solver/series_kernels.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

namespace {

constexpr int max_order = 32;
// How often a pattern meets a length before it is prepared for: preparing takes as many series as there are states.
constexpr int worth_preparing = 8;

} // namespace

SensitivitySeries::SensitivitySeries(std::size_t states, std::size_t parameters)
    : states_(states),
      parameters_(parameters),
      height_(padded(states)) {
    sums_.resize(height_ * (1 + parameters_));
    room_.resize(4 * sums_.size());
}

void SensitivitySeries::set_matrices(Pattern& pattern, std::span<const double> a,
                                     std::span<const double> partial) const {
    const auto n = static_cast<std::ptrdiff_t>(states_);
    pattern = {};
    pattern.a.assign(height_ * height_, 0.0);
    for (std::size_t j = 0; j < states_; ++j) {
        std::copy_n(a.begin() + static_cast<std::ptrdiff_t>(j) * n, n, pattern.a.data() + j * height_);
    }
    for (std::size_t j = 0; j < states_; ++j) {
        bool alone = true;
        for (std::size_t k = 0; k < states_; ++k) alone = alone && (k == j || a[k * states_ + j] == 0);
        if (alone) pattern.decay = std::min(pattern.decay, a[j * states_ + j]);
    }
    pattern.first = {0, 0};
    for (std::size_t column = 0; column < parameters_ * states_; ++column) {
        const auto own = partial.subspan(column * states_, states_);
        if (std::any_of(own.begin(), own.end(), [](double value) { return value != 0; })) {
            pattern.parts.insert(pattern.parts.end(), own.begin(), own.end());
            pattern.parts.resize(pattern.parts.size() + height_ - states_);
            pattern.places.push_back(column % states_);
        }
        if ((column + 1) % states_ == 0) pattern.first.push_back(pattern.places.size());
    }
}

void SensitivitySeries::propagate(Pattern& pattern, double t, double h, const double* f, const double* q, double* s) {
    if (const Prepared* prepared = prepared_for(pattern, t, h)) {
        propagate_sensitivities(prepared->move.data(), prepared->psi.data(), prepared->psi_p.data(), f, q, states_,
                                height_, parameters_, s);
    } else {
        expand(pattern, h, f, q, s);
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

void SensitivitySeries::expand(const Pattern& pattern, double h, const double* f, const double* q, double* s) {
    double* d = room_.data() + height_;
    for (std::size_t i = 0; i < height_; ++i) room_[i] = h * f[i];
    for (std::size_t p = 0; p < parameters_; ++p) {
        double* own = d + p * height_;
        std::copy_n(q + p * height_, height_, own);
        add_columns(own, pattern.a.data(), states_, height_, s + p * height_, own);
    }
    for (std::size_t i = 0; i < parameters_ * height_; ++i) d[i] *= h;
    const PartialColumns partial{pattern.parts.data(), pattern.places.data(), pattern.first.data()};
    if (expand_sensitivities(pattern.a.data(), states_, pattern.decay, partial, 1 + parameters_, height_, h, max_order,
                             room_.data(), sums_.data())) {
        for (std::size_t i = 0; i < parameters_ * height_; ++i) s[i] += sums_[height_ + i];
        return;
    }
    // What is not finite stays so.
    if (!std::all_of(sums_.begin(), sums_.end(), [](double value) { return std::isfinite(value); })) {
        for (std::size_t i = 0; i < parameters_ * height_; ++i) s[i] += sums_[height_ + i];
        return;
    }
    // In halves; the second begins where x has moved by the first's sum.
    std::vector<double> f_now(f, f + height_), q_now(q, q + parameters_ * height_);
    std::vector<double> travel(height_);
    expand(pattern, h / 2, f, q, s);
    std::copy_n(sums_.begin(), height_, travel.begin());
    add_columns(f_now.data(), pattern.a.data(), states_, height_, travel.data(), f_now.data());
    for (std::size_t p = 0; p < parameters_; ++p) {
        for (std::size_t i = pattern.first[1 + p]; i < pattern.first[2 + p]; ++i) {
            for (std::size_t row = 0; row < height_; ++row) {
                q_now[p * height_ + row] += pattern.parts[i * height_ + row] * travel[pattern.places[i]];
            }
        }
    }
    expand(pattern, h / 2, f_now.data(), q_now.data(), s);
    // Of the whole step, for a caller that halves too.
    for (std::size_t i = 0; i < height_; ++i) sums_[i] += travel[i];
}

// Column by column, as the responses to f = e_j.
SensitivitySeries::Prepared SensitivitySeries::prepare(const Pattern& pattern, double h) {
    Prepared made{h, std::vector<double>(height_ * height_), std::vector<double>(height_ * height_),
                  std::vector<double>(parameters_ * height_ * height_)};
    std::vector<double> f(height_), q(parameters_ * height_), s(parameters_ * height_);
    for (std::size_t j = 0; j < states_; ++j) {
        f[j] = 1;
        std::fill(s.begin(), s.end(), 0.0);
        expand(pattern, h, f.data(), q.data(), s.data());
        std::copy_n(sums_.begin(), height_, made.psi.data() + j * height_);
        for (std::size_t p = 0; p < parameters_; ++p) {
            std::copy_n(s.data() + p * height_, height_, made.psi_p.data() + (p * height_ + j) * height_);
        }
        f[j] = 0;
    }
    for (std::size_t j = 0; j < states_; ++j) {
        for (std::size_t k = 0; k < states_; ++k) {
            const double factor = pattern.a[j * height_ + k];
            for (std::size_t row = 0; factor != 0 && row < height_; ++row) {
                made.move[j * height_ + row] += made.psi[k * height_ + row] * factor;
            }
        }
    }
    return made;
}

} // namespace tribode
