#include "tribode/base/error.hpp"
#include "tribode/fmu_runtime/fmu_model.hpp"
#include "tribode/solver/simulator.hpp"
#include "tribode/system/contacts.hpp"
#include "tribode/system/equation_system.hpp"
#include "tribode/system/equations_json.hpp"
#include "tribode/system/input_delays.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace tribode::fmu {

namespace {

using Kind = Variable::Kind;

// The inputs become discrete variables that are set from outside; where they are set is an instant like that of a clock.
constexpr ClockId input_clock = 0;

struct Prepared {
    std::unique_ptr<const EquationSystem> system;
    const std::vector<double>* inputs = nullptr; // of the run that sets them now
    std::size_t first_input = 0;                 // among the discrete variables
    SolverOptions options;
    double start_time = 0; // [s]
};

// What differs from the model as it is written.
void apply(const Settings& settings, const Settings& written, Equations& equations) {
    const auto put = [](const auto& values, const auto& defaults, auto& variables, auto member) {
        for (std::size_t i = 0; i < std::min(values.size(), variables.size()); ++i) {
            if (values[i] != defaults[i]) variables[i].*member = values[i];
        }
    };
    put(settings.parameters, written.parameters, equations.parameters, &Equations::Parameter::value);
    put(settings.inputs, written.inputs, equations.inputs, &Equations::Input::value);
    put(settings.states, written.states, equations.states, &Equations::State::start);
    put(settings.discrete, written.discrete, equations.discrete, &Equations::Discrete::start);
}

// Without contacts and delays, which need the values of parameters.
void close(Equations& equations) {
    close_contacts(equations);
    if (const auto delayed = take_out_delays(equations); !delayed.empty()) {
        throw InputError(
            fmt::format("{}: {} is an input of an earlier time, which a functional mock-up unit does not keep; "
                        "delay it in samples",
                        equations.name, equations.graph->name(delayed.front().symbol)));
    }
}

void open_to_outside(Equations& equations, Prepared& prepared, bool model_exchange) {
    prepared.first_input = equations.discrete.size();
    Equations::Function set_inputs;
    for (const auto& input : equations.inputs) {
        equations.discrete.push_back({input.name, input.unit, input.value, input.symbol, {}});
        set_inputs.writes.push_back(input.symbol);
    }
    equations.inputs.clear();
    if (model_exchange) {
        // As numbers, parameters could take conditions away, and the number of event indicators is fixed.
        for (const auto& parameter : equations.parameters) {
            equations.discrete.push_back({parameter.name, parameter.unit, parameter.value, parameter.symbol, {}});
        }
        equations.parameters.clear();
        return;
    }
    set_inputs.call = [&prepared](long, std::span<const double>, std::span<double> written) {
        std::copy(prepared.inputs->begin(), prepared.inputs->end(), written.begin());
    };
    constexpr double never = 1e300; // [s]: it fires when a run says so
    equations.clocks.insert(equations.clocks.begin(), {"inputs", never, never, {}, std::move(set_inputs)});
}

class CoSimulation final : public Run {
  public:
    CoSimulation(std::shared_ptr<Prepared> prepared, const Settings& settings)
        : prepared_(std::move(prepared)),
          inputs_(settings.inputs),
          applied_(inputs_),
          simulator_(system(), prepared_->options, system().initial_state(prepared_->start_time)) {}
    CoSimulation(const CoSimulation& other)
        : prepared_(other.prepared_),
          inputs_(other.inputs_),
          applied_(other.applied_),
          simulator_(system(), prepared_->options, other.simulator_.state()) {
        simulator_.propose_step(other.simulator_.proposed_step());
    }
    CoSimulation& operator=(const CoSimulation&) = delete;

    std::unique_ptr<Run> copy() const override { return std::make_unique<CoSimulation>(*this); }
    double time() const override { return simulator_.state().t; }
    void set_input(std::size_t place, double value) override {
        inputs_.at(place) = value;
        seen_.reset();
    }

    double value(Kind kind, std::size_t place) override {
        const SystemState& state = seen();
        if (kind == Kind::state) return state.x.at(place);
        if (kind == Kind::discrete) return system().discrete(state)[place];
        std::vector<double> outputs(system().equations().outputs.size());
        system().outputs(state, outputs);
        return outputs.at(place);
    }

    RunOutcome advance(double t_end) override {
        seen_.reset();
        if (inputs_ != applied_) {
            prepared_->inputs = &inputs_;
            simulator_.change([&](SystemState& state) { return system().on_sample(input_clock, 0, state); });
            applied_ = inputs_;
        }
        NearestInstant end{t_end};
        for (std::size_t i = input_clock + 1; i < system().clocks().size(); ++i) {
            end.look_at(system().clocks()[i].offset, system().clocks()[i].period);
        }
        return simulator_.advance_before(end.t);
    }

