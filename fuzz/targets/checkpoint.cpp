#include "target.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/experiment/sweep_checkpoint.hpp"
#include "tribode/record/json_file.hpp"

#include <cmath>

namespace tribode::fuzz {

namespace {

const MachineModel& mass() {
    static const auto model = MachineModel::from_description(Json{{"rigid_gain_per_kg", 0.1}}, "mass.json");
    return model;
}

SweepOptions three_frequencies() {
    SweepOptions options;
    options.frequency_hz = {10, 20, 30};
    return options;
}

void load(const std::filesystem::path& file) {
    const auto options = three_frequencies();
    SweepCheckpoint checkpoint(file, mass(), options);
    const auto points = checkpoint.load();
    require(points.size() == options.frequency_hz.size(), "a place per frequency");
    SweepResult result;
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (!points[i]) continue;
        result.points.push_back(*points[i]);
    }
    if (result.points.empty()) return;
    result.table();
    result.warnings();
    result.statistics();
    result.loop_gain();
    for (std::size_t a = 0; a < analysis_count; ++a) result.response(a);
}

} // namespace

// As it stands, and as if it belonged to this sweep and had its checksum.
void run_checkpoint(std::string_view bytes) {
    const auto file = scratch_folder() / "sweep.resume.json";
    write_plainly(file, bytes);
    try {
        load(file);
    } catch (const InputError&) {
    }
    try {
        Json json = parse_json(std::string(bytes), "sweep.resume.json");
        if (!json.is_object() || !json.contains("points")) return;
        json["sha256"] = sha256(json["points"].dump(-1, ' ', false, Json::error_handler_t::replace));
        json["key"] = SweepCheckpoint(file, mass(), three_frequencies()).key();
        if (json.contains("points")) {
            json["sha256"] = sha256(json["points"].dump(-1, ' ', false, Json::error_handler_t::replace));
        }
        write_plainly(file, to_json_text(json));
        load(file);
    } catch (const InputError&) {
    }
}

} // namespace tribode::fuzz
