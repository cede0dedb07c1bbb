#pragma once
#include "tribode/base/json.hpp"
#include "tribode/solver/run_outcome.hpp"

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace tribode::fmu {

// A quantity of the model as the importing program sees it. Its place in the list is its value reference.
struct Variable {
    enum class Kind { time, parameter, input, output, state, rate, discrete, event_indicator };
    Kind kind = Kind::time;
    std::size_t place = 0; // among those of its kind
    std::string name, unit, description;
    double start = 0;        // of parameters and inputs; of states and discrete variables where has_start
    bool has_start = false;  // a value that may be set before the initialization
    bool is_sampled = false; // an output that changes at samples and events only, an input that is read there
    std::size_t rate_of = 0; // of a rate the value reference of its state
    std::vector<std::size_t> depends_on =
        {}; // value references of the inputs and states that an output or rate depends on
};

// What is set before a run.
struct Settings {
    double start_time = 0;           // [s]
    std::optional<double> tolerance; // relative, of methods that have one
    std::vector<double> parameters, inputs, states, discrete;
};

// What the events of an instant did, in model exchange.
struct EventResult {
    bool states_changed = false, stopped = false;
};

// A model under way. Functions throw an Error where the model has none of what is asked, or where it fails.
class Run {
  public:
    virtual ~Run() = default;
    virtual std::unique_ptr<Run> copy() const = 0; // goes on as this one would, to within the tolerance of its solver

    virtual double time() const = 0;
    virtual void set_input(std::size_t place, double value) = 0;
    // At the time reached: left limits, with the inputs as they are now.
    virtual double value(Variable::Kind kind, std::size_t place) = 0;

    // Co-simulation: up to t_end, without the sample clocks that are due there. They fire first in the next call, so that they
    // see the inputs of their instant.
    virtual RunOutcome advance(double t_end);

    // Model exchange.
    virtual void set_time(double t);
    virtual void set_states(std::span<const double> x);
    virtual std::span<const double> states() const;
    virtual std::span<const double> nominals() const;
    virtual EventResult handle_events();
};

// The content of resources/model.json: a machine or a system of equations, and how it is to be solved.
class Model {
  public:
    virtual ~Model() = default;

    // Throws InputError where the model cannot be a functional mock-up unit of that kind, with the reason.
    static std::unique_ptr<Model> read(const Json& json);

    const std::vector<Variable>& variables() const { return variables_; }
    std::size_t count(Variable::Kind kind) const;
    Settings settings() const; // with the values that stand in the model
    bool is_model_exchange() const { return model_exchange_; }
    double step() const { return step_; } // of the samples, as a proposal for the communication step [s]; 0: none
    double tolerance() const { return tolerance_; } // relative
    const std::string& name() const { return name_; }
    const std::string& token() const { return token_; } // what the library and modelDescription.xml agree on

    virtual std::unique_ptr<Run> start(const Settings& settings) const = 0;

  protected:
    std::size_t add(Variable variable); // its value reference

    std::vector<Variable> variables_;
    bool model_exchange_ = false;
    double step_ = 0, tolerance_ = 0;
    std::string name_, token_;
};

std::unique_ptr<Model> read_machine(const Json& json);
std::unique_ptr<Model> read_system(const Json& json, bool model_exchange);

// The instant of a clock that t is, but for the rounding of who adds up steps; else t.
struct NearestInstant {
    double t, distance = 1e-6; // the latter in periods
    void look_at(double offset, double period);
};

} // namespace tribode::fmu
