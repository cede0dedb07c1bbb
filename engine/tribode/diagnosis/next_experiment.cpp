#include "tribode/diagnosis/next_experiment.hpp"
#include "tribode/base/constants.hpp"
#include "tribode/diagnosis/diagnosis.hpp"
#include "tribode/diagnosis/response.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace tribode {

namespace {

constexpr double duration = 4; // of each record on the list [s]

struct Experiment {
    std::string text;
    std::vector<double> reference, excitation; // or, in open loop, excitation as u
};

struct Limits {
    double low, high, speed, thrust; // seen so far
};

Limits limits_of(const Diagnosis& d, double sample_time) {
    Limits l{0, 0, 0, 0};
    for (const auto* list : {&d.fitted, &d.validation}) {
        for (const auto& c : *list) {
            const auto& y = c.measurement.position();
            for (std::size_t k = 0; k < y.size(); ++k) {
                l.low = std::min(l.low, y[k]);
                l.high = std::max(l.high, y[k]);
                l.thrust = std::max(l.thrust, std::abs(c.measurement.thrust[k]));
                if (k >= 20) l.speed = std::max(l.speed, std::abs(y[k] - y[k - 20]) / (20 * sample_time));
            }
        }
    }
    return l;
}

std::vector<Experiment> menu(const Limits& l, double sample_time, bool closed_loop) {
    const auto n = static_cast<std::size_t>(duration / sample_time);
    std::vector<Experiment> list;
    const double middle = (l.low + l.high) / 2, reach = (l.high - l.low) / 2;
    const auto sine = [&](double amplitude, double frequency) {
        std::vector<double> r(n);
        for (std::size_t k = 0; k < n; ++k) {
            const double t = static_cast<double>(k) * sample_time;
            r[k] = std::min(t / 0.5, 1.0) * (middle + amplitude * std::sin(two_pi * frequency * t));
        }
        return r;
    };
    const auto multisine = [&](double rms, double lowest, double highest) {
        std::vector<double> u(n, 0.0);
        int lines = 0;
        for (double f = lowest; f <= highest; f += 2) ++lines;
        int line = 0;
        for (double f = lowest; f <= highest; f += 2, ++line) {
            const double phase = -std::numbers::pi * line * line / lines;
            for (std::size_t k = 0; k < n; ++k) {
                const double t = static_cast<double>(k) * sample_time;
                u[k] += rms * std::sqrt(2.0 / lines) * std::sin(two_pi * f * t + phase);
            }
        }
        return u;
    };
    if (closed_loop) {
        for (const double share : {0.9, 0.02, 0.002}) {
            const double amplitude = share * reach;
            const double frequency = std::clamp(l.speed / (two_pi * amplitude), 0.3, 3.0);
            list.push_back({fmt::format("a sine of {:.3g} mm and {:.2g} Hz about {:.3g} mm, {:g} s", 1e3 * amplitude,
                                        frequency, 1e3 * middle, duration),
                            sine(amplitude, frequency), std::vector<double>(n, 0.0)});
        }
        list.push_back(
            {fmt::format("a slow sine over the whole stroke ({:.3g} mm, 0.25 Hz), {:g} s", 1e3 * 0.9 * reach, duration),
             sine(0.9 * reach, 0.25), std::vector<double>(n, 0.0)});
    }
    for (const auto& [lowest, highest] : {std::pair{2.0, 60.0}, {10.0, 200.0}, {100.0, 400.0}}) {
        if (highest > 0.45 / sample_time) continue;
        const double rms = 0.25 * l.thrust;
        list.push_back({fmt::format("a multisine of {:.3g} N rms from {:g} to {:g} Hz on the thrust, {:g} s", rms,
                                    lowest, highest, duration),
                        std::vector<double>(n, 0.0), multisine(rms, lowest, highest)});
    }
    list.push_back({fmt::format("a multisine of {:.3g} N rms from 2 to 60 Hz, near the largest thrust seen, {:g} s",
                                0.6 * l.thrust, duration),
                    std::vector<double>(n, 0.0), multisine(0.6 * l.thrust, 2, 60)});
    return list;
}

} // namespace

std::optional<NextExperiment> next_experiment(const MachineModel& machine, const Diagnosis& d,
                                              const RunControl& control) {
    const bool is_open =
        d.verdict == "undecided" || d.verdict == "partial" || std::ranges::any_of(d.effects, &NamedEffect::is_open);
    if (!is_open || d.effects.empty() || d.search.ranking.size() < 2) return std::nullopt;
    const ModelFit fit(machine, d.search.fitted);
    // The best and the nearest of other names.
    const Hypothesis& a = d.search.ranking[0].hypothesis;
    const Hypothesis& b = d.search.ranking[1].hypothesis;
    const MachineModel first = fit.machine(a), second = fit.machine(b);
    const Evidence& record = d.search.fitted.front();
    const bool closed = record.measurement.drive.closed_loop();
    const auto list = menu(limits_of(d, first.sample_time), first.sample_time, closed);
    const auto difference = [&](const Measurement& m) {
        const auto ya = simulated_position(first, m), yb = simulated_position(second, m);
        if (!ya || !yb) return 0.0;
        std::vector<double> gap = *ya;
        for (std::size_t k = 0; k < gap.size(); ++k) gap[k] -= (*yb)[k];
        double sum = 0;
        for (const double w : record.floor.whitened(gap)) sum += w * w;
        return std::sqrt(sum);
    };
    const auto drive_of = [&](const Experiment& experiment) {
        DriveRecord drive;
        for (std::size_t k = 0; k < experiment.excitation.size(); ++k) {
            drive.t.push_back(static_cast<double>(k) * first.sample_time);
        }
        if (closed) {
            drive.reference = experiment.reference;
            drive.excitation = experiment.excitation;
        } else {
            drive.u = experiment.excitation;
        }
        return drive;
    };
    std::vector<double> apart(list.size());
    for_each_index(list.size(), control, "next experiment", [&](std::size_t i) {
        Measurement m;
        m.drive = drive_of(list[i]);
        m.thrust = list[i].excitation;
        m.drive.measured.assign(m.drive.t.size(), 0.0);
        m.drive.measured.back() = 1; // a bound of what the positions may be: meters
        apart[i] = difference(m);
    });
    const auto best = static_cast<std::size_t>(std::max_element(apart.begin(), apart.end()) - apart.begin());
    const std::string rivals = fmt::format("{} and {}", a.effects.back()->kind().name, b.effects.back()->kind().name);
    const double here = difference(record.measurement);
    if (apart[best] < 1.2 * here) {
        return NextExperiment{
            fmt::format("No record on the list separates {} better than the present one ({:.3g} standard deviations): "
                        "a change of the machine would, such as a known mass added.",
                        rivals, here),
            {}};
    }
    return NextExperiment{
        fmt::format("{}: there {} differ by {:.3g} standard deviations of the noise, on the present record by {:.3g}.",
                    list[best].text, rivals, apart[best], here),
        drive_of(list[best])};
}

} // namespace tribode
