#pragma once
#include <complex>
#include <vector>

namespace tribode {

// H(z) = (b0 + b1 z^-1 + ...)/(1 + a1 z^-1 + ...), in transposed direct form II.
class DiscreteTransferFunction {
  public:
    // Coefficients of ascending powers of z^-1; the denominator's first must not be zero. Both are divided by it.
    DiscreteTransferFunction(std::vector<double> numerator, std::vector<double> denominator);

    // Pade approximant of order n of the dead time L [s] (eq. (19) for n = 4), brought to the sample time [s] by the
    // bilinear transform. All-pass: gain one at every frequency. Its delay is L (1 + (w Ts)^2/12 + ...) for w Ts < 1
    // (the transform's warping): 0.6 % too long at 82 Hz with 500 us. L = 0 gives H = 1.
    static DiscreteTransferFunction pade_delay(double delay, int order, double sample_time);

    double step(double input);
    void reset();
    std::complex<double> response(double frequency_hz, double sample_time) const;

  private:
    std::vector<double> b_, a_, memory_;
};

} // namespace tribode
