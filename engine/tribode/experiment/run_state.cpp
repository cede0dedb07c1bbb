#include "tribode/experiment/run_state.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

constexpr const char* format = "tribode run state 1";

// Independent of how a number is written, 1 or 1.0.
std::string checksum(const RunState& state) {
    std::string all = fmt::format("{}\n{}\n{}\n{}", format, state.fingerprint, state.method, to_text(state.step));
    for (const auto& [name, list] : state.system) {
        all += "\n" + name;
        for (const double value : list) all += fmt::format(" {}", to_text(value));
    }
    return sha256(all);
}

RunState read(const Json& json, const std::string& where) {
    const auto damaged = [&](const std::string& what) {
        throw InputError(fmt::format("{} is damaged or no state of a run: {}", where, what));
    };
    const auto text = [&](const char* key) {
        if (!json.is_object() || !json.contains(key) || !json[key].is_string())
            damaged(fmt::format("it has no {}", key));
        return json[key].get<std::string>();
    };
    RunState state;
    if (text("format") != format) damaged(fmt::format("its format is \"{}\", must be \"{}\"", text("format"), format));
    state.fingerprint = text("system");
    state.method = text("solver");
    if (!json.contains("step_s") || !json["step_s"].is_number()) damaged("it has no step_s");
    state.step = json["step_s"].get<double>();
    if (!json.contains("lists") || !json["lists"].is_object()) damaged("it has no lists");
    for (const auto& [name, values] : json["lists"].items()) {
        auto& list = state.system[name];
        for (const auto& value : values) { // an empty list may have become an empty table
            const auto number = value.is_number()   ? std::optional(value.get<double>())
                                : value.is_string() ? parse_number(value.get<std::string>())
                                                    : std::nullopt;
            if (!number) damaged(fmt::format("{} has an entry that is no number", name));
            list.push_back(*number);
        }
    }
    if (text("checksum") != checksum(state)) damaged("its checksum does not fit");
    return state;
}

} // namespace

Json to_json(const RunState& state) {
    Json lists = Json::object();
    for (const auto& [name, list] : state.system) {
        Json& values = lists[name] = Json::array();
        // A file has no other way to write what is not finite.
        for (const double value : list) values.push_back(std::isfinite(value) ? Json(value) : Json(to_text(value)));
    }
    return {{"format", format},     {"system", state.fingerprint}, {"solver", state.method},
            {"step_s", state.step}, {"lists", std::move(lists)},   {"checksum", checksum(state)}};
}

RunState read_run_state(const Json& json, const std::string& fingerprint, const std::string& where) {
    RunState state = read(json, where);
    if (state.fingerprint != fingerprint) {
        throw InputError(
            fmt::format("{} is that of another system, or of other parameters or inputs; start = run.final "
                        "begins a run with its values",
                        where));
    }
    return state;
}

double time_of_run_state(const Json& json, const std::string& where) {
    const RunState state = read(json, where);
    const auto t = state.system.find("t");
    return t == state.system.end() || t->second.empty() ? 0 : t->second[0];
}

} // namespace tribode
