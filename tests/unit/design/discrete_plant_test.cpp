#include "tribode/analysis/loop_gain.hpp"
#include "tribode/base/error.hpp"
#include "tribode/design/discrete_plant.hpp"

#include <Eigen/Dense>
#include <gtest/gtest.h>
#include <unsupported/Eigen/MatrixFunctions>

#include <cmath>
#include <numbers>
#include <random>

namespace tribode {
namespace {

using Complex = std::complex<double>;
using std::numbers::pi;

constexpr double ts = 5e-4; // [s]

const ModalModel table{94.28e-3, {{13.08e-3, 33.32, 2.48e-2}, {5.27e-3, 82.22, 3.22e-3}}};

// The section by the other road: x'' = gain u - 2 zeta w x' - w^2 x with u held, by the exponential of the matrix with
// the input as a third state. The second is x'/w, so that the matrix is balanced.
std::vector<double> positions_by_matrix_exponential(double gain, double w, double zeta, const std::vector<double>& u) {
    Eigen::Matrix3d a;
    const double scale = w > 0 ? w : 1;
    a << 0, scale, 0, -w * w / scale, -2 * zeta * w, gain / scale, 0, 0, 0;
    const Eigen::Matrix3d step = (a * ts).exp();
    Eigen::Vector3d x = Eigen::Vector3d::Zero();
    std::vector<double> positions;
    for (const double value : u) {
        positions.push_back(x[0]);
        x[2] = value;
        x = step * x;
    }
    return positions;
}

std::vector<double> random_thrust(std::size_t count) {
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    std::vector<double> thrust(count);
    for (double& value : thrust) value = normal(random);
    return thrust;
}

double largest(const std::vector<double>& values) {
    double most = 0;
    for (const double value : values) most = std::max(most, std::abs(value));
    return most;
}

class OneMode : public ::testing::TestWithParam<VibrationMode> {};

TEST_P(OneMode, MovesAsTheMatrixExponentialSays) {
    const auto mode = GetParam();
    const auto thrust = random_thrust(200);
    const auto found = DiscretePlant({0, {mode}}, ts).simulate(thrust);
    const auto expected = positions_by_matrix_exponential(mode.gain, 2 * pi * mode.freq_hz, mode.zeta, thrust);
    // The coefficients are known to rounding over (w Ts)^2, which is 1e-5 for the slowest mode here.
    for (std::size_t k = 0; k < thrust.size(); ++k) EXPECT_NEAR(found[k], expected[k], 1e-10 * largest(expected)) << k;
}

INSTANTIATE_TEST_SUITE_P(Dampings, OneMode,
                         ::testing::Values(VibrationMode{5.27e-3, 82.22, 3.22e-3}, VibrationMode{0.01, 300, 0},
                                           VibrationMode{0.01, 40, 1}, VibrationMode{0.01, 40, 2.5},
                                           VibrationMode{0.01, 1, 0.02}));

TEST(DiscretePlant, ARigidBodyMovesAsTheMatrixExponentialSays) {
    const auto thrust = random_thrust(200);
    const auto found = DiscretePlant({0.1, {}}, ts).simulate(thrust);
    const auto expected = positions_by_matrix_exponential(0.1, 0, 0, thrust);
    for (std::size_t k = 0; k < thrust.size(); ++k) EXPECT_NEAR(found[k], expected[k], 1e-12 * largest(expected));
}

TEST(DiscretePlant, TheQuotientOfThePolynomialsIsTheSumOfTheSections) {
    const DiscretePlant plant(table, ts);
    ASSERT_EQ(plant.order(), 6u);
    ASSERT_EQ(plant.numerator().size(), 7u);
    EXPECT_EQ(plant.numerator()[0], 0);
    EXPECT_EQ(plant.denominator()[0], 1);
    for (const double f : {20.0, 33.0, 80.0, 200.0, 900.0}) {
        const Complex d = std::polar(1.0, -2 * pi * f * ts);
        Complex above = 0, below = 0;
        for (std::size_t i = 7; i-- > 0;) {
            above = above * d + plant.numerator()[i];
            below = below * d + plant.denominator()[i];
        }
        // D is 2e-6 at 20 Hz and less at 33 Hz, its coefficients go to 20: rounding of these over that.
        EXPECT_LT(std::abs(above / below / plant.response(f) - 1.0), 1e-7) << f;
    }
}

TEST(DiscretePlant, ThePolesAreThoseOfTheModelThroughTheExponential) {
    const auto poles = DiscretePlant(table, ts).poles();
    ASSERT_EQ(poles.size(), 6u);
    EXPECT_EQ(poles[0], Complex(1));
    EXPECT_EQ(poles[1], Complex(1));
    const double w = 2 * pi * 33.32, zeta = 2.48e-2;
    const Complex expected = std::exp(ts * Complex(-zeta * w, w * std::sqrt(1 - zeta * zeta)));
    EXPECT_LT(std::abs(poles[2] - expected), 1e-13); // rounding, over an angle of 0.1
}

TEST(DiscretePlant, ItsZerosAreZerosOfTheResponse) {
    const DiscretePlant plant(table, ts);
    const auto zeros = plant.zeros();
    ASSERT_EQ(zeros.size(), 5u);
    for (const Complex zero : zeros) {
        Complex sum = 0, size = 0;
        for (const auto& s : plant.sections()) {
            const Complex d = 1.0 / zero, term = d * (s.b1 + s.b2 * d) / (1.0 + d * (s.a1 + s.a2 * d));
            sum += term;
            size += std::abs(term);
        }
        EXPECT_LT(std::abs(sum), 1e-7 * std::abs(size)) << zero; // eigenvalues near one another: half of the digits
    }
}

// The sum over the aliases is another road to the same response; with a delay of whole samples it is that times z^-n.
TEST(DiscretePlant, TheResponseIsThatOfTheSampledLoop) {
    const DiscretePlant plant(table, ts);
    for (const double f : {10.0, 33.0, 82.0, 300.0, 900.0}) {
        const Complex delayed = plant.response(f) * std::polar(1.0, -2 * pi * f * 3 * ts);
        // The terms left out, about (f Ts)^3/10^3 of the sum.
        EXPECT_LT(std::abs(sampled_response(table, {ts, 3 * ts, 0}, f) / delayed - 1.0), 2e-4) << f;
    }
}

TEST(DiscretePlant, AnEmptyModelIsRefused) { EXPECT_THROW(DiscretePlant({0, {}}, ts), InputError); }

} // namespace
} // namespace tribode
