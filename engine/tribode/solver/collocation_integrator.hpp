#pragma once
#include "tribode/solver/series_integrator.hpp"

namespace tribode {

// Exponential collocation, for systems that are affine but for a few smooth functions w (PiecewiseAffine::forcing):
//
//     dx/dt = A x + b + B w(t, x)
//
// Over a step of length h each w is a cubic in s through its values at the four Lobatto nodes s = 0, (1 -+ 1/sqrt 5)/2, 1.
// For given cubics x is known exactly, as the Taylor series of ExactIntegrator with the coefficients of B w added; from
// x at the nodes come new values of w, again and again until x(1) no longer changes (waveform relaxation; each round
// gains a factor of about h dw/dv, h^2 dw/dy). The stiff part A costs nothing: what limits h is how fast w bends. See
// [Hochbruck 2010], section 2, for exponential methods.
//
// The error of a step is held below the tolerance by two estimates: the change of x(1) in the last round, and what
// the cubic part of w does to x, which is that of a quadratic w and so rather too large. A step that fails is halved.
// What bounds the guards in a step of a length that recurs is prepared once, with the responses of x to every value of w.
// docs/decisions/0015 has the measurements.
class CollocationIntegrator final : public SeriesIntegrator {
  public:
    // Throws InputError, with the reason, where the system is not nearly affine.
    CollocationIntegrator(const HybridSystem& system, const SolverOptions& options);

    void restart(SystemState& state) override;
    Progress step(double t_stop) override;
    void interpolate(double t, std::span<double> x) override;

  private:
    static constexpr std::size_t nodes = 3; // besides s = 0
    static constexpr int max_rounds = 6;

    using Cubic = std::array<double, nodes + 1>; // coefficients of s^n

    // How one guard moves in a step from the derivative f at its beginning: first and second coefficient, and at most
    // rest abs(f) beside them; and at most forced times how far w leaves its value at the beginning.
    struct Reach {
        std::vector<double> first, second, rest; // (states)
        std::vector<double> forced;              // (w)
        bool moves;
    };

    struct Prepared {
        double h;
        std::array<Columns, nodes> psi; // x at the node: x + psi f, w staying as it is (height x states)
        std::array<Columns, nodes>
            response;             // and by how much more, w having other values at the nodes (height x w nodes)
        std::vector<Reach> reach; // (guards)
    };

    struct ForcedPattern : Pattern<Prepared> {
        Columns a, b;                       // (height x states), (height x w)
        std::vector<double> size;           // (2 height): largest |B|, |A B| of every w, how an error of w enters x
        std::vector<std::vector<double>> g; // (guards x states)
        std::vector<double> c;              // (guards x w)
        bool forced = false;                // B or C is not zero
    };

    static const HybridSystem& checked(const HybridSystem& system);
    ForcedPattern make_pattern() const;
    void prepare(double h);
    const Prepared* prepared_for_length(double h) const { return varies_ ? nullptr : prepared_for(*pattern_, h); }
    double first_length(double whole, double t_stop);
    bool settle(double h, const Prepared* prepared, double& error);
    bool clear_of_guards(const Prepared& prepared) const;
    bool expand(double h);
    double find_crossing();
    void fit_cubics();
    void evaluate(double s, double* x) const;

    const std::size_t forcing_count_;
    const double relative_tolerance_;
    std::vector<double> absolute_tolerance_; // (states)
    Patterns<ForcedPattern> patterns_;
    ForcedPattern* pattern_ = nullptr;
    bool varies_ = false;                      // b does
    double longest_;                           // step that the error allows [s]
    double piece_ = 0, piece_end_ = 0;         // an interval in equal pieces: their length, its end [s]
    Columns slope_;                            // f at t0_
    std::array<Columns, nodes> free_, at_;     // x at the nodes with w as at the beginning, and as it is
    std::vector<double> w0_, w_, dw_, before_; // (w), (w), (nodes x w): w at the nodes less w0_
    std::vector<Cubic> cubics_;                // (w)
    Columns work_, largest_;
    std::vector<double> tolerance_; // (height), of the present step, inverse
};

} // namespace tribode
