#include "tribode/design/zero_phase_feedforward.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/control/discrete_transfer_function.hpp"
#include "tribode/design/discrete_plant.hpp"
#include "tribode/design/s_curve_feedforward.hpp"

#include <fmt/format.h>

namespace tribode {

namespace {

using Complex = std::complex<double>;

bool may_be_cancelled(Complex zero) { return std::abs(zero) < (zero.real() < 0 ? 0.8 : 1.0); }

// The polynomial of z^-1 with these zeros; complex ones come in pairs.
std::vector<double> with_zeros(const std::vector<Complex>& zeros) {
    std::vector<Complex> sum = {1};
    for (const Complex zero : zeros) {
        sum.push_back(0);
        for (std::size_t i = sum.size() - 1; i > 0; --i) sum[i] -= zero * sum[i - 1];
    }
    std::vector<double> real;
    for (const Complex c : sum) real.push_back(c.real());
    return real;
}

} // namespace

Feedforward zero_phase_feedforward(const ModalModel& model, const MoveTask& task) {
    const DiscretePlant plant(model, task.sample_time);
    std::vector<Complex> cancelled, kept;
    for (const Complex zero : plant.zeros()) (may_be_cancelled(zero) ? cancelled : kept).push_back(zero);
    const std::size_t end = task.settling_sample(), p = kept.size();
    if (end <= 2 * p) {
        throw InputError(fmt::format("zero phase error tracking: the duration {} s is {} samples, must be more than {}",
                                     to_text(task.duration), end, 2 * p));
    }
    const SCurve path(task.distance, static_cast<double>(end - 2 * p) * task.sample_time);
    const auto demanded = [&](long k) {
        return path.position(static_cast<double>(k - static_cast<long>(p)) * task.sample_time);
    };
    const std::vector<double> bu = with_zeros(kept);
    double static_gain = 0; // Bu(1)
    for (const double b : bu) static_gain += b;
    std::vector<double> below = with_zeros(cancelled);
    for (double& b : below) b *= plant.numerator()[1];
    DiscreteTransferFunction inverse({1.0}, below);

    Feedforward result{"zero_phase", task, {}, {}};
    std::vector<double> filtered; // Bu(z)/Bu(1)^2 r_d[k+1]
    for (std::size_t k = 0; k < task.length(); ++k) {
        double ahead = 0, both = 0; // Bu(z) r_d[k+1], Bu(z) Bu(z^-1) r_d[k]
        for (std::size_t i = 0; i < bu.size(); ++i) {
            const long now = static_cast<long>(k + i);
            ahead += bu[i] * demanded(now + 1);
            for (std::size_t j = 0; j < bu.size(); ++j) both += bu[i] * bu[j] * demanded(now - static_cast<long>(j));
        }
        result.reference.push_back(both / (static_gain * static_gain));
        filtered.push_back(ahead / (static_gain * static_gain));
    }
    filtered = plant.times_denominator(std::move(filtered));
    for (std::size_t k = 0; k < task.length(); ++k) result.thrust.push_back(inverse.step(filtered[k]));
    return result;
}

} // namespace tribode
