// What the zero-order hold does to the phase of a sampled sine.
#include "physics/oracle.hpp"
#include "tribode/analysis/sine_fit.hpp"

#include <complex>

namespace tribode {
namespace {

constexpr double ts = 5e-4, gain = 0.1;

// Thrust to position of a mass at the sample instants, apart from the drift that the start leaves.
std::complex<double> response(const Json& machine, double frequency_hz, std::size_t samples) {
    const auto u = problems::sampled_sine(3, frequency_hz, ts, samples + 1);
    const auto run =
        run_open_loop(machine, u, {.method = Method::erk, .relative_tolerance = 1e-10, .absolute_tolerance = 1e-14});
    const auto from = [&](const std::vector<double>& v) { return std::span(v).subspan(1); };
    return fit_sine(from(run.trace.x), ts, frequency_hz, ts, 1, Drift::linear).fundamental() /
           fit_sine(from(run.trace.u), ts, frequency_hz, ts).fundamental();
}

TEST(Hold, a_held_sine_lags_by_half_a_sample) {
    const Json mass = {{"rigid_gain_per_kg", gain}};
    for (const double f : {5.0, 50.0, 200.0, 500.0}) {
        const double theta = 2 * std::numbers::pi * f * ts; // w Ts
        // -k Ts^2 cos(theta/2) / (4 sin^2(theta/2)) exp(-j theta/2): the sampled double integrator
        const double magnitude = gain * ts * ts * std::cos(theta / 2) / (4 * std::pow(std::sin(theta / 2), 2));
        const auto found = response(mass, f, 2000);
        EXPECT_NEAR(std::arg(-found), -theta / 2, 1e-7) << f; // the fit takes the drift away, to its conditioning
        EXPECT_NEAR(std::abs(found) / magnitude, 1, 1e-7) << f;
    }
}

TEST(Hold, dead_time_and_lag_add_their_phases) {
    const double delay = 7.3e-4, corner_hz = 300;
    const Json machine = {{"rigid_gain_per_kg", gain}, {"input_delay_s", delay}, {"current_loop_hz", corner_hz}};
    const Json mass = {{"rigid_gain_per_kg", gain}};
    for (const double f : {5.0, 20.0, 50.0}) {
        const std::complex<double> jw(0, 2 * std::numbers::pi * f);
        const auto expected = std::exp(-jw * delay) / (1.0 + jw / (2 * std::numbers::pi * corner_hz));
        const auto found = response(machine, f, 4000) / response(mass, f, 4000);
        // Images of the hold, at 2 kHz and above, pass delay and lag otherwise and fold back: (f Ts)^2 of the
        // response. The start leaves a transient of 1/(2 pi 300 Hz) in a record of 2 s.
        EXPECT_LT(std::abs(found - expected), 2e-3) << f;
    }
}

} // namespace
} // namespace tribode
