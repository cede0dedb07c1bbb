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

// What CVODE, IDA and ARKODE have in common: context, vectors, callbacks, their messages turned into outcomes. Guards are not
// the libraries' root functions, which see no more of them than their signs at the ends of a step: EventSearch follows them
// along the polynomial that the method itself takes for its step. Guards of the time alone are solved beforehand, so that a
// step ends where they fall.
class SundialsIntegrator : public Integrator {
  public:
    SundialsIntegrator(const HybridSystem& system, const SolverOptions& options);
    ~SundialsIntegrator() override;

    void restart(SystemState& state) override;
    void change_guards(SystemState& state) override;
    Progress step(double t_stop) override;
    void interpolate(double t, std::span<double> x) override;
    RunStatistics statistics() const override;
    double proposed_step() const override { return kept_step_; }
    void propose_step(double h) override { kept_step_ = h; }

  protected:
    struct Freed {
        void operator()(N_Vector v) const { N_VDestroy(v); }
        void operator()(SUNMatrix m) const { SUNMatDestroy(m); }
        void operator()(SUNLinearSolver s) const { SUNLinSolFree(s); }
        void operator()(SUNNonlinearSolver s) const { SUNNonlinSolFree(s); }
    };
    template <class Handle>
    using Owned = std::unique_ptr<std::remove_pointer_t<Handle>, Freed>;

    enum class Native { stepped, stopped, failed };

    // Starts at (t, vector_) with initial step h [s]; 0: the method's own estimate.
    virtual void native_restart(double t, double h) = 0;
    virtual Native native_step(double t_stop, double& t) = 0;
    // The polynomial that the method takes for its last step, which began at polynomial.t0 with x0 and lasted polynomial.h.
    virtual void native_polynomial(std::span<const double> x0, StepPolynomial& polynomial) = 0;
    // Of a method of several steps, whose polynomial is its history, from its derivatives at the step's beginning.
    static void polynomial_of_derivatives(int order, const std::function<std::span<const double>(int)>& derivative,
                                          std::span<const double> x0, std::span<const double> x1,
                                          StepPolynomial& polynomial);
    // The library has asked for a derivative.
    virtual void derivative_seen(std::span<const double>) {}
    virtual long native_rejected_steps() const = 0; // since the counters of the library were last zeroed
    virtual bool counters_restart() const = 0;      // whether native_restart zeroes them
    // The step size worth keeping for the next restart, after a step that was the first since the last one or
    // not, and was cut short by t_stop or not.
    virtual double kept_step(bool first, bool cut) const = 0;
    // Whether it also serves after an event. A method that begins with a single evaluation at the end of a step may be
    // deceived there: where the motion of before and of after an event agree at the two ends, it sees no error.
    virtual bool keeps_step_at_events() const = 0;

    // Throws on any flag of a set-up call that is not success: our own bug or no memory.
    static void check(int flag, const char* function);

    // Of the implicit methods: matrix_ and linear_solver_, KLU where the system knows that its Jacobian is large and sparse.
    // Whether the system has an analytic Jacobian; then put_jacobian() puts df/dx into such a matrix and returns 0.
    bool make_jacobian();
    int put_jacobian(double t, N_Vector x, SUNMatrix matrix);
    bool has_sparse_jacobian() const { return !starts_.empty(); }

    static int derivative_callback(double t, N_Vector x, N_Vector dxdt, void* self);
    static void message_callback(int code, const char* module, const char* function, char* text, void* self);

    const HybridSystem& system_;
    const std::size_t size_;
    SUNContext context_ = nullptr;
    Owned<N_Vector> vector_, tolerance_;
    double kept_step_ = 0; // [s]

    std::span<const double> values(N_Vector v) const { return {N_VGetArrayPointer(v), size_}; }

    SystemState* state_ = nullptr;
    RunStatistics counts_;
    std::exception_ptr thrown_; // by what the library has called
    Owned<SUNMatrix> matrix_;
    Owned<SUNLinearSolver> linear_solver_;
    // Of the sparse Jacobian, which has its diagonal whole: the starts of the columns, the rows, where the entries of the
    // system go, and the diagonal.
    std::vector<sunindextype> starts_, rows_, places_, diagonal_;

  private:
    void make_sparse_jacobian(const SparsityPattern& pattern);
    const StepPolynomial& polynomial();
    double next_stop(double t_stop);
    Native take_native_step(double t_stop, double& t);
    Progress look_for_falls(double t_stop);
    void record_failure(double t);

    EventSearch search_;
    const bool has_guards_;
    StepPolynomial polynomial_;
    bool polynomial_made_ = false;
    std::vector<double> x_before_;
    double t_before_ = 0, t_native_ = 0; // where the library's last step began and ended [s]
    bool ahead_ = false;                 // the library has gone beyond the state, as a guard fell within its last step
    bool fell_ = false;                  // a guard, where the state stands
    double clear_to_ = 0;                // no guard of the time alone falls before this, since the last restart [s]
    long creeping_steps_ = 0;
    std::string last_message_;
    std::optional<NotFinite> not_finite_; // the last one met
    bool met_non_finite_ = false;         // in this step
    bool first_step_ = true;
    long rejected_before_ = 0;
    std::vector<double> entries_; // of the sparse Jacobian
};

} // namespace tribode
