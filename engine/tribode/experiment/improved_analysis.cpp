#include "tribode/experiment/improved_analysis.hpp"
#include "tribode/analysis/periodic_friction.hpp"

#include <unsupported/Eigen/FFT>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

namespace tribode {

using std::numbers::pi;

namespace {

// Of the n-th harmonic, from the detected position to that of the driven point.
std::complex<double> undelayed(const MachineModel& machine, double frequency_hz, std::size_t harmonic) {
    return std::polar(1.0, 2 * pi * static_cast<double>(harmonic) * frequency_hz * machine.output_delay);
}

} // namespace

double loop_dead_time(const MachineModel& machine) {
    const double hold = machine.input == InputKind::hold ? machine.sample_time / 2 : 0;
    const double lag = machine.current_loop_hz > 0 ? 1 / (2 * std::numbers::pi * machine.current_loop_hz) : 0;
    return hold + lag + machine.input_delay + machine.output_delay;
}

std::complex<double> actuator_response(const MachineModel& machine, double frequency_hz) {
    const ServoAxis axis = machine.axis(); // as it is, with its effects
    const double half_turn = machine.input == InputKind::hold ? pi * frequency_hz * machine.sample_time : 0;
    const double late = half_turn + 2 * pi * frequency_hz * axis.input_delay;
    std::complex<double> response = std::polar(half_turn == 0 ? 1 : std::sin(half_turn) / half_turn, -late);
    const double corner = axis.plant.current_loop_hz;
    if (corner > 0) response /= std::complex(1.0, frequency_hz / corner);
    return response;
}

namespace {

// Of the laws under a steady motion, whose phasors these are at the driven point, as friction_phasor(). thrust: of the motor.
std::complex<double> law_phasor(const std::vector<Effect>& laws, double frequency_hz,
                                const std::vector<std::complex<double>>& position, std::complex<double> thrust) {
    constexpr int points = 2000, periods = 3; // two to settle
    const double omega = 2 * pi * frequency_hz;
    SampledLaws sampled(laws, 1 / (frequency_hz * points));
    std::complex<double> sum = 0;
    for (int i = 0; i < periods * points; ++i) {
        const auto turn = std::polar(1.0, 2 * pi * (i % points) / points);
        std::complex<double> power = turn;
        double y = 0, v = 0;
        for (std::size_t n = 0; n < position.size(); ++n, power *= turn) {
            y += (position[n] * power).real();
            v -= static_cast<double>(n + 1) * omega * (position[n] * power).imag();
        }
        sampled.step(y, std::abs((thrust * turn).real()));
        if (i >= (periods - 1) * points) sum += sampled.force(v) * std::conj(turn);
    }
    return sum * (2.0 / points);
}

} // namespace

std::complex<double> improved_thrust(const MachineModel& machine, const FrictionModel& model, double frequency_hz,
                                     std::complex<double> thrust, std::vector<std::complex<double>> position) {
    for (std::size_t n = 0; n < position.size(); ++n) position[n] *= undelayed(machine, frequency_hz, n + 1);
    const auto driving = actuator_response(machine, frequency_hz) * thrust;
    auto friction = friction_phasor(position, frequency_hz, model.elements, model.viscous);
    if (!model.laws.empty()) friction += law_phasor(model.laws, frequency_hz, position, driving);
    return driving - friction;
}

std::complex<double> improved_response(const MachineModel& machine, const FrictionModel& model, double frequency_hz,
                                       std::complex<double> thrust, const std::vector<std::complex<double>>& position) {
    return position.front() * undelayed(machine, frequency_hz, 1) /
           improved_thrust(machine, model, frequency_hz, thrust, position);
}

std::vector<double> actuator_thrust(const MachineModel& machine, const std::vector<double>& thrust) {
    // Behind the record the signal goes back to its first value, so that its periodic continuation has no jump.
    const std::size_t count = thrust.size(), size = std::bit_ceil(count + 4096), pad = size - count;
    std::vector<std::complex<double>> samples(thrust.begin(), thrust.end()), lines;
    for (std::size_t i = 1; i <= pad; ++i) {
        const double share = 0.5 - 0.5 * std::cos(pi * static_cast<double>(i) / static_cast<double>(pad + 1));
        samples.push_back(thrust.back() + share * (thrust.front() - thrust.back()));
    }
    Eigen::FFT<double> fft;
    fft.fwd(lines, samples);
    for (std::size_t l = 1; l <= size / 2; ++l) {
        const double f = static_cast<double>(l) / static_cast<double>(size) / machine.sample_time;
        const auto factor = actuator_response(machine, f) * std::polar(1.0, -2 * pi * f * machine.output_delay);
        lines[l] *= 2 * l == size ? factor.real() : factor;
        lines[size - l] = std::conj(lines[l]);
    }
    fft.inv(samples, lines);
    std::vector<double> result(count);
    for (std::size_t k = 0; k < count; ++k) result[k] = samples[k].real();
    return result;
}

namespace {

// A low-pass at half the sampling rate between `finer` times as many instants: a sinc in a Hann window that reaches over some
// samples on each side.
constexpr long finer = 8, reach = 32;

double kernel(long distance) { // [finer instants]
    const double x = static_cast<double>(distance) / static_cast<double>(finer);
    const double hann = 0.5 + 0.5 * std::cos(pi * x / (reach + 1));
    return distance == 0 ? 1 : std::sin(pi * x) / (pi * x) * hann;
}

// Behind its ends a signal goes on as before, turned round.
double beyond(const std::vector<double>& signal, long k) {
    const long last = static_cast<long>(signal.size()) - 1;
    const auto at = [&](long i) { return signal[static_cast<std::size_t>(std::clamp(i, 0L, last))]; };
    if (k < 0) return 2 * signal.front() - at(-k);
    if (k > last) return 2 * signal.back() - at(2 * last - k);
    return at(k);
}

std::vector<double> interpolated(const std::vector<double>& signal) {
    std::vector<double> weight(static_cast<std::size_t>(finer * 2 * reach)), sum(finer);
    const auto place = [](long phase, long j) { return static_cast<std::size_t>(phase * 2 * reach + j + reach - 1); };
    for (long phase = 0; phase < finer; ++phase) {
        for (long j = 1 - reach; j <= reach; ++j) {
            sum[static_cast<std::size_t>(phase)] += weight[place(phase, j)] = kernel(finer * j - phase);
        }
    }
    std::vector<double> fine;
    fine.reserve(signal.size() * static_cast<std::size_t>(finer));
    for (long k = 0; k < static_cast<long>(signal.size()); ++k) {
        for (long phase = 0; phase < finer; ++phase) {
            double value = 0;
            for (long j = 1 - reach; j <= reach; ++j) value += weight[place(phase, j)] * beyond(signal, k + j);
            fine.push_back(value / sum[static_cast<std::size_t>(phase)]);
        }
    }
    fine.resize(fine.size() - static_cast<std::size_t>(finer - 1)); // up to the last sample
    return fine;
}

} // namespace

std::vector<double> friction_along(const MachineModel& machine, const FrictionModel& model,
                                   const std::vector<double>& position, const std::vector<double>& thrust) {
    if (model.elements.empty() && model.viscous == 0 && !model.dry.present() && model.laws.empty()) {
        return std::vector<double>(position.size());
    }
    const std::vector<double> y = interpolated(position), load = interpolated(thrust);
    MachineModel finely = machine;
    finely.sample_time /= finer;
    MeasuredFriction friction(model, finely);
    std::vector<double> force(y.size());
    for (std::size_t k = 0; k < y.size(); ++k) {
        const double before = y[k == 0 ? 0 : k - 1], after = y[std::min(k + 1, y.size() - 1)];
        force[k] = friction.step(y[k], load[k]);
        force[k] += friction.velocity_correction((after - before) / (2 * finely.sample_time));
    }
    std::vector<double> weight;
    double sum = 0;
    for (long j = -finer * reach; j <= finer * reach; ++j) sum += weight.emplace_back(kernel(j));
    std::vector<double> result;
    result.reserve(position.size());
    for (long k = 0; k < static_cast<long>(position.size()); ++k) {
        double value = 0;
        for (long j = -finer * reach; j <= finer * reach; ++j) {
            value += weight[static_cast<std::size_t>(j + finer * reach)] * beyond(force, finer * k + j);
        }
        result.push_back(value / sum);
    }
    return result;
}

} // namespace tribode
