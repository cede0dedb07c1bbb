#pragma once
#include "tribode/solver/sundials_integrator.hpp"

namespace tribode {

// The functions that CVODE and IDA both have besides those of SundialsLibrary.
struct MultistepLibrary : SundialsLibrary {
    int (*get_last_order)(void* memory, int* order);
    int (*get_current_step)(void* memory, double* h);
    int (*get_derivative)(void* memory, double t, int k, N_Vector derivative);
};

// What CVODE and IDA have in common besides SundialsIntegrator: a method of several steps begins again at order one after
// each restart, with a short step, and its polynomial is its history. With the Jacobian of the implicit methods.
class MultistepIntegrator : public SundialsIntegrator {
  public:
    MultistepIntegrator(const HybridSystem& system, const SolverOptions& options, const MultistepLibrary& library);

  protected:
    // matrix_ and linear_solver_, KLU where the system knows that its Jacobian is large and sparse. Whether the system has an
    // analytic Jacobian; then put_jacobian() puts df/dx into such a matrix and returns 0.
    bool make_jacobian();
    int put_jacobian(double t, N_Vector x, SUNMatrix matrix);
    bool has_sparse_jacobian() const { return !starts_.empty(); }

    // A vector of the method's own for derivatives.
    N_Vector derivative() { return derivative_.get(); }
    int last_order() const;

    // Of the sparse Jacobian, which has its whole diagonal: the starts of the columns, the rows, where the entries of the
    // system go, and the diagonal.
    std::vector<sunindextype> starts_, rows_, places_, diagonal_;

  private:
    void native_polynomial(std::span<const double> x0, StepPolynomial& polynomial) final;
    bool counters_restart() const final { return true; }
    double kept_step(bool first, bool cut) const final;
    bool keeps_step_at_events() const final { return false; }
    void make_sparse_jacobian(const SparsityPattern& pattern);

    const MultistepLibrary& library_;
    Owned<N_Vector> derivative_;
    std::vector<double> entries_; // of the sparse Jacobian
};

} // namespace tribode
