#pragma once
#include "tribode/diagnosis/candidate.hpp"
#include "tribode/diagnosis/signal_fit.hpp"

#include <string>
#include <vector>

namespace tribode {

// Reads from the residual force where the fit of each effect should begin. Its parts: friction_candidates.cpp,
// force_candidates.cpp and drive_candidates.cpp (amplifier, structure, encoder).
class Proposer {
  public:
    explicit Proposer(const Clues& clues); // which must outlive it
    std::vector<Candidate> all();

  private:
    void coulomb();
    void viscous();
    void asymmetric();
    void stribeck();
    void presliding();
    void position_dependent();
    void time_varying();

    void constant();
    void ripple();
    void spring();
    void cubic();
    void drag();
    void disturbance();

    void dead_zone();
    void saturation();
    void thrust_gain();
    void payload();
    void delay();
    void lag();
    void mode();
    void backlash();
    void encoder();

    // Starts and probes are moved into the bounds; a candidate without any is left out.
    void add(Candidate candidate);

    // Bounds that no plausible machine comes near: forces against the thrust that was used, and so on.
    double force() const { return 20 * thrust_; }
    static FitParameter factor(const std::string& name, double low, double high) {
        return {name, low, high, true, 1e-3};
    }
    static FitParameter angle(const std::string& name) { return {name, -1e3, 1e3, false, 1e-3}; }

    double typical_force() const;
    double sized(double value) const; // at least what a start has, lest the first differences see nothing
    bool has_friction() const;

    const Clues& c_;
    const Signal &d_, &y_, &v_; // residual force, position and velocity
    Signal sign_;               // of the velocity, in between about zero
    double low_, high_, stroke_, reach_, fastest_, thrust_, duration_;
    double gain_; // of the machine, modes included [1/kg]
    std::vector<Candidate> list_;
};

} // namespace tribode
