#pragma once
#include <algorithm>
#include <cstddef>
#include <vector>

namespace tribode {

using Signal = std::vector<double>;

struct Regression {
    std::vector<double> coefficients;
    double explained; // share of the sum of squares
};

// A signal as a sum of columns of its length, by least squares.
Regression regress(const std::vector<Signal>& columns, const Signal& target);

template <class Function>
Signal map(const Signal& x, const Function& f) {
    Signal y(x.size());
    std::transform(x.begin(), x.end(), y.begin(), f);
    return y;
}

double largest(const Signal& x); // of the absolute values
double rms(const Signal& x);
std::vector<double> geometric(double from, double to, int count);

// A sinusoid of x found in a signal: amplitude sin(2 pi x/period + phase).
struct Sinusoid {
    double period, amplitude, phase, explained;
};

// The sinusoids of x, times a weight if one is given, that explain most of a signal, one at a time, periods from `shortest`
// to `longest`. Fine periods are proposed by the spectrum of the signal collected in bins of x, long ones by trying.
std::vector<Sinusoid> sinusoids(const Signal& x, const Signal& target, const Signal& weight, double shortest,
                                double longest, std::size_t count);

} // namespace tribode
