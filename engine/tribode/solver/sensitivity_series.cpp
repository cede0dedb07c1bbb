#include "tribode/solver/sensitivity_series.hpp"
#include "tribode/solver/series_kernels.hpp"

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
    // Of each A_p column after column, with all that are multiples of it.
    constexpr double rounding = 4 * std::numeric_limits<double>::epsilon();
    std::vector<double> rest(partial.begin(), partial.end()), multiples;
    pattern.first = {0, 0};
    for (std::size_t p = 0; p < parameters_; ++p) {
        const auto column = [&](std::size_t j) {
            return std::span(rest).subspan((p * states_ + j) * states_, states_);
        };
        for (std::size_t j = 0; j < states_; ++j) {
            const std::vector<double> u(column(j).begin(), column(j).end());
            const auto greatest = static_cast<std::size_t>(
                std::max_element(u.begin(), u.end(), [](double x, double y) { return std::abs(x) < std::abs(y); }) -
                u.begin());
            if (u[greatest] == 0) continue;
            const std::size_t product = pattern.left.size() / height_;
            pattern.left.insert(pattern.left.end(), u.begin(), u.end());
            pattern.left.resize((product + 1) * height_);
            multiples.resize((product + 1) * states_);
            for (std::size_t k = j; k < states_; ++k) {
                const double multiple = column(k)[greatest] / u[greatest];
                bool is_multiple = true;
                for (std::size_t i = 0; i < states_; ++i) {
                    const double part = multiple * u[i];
                    is_multiple = is_multiple && std::abs(column(k)[i] - part) <= rounding * std::abs(part);
                }
                if (!is_multiple) continue;
                multiples[product * states_ + k] = multiple;
                std::ranges::fill(column(k), 0.0);
            }
        }
        pattern.first.push_back(pattern.left.size() / height_);
    }
    const std::size_t products = pattern.first.back();
    pattern.rows = padded(products);
    pattern.right.assign(pattern.rows * height_, 0.0);
    for (std::size_t product = 0; product < products; ++product) {
        for (std::size_t j = 0; j < states_; ++j) {
            pattern.right[j * pattern.rows + product] = multiples[product * states_ + j];
        }
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
    values_.resize(pattern.rows);
    const PartialProducts partial{pattern.left.data(), pattern.right.data(), pattern.first.data(), pattern.rows,
                                  values_.data()};
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
            double along = 0;
            for (std::size_t j = 0; j < states_; ++j) along += pattern.right[j * pattern.rows + i] * travel[j];
            for (std::size_t row = 0; row < height_; ++row) {
                q_now[p * height_ + row] += pattern.left[i * height_ + row] * along;
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
