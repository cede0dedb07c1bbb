#include "tribode/analysis/modal_model.hpp"

#include <numbers>

namespace tribode {

std::complex<double> ModalModel::response(double frequency_hz) const {
    const double omega = 2 * std::numbers::pi * frequency_hz;
    std::complex<double> sum = rigid_gain == 0 ? 0.0 : -rigid_gain / (omega * omega);
    for (const VibrationMode& mode : modes) {
        const double own = 2 * std::numbers::pi * mode.freq_hz;
        sum += mode.gain / std::complex<double>(own * own - omega * omega, 2 * mode.zeta * own * omega);
    }
    return sum;
}

} // namespace tribode
