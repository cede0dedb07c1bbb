#include "tribode/diagnosis/measurement.hpp"
#include "tribode/diagnosis/noise_floor.hpp"
#include "tribode/diagnosis/response.hpp"
#include "unit/diagnosis/small_case.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

using namespace diagnosis_cases;

// A strong random force beside a fine encoder makes errors of which a millionth part is new in each sample.
TEST(NoiseFloor, ErrorsOfTheTrueMachineAreWhiteWithVarianceOneHoweverSmoothTheyAre) {
    Json machine = Json::parse(R"({"Ts": 0.0005, "rigid_gain_per_kg": 0.1, "friction": {"viscous": 20, "coulomb": 0},
        "controller": {"type": "pid", "kp": 2000, "ki": 0, "kd": 100, "derivative_filter_hz": 300}})");
    for (const double force : {0.0, 0.1, 2.0}) {
        for (const double sensor : {1e-9, 1e-8, 1e-6}) {
            for (const double coulomb : {0.0, 4.0}) {
                machine["friction"]["coulomb"] = coulomb;
                machine["process_noise_rms_N"] = force;
                machine["encoder_resolution_m"] = machine["noise_rms_m"] = sensor;
                const MachineModel model = MachineModel::from_description(machine, "case");
                const Measurement measurement =
                    measurement_from_table(measured(machine, Json::array(), sine_record(0.05, 1, 3), 7), model, "case");
                const auto floor = noise_floor(model, measurement, {});
                ASSERT_TRUE(floor);
                auto errors = measurement.position();
                const auto clean = *simulated_position(model, measurement);
                for (std::size_t k = 0; k < errors.size(); ++k) errors[k] -= clean[k];
                const auto white = floor->whitened(errors);
                double square = 0, product = 0;
                for (std::size_t k = 0; k < white.size(); ++k) {
                    square += white[k] * white[k];
                    if (k > 0) product += white[k] * white[k - 1];
                }
                const double n = static_cast<double>(white.size());
                EXPECT_NEAR(square / n, 1, 5 * std::sqrt(2 / n) + 3 * floor->spread) << force << " " << sensor;
                EXPECT_NEAR(product / square, 0, 5 / std::sqrt(n)) << force << " " << sensor;
                EXPECT_LT(floor->spread, 0.05);
            }
        }
    }
}

} // namespace
} // namespace tribode
