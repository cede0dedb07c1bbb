#pragma once
#include "tribode/analysis/modal_model.hpp"

#include <complex>
#include <vector>

namespace tribode {

// A ModalModel behind a zero-order hold, seen at the sample instants:
//
//     P(z) = sum_i (b1_i z^-1 + b2_i z^-2)/(1 + a1_i z^-1 + a2_i z^-2) = N(z)/D(z)
//
// with one section for the rigid body (double pole at z = 1) and one per mode (poles exp(s Ts)), each in closed form.
// The sums are exact at the instants; the half sample by which the hold delays is part of P(z). D has the degree
// 2 (modes + 1), N one z^-1 in front and as many coefficients behind it.
class DiscretePlant {
  public:
    struct Section {
        double b1, b2; // [m/N]
        double a1, a2;
    };

    // sample_time [s]. Throws InputError where the model has neither a rigid gain nor a mode.
    DiscretePlant(const ModalModel& model, double sample_time);

    const std::vector<Section>& sections() const { return sections_; }

    // Coefficients of ascending powers of z^-1, from z^0: N begins with 0, D with 1; both have order() + 1.
    const std::vector<double>& numerator() const { return numerator_; } // [m/N]
    const std::vector<double>& denominator() const { return denominator_; }
    // N(z) and D(z) times a sequence (a polynomial of z^-1), factor by factor. On a smooth sequence that is more exact than
    // the coefficients are: D is a difference of high order, small at all low frequencies.
    std::vector<double> times_numerator(const std::vector<double>& sequence) const;
    std::vector<double> times_denominator(std::vector<double> sequence) const;
    std::size_t order() const { return 2 * sections_.size(); }

    std::vector<std::complex<double>> poles() const;          // of the sections, in their order
    std::vector<std::complex<double>> zeros() const;          // of z^order N(z)
    std::complex<double> response(double frequency_hz) const; // [m/N]; from the sections

    // Position at the instants 0 .. n-1 for thrust[k] held from instant k to the next, from rest.
    std::vector<double> simulate(const std::vector<double>& thrust) const;

  private:
    double sample_time_;
    std::vector<Section> sections_;
    std::vector<double> numerator_, denominator_;
};

// Coefficients of the product of two polynomials.
std::vector<double> product(const std::vector<double>& p, const std::vector<double>& q);

} // namespace tribode
