#pragma once
#include "solver/integrator.hpp"

#include <memory>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_context.h>
#include <sundials/sundials_linearsolver.h>
#include <sundials/sundials_matrix.h>
#include <sundials/sundials_nonlinearsolver.h>

namespace tribode {

// What CVODE and ARKODE have in common: context, vectors, callbacks, their messages turned into outcomes.
// Guards are root functions of direction -1 (falling).
class SundialsIntegrator : public Integrator {
  public:
    SundialsIntegrator(const HybridSystem& system, const SolverOptions& options);
    ~SundialsIntegrator() override;

    void restart(SystemState& state) override;
    Progress step(double t_stop) override;
    RunStatistics statistics() const override;

  protected:
    struct Freed {
        void operator()(N_Vector v) const { N_VDestroy(v); }
        void operator()(SUNMatrix m) const { SUNMatDestroy(m); }
        void operator()(SUNLinearSolver s) const { SUNLinSolFree(s); }
        void operator()(SUNNonlinearSolver s) const { SUNNonlinSolFree(s); }
    };
    template <class Handle>
    using Owned = std::unique_ptr<std::remove_pointer_t<Handle>, Freed>;

    enum class Native { stepped, stopped, root, failed };

    // Starts at (t, vector_) with initial step h [s]; 0: the method's own estimate.
    virtual void native_restart(double t, double h) = 0;
    virtual Native native_step(double t_stop, double& t) = 0;
    virtual void native_roots(int* found) const = 0;
    virtual long native_rejected_steps() const = 0; // since the counters of the library were last zeroed
    virtual bool counters_restart() const = 0;      // whether native_restart zeroes them
    // The step size worth keeping for the next restart, after a step that was the first since the last one or
    // not, and was cut short by t_stop or not.
    virtual double kept_step(bool first, bool cut) const = 0;

    // Throws on any flag of a set-up call that is not success: our own bug or no memory.
    static void check(int flag, const char* function);

    static int derivative_callback(double t, N_Vector x, N_Vector dxdt, void* self);
    static int guard_callback(double t, N_Vector x, double* g, void* self);
    static int jacobian_callback(double t, N_Vector x, N_Vector fx, SUNMatrix matrix, void* self, N_Vector, N_Vector,
                                 N_Vector);
    static void message_callback(int code, const char* module, const char* function, char* text, void* self);

    const HybridSystem& system_;
    const std::size_t size_;
    SUNContext context_ = nullptr;
    Owned<N_Vector> vector_, tolerance_, dense_;
    double kept_step_ = 0; // [s]
    bool has_jacobian_ = false;

  private:
    std::span<const double> values(N_Vector v) const { return {N_VGetArrayPointer(v), size_}; }
    void record_failure(double t);
    bool look_for_missed_fall(double t_before);

    SystemState* state_ = nullptr;
    std::vector<int> found_;
    std::vector<double> guard_values_, x_between_;
    int steps_without_progress_ = 0;
    std::string last_message_;
    std::optional<NotFinite> not_finite_; // the last one met
    bool met_non_finite_ = false;         // in this step
    bool first_step_ = true;
    RunStatistics counts_;
    long rejected_before_ = 0;
};

} // namespace tribode
