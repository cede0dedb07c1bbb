#include "tribode/analysis/periodic_friction.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tribode {

namespace {

constexpr std::size_t points = 2000; // of a period

struct Motion {
    double position; // [m]
    double velocity; // [m/s]
};

std::vector<Motion> one_period(std::span<const std::complex<double>> harmonics, double omega,
                               const std::vector<std::complex<double>>& turns) {
    std::vector<Motion> motion;
    for (const auto turn : turns) {
        std::complex<double> power = turn;
        Motion now{0, 0};
        for (std::size_t n = 0; n < harmonics.size(); ++n, power *= turn) {
            const std::complex<double> part = harmonics[n] * power;
            now.position += part.real();
            now.velocity -= static_cast<double>(n + 1) * omega * part.imag();
        }
        motion.push_back(now);
    }
    return motion;
}

} // namespace

std::complex<double> friction_phasor(std::span<const std::complex<double>> position, double frequency_hz,
                                     const std::vector<MaxwellSlipElement>& elements, double viscous) {
    const double omega = 2 * std::numbers::pi * frequency_hz;
    std::vector<std::complex<double>> turns; // exp(j w t)
    for (std::size_t i = 0; i < points; ++i) {
        turns.push_back(std::polar(1.0, 2 * std::numbers::pi * static_cast<double>(i) / points));
    }
    const std::vector<Motion> motion = one_period(position, omega, turns);

    std::complex<double> sum = 0;
    for (const auto& element : elements) {
        const double limit = element.limit();
        double z = 0, previous = motion.front().position;
        const auto follow = [&](double to) {
            z = std::clamp(z + to - previous, -limit, limit);
            previous = to;
        };
        for (const Motion& now : motion) follow(now.position); // past both turning points
        for (std::size_t i = 0; i < points; ++i) {
            follow(motion[i].position);
            const double damping = std::abs(z) < limit ? element.damping * motion[i].velocity : 0.0;
            sum += (element.stiffness * z + damping) * std::conj(turns[i]);
        }
    }
    return sum * (2.0 / points) + std::complex(0.0, omega * viscous) * position.front();
}

} // namespace tribode
