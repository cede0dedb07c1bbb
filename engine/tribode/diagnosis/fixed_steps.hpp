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
        std::vector<std::vector<double>> at_samples; // of each input where an output is taken; empty: as the pieces say
        std::vector<std::optional<double>> measured_first; // of each beginning of the model, see SystemModel
        std::size_t samples = 0;
        bool holds = false;    // all inputs are constant between samples
        std::size_t group = 0; // those that go side by side: their intervals are the same, but for their start

        // Whether the intervals of the other one are those that this one begins with.
        bool begins_as(const Course& other) const;
    };
    // Of every n-th of the samples that count (`used`, from the first one). Inputs are then straight lines over n samples, with the
    // mean and the first moment of what they are there.
    Course course(const SystemRecord& record, std::size_t used, Interpolation between, std::size_t n = 1) const;

    // A run to be made.
    struct Simulation {
        const Course* course;
        const std::vector<double>* values; // parameters of the model, then its start values
    };
    // Of each the measured outputs: place output * samples + sample. Those of a group that follow one another, and whose courses are
    // about as long, go side by side. `substeps`: of each interval. One whose run is not finite has values that are none.
    std::vector<std::vector<double>> outputs(std::span<const Simulation> simulations, std::size_t substeps) const;

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
    using Simulations = std::span<const Simulation>;
    using Outputs = std::span<std::vector<double>>;
    void run_four(Simulations simulations, std::size_t substeps, Outputs all) const;
    void run_eight(Simulations simulations, std::size_t substeps, Outputs all) const;

    std::vector<double> starts_, parameters_, own_inputs_; // values, where they do not move
    std::vector<std::size_t> moved_parameters_, moved_starts_;
    std::size_t input_count_ = 0, output_count_ = 0;
    std::vector<std::size_t> delayed_; // the input of each
    // Of states; time, inputs, delayed inputs, mode of the friction; parameters.
    Tape rates_, outputs_, delays_, at_rest_;
    std::vector<SystemModel::Beginning> beginnings_;
    std::optional<Friction> friction_;
};

} // namespace tribode
