#include "physics/reference_machine.hpp"
#include "tribode/base/error.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/experiment/sweep_checkpoint.hpp"
#include "tribode/record/csv.hpp"

#include <cmath>
#include <fstream>
#include <gtest/gtest.h>
#include <random>

namespace tribode {
namespace {

SweepOptions sweep(std::vector<double> frequency_hz, double amplitude = 15) {
    SweepOptions options;
    options.frequency_hz = std::move(frequency_hz);
    options.amplitude = amplitude;
    options.solver.method = Method::erk;
    return options;
}

MachineModel reference() { return machine_of(reference_description()); }

// Without friction and rounding: linear.
MachineModel linear() {
    Json d = reference_description();
    d["friction"] = Json::object();
    d["encoder_resolution_m"] = 0.0;
    return machine_of(d);
}

std::string bytes(const SweepResult& result) { return to_csv(result.table()); }

// How far a response lies from the linear dynamics of the machine, relative, at each frequency.
std::vector<double> deviation(const MachineModel& machine, const FrequencyResponse& response) {
    const ModalModel plant = modal_model_of(machine);
    std::vector<double> result;
    for (std::size_t i = 0; i < response.size(); ++i) {
        result.push_back(std::abs(response.value[i] / plant.response(response.frequency_hz[i]) - 1.0));
    }
    return result;
}

constexpr double dead_time = 1.38e-3; // of the loop: input delay, half a sample, thrust lag, output delay [s]

class TemporaryFile {
  public:
    TemporaryFile() {
        std::random_device random;
        path_ = std::filesystem::temp_directory_path() / ("tribode-sweep-" + std::to_string(random()) + ".json");
    }
    ~TemporaryFile() { std::filesystem::remove(path_); }
    TemporaryFile(const TemporaryFile&) = delete;
    TemporaryFile& operator=(const TemporaryFile&) = delete;
    const std::filesystem::path& path() const { return path_; }