  private:
    const EquationSystem& system() const { return *prepared_->system; }

    // With the inputs that the next step begins with.
    const SystemState& seen() {
        if (inputs_ == applied_) return simulator_.state();
        if (!seen_) {
            seen_ = simulator_.state();
            prepared_->inputs = &inputs_;
            system().on_sample(input_clock, 0, *seen_);
        }
        return *seen_;
    }

    std::shared_ptr<Prepared> prepared_;
    std::vector<double> inputs_, applied_;
    Simulator simulator_;
    std::optional<SystemState> seen_;
};

class ModelExchange final : public Run {
  public:
    ModelExchange(std::shared_ptr<Prepared> prepared)
        : prepared_(std::move(prepared)),
          state_(system().initial_state(prepared_->start_time)) {
        for (const auto& variable : system().states()) nominals_.push_back(variable.scale);
    }

    std::unique_ptr<Run> copy() const override { return std::make_unique<ModelExchange>(*this); }
    double time() const override { return state_.t; }
    void set_input(std::size_t place, double value) override {
        system().discrete_values(state_)[prepared_->first_input + place] = value;
    }

    double value(Kind kind, std::size_t place) override {
        if (kind == Kind::state) return state_.x.at(place);
        if (kind == Kind::discrete) return system().discrete(state_)[place];
        const auto values = [&](std::size_t count, auto fill) {
            values_.resize(count);
            fill();
            return values_.at(place);
        };
        switch (kind) {
        case Kind::rate:
            return values(state_.x.size(), [&] { system().derivative(state_.t, state_.x, *state_.discrete, values_); });
        case Kind::event_indicator:
            return values(system().guard_count(),
                          [&] { system().guards(state_.t, state_.x, *state_.discrete, values_); });
        default: return values(system().equations().outputs.size(), [&] { system().outputs(state_, values_); });
        }
    }

    void set_time(double t) override { state_.t = t; }
    void set_states(std::span<const double> x) override {
        if (x.size() != state_.x.size()) {
            throw Error(fmt::format("{} continuous states are given, must be {}", x.size(), state_.x.size()));
        }
        state_.x.assign(x.begin(), x.end());
    }
    std::span<const double> states() const override { return state_.x; }
    std::span<const double> nominals() const override { return nominals_; }

    EventResult handle_events() override {
        const std::vector<double> before = state_.x;
        const std::size_t max_rounds = 10 + 2 * system().guard_count();
        std::vector<double> guards(system().guard_count());
        EventLog log;
        for (std::size_t round = 0;; ++round) {
            system().guards(state_.t, state_.x, *state_.discrete, guards);
            std::vector<GuardId> below;
            for (GuardId guard = 0; guard < guards.size(); ++guard) {
                if (guards[guard] < 0) below.push_back(guard);
            }
            if (below.empty()) break;
            if (round == max_rounds) {
                throw Error(
                    fmt::format("{} does not come to rest at t = {:.9g} s: after {} rounds it still asks for an event",
                                system().guard_name(below.front(), state_), state_.t, max_rounds));
            }
            system().on_crossings(below, state_, log);
        }
        return {state_.x != before, system().ends_run(state_)};
    }

  private:
    const EquationSystem& system() const { return *prepared_->system; }

    std::shared_ptr<Prepared> prepared_;
    SystemState state_;
    std::vector<double> nominals_, values_;
};

class SystemOfFmu final : public Model {
  public:
    SystemOfFmu(const Json& json, bool model_exchange) : json_(json.at("equations")) {
        model_exchange_ = model_exchange;
        solver_.method = method_named(json.value("solver", "auto"));
        tolerance_ = solver_.relative_tolerance;
        Equations equations = equations_from(json_);
        if (model_exchange) require_model_exchange(equations);
        close(equations);
        for (const auto& clock : equations.clocks) step_ = step_ == 0 ? clock.period : std::min(step_, clock.period);
        name_variables(equations);
        Prepared prepared;
        open_to_outside(equations, prepared, model_exchange);
        const EquationSystem system(std::move(equations));
        resolved(solver_.method, system); // may refuse
        indicators_ = system.guard_count();
        for (std::size_t i = 0; model_exchange && i < indicators_; ++i) {
            add({Kind::event_indicator, 0, fmt::format("event indicator {}", i + 1), ""});
        }
    }

