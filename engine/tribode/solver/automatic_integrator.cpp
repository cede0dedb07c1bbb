#include "tribode/solver/automatic_integrator.hpp"

namespace tribode {

namespace {

// Chosen on the problems of tests/problems: stiff ones stay between 2.9 and 3.4 on the average, and below only where their
// steps follow the accuracy; smooth ones never come above 2.5 at two looks in a row.
constexpr double stiff_above = 2.5;    // ErkIntegrator::stability_number()
constexpr int steps_between_looks = 8; // so that looking costs nothing
constexpr int stiff_looks_needed = 12; // in a row

} // namespace

AutomaticIntegrator::AutomaticIntegrator(const HybridSystem& system, const SolverOptions& options)
    : system_(system),
      options_(options),
      explicit_(system, options) {}

void AutomaticIntegrator::restart(SystemState& state) {
    state_ = &state;
    steps_ = stiff_looks_ = 0;
    active().restart(state);
}

Integrator::Progress AutomaticIntegrator::step(double t_stop) {
    // Not before the next step is asked for: until then the last one is to be interpolated.
    if (!stiff_ && stiff_looks_ == stiff_looks_needed) go_on_as_stiff();
    const Progress progress = active().step(t_stop);
    if (progress == Progress::crossing) crossed_ = active().crossed();
    if (progress == Progress::failed) failure_ = active().failure();
    if (!stiff_ && ++steps_ % steps_between_looks == 0) {
        stiff_looks_ = explicit_.stability_number() > stiff_above ? stiff_looks_ + 1 : 0;
    }
    return progress;
}

void AutomaticIntegrator::go_on_as_stiff() {
    SolverOptions options = options_;
    options.method = Method::bdf;
    stiff_ = std::make_unique<CvodeIntegrator>(system_, options);
    stiff_from_ = state_->t;
    stiff_->restart(*state_);
}

RunStatistics AutomaticIntegrator::statistics() const {
    RunStatistics all = explicit_.statistics();
    if (stiff_) all += stiff_->statistics();
    return all;
}

} // namespace tribode
