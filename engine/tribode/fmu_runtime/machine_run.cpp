#include "tribode/base/error.hpp"
#include "tribode/fmu_runtime/fmu_model.hpp"
#include "tribode/machine/servo_system.hpp"
#include "tribode/solver/simulator.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <map>

namespace tribode::fmu {

namespace {

using Kind = Variable::Kind;

// Units of the fields of a machine description, by the last name of their path.
const std::map<std::string, std::string>& units() {
    static const std::map<std::string, std::string> table = {{"Ts", "s"},
                                                             {"rigid_gain_per_kg", "m/(N s2)"},
                                                             {"gain", "m/(N s2)"},
                                                             {"freq_hz", "Hz"},
                                                             {"zeta", ""},
                                                             {"coulomb", "N"},
                                                             {"static", "N"},
                                                             {"velocity", "m/s"},
                                                             {"exponent", ""},
                                                             {"viscous", "N s/m"},
                                                             {"K", "N/m"},
                                                             {"F", "N"},
                                                             {"D", "N s/m"},
                                                             {"input_delay_s", "s"},
                                                             {"output_delay_s", "s"},
                                                             {"current_loop_hz", "Hz"},
                                                             {"noise_rms_m", "m"},
                                                             {"encoder_resolution_m", "m"},
                                                             {"process_noise_rms_N", "N"}};
    return table;
}

std::string unit_of(const Json::json_pointer& path, const Json& machine) {
    const std::string name = path.back();
    const Json::json_pointer above = path.parent_pointer();
    if (!above.empty() && above.back() == "controller") {
        const bool cascade = machine.at("controller").value("type", "pid") == "cascade";
        if (name == "kp") return cascade ? "1/s" : "N/m";
        if (name == "limit") return "N";
        if (name == "derivative_filter_hz") return "Hz";
        return name == "ki" ? "N/(m s)" : name == "kd" || name == "kv" ? "N s/m" : "";
    }
    // Of effects: effects/i/parameters/name, or .../name/j/field.
    const std::string text = path.to_string();
    if (text.starts_with("/effects/")) {
        const auto effect = text.substr(0, text.find('/', sizeof "/effects/" - 1));
        const auto& parameters = effect_kind(machine.at(Json::json_pointer(effect)).value("name", "")).parameters;
        for (const auto& parameter : parameters) {
            if (parameter.name == name) return parameter.unit;
            for (const auto& field : parameter.fields) {
                if (field.name == name) return field.unit;
            }
        }
        return "";
    }
    const auto known = units().find(name);
    return known == units().end() ? "" : known->second;
}

// "/modes/0/freq_hz" -> "modes[1].freq_hz".
std::string name_of(Json::json_pointer path) {
    std::vector<std::string> parts;
    for (; !path.empty(); path.pop_back()) parts.push_back(path.back());
    std::string name;
    for (auto part = parts.rbegin(); part != parts.rend(); ++part) {
        const bool is_index = part->find_first_not_of("0123456789") == std::string::npos;
        if (is_index) {
            name += fmt::format("[{}]", std::stoul(*part) + 1);
        } else {
            name += (name.empty() ? "" : ".") + *part;
        }
    }
    return name;
}

void find_numbers(const Json& value, const Json::json_pointer& path, std::vector<Json::json_pointer>& found) {
    if (value.is_number() && !value.is_number_integer()) found.push_back(path);
    if (value.is_number_integer() && (path.empty() || path.back() != "delay_samples")) found.push_back(path);
    if (value.is_object()) {
        for (const auto& [key, field] : value.items()) {
            if (!FieldReader::is_note(key) && !(path.empty() && key == "tolerance"))
                find_numbers(field, path / key, found);
        }
    }
    for (std::size_t i = 0; value.is_array() && i < value.size(); ++i) find_numbers(value[i], path / i, found);
}

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
    explicit MachineOfFmu(const Json& json) : description_(json.at("machine")) {
        solver_.method = method_named(json.value("solver", "auto"));
        const MachineModel model = MachineModel::from_description(description_, json.at("name"));
        require_possible(model);
        step_ = model.sample_time;
        tolerance_ = solver_.relative_tolerance;
        Driven driven;
        driven.make(model);
        add({Kind::time, 0, "time", "s"});
        find_numbers(description_, Json::json_pointer(), paths_);
        for (const auto& path : paths_) {
            add({Kind::parameter, 0, name_of(path), unit_of(path, description_), "", description_[path].get<double>(),
                 true});
        }
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
        Json description = description_;
        for (std::size_t i = 0; i < paths_.size(); ++i) {
            // What nobody changed stays as it was written, an integer too.
            if (description[paths_[i]].get<double>() != settings.parameters[i]) {
                description[paths_[i]] = settings.parameters[i];
            }
        }
        auto driven = std::make_shared<Driven>();
        driven->options = solver_;
        if (settings.tolerance) driven->options.relative_tolerance = *settings.tolerance;
        driven->make(MachineModel::from_description(description, name_));
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

    Json description_;
    SolverOptions solver_;
    std::vector<Json::json_pointer> paths_; // of the parameters
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
