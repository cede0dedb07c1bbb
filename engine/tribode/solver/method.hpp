#pragma once
#include <memory>
#include <string>
#include <vector>

namespace tribode {

class HybridSystem;
class Integrator;
struct SolverOptions;

// The ways to integrate; method.cpp says what each of them is. Those up to ida locate events and serve for results. The
// fixed-step ones are there to be compared with them: they look at the guards after each step only, as one would write it on
// a signal processor.
enum class Method {
    automatic, // exact where the system is piecewise affine, ida where it has algebraic variables, else erk, and bdf from
               // where that is stiff: the default; the user writes auto
    exact,
    collocation,
    erk,
    adams,
    bdf,
    ida,
    fixed,
    euler,
    semi_implicit_euler,
    zoh
};

// All that is known of a method besides its integrator. Texts are Markdown, for the documentation and `tribode solvers`.
struct MethodEntry {
    Method method;
    const char* name; // as the user writes it
    const char* what;
    const char* suited_to;
    std::unique_ptr<Integrator> (*make)(const HybridSystem& system, const SolverOptions& options);
    bool fixed_step = false; // and no error control
};

// All methods, in the order of Method.
const std::vector<MethodEntry>& method_list();

std::string name_of(Method method);
Method method_named(const std::string& name); // throws InputError
bool has_fixed_step(Method method);

} // namespace tribode
