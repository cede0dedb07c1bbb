#include "tribode/diagnosis/residual_force.hpp"
#include "tribode/analysis/friction_identification.hpp"

#include <unsupported/Eigen/FFT>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace tribode {

namespace {

using Complex = std::complex<double>;
using std::numbers::pi;

// Filter and end effects die out over this time; it is left out at both ends [s].
constexpr double margin = 0.05;

// A length whose factors are small, as a fast Fourier transform likes it.
std::size_t good_length(std::size_t length) {
    for (;; --length) {
        std::size_t rest = length;
        for (const std::size_t factor : {2u, 3u, 5u}) {
            while (rest % factor == 0) rest /= factor;
        }
        if (rest == 1) return length;
    }
}

// A record as a periodic signal: the line from its first to its last value taken out.
struct Spectrum {
    std::vector<Complex> line;
    double first = 0, slope = 0; // of the line taken out, per sample
    double step;                 // of the frequencies [Hz]

    Spectrum(const std::vector<double>& values, std::size_t length, double sample_time)
        : step(1 / (static_cast<double>(length) * sample_time)) {
        first = values.front();
        slope = (values[length - 1] - values.front()) / static_cast<double>(length);
        std::vector<double> periodic(length);
        for (std::size_t k = 0; k < length; ++k) periodic[k] = values[k] - first - slope * static_cast<double>(k);
        Eigen::FFT<double> fft;
        fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
        fft.fwd(line, periodic);
    }

    // The signal behind a filter H(j omega); the line goes through by its value and slope at zero frequency.
    template <class Filter>
    std::vector<double> filtered(std::size_t length, const Filter& filter, double at_zero, double line_rate = 0) const {
        std::vector<Complex> out(line.size());
        for (std::size_t k = 0; k < line.size(); ++k)
            out[k] = line[k] * (k == 0 ? Complex(at_zero) : filter(step * static_cast<double>(k)));
        std::vector<double> values;
        Eigen::FFT<double> fft;
        fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
        fft.inv(values, out, static_cast<Eigen::Index>(length));
        for (std::size_t k = 0; k < length; ++k) {
            values[k] += at_zero * (first + slope * static_cast<double>(k)) + line_rate * slope;
        }
        return values;
    }
};

Complex plant(const MachineModel& machine, double f) {
    const Complex s(0, 2 * pi * f);
    Complex sum = machine.rigid_gain / (s * s);
    for (const auto& mode : machine.modes) {
        const double w = 2 * pi * mode.freq_hz;
        sum += mode.gain / (s * s + 2 * mode.zeta * w * s + w * w);
    }
    return sum;
}

struct Motion {
    std::vector<double> position, velocity, inertial, thrust, thrust_rate, friction;
};

Motion motion_of(const MachineModel& machine, const std::vector<double>& y, const std::vector<double>& u,
                 double bandwidth, std::size_t length) {
    const double Ts = machine.sample_time;
    const auto low_pass = [bandwidth](double f) { return 1 / (1 + std::pow(f / bandwidth, 8)); };
    const auto ahead = [&](double f) { return std::polar(1.0, 2 * pi * f * machine.output_delay); };
    double stiffness = 0;
    if (machine.rigid_gain == 0) stiffness = (1.0 / plant(machine, 1e-9)).real();
    const Spectrum positions(y, length, Ts);
    Motion m;
    m.position = positions.filtered(
        length, [&](double f) { return ahead(f) * low_pass(f); }, 1, machine.output_delay / Ts);
    m.velocity = positions.filtered(
        length, [&](double f) { return Complex(0, 2 * pi * f) * ahead(f) * low_pass(f); }, 0, 1 / Ts);
    m.inertial = positions.filtered(
        length, [&](double f) { return ahead(f) * (low_pass(f) / plant(machine, f)); }, stiffness);
    const auto drive = [&](double f) {
        const Complex s(0, 2 * pi * f);
        Complex h = std::exp(-s * machine.input_delay) * (1.0 - std::exp(-s * Ts)) / (s * Ts);
        if (machine.input == InputKind::band_limited) h = std::exp(-s * machine.input_delay);
        if (machine.current_loop_hz > 0) h /= 1.0 + s / (2 * pi * machine.current_loop_hz);
        return h * low_pass(f);
    };
    const Spectrum thrusts(u, length, Ts);
    m.thrust = thrusts.filtered(length, drive, 1);
    m.thrust_rate = thrusts.filtered(
        length, [&](double f) { return drive(f) * Complex(0, 2 * pi * f); }, 0, 1 / Ts);
    // Friction along the way. Where the velocity is no more than its noise, dry friction is taken in proportion.
    m.friction = rolling_force(machine.elements, m.position);
    double fastest = 0;
    for (const double v : m.velocity) fastest = std::max(fastest, std::abs(v));
    const double slow = 3e-3 * fastest;
    for (std::size_t k = 0; k < length; ++k) {
        const double v = m.velocity[k];
        m.friction[k] += machine.viscous * v + machine.dry.level(v) * std::clamp(v / slow, -1.0, 1.0);
    }
    m.friction = Spectrum(m.friction, length, Ts).filtered(length, low_pass, 1);
    return m;
}

} // namespace

ResidualForce residual_force(const MachineModel& machine, const Measurement& measurement,
                             const SimulatedSignals& simulated, double asked_bandwidth) {
    const std::size_t length = good_length(measurement.size());
    const double Ts = machine.sample_time;
    ResidualForce result;
    // The widest band in which noise and rounding stay well below the force that is looked for.
    const double white = std::hypot(machine.noise_rms, machine.encoder_resolution / std::sqrt(12.0));
    for (const double bandwidth : {200.0, 150.0, 100.0, 60.0, 40.0}) {
        if (bandwidth > 0.2 / Ts || (asked_bandwidth > 0 && bandwidth != asked_bandwidth)) continue;
        const Motion measured = motion_of(machine, measurement.position(), measurement.thrust, bandwidth, length);
        const Motion model = motion_of(machine, simulated.position, simulated.thrust, bandwidth, length);
        double noise = 0;
        for (double f = 1; f < 3 * bandwidth; f += 1) {
            noise += std::norm(1.0 / (plant(machine, f) * (1 + std::pow(f / bandwidth, 8)))) * white * white * 2 * Ts;
        }
        result = {};
        result.bandwidth = bandwidth;
        result.noise = std::sqrt(noise);
        const std::size_t stride = std::max<std::size_t>(1, static_cast<std::size_t>(1 / (5 * bandwidth * Ts)));
        const auto skip = static_cast<std::size_t>(margin / Ts);
        result.sample_time = static_cast<double>(stride) * Ts;
        double square = 0;
        for (std::size_t k = skip; k + skip < length; k += stride) {
            result.index.push_back(k);
            result.time.push_back(static_cast<double>(k) * Ts);
            result.position.push_back(measured.position[k]);
            result.velocity.push_back(measured.velocity[k]);
            result.inertial.push_back(measured.inertial[k]);
            result.thrust.push_back(measured.thrust[k]);
            result.thrust_rate.push_back(measured.thrust_rate[k]);
            result.reference_thrust.push_back(measurement.thrust[k]);
            result.friction.push_back(measured.friction[k]);
            const double force = (measured.inertial[k] + measured.friction[k] - measured.thrust[k]) -
                                 (model.inertial[k] + model.friction[k] - model.thrust[k]);
            result.force.push_back(force);
            square += force * force;
        }
        if (!result.force.empty() && std::sqrt(square / static_cast<double>(result.force.size())) > 3 * result.noise)
            break;
    }
    return result;
}

} // namespace tribode
