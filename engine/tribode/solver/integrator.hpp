#pragma once
#include "tribode/base/options.hpp"
#include "tribode/hybrid/hybrid_system.hpp"
#include "tribode/solver/method.hpp"
#include "tribode/solver/run_outcome.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// Integrates dx/dt = f(t, x; d) of one system over intervals on which d is constant.
//
// The state is the caller's: the integrator reads t and x at restart(), writes them in step(), and looks at the
// discrete values when it evaluates. One integrator serves one run on one thread.
class Integrator {
  public:
    virtual ~Integrator() = default;

    // x jumped, or the derivative changed, at state.t. What is known of a good step size survives.
    virtual void restart(SystemState& state) = 0;

    // The guards changed at state.t, where one has just crossed; x and the derivative did not.
    virtual void change_guards(SystemState& state) { restart(state); }

    enum class Progress { stepped, stopped, crossing, failed };

    // One step, to t_stop at most:
    //   stepped     state.t < t_stop
    //   stopped     state.t == t_stop exactly, and no guard crossed zero
    //   crossing    state is at the first zero crossing of a guard, as exactly as the method locates it; crossed() tells which
    //   failed      failure() tells why; state is the last good one
    virtual Progress step(double t_stop) = 0;

    // x at a time within the last step, from the method's own interpolation. t in [before the step, state.t].
    virtual void interpolate(double t, std::span<double> x) = 0;

    // The step that the method would take after a restart [s], for a run that is continued by another integrator; 0: it
    // keeps none.
    virtual double proposed_step() const { return 0; }
    virtual void propose_step(double) {}

    // From when on [s] a run by `automatic` has gone on by BDF, the problem being stiff; nothing: it has not.
    virtual std::optional<double> stiff_from() const { return std::nullopt; }

    const std::vector<GuardId>& crossed() const { return crossed_; }
    const RunOutcome& failure() const { return failure_; }
    // Steps, evaluations; the counts of events and samples are the simulator's.
    virtual RunStatistics statistics() const = 0;

  protected:
    std::vector<GuardId> crossed_;
    RunOutcome failure_;
};

class PreparedSteps;

// Which method, and how exactly.
struct SolverOptions {
    Method method = Method::automatic;
    double relative_tolerance = 1e-8;
    double absolute_tolerance = 1e-12; // [m] for positions; other states: times their scale
    double fixed_step = 5e-5;          // [s] of fixed, euler, semi_implicit_euler, zoh
    long max_steps = 100'000'000;      // from one output or sample to the next; more: the run ends
    double max_step = 0;               // [s] of erk, adams, bdf, ida; 0: as long as the tolerances allow
    // Of exact, for many runs, of one system or of any: what they prepare together, which changes no result. Not owned.
    PreparedSteps* prepared_steps = nullptr;

    static const std::vector<std::string>& method_names(); // as the user writes them, in the order of Method
    static constexpr Alias method_alias{"cvode", "bdf"};   // a name that is also accepted

    // The absolute tolerance of a servo axis is that of its positions; of equations, that times the nominal value of a state.
    static void describe(auto& o, auto& fields, bool of_axis = true) {
        fields.choice("solver", o.method, method_names(),
                      About("[integration method](hybrid-simulation.md); `\"fixed\"` (RK4), `\"euler\"`, "
                            "`\"semi_implicit_euler\"` and `\"zoh\"` have a fixed step")
                          .also(method_alias));
        fields.number("relative_tolerance", o.relative_tolerance, "", Allowed::positive,
                      "ignored by `exact` and the fixed-step methods, as is the absolute one");
        fields.number(of_axis ? "absolute_tolerance_m" : "absolute_tolerance", o.absolute_tolerance, of_axis ? "m" : "",
                      Allowed::positive,
                      of_axis ? "of positions; other states are scaled" : "times the nominal value of each state");
        fields.number("fixed_step_s", o.fixed_step, "s", Allowed::positive, "step of the fixed-step methods");
        fields.number("max_step_s", o.max_step, "s", Allowed::positive,
                      of_axis ? "largest step of `erk`, `adams`, `bdf`, `ida`; default: as long as the tolerances allow"
                              : "largest step of `erk`, `adams`, `bdf`, `ida`; default: a fiftieth of the duration");
        fields.integer("max_steps", o.max_steps, 1, 1'000'000'000'000,
                       "from one result or sample to the next; a run that needs more ends there with a message");
    }
};

// What a run is for. Its result is looked at; or it is one of many in a search, which needs the fastest method whose error
// is known to be small.
enum class Purpose { result, search };

// What `automatic` means for this system; any other method as it is. The one place where a method is chosen.
Method resolved(Method method, const HybridSystem& system, Purpose purpose = Purpose::result);

std::unique_ptr<Integrator> make_integrator(const HybridSystem& system, const SolverOptions& options);

} // namespace tribode
