#include "tribode/design/discrete_plant.hpp"
#include "tribode/base/error.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <numbers>

namespace tribode {

namespace {

using std::numbers::pi;

DiscretePlant::Section rigid_section(double gain, double ts) { return {gain * ts * ts / 2, gain * ts * ts / 2, -2, 1}; }

// k/(s^2 + 2 zeta w s + w^2) behind a hold. With a = zeta w Ts, q = (1 - zeta^2)(w Ts)^2 and
// C = cos(sqrt q), S = sin(sqrt q)/sqrt q (hyperbolic for q < 0):
//
//     b1 = k/w^2 (1 - e^-a (C + a S)),  b2 = k/w^2 e^-a (e^-a - C + a S),  a1 = -2 e^-a C,  a2 = e^-2a
//
// 1 - e^-a C is split into (1 - e^-a) + e^-a (1 - C), which keeps its digits for slow modes.
DiscretePlant::Section mode_section(const VibrationMode& mode, double ts) {
    const double w = 2 * pi * mode.freq_hz, a = mode.zeta * w * ts;
    const double q = (1 - mode.zeta * mode.zeta) * w * ts * w * ts, root = std::sqrt(std::abs(q));
    const double half = q >= 0 ? std::sin(root / 2) : std::sinh(root / 2);
    const double one_less_c = (q >= 0 ? 2 : -2) * half * half;
    const double s = root == 0 ? 1.0 : (q >= 0 ? std::sin(root) : std::sinh(root)) / root;
    const double e = std::exp(-a), one_less_e = -std::expm1(-a), static_gain = mode.gain / (w * w);
    return {static_gain * (one_less_e + e * (one_less_c - a * s)), static_gain * e * (one_less_c - one_less_e + a * s),
            -2 * e * (1 - one_less_c), e * e};
}

} // namespace

std::vector<double> product(const std::vector<double>& p, const std::vector<double>& q) {
    std::vector<double> result(p.size() + q.size() - 1);
    for (std::size_t i = 0; i < p.size(); ++i) {
        for (std::size_t j = 0; j < q.size(); ++j) result[i + j] += p[i] * q[j];
    }
    return result;
}

DiscretePlant::DiscretePlant(const ModalModel& model, double sample_time) : sample_time_(sample_time) {
    if (model.rigid_gain != 0) sections_.push_back(rigid_section(model.rigid_gain, sample_time));
    for (const auto& mode : model.modes) sections_.push_back(mode_section(mode, sample_time));
    if (sections_.empty()) throw InputError("the model has neither a rigid gain nor a mode, must have one of them");
    numerator_ = times_numerator({1});
    denominator_ = times_denominator({1});
}

std::vector<double> DiscretePlant::times_numerator(const std::vector<double>& sequence) const {
    std::vector<double> sum(sequence.size() + order());
    for (std::size_t i = 0; i < sections_.size(); ++i) {
        std::vector<double> term = sequence;
        for (std::size_t j = 0; j < sections_.size(); ++j) {
            if (j != i) term = product(term, {1, sections_[j].a1, sections_[j].a2});
        }
        term = product(term, {0, sections_[i].b1, sections_[i].b2});
        for (std::size_t n = 0; n < term.size(); ++n) sum[n] += term[n];
    }
    return sum;
}

std::vector<double> DiscretePlant::times_denominator(std::vector<double> sequence) const {
    for (const auto& section : sections_) sequence = product(sequence, {1, section.a1, section.a2});
    return sequence;
}

std::vector<std::complex<double>> DiscretePlant::poles() const {
    std::vector<std::complex<double>> result;
    for (const auto& section : sections_) {
        const auto root = std::sqrt(std::complex<double>(section.a1 * section.a1 / 4 - section.a2));
        result.push_back(-section.a1 / 2 + root);
        result.push_back(-section.a1 / 2 - root);
    }
    return result;
}

std::vector<std::complex<double>> DiscretePlant::zeros() const {
    const auto size = static_cast<Eigen::Index>(order()) - 1;
    Eigen::MatrixXd companion = Eigen::MatrixXd::Zero(size, size);
    for (Eigen::Index i = 0; i < size; ++i) {
        companion(0, i) = -numerator_[static_cast<std::size_t>(i) + 2] / numerator_[1];
        if (i > 0) companion(i, i - 1) = 1;
    }
    const Eigen::VectorXcd roots = companion.eigenvalues();
    return {roots.begin(), roots.end()};
}

std::complex<double> DiscretePlant::response(double frequency_hz) const {
    const auto d = std::polar(1.0, -2 * pi * frequency_hz * sample_time_); // z^-1
    std::complex<double> sum = 0;
    for (const auto& s : sections_) sum += d * (s.b1 + s.b2 * d) / (1.0 + d * (s.a1 + s.a2 * d));
    return sum;
}

std::vector<double> DiscretePlant::simulate(const std::vector<double>& thrust) const {
    std::vector<double> position(thrust.size());
    for (const auto& s : sections_) {
        double next = 0, after = 0; // what the past contributes to the next position and the one after [m]
        for (std::size_t k = 0; k < thrust.size(); ++k) {
            const double now = next;
            position[k] += now;
            next = after + s.b1 * thrust[k] - s.a1 * now;
            after = s.b2 * thrust[k] - s.a2 * now;
        }
    }
    return position;
}

} // namespace tribode
