#pragma once
#include "tribode/diagnosis/system_model.hpp"
#include "tribode/system/tape.hpp"

#include <array>
#include <optional>
#include <span>
#include <vector>

namespace tribode {

// Simulates a model on a record for several sets of values side by side, with steps of fixed length by the classical
// method of Runge and Kutta: what a fit needs, which runs the same equations thousands of times and compares runs with
// one another. Steps end at samples of inputs and outputs and where a delayed input changes; between these they are
// equal. Branches follow their conditions at once, so a kink is passed with an error of second order in the step; whoever
// uses it compares steps with halved ones. Dry friction that holds a velocity at zero sticks and slips within steps, in each
// run at instants of its own: where the velocity, as a cubic over the step, or the force that holds it says so.
class FixedSteps {
  public:
    static constexpr std::size_t most_lanes = 8;

    // Nothing where the equations have more than rates and outputs and one dry friction on a state: algebraic variables, clocks,
    // events that set something, other forces that hold something at rest, or delays of more than an input.
    static std::optional<FixedSteps> of(const SystemModel& model);

    // Lays out a record: the instants at which steps end, and the inputs between them.
    struct Course {
        struct Interval {
            double start, length; // [s]
            std::size_t piece;    // of the inputs
            bool is_sample;       // whether an output is taken at its start
        };
        std::vector<Interval> intervals;                        // the last one has no length
        double begin = 0, period = 1;                           // of the pieces [s]
        std::vector<std::vector<std::array<double, 4>>> inputs; // of each input of the equations
        std::size_t samples = 0;
        bool holds = false; // all inputs are constant between samples
    };
    Course course(const SystemRecord& record, std::size_t samples, Interpolation between) const;

    // Of each set of values (parameters of the model, then its start values), at most most_lanes, the measured outputs:
    // place (set * outputs + output) * samples + sample. `substeps`: of each interval. A set whose run is not finite has
    // values that are none.
    std::vector<double> outputs(const Course& course, std::span<const std::vector<double>> sets,
                                std::size_t substeps) const;

    std::size_t measured() const { return output_count_; }
    bool is_static() const { return starts_.empty(); } // no states: steps do not matter

  private:
    // What acts on one state and can hold it at zero.
    struct Friction {
        std::size_t velocity; // the state
        Tape holding;         // the force that holds it, and the one from which it slips; of what rates are of
    };

    FixedSteps() = default;
    template <std::size_t lanes>
    class Run;
    using Sets = std::span<const std::vector<double>>;
    void run_four(const Course& course, Sets sets, std::size_t substeps, std::vector<double>& all) const;
    void run_eight(const Course& course, Sets sets, std::size_t substeps, std::vector<double>& all) const;

    std::vector<double> starts_, parameters_, own_inputs_; // values, where they do not move
    std::vector<std::size_t> moved_parameters_, moved_starts_;
    std::size_t input_count_ = 0, output_count_ = 0;
    std::vector<std::size_t> delayed_; // the input of each
    Tape rates_, outputs_, delays_;    // of states; time, inputs, delayed inputs, mode of the friction; parameters
    std::optional<Friction> friction_;
};

} // namespace tribode
