#include "tribode/base/error.hpp"
#include "tribode/base/field_path.hpp"
#include "tribode/fmu_runtime/fmu_model.hpp"
#include "tribode/machine/servo_system.hpp"
#include "tribode/solver/simulator.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace tribode::fmu {

namespace {

using Kind = Variable::Kind;

// What the machine and its runs share: the system asks for the inputs of the run that is advancing.
struct Driven {
    std::unique_ptr<const ServoSystem> system;
    const std::vector<double>* inputs = nullptr;
    bool closed = false;
    SolverOptions options;

    void make(const MachineModel& model) {
        closed = model.in_closed_loop();
        Drive drive = OpenLoop{[this](long) { return std::array{inputs->at(0), 0.0, 0.0, 0.0}; }};
        if (closed) drive = ClosedLoop{[this](long) { return LoopInput{inputs->at(0), inputs->at(1)}; }};
        system = std::make_unique<const ServoSystem>(model, std::move(drive));
    }
};

class MachineRun final : public Run {
  public:
    MachineRun(std::shared_ptr<Driven> driven, const Settings& settings)
        : driven_(std::move(driven)),
          inputs_(settings.inputs),
          offset_(settings.start_time),
          simulator_(*driven_->system, driven_->options) {}
    MachineRun(const MachineRun& other)
        : driven_(other.driven_),
          inputs_(other.inputs_),
          offset_(other.offset_),
          simulator_(*driven_->system, driven_->options, other.simulator_.state()) {
        simulator_.propose_step(other.simulator_.proposed_step());
    }
    MachineRun& operator=(const MachineRun&) = delete;

    std::unique_ptr<Run> copy() const override { return std::make_unique<MachineRun>(*this); }
    double time() const override { return offset_ + simulator_.state().t; }
    void set_input(std::size_t place, double value) override { inputs_.at(place) = value; }

    double value(Kind kind, std::size_t place) override {
        const SystemState& state = simulator_.state();
        if (kind == Kind::state) return state.x.at(place);
        const auto outputs = driven_->system->outputs(state);
        switch (place) {
        case 0: return detected();
        case 1: return outputs.position;
        case 2: return outputs.velocity;
        case 3: return outputs.friction;
        default: return ServoSystem::values(state).thrust;
        }
    }

    RunOutcome advance(double t_end) override {
        driven_->inputs = &inputs_;
        NearestInstant end{t_end - offset_};
        for (const auto& clock : driven_->system->clocks()) end.look_at(clock.offset, clock.period);
        return simulator_.advance_before(end.t);
    }

  private:
    // y, the last one that a controller of the importing program would have here: of this instant where it is one of a sample.
    // The encoder and the controller step a copy; y does not depend on the inputs.
    double detected() {
        driven_->inputs = &inputs_;
        const ServoSystem& system = *driven_->system;
        SystemState copy = simulator_.state();
        for (const ClockId clock : {ClockId{ServoSystem::encoder}, ClockId{ServoSystem::controller}}) {
            const long k = copy.next_sample.at(clock);
            NearestInstant next{copy.t};
            next.look_at(system.clocks()[clock].offset, system.clocks()[clock].period);
            if (next.distance < 1e-6 && next.t == system.clocks()[clock].instant(k)) system.on_sample(clock, k, copy);
        }
        return ServoSystem::values(copy).detected;
    }

    std::shared_ptr<Driven> driven_;
    std::vector<double> inputs_;
    const double offset_; // of the importing program's time, at which the machine's begins [s]
    Simulator simulator_;
};

class MachineOfFmu final : public Model {
  public:
    explicit MachineOfFmu(const Json& json)
        : model_(MachineModel::from_description(json.at("machine"), json.at("name"))) {
        solver_.method = method_named(json.value("solver", "auto"));
        require_possible(model_);
        step_ = model_.sample_time;
        tolerance_ = solver_.relative_tolerance;
        Driven driven;
        driven.make(model_);
        add({Kind::time, 0, "time", "s"});
        std::size_t place = 0;
        each_number(model_, [&](double value, auto path, std::string_view unit, Allowed, const About& about) {
            const std::string name = path();
            // A run knows nothing of tolerances.
            if (!name.starts_with("tolerance.")) {
                places_.push_back(place);
                add({Kind::parameter, 0, name, std::string(unit), std::string(about.meaning), value, true});
            }
            ++place;
        });
        if (driven.closed) {
            add({Kind::input, 0, "r", "m", "position reference, read at each sample instant", 0, true, true});
            add({Kind::input, 0, "exc", "N", "excitation, added to the controller's output", 0, true, true});
        } else {
            add({Kind::input, 0, "u", "N", "thrust reference, read at each sample instant", 0, true, true});
        }
        add({Kind::output, 0, "y", "m", "detected position", 0, false, true});
        add({Kind::output, 0, "x", "m", "true position"});
        add({Kind::output, 0, "v", "m/s", "true velocity"});
        add({Kind::output, 0, "f", "N", "friction force"});
        if (driven.closed) add({Kind::output, 0, "u", "N", "thrust reference of the last sample", 0, false, true});
        for (const auto& state : driven.system->states()) add({Kind::state, 0, "state." + state.name, state.unit});
    }

    std::unique_ptr<Run> start(const Settings& settings) const override {
        MachineModel model = model_;
        const auto numbers = model.numbers();
        for (std::size_t i = 0; i < places_.size(); ++i) *numbers[places_[i]] = settings.parameters[i];
        auto driven = std::make_shared<Driven>();
        driven->options = solver_;
        if (settings.tolerance) driven->options.relative_tolerance = *settings.tolerance;
        // As a description they are checked.
        driven->make(MachineModel::from_description(model.description(), name_));
        return std::make_unique<MachineRun>(std::move(driven), settings);
    }

  private:
    static void require_possible(const MachineModel& model) {
        if (model.initial == InitialKind::fitted) {
            throw InputError(
                "initial = \"fitted\" needs a record to fit the start to; for a functional mock-up unit it "
                "must be \"rest\"");
        }
        if (model.input == InputKind::band_limited) {
            throw InputError(
                "input = \"band_limited\" needs u as a whole record; for a functional mock-up unit it must be "
                "\"hold\"");
        }
        for (const auto& effect : model.effects) {
            if (effect.kind().name != "own_force") continue;
            throw InputError(
                "the effect own_force is a text in Lua, which a functional mock-up unit cannot run; write the "
                "axis as tb.system{...} with that force");
        }
    }

    MachineModel model_;
    SolverOptions solver_;
    std::vector<std::size_t> places_; // of the parameters, in MachineModel::numbers()
};

} // namespace

std::unique_ptr<Model> read_machine(const Json& json) {
    if (json.at("model_exchange").get<bool>()) {
        throw InputError(
            "a machine has sample clocks (encoder, controller, hold), and model exchange is for systems without "
            "any; co-simulation (--kind cs) runs them inside");
    }
    return std::make_unique<MachineOfFmu>(json);
}

} // namespace tribode::fmu
