#pragma once
#include "tribode/solver/event_search.hpp"
#include "tribode/solver/integrator.hpp"

#include <exception>
#include <functional>
#include <memory>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_context.h>
#include <sundials/sundials_linearsolver.h>
#include <sundials/sundials_matrix.h>
#include <sundials/sundials_nonlinearsolver.h>

namespace tribode {

// The functions that CVODE, IDA and ERKStep of ARKODE all have, each under its own name.
struct SundialsLibrary {
    void (*free)(void** memory);
    int (*set_error_handler)(void* memory, void (*)(int, const char*, const char*, char*, void*), void* data);
    int (*set_user_data)(void* memory, void* data);
    int (*set_tolerances)(void* memory, double relative, N_Vector absolute);
    int (*set_max_step)(void* memory, double h);
    int (*set_initial_step)(void* memory, double h);
    int (*set_stop_time)(void* memory, double t);
    int (*get_rejected_steps)(void* memory, long* count);
};

// What CVODE, IDA and ARKODE have in common: context, vectors, callbacks, steps, their messages turned into outcomes. Guards
// are not the libraries' root functions, which compare only their signs at the ends of a step: EventSearch follows them along
// the polynomial that the method itself takes for its step. Guards of the time alone are solved beforehand, so that a step
// ends at their zero crossings.
//
// The libraries are C: no exception may pass through them. Each callback stores what it catches in `thrown_` and reports a
// failure to the library; it is thrown again when the library has returned.
class SundialsIntegrator : public Integrator {
  public:
    SundialsIntegrator(const HybridSystem& system, const SolverOptions& options, const SundialsLibrary& library);

    void restart(SystemState& state) override;
    void change_guards(SystemState& state) override;
    Progress step(double t_stop) override;
    void interpolate(double t, std::span<double> x) override;
    RunStatistics statistics() const override;
    double proposed_step() const override { return kept_step_; }
    void propose_step(double h) override { kept_step_ = h; }

  protected:
    struct Freed {
        void operator()(SUNContext c) const { SUNContext_Free(&c); }
        void operator()(N_Vector v) const { N_VDestroy(v); }
        void operator()(SUNMatrix m) const { SUNMatDestroy(m); }
        void operator()(SUNLinearSolver s) const { SUNLinSolFree(s); }
        void operator()(SUNNonlinearSolver s) const { SUNNonlinSolFree(s); }
    };
    template <class Handle>
    using Owned = std::unique_ptr<std::remove_pointer_t<Handle>, Freed>;

    // Throws where `function` has returned nothing: no memory.
    template <class Handle>
    static Owned<Handle> own(Handle handle, const char* function) {
        check(handle ? 0 : -1, function);
        return Owned<Handle>(handle);
    }

    enum class Native { stepped, stopped, failed };

    // From a constructor: takes the library's memory over, whose method is made and initialized, and sets what is the same
    // in all.
    void take_memory(void* memory, const char* function);
    void set_up(const SolverOptions& options);

    // Starts at (t, vector_).
    virtual void native_restart(double t) = 0;
    // One step, to t_stop at most: calls solve().
    virtual Native native_step(double t_stop, double& t) = 0;
    // Calls the library with a stop time; `one_step` returns the library's flag.
    template <class OneStep>
    Native solve(double t_stop, double& t, const OneStep& one_step) {
        check(library_.set_stop_time(memory(), t_stop), "SetStopTime");
        return outcome_of(one_step(), t_stop, t);
    }
    // The polynomial that the method takes for its last step, which began at polynomial.t0 with x0 and lasted polynomial.h.
    virtual void native_polynomial(std::span<const double> x0, StepPolynomial& polynomial) = 0;
    // The library has asked for a derivative.
    virtual void derivative_seen(std::span<const double>) {}
    virtual bool counters_restart() const = 0; // whether native_restart zeroes the library's counters
    // The step size worth keeping for the next restart, after a step that was the first since the last one or
    // not, and was cut short by t_stop or not.
    virtual double kept_step(bool first, bool cut) const = 0;
    // Whether it also serves after an event. A method that begins with a single evaluation at the end of a step may be
    // deceived there: where the motion of before and of after an event agree at the two ends, it sees no error.
    virtual bool keeps_step_at_events() const = 0;

    // Throws on any flag of a set-up call that is not success: our own bug or no memory.
    static void check(int flag, const char* function);

    long native_rejected_steps() const; // since the counters of the library were last zeroed
    void set_max_step(double h) { check(library_.set_max_step(memory(), h), "SetMaxStep"); } // [s]; 0: none

    static int derivative_callback(double t, N_Vector x, N_Vector dxdt, void* self);
    static void message_callback(int code, const char* module, const char* function, char* text, void* self);

    void* memory() const { return memory_.get(); }
    std::span<const double> values(N_Vector v) const { return {N_VGetArrayPointer(v), size_}; }

    const HybridSystem& system_;
    const std::size_t size_;
    // In this order: each handle is freed before those that it uses.
    Owned<SUNContext> context_;
    Owned<N_Vector> vector_, tolerance_;
    Owned<SUNMatrix> matrix_; // of implicit methods, as the solvers are
    Owned<SUNLinearSolver> linear_solver_;
    Owned<SUNNonlinearSolver> nonlinear_solver_;
    double kept_step_ = 0; // [s]

    SystemState* state_ = nullptr;
    RunStatistics counts_;
    std::exception_ptr thrown_; // by a callback

  private:
    struct MemoryFreed {
        const SundialsLibrary* library;
        void operator()(void* memory) const { library->free(&memory); }
    };

    static Native outcome_of(int flag, double t_stop, double& t);
    const StepPolynomial& polynomial();
    double next_stop(double t_stop);
    Native take_native_step(double t_stop, double& t);
    Progress look_for_crossings(double t_stop);
    void record_failure(double t);

    const SundialsLibrary& library_;
    std::unique_ptr<void, MemoryFreed> memory_;
    EventSearch search_;
    const bool has_guards_;
    StepPolynomial polynomial_;
    bool polynomial_made_ = false;
    std::vector<double> x_before_;
    double t_before_ = 0, t_native_ = 0; // where the library's last step began and ended [s]
    bool ahead_ = false;    // the library is beyond the state, as a guard crossed zero within its last step
    bool crossing_ = false; // the state is at a zero crossing
    double clear_to_ = 0;   // no guard of the time alone crosses zero before this, since the last restart [s]
    long creeping_steps_ = 0;
    std::string last_message_;
    std::optional<NotFinite> not_finite_; // the last one met
    bool met_non_finite_ = false;         // in this step
    bool first_step_ = true;
    long rejected_before_ = 0;
};

} // namespace tribode
