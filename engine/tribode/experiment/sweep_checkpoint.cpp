#include "tribode/experiment/sweep_checkpoint.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/json_file.hpp"

#include <fmt/format.h>
#include <limits>

namespace tribode {

namespace {

constexpr std::chrono::seconds saving_interval{5};

Json to_json(std::complex<double> z) { return Json::array({z.real(), z.imag()}); }
std::complex<double> complex_of(const Json& json) { return {json.at(0).get<double>(), json.at(1).get<double>()}; }

// A count of something.
long count_of(const Json& json) {
    constexpr std::int64_t most = std::int64_t{1} << 53;
    if (!json.is_number_integer() || json.get<std::int64_t>() < 0 || json.get<std::int64_t>() > most) {
        throw Error("is not a count");
    }
    return json.get<long>();
}

// What the numbers of the points are checked by: a flipped bit is no result.
std::string checksum_of(const Json& points) {
    return sha256(points.dump(-1, ' ', false, Json::error_handler_t::replace));
}

// Numbers as JSON has them: infinite and undefined ones, which an undistorted or silent signal may give, are null.
double number_of(const Json& json) {
    return json.is_null() ? std::numeric_limits<double>::quiet_NaN() : json.get<double>();
}

Json to_json(const SweepPoint& p) {
    Json json;
    json["frequency_hz"] = p.frequency_hz;
    for (std::size_t a = 0; a < analysis_count; ++a) {
        json["response"].push_back(to_json(p.response[a]));
        json["coherence"].push_back(p.coherence[a]);
    }
    if (p.improved) json["improved"] = to_json(*p.improved);
    if (p.add_on) json["add_on"] = to_json(*p.add_on);
    json["loop_gain"] = to_json(p.loop_gain);
    json["thrust"] = to_json(p.thrust);
    json["position"] = to_json(p.position);
    json["distortion"] = {p.thrust_distortion, p.position_distortion};
    json["settling_time"] = p.settling_time;
    json["settled"] = p.settled;
    json["outcome"] = {static_cast<int>(p.outcome.end), p.outcome.t, p.outcome.message};
    for (const auto& [name, count] : RunStatistics::counts) json["counts"][name] = p.statistics.*count;
    return json;
}

SweepPoint point_of(const Json& json) {
    SweepPoint p;
    p.frequency_hz = json.at("frequency_hz").get<double>();
    for (std::size_t a = 0; a < analysis_count; ++a) {
        p.response[a] = complex_of(json.at("response").at(a));
        p.coherence[a] = number_of(json.at("coherence").at(a));
    }
    if (json.contains("improved")) p.improved = complex_of(json.at("improved"));
    if (json.contains("add_on")) p.add_on = complex_of(json.at("add_on"));
    p.loop_gain = complex_of(json.at("loop_gain"));
    p.thrust = complex_of(json.at("thrust"));
    p.position = complex_of(json.at("position"));
    p.thrust_distortion = number_of(json.at("distortion").at(0));
    p.position_distortion = number_of(json.at("distortion").at(1));
    p.settling_time = json.at("settling_time").get<double>();
    p.settled = json.at("settled").get<bool>();
    const long end = count_of(json.at("outcome").at(0));
    if (end > static_cast<long>(last_run_end)) throw Error("is not an outcome");
    p.outcome = {static_cast<RunEnd>(end), json.at("outcome").at(1).get<double>(),
                 json.at("outcome").at(2).get<std::string>()};
    for (const auto& [name, count] : RunStatistics::counts) p.statistics.*count = count_of(json.at("counts").at(name));
    return p;
}

} // namespace

SweepCheckpoint::SweepCheckpoint(std::filesystem::path path, const MachineModel& machine, const SweepOptions& options)
    : path_(std::move(path)),
      frequency_hz_(options.frequency_hz) {
    key_ = sha256(version() + machine.hash() + options_json(options).dump());
}

std::vector<std::optional<SweepPoint>> SweepCheckpoint::load() {
    std::vector<std::optional<SweepPoint>> points(frequency_hz_.size());
    if (path_.empty() || !std::filesystem::exists(path_)) return points;
    try {
        const Json file = read_json(path_);
        const Json& kept = file.at("points");
        if (file.at("sha256") != checksum_of(kept)) throw Error("another checksum");
        if (file.at("key") != key_) return points;
        for (const auto& [index, point] : kept.items()) {
            const std::size_t place = std::stoul(index);
            points.at(place) = point_of(point);
            if (points[place]->frequency_hz != frequency_hz_[place]) throw Error("another frequency");
            points_[index] = point;
        }
    } catch (const std::exception&) {
        throw InputError(fmt::format("{}: is damaged; remove it, and the sweep begins anew", path_.string()));
    }
    return points;
}

void SweepCheckpoint::add(std::size_t index, const SweepPoint& point) {
    if (path_.empty()) return;
    const std::lock_guard lock(mutex_);
    points_[std::to_string(index)] = to_json(point);
    if (std::chrono::steady_clock::now() - saved_ > saving_interval) save_locked();
}

void SweepCheckpoint::save() {
    if (path_.empty()) return;
    const std::lock_guard lock(mutex_);
    save_locked();
}

void SweepCheckpoint::save_locked() {
    write_json(path_, Json{{"key", key_}, {"points", points_}, {"sha256", checksum_of(points_)}});
    saved_ = std::chrono::steady_clock::now();
}

void SweepCheckpoint::remove() {
    if (path_.empty()) return;
    std::error_code ignored; // there may be none
    std::filesystem::remove(path_, ignored);
}

} // namespace tribode
