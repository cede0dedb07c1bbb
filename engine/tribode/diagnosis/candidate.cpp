#include "tribode/diagnosis/candidate.hpp"
#include "tribode/diagnosis/proposer.hpp"

#include <algorithm>
#include <cmath>

namespace tribode {

Proposer::Proposer(const Clues& clues)
    : c_(clues),
      d_(clues.residual.force),
      y_(clues.residual.position),
      v_(clues.residual.velocity) {
    const auto [low, high] = std::minmax_element(y_.begin(), y_.end());
    low_ = *low;
    high_ = *high;
    stroke_ = high_ - low_;
    reach_ = std::max(std::abs(low_), std::abs(high_));
    fastest_ = largest(v_);
    thrust_ = largest(c_.residual.reference_thrust);
    duration_ = static_cast<double>(c_.measurement.size()) * c_.machine.sample_time;
    const double slow = 0.01 * fastest_;
    sign_ = map(v_, [slow](double v) { return std::clamp(v / slow, -1.0, 1.0); });
    gain_ = c_.machine.rigid_gain;
    for (const auto& mode : c_.machine.modes) gain_ += mode.gain;
}

std::vector<Candidate> Proposer::all() {
    constant();
    coulomb();
    viscous();
    asymmetric();
    stribeck();
    presliding();
    position_dependent();
    time_varying();
    ripple();
    spring();
    cubic();
    drag();
    dead_zone();
    saturation();
    thrust_gain();
    payload();
    delay();
    lag();
    mode();
    disturbance();
    encoder();
    backlash();
    return std::move(list_);
}

void Proposer::add(Candidate candidate) {
    for (auto* points : {&candidate.starts, &candidate.probes}) {
        for (auto& point : *points) {
            for (std::size_t i = 0; i < point.size(); ++i) {
                const auto& p = candidate.parameters[i];
                const double room = p.logarithmic ? 0 : 1e-6 * (p.high - p.low);
                point[i] = std::clamp(point[i], p.low + room, p.high - room);
            }
        }
    }
    if (!candidate.starts.empty() || !candidate.probes.empty()) list_.push_back(std::move(candidate));
}

double Proposer::typical_force() const { return std::max(rms(d_), 1e-3 * thrust_); }

double Proposer::sized(double value) const {
    const double least = 0.02 * typical_force();
    return std::abs(value) > least ? value : std::copysign(least, value);
}

Effect Candidate::at(std::span<const double> values) const {
    const Json description{{"name", effect}, {"parameters", make(values)}};
    FieldReader fields(description, "diagnosis");
    return Effect::read(fields);
}

std::vector<Candidate> candidates(const Clues& clues) { return Proposer(clues).all(); }

} // namespace tribode
