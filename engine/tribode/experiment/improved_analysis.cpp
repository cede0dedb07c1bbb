#include "tribode/experiment/improved_analysis.hpp"
#include "tribode/analysis/periodic_friction.hpp"

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

std::complex<double> actuator_response(const MachineModel& machine, double frequency_hz) {
    const ServoAxis axis = machine.axis(); // as it is, with its effects
    const double half_turn = pi * frequency_hz * machine.sample_time;
    const double late = half_turn + 2 * pi * frequency_hz * axis.input_delay;
    std::complex<double> response = std::polar(std::sin(half_turn) / half_turn, -late);
    const double corner = axis.plant.current_loop_hz;
    if (corner > 0) response /= std::complex(1.0, frequency_hz / corner);
    return response;
}

std::complex<double> improved_thrust(const MachineModel& machine, const FrictionModel& model, double frequency_hz,
                                     std::complex<double> thrust, std::vector<std::complex<double>> position) {
    for (std::size_t n = 0; n < position.size(); ++n) position[n] *= undelayed(machine, frequency_hz, n + 1);
    const auto friction = friction_phasor(position, frequency_hz, model.elements, model.viscous);
    return actuator_response(machine, frequency_hz) * thrust - friction;
}

std::complex<double> improved_response(const MachineModel& machine, const FrictionModel& model, double frequency_hz,
                                       std::complex<double> thrust, const std::vector<std::complex<double>>& position) {
    return position.front() * undelayed(machine, frequency_hz, 1) /
           improved_thrust(machine, model, frequency_hz, thrust, position);
}

} // namespace tribode
