// A new effect in one source file: the kind, and the test that machine files, tb.effects, machines as systems of equations,
// the fit and the diagnosis know it. In the engine the first half would be engine/tribode/effect/kinds/one_way_drag.cpp,
// and nothing would register it.
#include "tribode/base/error.hpp"
#include "tribode/diagnosis/diagnosis.hpp"
#include "tribode/effect/candidate.hpp"
#include "tribode/script/script_run.hpp"
#include "unit/diagnosis/small_case.hpp"
#include "unit/script/temporary_folder.hpp"

#include <algorithm>
#include <gtest/gtest.h>

namespace tribode {

namespace effects {

namespace {

class OneWayDrag final : public PointForce {
  public:
    explicit OneWayDrag(double drag) : drag_(drag) {}
    double force(double, double, double v, std::span<const double>) const override { return -drag_ * v * v; }
    std::optional<Slopes> slopes(double, double, double v) const override { return Slopes{0, -2 * drag_ * v}; }
    std::string reason() const override { return "the drag (one_way_drag) is not linear in the velocity"; }

  private:
    double drag_;
};

} // namespace

extern const EffectKind one_way_drag = {
    .name = "one_way_drag",
    .summary = "Wind from one side: moving either way, the axis is pushed back.",
    .order = 125,
    .equation = "- c v^2",
    .parameters = {{.name = "c", .unit = "N s^2/m^2", .meaning = "drag", .plausible_min = 0.1, .plausible_max = 2000}},
    .example = R"({"c": 300})",
    .affine = false,
    .drawn_against = DrawnAgainst::velocity,
    .neutral = {{"c", 0}},
    .apply = [](const Effect& e,
                ServoAxis& axis) { axis.plant.forces.push_back(std::make_shared<const OneWayDrag>(e.number("c"))); },
    .lua = R"lua(
m.add_force { force = function(s) return -p.c * s.v ^ 2 end }
)lua",
    .forms = [](const Clues& clues) -> std::vector<EffectForm> {
        const double c = -regress({map(clues.velocity, [](double v) { return v * v; })}, clues.force).coefficients[0];
        const double typical = clues.typical_force() / (clues.max_speed * clues.max_speed);
        return {{.parameters = {{"c", -1e3 * typical, 1e3 * typical, false, 1e-3 * typical}},
                 .starts = {{Clues::at_least(0.02 * typical, c)}}}};
    },
    .fit_order = 125,
};

} // namespace effects

namespace {

using namespace diagnosis_cases;

class NewEffect : public ::testing::Test {
  protected:
    static void SetUpTestSuite() { register_effect(effects::one_way_drag); }

    static Json description(double c) { return {{"name", "one_way_drag"}, {"parameters", {{"c", c}}}}; }
};

TEST_F(NewEffect, is_in_the_lists_in_its_place_and_has_a_name_of_its_own) {
    std::vector<std::string> names;
    for (const auto* kind : effect_kinds()) names.push_back(kind->name);
    const auto it = std::find(names.begin(), names.end(), "one_way_drag");
    ASSERT_NE(it, names.end());
    EXPECT_EQ(*(it - 1), "quadratic_drag");
    EXPECT_EQ(*(it + 1), "periodic_disturbance");
    EXPECT_NE(effect_tables().find("| `one_way_drag` | Wind from one side"), std::string::npos);
    EXPECT_THROW(register_effect(effects::one_way_drag), InputError);
}

TEST_F(NewEffect, is_known_to_machine_files_tb_effects_and_machines_as_systems) {
    Json machine = small_axis();
    machine["encoder_resolution_m"] = machine["noise_rms_m"] = 0;
    machine["effects"] = Json::array({description(500)});
    const TemporaryFolder folder;
    const auto file = folder.write("machine.json", machine.dump());
    ScriptRequest request;
    request.script = folder.write("script.lua", R"lua(
local tb, servo = require "tribode", require "servo"
local listed
for _, kind in ipairs(tb.effects {}) do
  if kind.name == "one_way_drag" then listed = kind end
end
assert(listed.summary == "Wind from one side: moving either way, the axis is pushed back.")
assert(listed.parameters[1].unit == "N s^2/m^2" and listed.example.c == 300)
local machine = tb.machine(tb.options { machine = "" }.machine)
local exc = {}
for k = 1, 401 do exc[k] = 60 * math.sin(0.05 * k) end
local built_in = tb.simulate { machine = machine, exc = exc, solver = "erk", relative_tolerance = 1e-9 }
assert(built_in.ok, built_in.message)
local system = tb.run_system { system = servo.wire(servo.parts(machine)), duration_s = 400 * machine.Ts,
  output_step_s = machine.Ts, solver = "erk", relative_tolerance = 1e-9,
  inputs = { exc = { sample_time_s = machine.Ts, values = exc } } }
assert(system.ok, system.message)
machine.effects = {}
local without = tb.simulate { machine = machine, exc = exc, solver = "erk", relative_tolerance = 1e-9 }
local difference, size = 0, 0
for k, x in ipairs(built_in.x) do
  difference = math.max(difference, math.abs(system.values["plant.y"][k] - x))
  size = math.max(size, math.abs(without.x[k] - x))
end
assert(size > 1e-5 and difference < 1e-6 * size, string.format("%g of %g", difference, size))
)lua");
    request.folder = folder / "results";
    request.defines = {{"machine", file.string()}};
    request.named = {file};
    ScriptRun run(request, {});
    EXPECT_NO_THROW(run.execute());
}

TEST_F(NewEffect, is_found_and_measured_by_a_diagnosis) {
    const MachineModel machine = MachineModel::from_description(small_axis(), "case");
    const auto record = [&](double amplitude, double frequency, std::uint64_t seed) {
        return measurement_from_table(
            measured(small_axis(), Json::array({description(400)}), sine_record(amplitude, frequency, 2), seed),
            machine, "case");
    };
    const Diagnosis d =
        diagnose(machine, {record(0.012, 1.5, 1)}, record(0.02, 1, 2), {.max_effects = 1}, {.workers = 2});
    ASSERT_EQ(d.verdict, "effect_found");
    ASSERT_EQ(d.effects[0].name, "one_way_drag");
    const double error = d.effects[0].standard_errors["c"].get<double>();
    EXPECT_GT(error, 0);
    EXPECT_NEAR(d.effects[0].parameters["c"].get<double>(), 400, 3.5 * error); // 3.5: once in two thousand
    EXPECT_LT(d.validation_gap.after, 1.2 * d.validation_gap.floor);
}

} // namespace
} // namespace tribode
