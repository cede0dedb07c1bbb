#pragma once
#include "tribode/solver/cvode_integrator.hpp"
#include "tribode/solver/erk_integrator.hpp"

namespace tribode {

// Begins as erk and goes on as BDF from where the problem turns out to be stiff: where stability alone has kept a hundred
// steps short. It does not go back: BDF loses little on a smooth stretch, and a problem that was stiff once mostly is again.
// The steps count from the last restart, so a sampled loop, in which a method of several steps would begin anew with every
// sample, stays with erk unless that takes more than a hundred steps from sample to sample.
class AutomaticIntegrator final : public Integrator {
  public:
    AutomaticIntegrator(const HybridSystem& system, const SolverOptions& options);

    void restart(SystemState& state) override;
    void change_guards(SystemState& state) override { active().change_guards(state); }
    Progress step(double t_stop) override;
    void interpolate(double t, std::span<double> x) override { active().interpolate(t, x); }
    double proposed_step() const override { return active().proposed_step(); }
    void propose_step(double h) override { active().propose_step(h); }
    RunStatistics statistics() const override;
    std::optional<double> stiff_from() const override { return stiff_from_; }

  private:
    SundialsIntegrator& active() { return stiff_ ? static_cast<SundialsIntegrator&>(*stiff_) : explicit_; }
    const SundialsIntegrator& active() const {
        return stiff_ ? static_cast<const SundialsIntegrator&>(*stiff_) : explicit_;
    }
    void go_on_as_stiff();

    const HybridSystem& system_;
    const SolverOptions options_;
    ErkIntegrator explicit_;
    std::unique_ptr<CvodeIntegrator> stiff_; // from there on
    SystemState* state_ = nullptr;
    int steps_ = 0, stiff_looks_ = 0;  // since the last restart; in a row
    std::optional<double> stiff_from_; // [s]
};

} // namespace tribode
