#include "tribode/diagnosis/proposer.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

// Shapes of u: the thrust that an amplifier makes of the reference, less the reference.
void Proposer::dead_zone() {
    const Signal& u = c_.residual.reference_thrust;
    std::vector<std::pair<double, std::vector<double>>> starts;
    for (const double width : geometric(0.01 * thrust_, 0.8 * thrust_, 10)) {
        const Regression fit =
            regress({map(u, [width](double value) { return -std::clamp(value, -width, width); })}, d_);
        // The right width has the coefficient one.
        starts.push_back({std::abs(fit.coefficients[0] - 1), {width}});
    }
    std::sort(starts.begin(), starts.end());
    add({"dead_zone",
         "",
         {factor("half_width", 1e-3 * thrust_, 2 * thrust_)},
         [](std::span<const double> p) {
             return Json{{"half_width", p[0]}};
         },
         {starts[0].second, starts[1].second},
         {},
         {}});
}

void Proposer::saturation() {
    std::vector<std::vector<double>> probes;
    for (const double share : geometric(0.05, 0.98, 18)) probes.push_back({share * thrust_});
    add({"thrust_saturation",
         "",
         {factor("limit", 0.02 * thrust_, thrust_)},
         [](std::span<const double> p) {
             return Json{{"limit", p[0]}};
         },
         {},
         probes,
         {}});
}

void Proposer::thrust_gain() {
    const double gain = 1 + regress({c_.residual.thrust}, d_).coefficients[0];
    add({"thrust_gain",
         "",
         {factor("gain", 0.05, 20)},
         [](std::span<const double> p) {
             return Json{{"gain", p[0]}};
         },
         {{std::clamp(gain, 0.3, 3.0)}, {gain > 1 ? 1.1 : 0.9}},
         {},
         {}});
}

void Proposer::payload() {
    if (c_.machine.rigid_gain == 0) return;
    const double ratio = -regress({c_.residual.inertial}, d_).coefficients[0];
    add({"payload_mass",
         "",
         {factor("1 + ratio", 0.1, 20)},
         [](std::span<const double> p) {
             return Json{{"ratio", p[0] - 1}};
         },
         {{1 + std::clamp(ratio, -0.6, 2.0)}, {ratio > 0 ? 1.1 : 0.9}},
         {},
         {}});
}

void Proposer::delay() {
    const double extra = -regress({c_.residual.thrust_rate}, d_).coefficients[0];
    const double least = -c_.machine.input_delay, most = 0.01;
    std::vector<std::vector<double>> starts{{std::clamp(extra, 0.9 * least, 3e-3)}};
    for (const double other : {2e-4, 6e-4, 1.2e-3, -2e-4}) starts.push_back({std::max(other, 0.9 * least)});
    add({"input_delay",
         "",
         {{"extra_s", least, most, false, 2e-6}},
         [](std::span<const double> p) {
             return Json{{"extra_s", p[0]}};
         },
         {},
         starts,
         {}});
}

void Proposer::lag() {
    const double present = c_.machine.current_loop_hz > 0 ? c_.machine.current_loop_hz : 2000;
    std::vector<std::vector<double>> probes;
    for (const double share : {0.85, 0.6, 0.4, 0.25, 0.15, 0.08, 1.3}) probes.push_back({share * present});
    add({"actuator_lag",
         "",
         {factor("current_loop_hz", 5, 20 * present)},
         [](std::span<const double> p) {
             return Json{{"current_loop_hz", p[0]}};
         },
         {},
         probes,
         {}});
}

void Proposer::mode() {
    std::vector<std::vector<double>> probes;
    for (const double f : geometric(6, std::min(400.0, 0.3 / c_.machine.sample_time), 40)) {
        probes.push_back({0.03 * gain_, f, 0.02});
    }
    add({"resonant_mode",
         "",
         {factor("gain", 1e-5 * gain_, 20 * gain_), factor("freq_hz", 2, 0.45 / c_.machine.sample_time),
          factor("zeta", 5e-4, 0.7)},
         [](std::span<const double> p) {
             return Json{{"gain", p[0]}, {"freq_hz", p[1]}, {"zeta", p[2]}};
         },
         {},
         probes,
         0,
         3,
         {},
         true});
}

void Proposer::backlash() {
    if (!c_.machine.modes.empty() || c_.machine.rigid_gain == 0) return;
    for (const char* sensor : {"motor", "load"}) {
        std::vector<std::vector<double>> probes;
        for (const double gap : geometric(4e-6, 2e-4, 12)) {
            for (const double share : {0.2, 0.35, 0.5, 0.65}) {
                for (const double contact : {160.0, 240.0, 340.0}) probes.push_back({gap, share, contact, 0.2});
            }
        }
        add({"backlash",
             sensor,
             // Steps of differences are small, lest a contact come or go within one.
             {{"gap_m", 1e-7, 5e-3, true, 1e-4},
              {"load_fraction", 0.03, 0.97, false, 1e-4},
              {"contact_hz", 30, 2000, true, 1e-4},
              {"contact_zeta", 5e-3, 2, true, 1e-4}},
             [sensor](std::span<const double> p) {
                 return Json{{"gap_m", p[0]},
                             {"load_fraction", p[1]},
                             {"contact_hz", p[2]},
                             {"contact_zeta", p[3]},
                             {"sensor", sensor}};
             },
             {},
             probes,
             {},
             3,
             {},
             false,
             true});
    }
}

void Proposer::encoder() {
    const Signal& y = c_.measurement.position();
    const double shortest = std::max({4e-6, 4 * c_.machine.encoder_resolution, stroke_ / 20000});
    const double longest = std::min(stroke_, 0.05);
    std::vector<std::vector<double>> one, two;
    for (const auto& found : sinusoids(y, c_.whitened, {}, shortest, longest, 3)) {
        const double A = found.amplitude * c_.innovation;
        one.push_back({A, found.period, found.phase});
        two.push_back({A, found.period, found.phase, 0.1 * A, 0});
        two.push_back({A, found.period, found.phase, 0.1 * A, 3});
    }
    const FitParameter A = factor("A", 1e-3 * c_.innovation, 0.3 * stroke_);
    const FitParameter period = factor("period_m", shortest / 2, longest);
    const auto make = [](double a, double p, double phase, double a2, double phase2) {
        return Json{{"A", a}, {"period_m", p}, {"phase", phase}, {"A2", a2}, {"phase2", phase2}};
    };
    add({"encoder_periodic_error",
         "fundamental",
         {A, period, angle("phase")},
         [make](std::span<const double> p) { return make(p[0], p[1], p[2], 0, 0); },
         one,
         {},
         {}});
    if (two.size() > 2) two.resize(2);
    add({"encoder_periodic_error",
         "two harmonics",
         {A, period, angle("phase"), factor("A2", 1e-3 * c_.innovation, 0.3 * stroke_), angle("phase2")},
         [make](std::span<const double> p) { return make(p[0], p[1], p[2], p[3], p[4]); },
         two,
         {},
         {}});
}

} // namespace tribode
