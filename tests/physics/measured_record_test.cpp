// Records of another program, the exact servo, which shares no code with the engine: what the analyses find in them is the
// dynamics of its problem, to what the encoder allows.
#include "physics/oracle.hpp"
#include "tribode/analysis/multisine.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/experiment/identification.hpp"
#include "tribode/experiment/measured_fra.hpp"

namespace tribode {
namespace {

struct OtherProgram {
    problems::ServoProblem problem = problems::linear_motor_table();
    problems::LoopSettings loop = {
        .kp = 2.05e4, .ki = 1.8e5, .kd = 653, .input_delay = 5e-4, .output_delay = 4.18e-4, .encoder_resolution = 1e-7};

    OtherProgram() { problem.lag_hz = 750; }

    Json description() const {
        Json d = description_of(problem);
        add_loop(d, loop);
        return d;
    }

    Table log(const std::vector<double>& excitation) const {
        const auto run = solve_loop_exactly(problem, loop, std::vector<double>(excitation.size()), excitation);
        Table table;
        table.source = "log";
        table.add("t", "s", run.t);
        table.add("exc", "N", excitation);
        table.add("u", "N", run.u);
        table.add("y", "m", run.y);
        return table;
    }
};

std::vector<double> multisine() {
    return make_multisine({.period = 1, .periods = 3, .f_min_hz = 10, .f_max_hz = 200, .amplitude = 60}).values;
}

// Gains, frequencies and damping ratios, one after another.
std::vector<double> numbers_of(const ModalModel& model) {
    std::vector<double> all = {model.rigid_gain};
    for (const auto& mode : model.modes) all.insert(all.end(), {mode.gain, mode.freq_hz, mode.zeta});
    return all;
}

TEST(MeasuredRecord, OfAnotherProgramHasTheDynamicsOfItsProblem) {
    const OtherProgram other;
    const MachineModel machine = machine_of(other.description());
    const ModalModel plant = modal_model_of(machine);
    const std::vector<double> truth = numbers_of(plant);
    const Table log = other.log(multisine());

    const auto fra = measure_fra(machine, {log}, {});
    const MeasuredAnalysis* improved = fra.find("improved");
    ASSERT_TRUE(improved && improved->fit);
    int covered = 0, all = 0;
    for (const auto& point : improved->points) {
        if (!point.missing.empty()) continue;
        const auto error = std::log(point.value / plant.response(point.frequency_hz));
        for (const double part : {error.real(), error.imag()}) {
            covered += std::abs(part) < 1.96 * std::sqrt(point.variance / 2);
            ++all;
        }
    }
    EXPECT_GT(all, 100);
    EXPECT_GT(covered, 0.85 * all);
    const auto found = numbers_of(improved->fit->model), bounds = numbers_of(improved->fit->standard_errors);
    for (std::size_t i = 0; i < truth.size(); ++i) EXPECT_LT(std::abs(found[i] - truth[i]), 3 * bounds[i]) << i;
    EXPECT_NEAR(found[0] / truth[0], 1, 2e-3);

    Json start = other.description();
    start["rigid_gain_per_kg"] = 1.05 * truth[0];
    for (auto& mode : start["modes"]) {
        mode["freq_hz"] = 1.01 * mode["freq_hz"].get<double>();
        mode["zeta"] = 1.3 * mode["zeta"].get<double>();
    }
    IdentifyOptions options;
    options.parameters = {"rigid_gain_per_kg", "modes"};
    GivenRecord record;
    record.table = log;
    const auto parameters = identify(machine_of(start), {record}, {}, options).parameters;
    ASSERT_EQ(parameters.size(), truth.size());
    for (std::size_t i = 0; i < truth.size(); ++i) {
        EXPECT_LT(std::abs(parameters[i].value - truth[i]), 3 * parameters[i].standard_error) << parameters[i].name;
        EXPECT_NEAR(parameters[i].value / truth[i], 1, 3e-3) << parameters[i].name;
    }
}

} // namespace
} // namespace tribode
