#include "tribode/solver/method.hpp"
#include "tribode/base/error.hpp"
#include "tribode/solver/automatic_integrator.hpp"
#include "tribode/solver/collocation_integrator.hpp"
#include "tribode/solver/cvode_integrator.hpp"
#include "tribode/solver/erk_integrator.hpp"
#include "tribode/solver/exact_integrator.hpp"
#include "tribode/solver/fixed_step_integrator.hpp"
#include "tribode/solver/ida_integrator.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace tribode {

namespace {

template <class Kind>
std::unique_ptr<Integrator> make(const HybridSystem& system, const SolverOptions& options) {
    return std::make_unique<Kind>(system, options);
}

std::unique_ptr<Integrator> make_exact(const HybridSystem& system, const SolverOptions& options) {
    return std::make_unique<ExactIntegrator>(system, options.prepared_steps);
}

std::unique_ptr<Integrator> make_fixed(const HybridSystem& system, const SolverOptions& options) {
    return std::make_unique<FixedStepIntegrator>(system, options.method, options.fixed_step);
}

} // namespace

const std::vector<MethodEntry>& method_list() {
    static const std::vector<MethodEntry> entries = {
        {Method::automatic, "auto",
         "`exact` if the system is piecewise affine, else `erk`; continues with `bdf` if the problem is stiff",
         "the default", make<AutomaticIntegrator>},
        {Method::exact, "exact", "Taylor series of each interval, to rounding error; no tolerance",
         "piecewise-affine systems: rolling and Coulomb friction, modes, lag", make_exact},
        {Method::collocation, "collocation",
         "exact propagation of the linear part, cubic polynomials for one or two nonlinear forces",
         "nearly affine machines: force ripple, cubic spring, drag, Stribeck friction, friction that varies; `auto` "
         "does not choose it",
         make<CollocationIntegrator>},
        {Method::erk, "erk", "explicit Runge-Kutta of order 5 [Dormand 1980], ARKODE [Reynolds 2023]",
         "any system in a sampled loop", make<ErkIntegrator>},
        {Method::adams, "adams", "Adams-Moulton with functional iteration, CVODE [Hindmarsh 2005]",
         "comparison; long smooth intervals", make<CvodeIntegrator>},
        {Method::bdf, "bdf",
         "backward differentiation formulas with Newton iteration, CVODE; `cvode` is another name of it",
         "stiff machines: very high gains, very fast lags", make<CvodeIntegrator>},
        {Method::ida, "ida", "the same for differential-algebraic equations, IDA",
         "systems of equations with algebraic variables, for which it is the default", make<IdaIntegrator>},
        {Method::fixed, "fixed", "classical Runge-Kutta of order 4, fixed step",
         "comparison with code for a signal processor", make_fixed, true},
        {Method::euler, "euler", "x⁺ = x + h f(x), fixed step", "the same", make_fixed, true},
        {Method::semi_implicit_euler, "semi_implicit_euler",
         "velocities and forces as by `euler`, then positions with the new velocities, fixed step", "the same",
         make_fixed, true},
        {Method::zoh, "zoh",
         "linear part discretized by zero-order hold, friction held at its value at the start of the step, fixed step",
         "the same", make_fixed, true},
    };
    return entries;
}

static const MethodEntry& entry_of(Method method) { return method_list()[static_cast<std::size_t>(method)]; }

std::string name_of(Method method) { return entry_of(method).name; }

Method method_named(const std::string& name) {
    constexpr Alias alias = SolverOptions::method_alias;
    const auto& names = SolverOptions::method_names();
    const auto it = std::find(names.begin(), names.end(), name == alias.name ? alias.means : name);
    if (it != names.end()) return static_cast<Method>(it - names.begin());
    throw InputError(fmt::format("solver \"{}\" is not known, must be one of {}", name, name_list(names, alias)));
}

bool has_fixed_step(Method method) { return entry_of(method).fixed_step; }

} // namespace tribode
