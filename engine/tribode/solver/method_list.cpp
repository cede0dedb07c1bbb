#include "tribode/solver/method_list.hpp"

namespace tribode {

const std::vector<MethodEntry>& method_list() {
    static const std::vector<MethodEntry> entries = {
        {Method::automatic, "exact if the system is piecewise affine, else erk; continues with BDF where it is stiff",
         "the default"},
        {Method::exact, "Taylor series of each interval, to rounding error; no tolerance",
         "piecewise-affine systems: rolling and Coulomb friction, modes, lag"},
        {Method::collocation, "exact propagation of the linear part, cubic polynomials for one or two nonlinear forces",
         "nearly affine machines: force ripple, cubic spring, drag, Stribeck friction"},
        {Method::erk, "explicit Runge-Kutta of order 5 (Dormand-Prince), ARKODE", "any system in a sampled loop"},
        {Method::adams, "Adams-Moulton with functional iteration, CVODE", "comparison; long smooth intervals"},
        {Method::bdf, "backward differentiation formulas with Newton iteration, CVODE",
         "stiff machines: very high gains, very fast lags"},
        {Method::ida, "the same for differential-algebraic equations, IDA", "systems with algebraic variables"},
        {Method::fixed, "classical Runge-Kutta of order 4, fixed step", "comparison with code for a signal processor"},
        {Method::euler, "explicit Euler, fixed step", "the same"},
        {Method::semi_implicit_euler, "velocities first, then positions with the new velocities, fixed step",
         "the same"},
        {Method::zoh, "linear part discretized by zero-order hold, friction held over the step, fixed step",
         "the same"},
    };
    return entries;
}

} // namespace tribode