    std::unique_ptr<Run> start(const Settings& settings) const override {
        Equations equations = equations_from(json_);
        const Settings written = this->settings();
        apply(settings, written, equations);
        close(equations);
        apply(settings, written, equations); // what the contacts have added
        auto prepared = std::make_shared<Prepared>();
        prepared->options = solver_;
        prepared->start_time = settings.start_time;
        if (settings.tolerance) prepared->options.relative_tolerance = *settings.tolerance;
        open_to_outside(equations, *prepared, model_exchange_);
        prepared->system = std::make_unique<const EquationSystem>(std::move(equations));
        if (!model_exchange_) return std::make_unique<CoSimulation>(std::move(prepared), settings);
        if (prepared->system->guard_count() != indicators_) {
            throw InputError(fmt::format("with these parameters there are {} event indicators, must be {} as declared",
                                         prepared->system->guard_count(), indicators_));
        }
        return std::make_unique<ModelExchange>(std::move(prepared));
    }

  private:
    static void require_model_exchange(const Equations& equations) {
        if (!equations.clocks.empty()) {
            throw InputError(fmt::format("{}: has the sample clock {}, and model exchange is for systems without any; "
                                         "co-simulation (--kind cs) runs them inside",
                                         equations.name, equations.clocks.front().name));
        }
        for (const auto& state : equations.states) {
            if (!state.is_algebraic()) continue;
            throw InputError(
                fmt::format("{}: {} is an algebraic variable, and model exchange is for systems without any; "
                            "co-simulation (--kind cs) solves for them",
                            equations.name, state.name));
        }
        // Its importer gives the values of inputs, but neither their rates of change nor where they jump.
        std::vector<Term> moving;
        for (const auto& contact : equations.contacts) moving.push_back(contact.quantity);
        for (const Term term : equations.graph->reachable(equations.terms())) {
            if ((*equations.graph)[term].op == Op::rate) moving.push_back(term);
        }
        const auto variables = equations.graph->variables_of(moving);
        for (const auto& input : equations.inputs) {
            if (!std::binary_search(variables.begin(), variables.end(), input.symbol)) continue;
            throw InputError(fmt::format("{}: a ready part acts with how the input {} changes, which an importer does "
                                         "not tell in model exchange; co-simulation (--kind cs) holds it over a step",
                                         equations.name, input.name));
        }
    }

    void name_variables(const Equations& equations) {
        std::unordered_map<Term, std::size_t> reference;
        add({Kind::time, 0, "time", "s"});
        for (const auto& p : equations.parameters) add({Kind::parameter, 0, p.name, p.unit, "", p.value, true});
        for (const auto& input : equations.inputs) {
            reference[input.symbol] = add({Kind::input, 0, input.name, input.unit, "", input.value, true});
        }
        const std::size_t first_output = variables_.size();
        for (const auto& output : equations.outputs) add({Kind::output, 0, output.name, output.unit});
        for (const auto& state : equations.states) {
            const std::size_t own =
                add({Kind::state, 0, state.name, state.unit, "", state.start, !state.is_algebraic()});
            if (model_exchange_) reference[state.symbol] = own;
        }
        for (const auto& discrete : equations.discrete) {
            std::string meaning;
            for (std::size_t i = 0; i < discrete.modes.size(); ++i) {
                meaning += fmt::format("{}{} {}", i == 0 ? "" : ", ", i, discrete.modes[i]);
            }
            add({Kind::discrete, 0, discrete.name, discrete.unit, meaning, discrete.start, true});
        }
        // Through algebraic variables an output may depend on any input.
        const bool through_algebraic = std::any_of(equations.states.begin(), equations.states.end(),
                                                   [](const auto& state) { return state.is_algebraic(); });
        const auto dependences = [&](Term term) {
            std::vector<std::size_t> found;
            for (const Term variable : equations.graph->variables_of(std::span(&term, 1))) {
                if (const auto known = reference.find(variable); known != reference.end())
                    found.push_back(known->second);
            }
            if (through_algebraic) {
                found.clear();
                for (const auto& [symbol, place] : reference) found.push_back(place);
            }
            std::sort(found.begin(), found.end());
            return found;
        };
        for (std::size_t i = 0; i < equations.outputs.size(); ++i) {
            variables_[first_output + i].depends_on = dependences(equations.outputs[i].value);
        }
        for (std::size_t i = 0; model_exchange_ && i < equations.states.size(); ++i) {
            const auto& state = equations.states[i];
            Variable rate{Kind::rate, 0, fmt::format("der({})", state.name),
                          state.unit.empty() ? "" : fmt::format("({})/s", state.unit)};
            rate.rate_of = reference.at(state.symbol);
            rate.depends_on = dependences(state.rate);
            add(std::move(rate));
        }
    }

    Json json_;
    SolverOptions solver_;
    std::size_t indicators_ = 0;
};

} // namespace

std::unique_ptr<Model> read_system(const Json& json, bool model_exchange) {
    return std::make_unique<SystemOfFmu>(json, model_exchange);
}

} // namespace tribode::fmu
