#include "tribode/fmu_runtime/fmu_model.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode::fmu {

static Error not_in(const char* kind) { return Error(fmt::format("this is no function of {}", kind)); }

RunOutcome Run::advance(double) { throw not_in("model exchange"); }
void Run::set_time(double) { throw not_in("co-simulation"); }
void Run::set_states(std::span<const double>) { throw not_in("co-simulation"); }
std::span<const double> Run::states() const { throw not_in("co-simulation"); }
std::span<const double> Run::nominals() const { throw not_in("co-simulation"); }
EventResult Run::handle_events() { throw not_in("co-simulation"); }

std::unique_ptr<Model> Model::read(const Json& json) {
    try {
        const bool model_exchange = json.at("model_exchange");
        auto model = json.contains("machine") ? read_machine(json) : read_system(json, model_exchange);
        model->name_ = json.at("name");
        model->token_ = json.value("token", "");
        return model;
    } catch (const Json::exception& problem) {
        throw InputError(fmt::format("model.json: {}", problem.what()));
    }
}

std::size_t Model::add(Variable variable) {
    variable.place = count(variable.kind);
    variables_.push_back(std::move(variable));
    return variables_.size() - 1;
}

std::size_t Model::count(Variable::Kind kind) const {
    return static_cast<std::size_t>(
        std::count_if(variables_.begin(), variables_.end(), [&](const auto& v) { return v.kind == kind; }));
}

Settings Model::settings() const {
    Settings made;
    for (const auto& variable : variables_) {
        switch (variable.kind) {
        case Variable::Kind::parameter: made.parameters.push_back(variable.start); break;
        case Variable::Kind::input: made.inputs.push_back(variable.start); break;
        case Variable::Kind::state: made.states.push_back(variable.start); break;
        case Variable::Kind::discrete: made.discrete.push_back(variable.start); break;
        default: break;
        }
    }
    return made;
}

void NearestInstant::look_at(double offset, double period) {
    const double k = std::round((t - offset) / period);
    const double instant = offset + k * period;
    const double away = std::abs(t - instant) / period;
    if (k < 0 || !(away < distance)) return;
    distance = away;
    t = instant;
}

} // namespace tribode::fmu
