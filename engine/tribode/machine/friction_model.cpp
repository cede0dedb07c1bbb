#include "tribode/machine/friction_model.hpp"

#include <cstddef>

namespace tribode {

namespace {

// One step of the classical Runge-Kutta method at a constant velocity.
std::vector<double> stepped(const FrictionLaw& law, double v, const std::vector<double>& s, double h) {
    const std::size_t n = s.size();
    std::vector<double> slope(n), sum(n), at(s);
    constexpr double share[] = {1, 2, 2, 1}, reach[] = {0.5, 0.5, 1, 0};
    for (int stage = 0; stage < 4; ++stage) {
        law.rates(v, at, slope);
        for (std::size_t i = 0; i < n; ++i) {
            sum[i] += share[stage] * slope[i];
            at[i] = s[i] + reach[stage] * h * slope[i];
        }
    }
    for (std::size_t i = 0; i < n; ++i) at[i] = s[i] + h / 6 * sum[i];
    return at;
}

// The first guard below zero.
std::optional<std::size_t> crossed(const FrictionLaw& law, double v, const std::vector<double>& s) {
    std::vector<double> g(law.guard_count());
    law.guards(v, s, g);
    const auto found = std::ranges::find_if(g, [](double value) { return value < 0; });
    if (found == g.end()) return std::nullopt;
    return static_cast<std::size_t>(found - g.begin());
}

} // namespace

std::vector<std::string> load_dependent(const std::vector<Effect>& laws) {
    std::vector<std::string> names;
    for (const auto& effect : laws) {
        ServoAxis axis;
        effect.apply(axis);
        for (const auto& force : axis.plant.forces) {
            const auto* law = dynamic_cast<const FrictionLaw*>(force.get());
            if (law && law->per_load()) names.push_back(effect.kind().name);
        }
    }
    return names;
}

SampledLaws::SampledLaws(const std::vector<Effect>& laws, double sample_time) : sample_time_(sample_time) {
    ServoAxis axis;
    for (const auto& effect : laws) effect.apply(axis);
    for (const auto& force : axis.plant.forces) {
        if (auto law = std::dynamic_pointer_cast<const FrictionLaw>(force)) {
            const std::size_t states = law->states().size();
            laws_.push_back({std::move(law), std::vector<double>(states)});
        }
    }
}

void SampledLaws::step(double position, double load) {
    velocity_ = (position - previous_.value_or(position)) / sample_time_;
    previous_ = position;
    load_ = load;
    for (auto& one : laws_) advance(one, sample_time_);
}

double SampledLaws::force(double velocity) const {
    double sum = 0;
    for (const auto& one : laws_) sum += (one.law->per_load() ? load_ : 1) * one.law->friction(velocity, one.state);
    return sum;
}

double SampledLaws::force_per_load(double velocity) const {
    double sum = 0;
    for (const auto& one : laws_) {
        if (one.law->per_load()) sum += one.law->friction(velocity, one.state);
    }
    return sum;
}

void SampledLaws::advance(Law& one, double duration) const {
    const FrictionLaw& law = *one.law;
    const double rate = law.fastest_rate(velocity_, one.state);
    constexpr double steps_per_constant = 5;
    const auto steps = static_cast<long>(std::ceil(steps_per_constant * rate * duration)) + 1;
    const double h = duration / static_cast<double>(steps);
    // Guards below zero at once: the velocity has changed its sign.
    for (std::size_t round = 0; round <= 2 * law.guard_count(); ++round) {
        const auto guard = crossed(law, velocity_, one.state);
        if (!guard) break;
        law.on_crossing(*guard, velocity_, one.state);
    }
    for (long k = 0; k < steps; ++k) {
        double left = h;
        for (std::size_t events = 0; left > 0; ++events) {
            std::vector<double> next = stepped(law, velocity_, one.state, left);
            if (events > law.guard_count() || !crossed(law, velocity_, next)) {
                one.state = std::move(next);
                break;
            }
            // The crossing, by bisection.
            double before = 0, after = left;
            constexpr int halvings = 40;
            for (int i = 0; i < halvings; ++i) {
                const double middle = (before + after) / 2;
                (crossed(law, velocity_, stepped(law, velocity_, one.state, middle)) ? after : before) = middle;
            }
            one.state = stepped(law, velocity_, one.state, after);
            law.on_crossing(*crossed(law, velocity_, one.state), velocity_, one.state);
            left -= after;
        }
    }
}

} // namespace tribode
