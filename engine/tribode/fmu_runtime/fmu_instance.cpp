#include "tribode/fmu_runtime/fmu_instance.hpp"
#include "tribode/base/error.hpp"

#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>

namespace tribode::fmu {

std::string folder_of(const std::string& location) {
    std::string_view rest = location;
    const bool is_uri = rest.starts_with("file:");
    if (is_uri) {
        rest.remove_prefix(sizeof "file:" - 1);
        if (rest.starts_with("//")) {
            rest.remove_prefix(2);
            rest.remove_prefix(std::min(rest.find('/'), rest.size())); // the host, mostly empty
        }
    }
    std::string path;
    const auto digit = [](char c) { return std::isxdigit(static_cast<unsigned char>(c)) != 0; };
    for (std::size_t i = 0; i < rest.size(); ++i) {
        if (is_uri && rest[i] == '%' && i + 2 < rest.size() && digit(rest[i + 1]) && digit(rest[i + 2])) {
            path += static_cast<char>(std::stoi(std::string(rest.substr(i + 1, 2)), nullptr, 16));
            i += 2;
        } else {
            path += rest[i];
        }
    }
    return path;
}

static std::unique_ptr<const Model> read_model(const std::string& resources) {
    const auto file = std::filesystem::path(folder_of(resources)) / "model.json";
    std::ifstream in(file, std::ios::binary);
    if (!in) throw InputError(fmt::format("{}: cannot be read", file.string()));
    try {
        return Model::read(Json::parse(in));
    } catch (const Json::exception& problem) {
        throw InputError(fmt::format("{}: {}", file.string(), problem.what()));
    }
}

Instance::Instance(const std::string& resources, const std::string& token, bool model_exchange)
    : model_(read_model(resources)),
      settings_(model_->settings()) {
    if (token != model_->token()) {
        throw InputError(
            fmt::format("the unit was instantiated with the token {}, its model has {}", token, model_->token()));
    }
    if (model_exchange == model_->is_model_exchange()) return;
    throw InputError(fmt::format("the unit was exported for {}, not for {}",
                                 model_exchange ? "co-simulation" : "model exchange",
                                 model_exchange ? "model exchange" : "co-simulation"));
}

void Instance::set_start(double t, std::optional<double> tolerance) {
    if (phase_ != Phase::instantiated) throw Error("the start time is set before the initialization");
    if (!std::isfinite(t) || t < 0) throw Error(fmt::format("the start time is {} s, must not be negative", t));
    if (tolerance && !(*tolerance > 0 && *tolerance < 1)) {
        throw Error(fmt::format("the tolerance is {}, must be positive and below 1", *tolerance));
    }
    settings_.start_time = time_ = t;
    settings_.tolerance = tolerance;
}

void Instance::enter_initialization() {
    if (phase_ != Phase::instantiated) throw Error("the initialization begins after the instantiation or a reset");
    phase_ = Phase::initialization;
}

void Instance::exit_initialization() {
    if (phase_ != Phase::initialization) throw Error("the initialization has not begun");
    run();
    phase_ = Phase::running;
}

void Instance::reset() {
    settings_ = model_->settings();
    phase_ = Phase::instantiated;
    time_ = 0;
    run_.reset();
}

Run& Instance::run() {
    if (phase_ == Phase::instantiated) throw Error("there is no run before the initialization");
    if (!run_) run_ = model_->start(settings_);
    return *run_;
}

const Variable& Instance::variable(std::size_t reference) const {
    const auto& all = model_->variables();
    if (reference < all.size()) return all[reference];
    throw Error(
        fmt::format("there is no variable with the value reference {}, must be below {}", reference, all.size()));
}

double* Instance::setting(const Variable& variable) {
    switch (variable.kind) {
    case Variable::Kind::parameter: return &settings_.parameters[variable.place];
    case Variable::Kind::input: return &settings_.inputs[variable.place];
    case Variable::Kind::state: return variable.has_start ? &settings_.states[variable.place] : nullptr;
    case Variable::Kind::discrete: return &settings_.discrete[variable.place];
    default: return nullptr;
    }
}

double Instance::get(std::size_t reference) {
    const Variable& wanted = variable(reference);
    if (wanted.kind == Variable::Kind::time) return model_->is_model_exchange() && run_ ? run_->time() : time_;
    const bool is_kept = wanted.kind == Variable::Kind::parameter || wanted.kind == Variable::Kind::input;
    if (is_kept || phase_ == Phase::instantiated) {
        const double* kept = setting(wanted);
        if (!kept) throw Error(fmt::format("{} has no value before the initialization", wanted.name));
        return *kept;
    }
    return run().value(wanted.kind, wanted.place);
}

void Instance::set(std::size_t reference, double value) {
    const Variable& wanted = variable(reference);
    double* kept = setting(wanted);
    if (!kept) throw Error(fmt::format("{} follows from the model and cannot be set", wanted.name));
    if (!std::isfinite(value)) throw Error(fmt::format("{} = {}, must be finite", wanted.name, value));
    const bool is_input = wanted.kind == Variable::Kind::input;
    const bool before = phase_ == Phase::instantiated || phase_ == Phase::initialization;
    if (!is_input && !before) {
        throw Error(fmt::format("{} can be set up to the end of the initialization only", wanted.name));
    }
    *kept = value;
    if (before) {
        run_.reset(); // made anew with it
    } else {
        run().set_input(wanted.place, value);
    }
}

Instance::Step Instance::step(double t, double size) {
    if (phase_ != Phase::running) throw Error("a step needs a unit that is initialized and has not ended");
    if (!(size >= 0) || !std::isfinite(size)) {
        throw Error(fmt::format("the communication step is {} s, must be finite and not negative", size));
    }
    // Who adds up steps is off by rounding.
    const double off = 1e-9 * std::max({std::abs(t), std::abs(time_), size});
    if (!(std::abs(t - time_) <= off)) {
        throw Error(
            fmt::format("the step begins at {:.17g} s, must begin at {:.17g} s where the last one ended", t, time_));
    }
    const RunOutcome outcome = run().advance(t + size);
    if (outcome.end == RunEnd::reached) return {time_ = t + size};
    time_ = run().time();
    phase_ = Phase::stopped;
    if (outcome.end == RunEnd::stopped) return {time_, true};
    throw Error(outcome.message);
}

Instance::Snapshot Instance::snapshot() const { return {settings_, phase_, time_, run_ ? run_->copy() : nullptr}; }

void Instance::restore(const Snapshot& snapshot) {
    settings_ = snapshot.settings;
    phase_ = snapshot.phase;
    time_ = snapshot.time;
    run_ = snapshot.run ? snapshot.run->copy() : nullptr;
}

} // namespace tribode::fmu
