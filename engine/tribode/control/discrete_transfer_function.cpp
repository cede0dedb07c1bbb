#include "tribode/control/discrete_transfer_function.hpp"

#include <algorithm>
#include <cassert>
#include <numbers>

namespace tribode {

DiscreteTransferFunction::DiscreteTransferFunction(std::vector<double> numerator, std::vector<double> denominator)
    : b_(std::move(numerator)),
      a_(std::move(denominator)) {
    assert(!a_.empty() && a_.front() != 0);
    const double first = a_.front();
    const std::size_t size = std::max(a_.size(), b_.size());
    a_.resize(size);
    b_.resize(size);
    for (auto& a : a_) a /= first;
    for (auto& b : b_) b /= first;
    memory_.assign(size, 0.0); // the last one stays zero
}

double DiscreteTransferFunction::step(double input) {
    const double output = b_[0] * input + memory_[0];
    for (std::size_t i = 1; i < b_.size(); ++i) memory_[i - 1] = memory_[i] + b_[i] * input - a_[i] * output;
    return output;
}

void DiscreteTransferFunction::reset() { std::fill(memory_.begin(), memory_.end(), 0.0); }

std::complex<double> DiscreteTransferFunction::response(double frequency_hz, double sample_time) const {
    const auto delay = std::polar(1.0, -2 * std::numbers::pi * frequency_hz * sample_time); // z^-1
    std::complex<double> above = 0, below = 0;
    for (std::size_t i = b_.size(); i-- > 0;) {
        above = above * delay + b_[i];
        below = below * delay + a_[i];
    }
    return above / below;
}

static std::vector<double> product(const std::vector<double>& p, const std::vector<double>& q) {
    std::vector<double> r(p.size() + q.size() - 1);
    for (std::size_t i = 0; i < p.size(); ++i) {
        for (std::size_t j = 0; j < q.size(); ++j) r[i + j] += p[i] * q[j];
    }
    return r;
}

DiscreteTransferFunction DiscreteTransferFunction::pade_delay(double delay, int order, double sample_time) {
    if (delay == 0) return {{1.0}, {1.0}};
    // exp(-Ls) ~ sum c_k (-Ls)^k / sum c_k (Ls)^k with c_k = c_{k-1} (n-k+1)/((2n-k+1) k), c_0 = 1.
    // With s = (2/Ts)(1-d)/(1+d), d = z^-1, and both sides times (1+d)^n:
    const auto n = static_cast<std::size_t>(order);
    std::vector<double> numerator(n + 1), denominator(n + 1);
    double c = 1, scale = 1; // scale = (2L/Ts)^k
    for (std::size_t k = 0; k <= n; ++k) {
        if (k > 0) {
            c *= static_cast<double>(n - k + 1) / static_cast<double>((2 * n - k + 1) * k);
            scale *= 2 * delay / sample_time;
        }
        std::vector<double> term = {c * scale};
        for (std::size_t i = 0; i < k; ++i) term = product(term, {1, -1});
        for (std::size_t i = k; i < n; ++i) term = product(term, {1, 1});
        for (std::size_t i = 0; i <= n; ++i) {
            numerator[i] += (k % 2 ? -1 : 1) * term[i];
            denominator[i] += term[i];
        }
    }
    return {numerator, denominator};
}

} // namespace tribode
