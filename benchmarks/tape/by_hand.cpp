#include "tape/by_hand.hpp"

#include <cmath>

namespace tribode {

void products_by_hand(const double* x, double* dxdt) {
    const double d1 = x[0] - x[1], d2 = x[1] - x[2];
    dxdt[0] = x[3];
    dxdt[1] = x[4];
    dxdt[2] = x[5];
    dxdt[3] = -1.5 * x[0] - 0.3 * x[0] * x[0] * x[0] - 0.7 * d1 - 0.2 * d1 * d1 * d1 - 0.11 * x[3] -
              0.05 * (x[3] - x[4]) + 0.9 * x[5] - 0.01 * x[3] * x[3] * x[3] + 0.02 * x[0] * x[3];
    dxdt[4] = -1.7 * x[1] + 0.7 * d1 + 0.2 * d1 * d1 * d1 - 0.8 * d2 - 0.4 * d2 * d2 * d2 - 0.12 * x[4] +
              0.05 * (x[3] - x[4]) - 0.06 * (x[4] - x[5]) + 0.03 * x[1] * x[4];
    dxdt[5] = -1.9 * x[2] - 0.6 * x[2] * x[2] * x[2] + 0.8 * d2 + 0.4 * d2 * d2 * d2 - 0.13 * x[5] +
              0.06 * (x[4] - x[5]) - 0.02 * x[5] * x[5] * x[5] + 0.04 * x[2] * x[5] + 0.5;
}

void functions_by_hand(const double* x, double* dxdt) {
    const double d1 = x[0] - x[1], d2 = x[1] - x[2];
    dxdt[0] = x[3];
    dxdt[1] = x[4];
    dxdt[2] = x[5];
    dxdt[3] = -1.5 * std::sin(x[0]) - 0.3 * std::tanh(x[3]) - 0.7 * d1 - 0.2 * d1 * d1 * d1 - 0.11 * x[3] -
              0.05 * (x[3] - x[4]) + 0.9 * std::cos(x[2]) - 0.01 * x[3] * x[3] * x[3] + 0.02 * x[0] * x[3];
    dxdt[4] = -1.7 * std::sin(x[1]) + 0.7 * d1 + 0.2 * d1 * d1 * d1 - 0.8 * d2 - 0.4 * std::tanh(x[4]) - 0.12 * x[4] +
              0.05 * (x[3] - x[4]) - 0.06 * (x[4] - x[5]) + 0.03 * x[1] * x[4];
    dxdt[5] = -1.9 * std::sin(x[2]) - 0.6 * std::tanh(x[5]) + 0.8 * d2 + 0.4 * std::cos(d2) - 0.13 * x[5] +
              0.06 * (x[4] - x[5]) - 0.02 * x[5] * x[5] * x[5] + 0.04 * x[2] * x[5] + 0.5;
}

} // namespace tribode
