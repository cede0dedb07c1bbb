#include "tribode/solver/integrator.hpp"
#include "tribode/base/error.hpp"
#include "tribode/hybrid/piecewise_affine.hpp"
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

const std::vector<std::string>& SolverOptions::method_names() {
    static const std::vector<std::string> names = {
        "auto", "exact", "collocation", "erk", "adams", "bdf", "ida", "fixed", "euler", "semi_implicit_euler", "zoh"};
    return names;
}

std::string name_of(Method method) { return SolverOptions::method_names()[static_cast<std::size_t>(method)]; }

Method method_named(const std::string& name) {
    constexpr Alias alias = SolverOptions::method_alias;
    const auto& names = SolverOptions::method_names();
    const auto it = std::find(names.begin(), names.end(), name == alias.name ? alias.means : name);
    if (it != names.end()) return static_cast<Method>(it - names.begin());
    throw InputError(fmt::format("solver \"{}\" is not known, must be one of {}", name, name_list(names, alias)));
}

bool has_fixed_step(Method method) { return method >= Method::fixed; }

Method resolved(Method method, const HybridSystem& system, Purpose purpose) {
    const auto& states = system.states();
    const auto algebraic = std::find_if(states.begin(), states.end(),
                                        [](const StateVariable& variable) { return variable.is_algebraic(); });
    if (algebraic != states.end()) {
        if (method == Method::automatic || method == Method::ida) return Method::ida;
        throw InputError(
            fmt::format("solver \"{}\" cannot solve for algebraic variables, of which the system has {}; must "
                        "be ida or auto",
                        name_of(method), algebraic->name));
    }
    if (method != Method::automatic) return method;
    if (!why_not_affine(system)) return Method::exact;
    return purpose == Purpose::search && !why_not_nearly_affine(system) ? Method::collocation : Method::erk;
}

std::unique_ptr<Integrator> make_integrator(const HybridSystem& system, const SolverOptions& options) {
    const Method method = resolved(options.method, system);
    if (options.method == Method::automatic && method == Method::erk) {
        return std::make_unique<AutomaticIntegrator>(system, options);
    }
    switch (method) {
    case Method::automatic:
    case Method::exact: return std::make_unique<ExactIntegrator>(system);
    case Method::collocation: return std::make_unique<CollocationIntegrator>(system, options);
    case Method::erk: return std::make_unique<ErkIntegrator>(system, options);
    case Method::adams:
    case Method::bdf: return std::make_unique<CvodeIntegrator>(system, options);
    case Method::ida: return std::make_unique<IdaIntegrator>(system, options);
    case Method::fixed:
    case Method::euler:
    case Method::semi_implicit_euler:
    case Method::zoh: break;
    }
    return std::make_unique<FixedStepIntegrator>(system, options.method, options.fixed_step);
}

} // namespace tribode
