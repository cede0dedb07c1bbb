#pragma once
#include "tribode/base/lanes.hpp"

#include <Eigen/Core>
#include <complex>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

namespace tribode {

// What a modal model is fitted to: a response at one frequency.
struct ResponsePoint {
    double omega; // [rad/s]
    std::complex<double> value;
};

// Descent of a modal model P to the nearest least cost, for a given number of modes. The unknowns are logarithms: of k0, then of
// k, w and zeta of each mode, each between bounds. With r = ln(H/P) at a frequency and the scale a of the loss the cost is
//
//     sum a^2/2 ln(1 + abs(r)^2/a^2),   infinite a: sum abs(r)^2/2
//
// Levenberg-Marquardt: steps of least squares, the equations weighted by 1/(1 + abs(r)^2/a^2), the unknowns scaled to columns of
// length one. The damping follows from how well the last step kept what it promised, without jumps [Madsen 2004]. Least squares go
// by an orthogonal decomposition, so that also modes that the data hardly tell apart keep their digits.
class ModalDescent {
  public:
    struct Bounds {
        double low, high;
    };
    struct Result {
        std::vector<double> logarithms;
        double cost = std::numeric_limits<double>::infinity();
        int iterations = 0;
        bool converged = false;
    };

    // bounds: of k0 and k, of w, of zeta, as logarithms.
    ModalDescent(std::span<const ResponsePoint> points, Bounds gain, Bounds omega, Bounds zeta);

    Result descend(std::vector<double> start, double scale, int max_iterations);

    Bounds bounds(std::size_t unknown) const {
        if (unknown % 3 == 0 && unknown > 0) return zeta_;
        return unknown % 3 == 2 ? omega_bounds_ : gain_;
    }

    // ln(H/P) at each frequency, gain [neper] and phase [rad], and the derivatives of all gains, then of all phases.
    struct Residuals {
        std::vector<double> gain, phase;
        Eigen::MatrixXd derivatives;
    };
    Residuals residuals(std::span<const double> logarithms);

  private:
    void evaluate(std::span<const double> logarithms);
    void differentiate(std::size_t unknowns);
    double weigh(double scale);
    void decompose(std::size_t unknowns);

    std::size_t count_, blocks_; // frequencies, and the vectors that hold them; the last point fills them up
    Bounds gain_, omega_bounds_, zeta_;
    std::vector<Lanes> omega_, square_, real_, imag_, norm_; // w, w^2, H, abs(H)^2
    // At the point that was evaluated last: parts of the model, and residuals.
    struct Mode {
        double gain, square, damp; // k, w^2, 2 w zeta
    };
    double rigid_gain_ = 0;
    std::vector<Mode> modes_;
    std::vector<Lanes> receptance_;  // of each mode: real, then imaginary parts of P by k
    std::vector<Lanes> model_;       // P, as real and imaginary parts
    std::vector<Lanes> gain_error_;  // the residuals: ln abs(H/P)
    std::vector<Lanes> phase_error_; // arg(H/P)
    std::vector<Lanes> weight_;      // their roots, for the equations; zero where there is no point
    std::vector<Lanes>
        columns_;              // the equations: a column of all gains and phases for each unknown, then the right side
    Eigen::MatrixXd triangle_; // what is left of them
    Eigen::VectorXd right_;
};

} // namespace tribode
