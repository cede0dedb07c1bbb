#pragma once
#include "tribode/diagnosis/fixed_steps.hpp"
#include "tribode/diagnosis/system_fit.hpp"

namespace tribode {

// Errors of a model and their derivatives by many runs side by side, in steps so short that halved ones change nothing that counts.
class LaneFit {
  public:
    // Nothing where the model cannot be simulated so at these values. `fit` must outlive it. `substeps`: so many steps of a sample are
    // taken unseen; 0: as many as these values need.
    static std::optional<LaneFit> of(const SystemFit& fit, const SystemModel& model, const std::vector<double>& values,
                                     std::size_t substeps = 0);
    std::size_t substeps() const { return substeps_; }

    // As SystemFit::errors(), of each set of values; empty where a run is not finite.
    std::vector<std::vector<double>> errors(const std::vector<std::vector<double>>& sets) const {
        return errors(sets, substeps_);
    }

    // As SystemFit::jacobian(), by differences: the steps are the same in all runs, so that they are as smooth as the equations.
    Eigen::MatrixXd jacobian(const std::vector<double>& values, const std::vector<double>& errors) const;

    // Halves the steps once, and on until that changes nothing that counts at these values. False where they are as short as may be.
    bool halve(const std::vector<double>& values);

    // Doubles the steps as often as that changes nothing that counts at these values.
    void lengthen(const std::vector<double>& values);

    // Whether halved steps come to the same errors, but for so many times what is negligible.
    bool are_short_enough(const std::vector<double>& values, const std::vector<double>& errors, double times = 1) const;

    // Over every n-th sample only, in one step each, n as large as that still agrees with all samples at these values. For the long
    // part of a fit; the errors are those of fewer samples then. False where all are needed.
    bool thin_out(const std::vector<double>& values);

    // Of a difference of errors, rms: a small part of the noise, or of the errors where these are larger.
    double negligible(const std::vector<double>& errors) const;

  private:
    LaneFit(const SystemFit& fit, const SystemModel& model, FixedSteps steps);
    // A run of one record from values of its own.
    struct OfRecord {
        std::size_t record;
        std::vector<double> values;
    };
    std::vector<std::vector<double>> errors_of(const std::vector<OfRecord>& runs, std::size_t substeps) const;
    std::vector<std::vector<double>> errors(const std::vector<std::vector<double>>& sets, std::size_t substeps) const;
    std::vector<double> errors_with(const std::vector<double>& values, std::size_t substeps) const {
        return errors({values}, substeps)[0];
    }
    void lay_out(std::size_t every);
    bool shorten(const std::vector<double>& values); // as far as needed

    const SystemFit& fit_;
    const SystemModel& model_;
    FixedSteps steps_;
    std::size_t every_ = 1;                   // n-th sample counts
    std::vector<FixedSteps::Course> courses_; // of each record
    std::vector<std::size_t> order_; // of records with samples, so that those that go side by side follow one another
    std::vector<std::size_t> first_row_; // of each record among the errors, and behind the last
    double noise_ = 0;                   // of the outputs over their scale, rms
    std::size_t substeps_ = 1;
};

} // namespace tribode
