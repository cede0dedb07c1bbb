#include "tribode/solver/erk_integrator.hpp"

#include <algorithm>
#include <arkode/arkode_erkstep.h>
#include <cmath>

namespace tribode {

namespace {

// The weights of the continuous extension's highest coefficient [Hairer 1993, II.6].
constexpr double d1 = -12715105075.0 / 11282082432.0, d3 = 87487479700.0 / 32700410799.0,
                 d4 = -10690763975.0 / 1880347072.0, d5 = 701980252875.0 / 199316789632.0,
                 d6 = -1453857185.0 / 822651844.0, d7 = 69997945.0 / 29380423.0;

constexpr SundialsLibrary erk_step = {ERKStepFree,         ERKStepSetErrHandlerFn,   ERKStepSetUserData,
                                      ERKStepSVtolerances, ERKStepSetMaxStep,        ERKStepSetInitStep,
                                      ERKStepSetStopTime,  ERKStepGetNumErrTestFails};

} // namespace

ErkIntegrator::ErkIntegrator(const HybridSystem& system, const SolverOptions& options)
    : SundialsIntegrator(system, options, erk_step),
      relative_tolerance_(options.relative_tolerance) {
    take_memory(ERKStepCreate(derivative_callback, 0.0, vector_.get(), context_.get()), "ERKStepCreate");
    set_up(options);
    check(ERKStepSetTableNum(memory(), ARKODE_DORMAND_PRINCE_7_4_5), "ERKStepSetTableNum");
    check(ERKStepSetAdaptivityFn(memory(), choose_step, this), "ERKStepSetAdaptivityFn");
    // What lies within a step is found from its slopes; the library interpolates at its ends only.
    check(ERKStepSetInterpolantDegree(memory(), 1), "ERKStepSetInterpolantDegree");
    check(ERKStepSetMaxHnilWarns(memory(), -1), "ERKStepSetMaxHnilWarns");
    for (auto& slope : last_slopes_) slope.resize(size_);
    start_.resize(size_);
}

void ErkIntegrator::native_restart(double t) {
    check(ERKStepReset(memory(), t, vector_.get()), "ERKStepReset");
    start_awaited_ = true;
    stepped_ = false;
}

// First comes the slope at a restart, then those of the stages 2 to 7 in their order, those of a rejected attempt before
// those of the next.
void ErkIntegrator::derivative_seen(std::span<const double> slope) {
    auto& place = start_awaited_ ? start_ : last_slopes_[next_slope_];
    std::copy(slope.begin(), slope.end(), place.begin());
    if (!start_awaited_) next_slope_ = (next_slope_ + 1) % last_slopes_.size();
    start_awaited_ = false;
}

SundialsIntegrator::Native ErkIntegrator::native_step(double t_stop, double& t) {
    // The last stage of a step is the first of the next one.
    if (stepped_) start_ = last_slopes_[(next_slope_ + stages - 2) % last_slopes_.size()];
    stepped_ = true;
    return solve(t_stop, t, [&] { return ERKStepEvolve(memory(), t_stop, vector_.get(), &t, ARK_ONE_STEP); });
}

std::array<const double*, ErkIntegrator::stages> ErkIntegrator::slopes() const {
    std::array<const double*, stages> k{start_.data()};
    for (std::size_t i = 1; i < stages; ++i) {
        k[i] = last_slopes_[(next_slope_ + i - 1) % last_slopes_.size()].data();
    }
    return k;
}

double ErkIntegrator::stability_number() const {
    // The weights of the seventh stage less those of the sixth.
    constexpr std::array<double, stages - 1> w = {35.0 / 384 - 9017.0 / 3168,      355.0 / 33,
                                                  500.0 / 1113 - 46732.0 / 5247,   125.0 / 192 - 49.0 / 176,
                                                  -2187.0 / 6784 + 5103.0 / 18656, 11.0 / 84};
    const auto k = slopes();
    const double* absolute = N_VGetArrayPointer(tolerance_.get());
    const std::span<const double> x = values(vector_.get());
    double of_slopes = 0, of_states = 0;
    for (std::size_t i = 0; i < size_; ++i) {
        double apart = 0;
        for (std::size_t j = 0; j < w.size(); ++j) apart += w[j] * k[j][i];
        const double tolerated = relative_tolerance_ * std::abs(x[i]) + absolute[i];
        const double slopes_apart = (k[6][i] - k[5][i]) / tolerated;
        of_slopes += slopes_apart * slopes_apart;
        of_states += apart * apart / (tolerated * tolerated);
    }
    return of_states > 0 ? std::sqrt(of_slopes / of_states) : 0;
}

// The step that would have met the tolerance: the error grows with its fifth power. The library shortens what it
// proposes to the stop time, so the proposal is kept from here.
int ErkIntegrator::choose_step(N_Vector, double, double h, double, double, double error, double, double, int,
                               int embedded_order, double* proposed, void* self) {
    constexpr double safety = 0.9, min_error = 1e-6; // chosen; at most 16 times the last step
    *proposed = safety * h * std::pow(std::max(error, min_error), -1.0 / (embedded_order + 1));
    static_cast<ErkIntegrator*>(self)->proposed_step_ = *proposed;
    return 0;
}

double ErkIntegrator::kept_step(bool, bool cut) const {
    // A step cut short by a sample instant says little of how long a step may be.
    return cut ? std::max(proposed_step_, kept_step_) : proposed_step_;
}

void ErkIntegrator::native_polynomial(std::span<const double> x0, StepPolynomial& polynomial) {
    const double h = polynomial.h;
    polynomial.resize(size_, 4);
    const std::span<const double> x1 = values(vector_.get());
    const auto k = slopes();
    for (std::size_t i = 0; i < size_; ++i) {
        const double rise = x1[i] - x0[i];
        const double start = h * k[0][i] - rise, end = rise - h * k[6][i] - start;
        const double fourth =
            h * (d1 * k[0][i] + d3 * k[2][i] + d4 * k[3][i] + d5 * k[4][i] + d6 * k[5][i] + d7 * k[6][i]);
        // x0 + s (rise + (1 - s) (start + s (end + (1 - s) fourth)))
        polynomial.term(0)[i] = x0[i];
        polynomial.term(1)[i] = h * k[0][i];
        polynomial.term(2)[i] = end + fourth - start;
        polynomial.term(3)[i] = -end - 2 * fourth;
        polynomial.term(4)[i] = fourth;
    }
}

} // namespace tribode
