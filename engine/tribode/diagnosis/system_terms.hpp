#pragma once
#include "tribode/diagnosis/system_fit.hpp"

#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// Something that a system may lack: a term of a derivative or an output, or a change of the path of an input.
struct SystemTerm {
    struct Parameter {
        std::string name;
        double start = 0; // of an amplitude: its value in the screening simulation
        double low = -std::numeric_limits<double>::infinity(), high = std::numeric_limits<double>::infinity();
        double scale = 1;
        std::string unit = {};
    };
    std::string name;     // as in docs/effects.md, e.g. "dry_friction"; nameless_term where no name fits
    std::string equation; // "der(v)", "output y", "input u"
    std::string of;       // the variables it depends on: "v", "x p"; of a "term" the function: "x^2 v"
    std::vector<std::string> variables = {}; // those that it is a function of; none of a path or a wave
    std::vector<Parameter> parameters;
    std::size_t amplitudes = 1; // the first so many parameters; where all are `neutral`, nothing changes
    std::vector<double> neutral = {0};
    std::vector<Parameter> constants = {}; // parameters that are not fitted
    std::size_t looked_at = 1;             // frequencies among which its own was the best
    bool is_flexible =
        false; // follows so much that it would be in all pairs and sums: it is tried alone, after the others
    // Where the state that it adds begins: at rest behind this of the equations, or where this output was measured first. Empty: where
    // it says itself.
    std::function<Term(const Equations&)> begins_as = {};
    std::vector<std::size_t> begin_so = {0};            // which of the states that it adds
    std::optional<std::size_t> begins_as_measured = {}; // among the measured outputs
    // Puts the term into the equations, with variables for its parameters and constants. Returns what was added, for a reader.
    std::function<Term(Equations&, const std::vector<Term>& parameters)> apply;

    // Of one kind there may be several forms, such as dry friction that sticks and that of a tanh.
    std::string form() const { return kind() + " by " + parameters.front().name; }
    std::string kind() const { return name + " in " + equation + (of.empty() ? "" : " of " + of); }
};

inline constexpr const char* nameless_term = "term";
// A function of one variable of any shape, by several values: for what no name fits.
inline constexpr const char* curve_term = "curve";

// A quantity of the system as the current model has it, over the samples of the fit.
struct SystemVariable {
    std::string name, unit;
    Term symbol = 0;
    std::optional<std::size_t> state; // which one, where it is a state
    std::vector<double> values;
    double low = 0, high = 0;
};

// An input whose motion is imposed has a companion of this name, its rate of change: without a column of its own it is
// that of the record.
std::string rate_name_of(const std::string& input);

// States and inputs that move. `states`: how many of the model's states are the user's; those that terms brought in come
// behind them and are left alone here and below. `traces`: of each record.
std::vector<SystemVariable> variables_of(const SystemModel& model, std::size_t states, const SystemFit& fit,
                                         const std::vector<SystemTrace>& traces);

// All terms that the library has for this system, in a fixed order. Each can be put into any model of the same system, with
// other terms or without. `errors`: of the current model, scaled as by SystemFit. `with_nameless`: also products of functions of
// two variables that have no name but "term"; else also curves.
std::vector<SystemTerm> system_terms(const SystemModel& model, std::size_t states, const SystemFit& fit,
                                     const std::vector<SystemVariable>& variables, const std::vector<double>& errors,
                                     bool with_nameless = false);

// The model with the term, whose parameters have these values and may move. The text of what was added goes to `text`.
SystemModel extended(const SystemModel& model, const SystemTerm& term, const std::vector<double>& values,
                     std::string* text = nullptr);

// The values of a model with those of one more term: its parameters come behind the others, before the start values.
std::vector<double> more_values(const SystemModel& model, const std::vector<double>& values,
                                const std::vector<double>& own);

} // namespace tribode