  private:
    std::filesystem::path path_;
};

TEST(FrequencySweep, the_result_is_the_same_to_the_byte_for_any_number_of_workers) {
    Json description = reference_description();
    description["noise_rms_m"] = 1e-8;
    const SweepOptions options = sweep({20, 25, 30, 34, 40, 60, 80, 120, 200});
    std::string first;
    for (const unsigned workers : {1u, 2u, 7u}) {
        RunControl control;
        control.workers = workers;
        const SweepResult result = run_sweep(machine_of(description), options, control);
        EXPECT_TRUE(result.complete);
        if (first.empty()) first = bytes(result);
        EXPECT_EQ(bytes(result), first) << workers;
    }
}

TEST(FrequencySweep, all_analyses_find_the_plant_of_a_linear_machine) {
    SweepOptions options = sweep({5, 10, 20, 40});
    options.settle_tolerance = 1e-5;
    options.settle_time_limit = 10;
    const MachineModel machine = linear();
    const SweepResult result = run_sweep(machine, options);
    for (const auto& point : result.points) {
        EXPECT_TRUE(point.settled) << point.frequency_hz;
        for (const double c : point.coherence) EXPECT_GT(c, 1 - 1e-6);
        EXPECT_LT(point.position_distortion, 1e-4);
    }
    const auto fra1 = deviation(machine, result.response(0).remove_delay(dead_time));
    const auto fra2 = deviation(machine, result.response(1).remove_delay(dead_time));
    const auto proposed = deviation(machine, result.response(2));
    for (std::size_t i = 0; i < 4; ++i) {
        const double f = options.frequency_hz[i];
        // A dead time is all that is removed; hold and thrust lag also lower the gain, by (w Ts)^2/24 and
        // (f/750 Hz)^2/2, and the Pade model of the delay is (w Ts)^2/12 too long.
        const double bound = 4e-4 + 3e-3 * std::pow(f / 40, 2);
        EXPECT_LT(fra1[i], bound) << f;
        EXPECT_LT(proposed[i], bound) << f;
        EXPECT_EQ(fra2[i], fra1[i]) << f; // no friction model to subtract
    }
}

TEST(FrequencySweep, the_proposed_analysis_is_nearer_to_the_plant_than_the_first_where_friction_acts) {
    const MachineModel machine = reference();
    const SweepResult result = run_sweep(machine, sweep({10, 15, 20, 34}));
    const auto fra1 = deviation(machine, result.response(0).remove_delay(dead_time));
    const auto proposed = deviation(machine, result.response(2));
    ASSERT_EQ(fra1.size(), 4u);
    for (std::size_t i = 0; i < 4; ++i) {
        EXPECT_LT(proposed[i], fra1[i]) << result.points[i].frequency_hz;
        EXPECT_LT(proposed[i], 0.5) << result.points[i].frequency_hz;
    }
}

TEST(FrequencySweep, the_improved_analysis_is_made_on_request_and_leaves_the_others_as_they_are) {
    SweepOptions options = sweep({20, 82, 150});
    const SweepResult without = run_sweep(reference(), options);
    options.improved = true;
    const SweepResult with = run_sweep(reference(), options);
    EXPECT_EQ(without.improved().size(), 0u);
    ASSERT_EQ(with.improved().size(), 3u);
    for (std::size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(with.points[i].response, without.points[i].response);
        EXPECT_EQ(with.points[i].coherence, without.points[i].coherence);
    }
    const Table table = with.table();
    const std::size_t more = table.columns.size() - without.table().columns.size();
    EXPECT_EQ(more, 2u);
}

// Hold, delays and thrust lag are exact; the remaining error is the images of the hold that fold onto f.
TEST(FrequencySweep, the_improved_analysis_finds_a_linear_machine_exactly_but_for_the_images_of_the_hold) {
    const MachineModel machine = linear();
    SweepOptions options = sweep({10, 20, 30, 34, 60, 82, 120, 200});
    options.improved = true;
    options.solver.method = Method::exact;
    // The slowest transients, of the second mode (1.7/s) and the integrator, are below 1e-8 then.
    options.settle_time = 12;
    options.settle_time_limit = 20;
    options.settle_tolerance = 1e-8;
    const SweepResult result = run_sweep(machine, options);
    const auto improved = deviation(machine, result.improved());
    ASSERT_EQ(improved.size(), options.frequency_hz.size());
    const ModalModel plant = modal_model_of(machine);
    for (std::size_t i = 0; i < improved.size(); ++i) {
        const double f = options.frequency_hz[i], image = 1 / machine.sample_time - f;
        // At f - 1/Ts the hold and the lag have this much of what they have at f, and the plant is a mass there; the
        // other images are smaller, and their sum is bounded by as much again.
        const double through_actuator = f / image * std::hypot(1, f / 750) / std::hypot(1, image / 750);
        const double mass_response = std::abs(plant.response(image) / plant.response(f));
        EXPECT_LT(improved[i], 1e-6 + 2 * through_actuator * mass_response) << f;
    }
    EXPECT_LT(improved[0], 1e-6);
    // 5 % of gain and 6 % of phase are what the proposed analysis leaves there.
    EXPECT_LT(improved.back(), 1e-3);
    EXPECT_GT(deviation(machine, result.response(2)).back(), 0.05);
}

// u - p fh is the thrust before the feedback is added.
TEST(FrequencySweep, the_add_on_form_of_all_the_friction_is_fra2_of_the_same_signals) {
    SweepOptions options = sweep({20, 60});
    EXPECT_EQ(run_sweep(reference(), options).add_on().size(), 0u);
    options.friction_feedback = 1;
    const SweepResult result = run_sweep(reference(), options);
    ASSERT_EQ(result.add_on().size(), 2u);
    for (std::size_t i = 0; i < 2; ++i) {
        // The same sums: rounding.
        EXPECT_LT(std::abs(result.add_on().value[i] / result.response(1).value[i] - 1.0), 1e-12);
    }
}

TEST(FrequencySweep, the_improved_analysis_finds_the_plant_below_the_friction) {
    SweepOptions options = sweep({21.3, 34.1, 47.3, 66.7, 103.7, 157.9, 191.3});
    options.improved = true;
    options.harmonics = 15;
    options.measure_time = 0.5;
    options.settle_time = 2;
    const MachineModel machine = reference();
    const SweepResult result = run_sweep(machine, options);
    const auto fra1 = deviation(machine, result.response(0).remove_delay(dead_time));
    const auto improved = deviation(machine, result.improved());
    for (std::size_t i = 0; i < improved.size(); ++i) {
        // Half a percent is rounding: one encoder step is a tenth of the 1 um of motion at 190 Hz, 0.3 of it the
        // standard deviation, divided by the root of half the thousand samples: 0.13 %.
        EXPECT_LT(improved[i], 5e-3) << options.frequency_hz[i];
        EXPECT_GT(fra1[i], 0.05) << options.frequency_hz[i];
    }
}

// Rolling friction is bounded: the larger the motion, the less it matters.
// An axis that does not reverse has no friction that changes with the sine: FRA-1 is the plant behind the delay. Along a slow
// sine it reverses now and then.
TEST(FrequencySweep, the_first_analysis_finds_the_plant_while_the_axis_moves) {
    const MachineModel machine = reference();
    const auto distance = [&](const SweepOptions& options) {
        const auto result = run_sweep(machine, options);
        return deviation(machine, result.response(0).remove_delay(dead_time));
    };
    SweepOptions options = sweep({20, 35.3, 60, 110});
    const auto at_rest = distance(options);
    options.bias_velocity = 0.03;
    const auto moving = distance(options);
    options.bias_velocity = 0;
    options.carrier_amplitude = 0.02;
    options.carrier_hz = 1;
    options.settle_time_limit = 8;
    const auto along = distance(options);
    for (std::size_t i = 0; i < at_rest.size(); ++i) {
        EXPECT_GT(at_rest[i], 0.08) << i;
        EXPECT_LT(moving[i], 0.03) << i; // hold and lag take 2 % of the gain at 110 Hz
        EXPECT_LT(along[i], 0.05) << i;
    }
}

TEST(FrequencySweep, each_frequency_has_the_amplitude_that_is_given) {
    SweepOptions options = sweep({20, 60});
    options.amplitudes = {30, 12};
    const auto shaped = run_sweep(reference(), options);
    for (const std::size_t i : {0u, 1u}) {
        const auto alone = run_sweep(reference(), sweep({20, 60}, options.amplitudes[i]));
        EXPECT_EQ(shaped.points[i].response, alone.points[i].response);
        EXPECT_EQ(shaped.points[i].loop_gain, alone.points[i].loop_gain);
    }
}

// As late as the machine's own description says, not as the paper's table.
TEST(FrequencySweep, the_delay_model_is_the_machines_own) {
    Json d = reference_description();
    d["friction"] = Json::object();
    d["input_delay_s"] = 2.5e-3;
    const MachineModel slow = machine_of(d);
    SweepOptions options = sweep({20, 60, 110});
    for (const double error : deviation(slow, run_sweep(slow, options).response(2))) EXPECT_LT(error, 0.03);
    options.delay = 1.38e-3;
    EXPECT_GT(deviation(slow, run_sweep(slow, options).response(2)).back(), 1);
}

TEST(FrequencySweep, the_first_analysis_comes_nearer_to_the_plant_with_the_amplitude) {
    const MachineModel machine = reference();
    std::vector<double> previous(4, 1e9);
    for (const double amplitude : {15.0, 20.0, 30.0, 50.0}) {
        const SweepResult result = run_sweep(machine, sweep({10, 15, 20, 34}, amplitude));
        const auto now = deviation(machine, result.response(0).remove_delay(dead_time));
        ASSERT_EQ(now.size(), 4u);
        for (std::size_t i = 0; i < 4; ++i) {
            EXPECT_LT(now[i], previous[i]) << amplitude << " N, " << result.points[i].frequency_hz << " Hz";
        }
        previous = now;
    }
}

TEST(FrequencySweep, says_whether_a_point_has_settled) {
    SweepOptions options = sweep({30});
    EXPECT_TRUE(run_sweep(reference(), options).points[0].settled);
    options.settle_tolerance = 1e-15;
    options.settle_time_limit = 0.7;
    const SweepResult hasty = run_sweep(reference(), options);
    EXPECT_FALSE(hasty.points[0].settled);
    EXPECT_TRUE(hasty.points[0].outcome.ok());
    ASSERT_EQ(hasty.warnings().size(), 1u);
    EXPECT_NE(hasty.warnings()[0].find("30 Hz: not settled"), std::string::npos);
}

TEST(FrequencySweep, settling_may_be_asked_to_take_no_time_at_all) {
    SweepOptions options = sweep({30, 100});
    options.settle_periods = 0;
    options.settle_time = 0;
    const SweepResult result = run_sweep(linear(), options);
    for (const auto& point : result.points) {
        EXPECT_TRUE(point.outcome.ok()) << point.outcome.message;
        // Two windows of at least 0.05 s are compared in any case.
        EXPECT_GE(point.settling_time, 2 * 0.05) << point.frequency_hz;
    }
    options.settle_periods = 1;
    EXPECT_TRUE(run_sweep(linear(), options).complete);
}

TEST(FrequencySweep, a_loop_that_is_unstable_gives_texts_and_no_numbers) {
    Json description = reference_description();
    description["controller"]["kp"] = 1e7;
    description["controller"]["kd"] = 1e6;
    const SweepResult result = run_sweep(machine_of(description), sweep({20, 40}));
    ASSERT_EQ(result.points.size(), 2u);
    EXPECT_TRUE(result.complete);
    EXPECT_EQ(result.warnings().size(), 2u);
    for (const auto& point : result.points) {
        EXPECT_FALSE(point.outcome.ok());
        EXPECT_FALSE(point.outcome.message.empty());
    }
    EXPECT_EQ(result.response(0).size(), 0u);
    EXPECT_TRUE(std::isnan(result.table()["fra1_real_m_per_N"].values[0]));
    EXPECT_EQ(result.table()["frequency_hz"].values, (std::vector<double>{20, 40}));
}

const std::vector<double> ten_frequencies = {20, 24, 28, 32, 36, 40, 50, 60, 80, 100};

// Runs the sweep until three points are done.
SweepResult interrupted_sweep(const MachineModel& machine, const SweepOptions& options,
                              const std::filesystem::path& checkpoint) {
    std::atomic<bool> stop{false};
    RunControl control;
    control.stop = &stop;
    control.progress = [&](const std::string&, std::size_t done, std::size_t) { stop = done >= 3; };
    return run_sweep(machine, options, control, checkpoint);
}

// Runs the sweep to its end; tells how many points were done when the first new one was.
std::pair<SweepResult, std::size_t> resumed_sweep(const MachineModel& machine, const SweepOptions& options,
                                                  const std::filesystem::path& checkpoint) {
    std::size_t first = 0;
    RunControl control;
    control.progress = [&](const std::string&, std::size_t done, std::size_t) { first = first ? first : done; };
    SweepResult result = run_sweep(machine, options, control, checkpoint);
    return {std::move(result), first};
}

TEST(SweepCheckpoint, a_sweep_interrupted_and_resumed_equals_the_undisturbed_one_to_the_byte) {
    const SweepOptions options = sweep(ten_frequencies);
    const TemporaryFile file;
    const SweepResult part = interrupted_sweep(reference(), options, file.path());
    EXPECT_FALSE(part.complete);
    EXPECT_EQ(part.points.size(), 3u);
    ASSERT_TRUE(std::filesystem::exists(file.path()));
    const auto [whole, first] = resumed_sweep(reference(), options, file.path());
    EXPECT_EQ(first, 4u); // three were kept
    EXPECT_TRUE(whole.complete);
    EXPECT_EQ(bytes(whole), bytes(run_sweep(reference(), options)));
    EXPECT_FALSE(std::filesystem::exists(file.path()));
}

TEST(SweepCheckpoint, the_improved_analysis_is_kept_too) {
    SweepOptions options = sweep(ten_frequencies);
    options.improved = true;
    const TemporaryFile file;
    interrupted_sweep(reference(), options, file.path());
    const auto [whole, first] = resumed_sweep(reference(), options, file.path());
    EXPECT_EQ(first, 4u); // three were kept
    EXPECT_EQ(whole.improved().size(), ten_frequencies.size());
    EXPECT_EQ(bytes(whole), bytes(run_sweep(reference(), options)));
}

TEST(SweepCheckpoint, the_add_on_form_and_the_loop_gain_are_kept_too) {
    SweepOptions options = sweep(ten_frequencies);
    options.friction_feedback = 0.8;
    const TemporaryFile file;
    interrupted_sweep(reference(), options, file.path());
    const auto [whole, first] = resumed_sweep(reference(), options, file.path());
    EXPECT_EQ(first, 4u); // three were kept
    EXPECT_EQ(whole.add_on().size(), ten_frequencies.size());
    EXPECT_EQ(bytes(whole), bytes(run_sweep(reference(), options)));
}

TEST(SweepCheckpoint, a_damaged_file_is_refused_and_kept) {
    const SweepOptions options = sweep({30, 50, 70, 90});
    const TemporaryFile file;
    interrupted_sweep(reference(), options, file.path());
    std::ifstream in(file.path());
    const std::string kept((std::istreambuf_iterator<char>(in)), {});
    in.close();
    std::string other_field = kept;
    other_field.replace(other_field.find("\"thrust\""), 8, "\"thirst\"");
    for (const std::string& damaged :
         {std::string("not JSON"), std::string(), kept.substr(0, kept.size() / 2), other_field}) {
        std::ofstream(file.path()) << damaged;
        EXPECT_THROW(resumed_sweep(reference(), options, file.path()), InputError) << damaged;
        std::ifstream after(file.path());
        EXPECT_EQ(std::string((std::istreambuf_iterator<char>(after)), {}), damaged);
    }
}

TEST(SweepCheckpoint, belongs_to_every_option) {
    const SweepOptions options = sweep({30, 50});
    const std::string key = SweepCheckpoint("", reference(), options).key();
    Json all = options_json(options);
    for (const auto& [name, value] : all.items()) {
        Json changed = all;
        changed.erase("max_step_s"); // zero is none, and is not written
        if (name == "max_step_s" || name == "delay_s")
            changed[name] = 0.1;
        else if (value.is_boolean())
            changed[name] = !value.get<bool>();
        if (value.is_number_integer()) changed[name] = value.get<long>() + 1;
        if (value.is_number_float()) changed[name] = 2 * value.get<double>() + 1e-3;
        if (value.is_array()) changed[name].push_back(90.0);
        if (name == "solver") changed[name] = "adams";
        if (name == "friction_model") changed[name] = {{"viscous", 1.5}};
        SweepOptions other;
        FieldReader fields(changed, name);
        read_options(other, fields);
        fields.finish();
        EXPECT_NE(SweepCheckpoint("", reference(), other).key(), key) << name;
    }
}

TEST(SweepCheckpoint, points_of_another_machine_or_other_options_are_not_used) {
    const SweepOptions options = sweep({30, 50, 70, 90});
    const TemporaryFile file;
    const auto first_after = [&](const MachineModel& machine, const SweepOptions& other) {
        interrupted_sweep(reference(), options, file.path());
        return resumed_sweep(machine, other, file.path()).second;
    };
    EXPECT_EQ(first_after(reference(), options), 4u);
    EXPECT_EQ(first_after(linear(), options), 1u);
    for (const auto change :
         {+[](SweepOptions& o) { o.amplitude = 16; }, +[](SweepOptions& o) { o.seed = 1; },
          +[](SweepOptions& o) { o.solver.relative_tolerance = 1e-7; },
          +[](SweepOptions& o) { o.measure_periods = 12; }, +[](SweepOptions& o) { o.improved = true; }}) {
        SweepOptions other = options;
        change(other);
        EXPECT_EQ(first_after(reference(), other), 1u);
    }
}

TEST(FrequencySweep, refuses_frequencies_that_cannot_be_measured_and_machines_without_controller) {
    EXPECT_THROW(run_sweep(reference(), sweep({10, 1000})), InputError); // the Nyquist frequency
    EXPECT_THROW(run_sweep(reference(), sweep({10, 1500})), InputError);
    EXPECT_THROW(run_sweep(reference(), sweep({20, 10})), InputError);
    EXPECT_THROW(run_sweep(reference(), sweep({10, 10})), InputError);
    EXPECT_THROW(run_sweep(reference(), sweep({0, 10})), InputError);
    EXPECT_THROW(run_sweep(reference(), sweep({})), InputError);
    EXPECT_THROW(run_sweep(machine_of(bare_description()), sweep({10})), InputError);
    SweepOptions shaped = sweep({10, 20});
    shaped.amplitudes = {15};
    EXPECT_THROW(run_sweep(reference(), shaped), InputError);
    SweepOptions along = sweep({10, 20});
    along.carrier_amplitude = 0.01;
    along.carrier_hz = 6;
    EXPECT_THROW(run_sweep(reference(), along), InputError);
    along.carrier_hz = 1;
    along.improved = true;
    EXPECT_THROW(run_sweep(reference(), along), InputError);
    try {
        run_sweep(reference(), sweep({1234}));
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("900 Hz"), std::string::npos) << error.what();
    }
}

TEST(FrequencySweep, the_signals_of_one_frequency_cover_the_periods_asked_for) {
    const SweepSignals s = run_single_frequency(reference(), sweep({}), 20, 2);
    EXPECT_NEAR(static_cast<double>(s.trace.t.size()), 2 * 100 + 1, 1);
    for (const auto* column : {&s.trace.u, &s.trace.y, &s.delayed_thrust, &s.friction_estimate, &s.effective_thrust}) {
        EXPECT_EQ(column->size(), s.trace.t.size());
    }
    for (std::size_t i = 0; i < s.effective_thrust.size(); ++i) {
        EXPECT_EQ(s.effective_thrust[i], s.delayed_thrust[i] - s.friction_estimate[i]) << i;
    }
}

// With the friction taken out of the model, FRA-2 is FRA-1, and the model that is given does not move the machine.
TEST(FrequencySweep, TheFrictionModelMayDifferFromTheMachine) {
    const MachineModel machine = reference();
    SweepOptions options = sweep({20, 60});
    const SweepResult own = run_sweep(machine, options);
    options.friction_model = FrictionModel{};
    const SweepResult none = run_sweep(machine, options);
    options.friction_model = FrictionModel::of(machine);
    const SweepResult given = run_sweep(machine, options);
    EXPECT_EQ(bytes(given), bytes(own));
    for (std::size_t i = 0; i < 2; ++i) {
        EXPECT_EQ(none.points[i].response[0], own.points[i].response[0]);
        EXPECT_EQ(none.points[i].response[1], none.points[i].response[0]);
        EXPECT_GT(std::abs(own.points[i].response[1] / none.points[i].response[1] - 1.0), 0.01);
    }
}

} // namespace
} // namespace tribode
