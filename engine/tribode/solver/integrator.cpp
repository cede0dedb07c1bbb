#include "tribode/solver/integrator.hpp"
#include "tribode/base/error.hpp"
#include "tribode/hybrid/piecewise_affine.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace tribode {

const std::vector<std::string>& SolverOptions::method_names() {
    static const std::vector<std::string> names = [] {
        std::vector<std::string> all;
        for (const auto& entry : method_list()) all.emplace_back(entry.name);
        return all;
    }();
    return names;
}

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
    Method method = resolved(options.method, system);
    // What begins as erk and may have to go on otherwise.
    if (options.method == Method::automatic && method == Method::erk) method = Method::automatic;
    return method_list()[static_cast<std::size_t>(method)].make(system, options);
}

} // namespace tribode
