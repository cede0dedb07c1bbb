#include "tribode/machine/servo_system.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"
#include "tribode/base/text.hpp"
#include "tribode/control/quantizer.hpp"

#include <cmath>

namespace tribode {

namespace {

enum NoiseStream : std::uint64_t { sensor_noise = 1, process_noise = 2 };

// delay = whole * period + rest with 0 <= rest < period; a rest within rounding of a whole sample is none, so that
// instants which should meet do.
struct SplitDelay {
    long whole;
    double rest;
};

SplitDelay split(double delay, double period) {
    constexpr double rounding = 1e-9; // of a sample
    const double samples = delay / period;
    const double nearest = std::round(samples);
    if (std::abs(samples - nearest) < rounding) return {static_cast<long>(nearest), 0.0};
    const double whole = std::floor(samples);
    return {static_cast<long>(whole), delay - whole * period};
}

} // namespace

ServoSystem::ServoSystem(const MachineModel& model, Drive drive, std::uint64_t seed, Start start)
    : ServoSystem(model, model.axis(), std::move(drive), seed, start) {}

ServoSystem::ServoSystem(const MachineModel& model, ServoAxis axis, Drive drive, std::uint64_t seed, Start start)
    : plant_(std::move(axis.plant)),
      amplifier_(axis.amplifier),
      encoder_errors_(std::move(axis.encoder_errors)),
      controller_(model),
      drive_(std::move(drive)),
      seed_(seed),
      start_(start),
      sample_time_(model.sample_time),
      output_delay_(model.output_delay),
      encoder_resolution_(axis.encoder_resolution),
      noise_rms_(model.noise_rms),
      process_noise_rms_(model.process_noise_rms) {
    if (std::holds_alternative<ClosedLoop>(drive_) && !model.has_controller()) {
        throw InputError("the machine has no controller, so it cannot run in closed loop; give it one or drive it "
                         "with u in open loop");
    }
    if (const auto* loop = std::get_if<ClosedLoop>(&drive_)) {
        const double share = loop->friction_feedback;
        if (!(share >= 0) || !std::isfinite(share)) {
            throw InputError("friction_feedback = " + to_text(share) + ", must be finite and not negative");
        }
        if (share > 0) {
            friction_model_.emplace(loop->friction_model.value_or(FrictionModel::of(model)), model);
        }
    }
    // Encoder instant k Ts - d = (k - lead) Ts + offset with 0 <= offset < Ts.
    const auto [encoder_whole, encoder_rest] = split(output_delay_, sample_time_);
    encoder_lead_ = encoder_whole + (encoder_rest > 0 ? 1 : 0);
    const double encoder_offset = encoder_rest > 0 ? sample_time_ - encoder_rest : 0.0;
    const auto [hold_whole, hold_rest] = split(axis.input_delay, sample_time_);
    hold_lag_ = hold_whole;
    clocks_ = {{"encoder", sample_time_, encoder_offset},
               {"controller", sample_time_, 0.0},
               {"hold", sample_time_, hold_rest}};
}

SystemState ServoSystem::initial_state() const {
    SystemState state;
    state.x.resize(plant_.states().size());
    auto values = std::make_unique<State>();
    values->plant = plant_.start(start_.position, start_.velocity, state.x);
    // Samples read before t = 0, while the axis came along at its initial velocity.
    values->encoder_ring.resize(static_cast<std::size_t>(encoder_lead_) + 1);
    for (long k = 0; k < encoder_lead_; ++k) {
        const double t = static_cast<double>(k) * sample_time_ - output_delay_;
        values->encoder_ring[static_cast<std::size_t>(k)] = detect(start_.position + start_.velocity * t, k);
    }
    values->hold_ring.resize(static_cast<std::size_t>(hold_lag_) + 1);
    values->friction_model = friction_model_;
    state.discrete = std::move(values);
    return state;
}

double ServoSystem::detect(double position, long k) const {
    if (!encoder_errors_.empty()) {
        double error = 0;
        for (const auto& part : encoder_errors_) error += part(position);
        position += error;
    }
    if (noise_rms_ > 0) position += noise_rms_ * sensor_noise_at(k);
    return quantize(position, encoder_resolution_);
}

double ServoSystem::sensor_noise_at(long k) const {
    return standard_normal(seed_, sensor_noise, static_cast<std::uint64_t>(k));
}

double ServoSystem::process_noise_at(long k) const {
    return standard_normal(seed_, process_noise, static_cast<std::uint64_t>(k));
}

void ServoSystem::derivative(double t, std::span<const double> x, const DiscreteState& d,
                             std::span<double> dxdt) const {
    plant_.derivative(t, x, plant_state(d), dxdt);
}

bool ServoSystem::jacobian(double t, std::span<const double> x, const DiscreteState& d,
                           std::span<double> matrix) const {
    return plant_.jacobian(t, x, plant_state(d), matrix);
}

void ServoSystem::guards(double t, std::span<const double> x, const DiscreteState& d, std::span<double> g) const {
    plant_.guards(t, x, plant_state(d), g);
}

EventEffect ServoSystem::on_crossing(GuardId guard, SystemState& state, EventLog& log) const {
    return plant_.on_crossing(guard, state.t, state.x, static_cast<State&>(*state.discrete).plant, log);
}

std::string ServoSystem::guard_name(GuardId guard, const SystemState& state) const {
    return plant_.guard_name(guard, values(state).plant);
}

EventEffect ServoSystem::on_sample(ClockId clock, long k, SystemState& state) const {
    State& s = static_cast<State&>(*state.discrete);
    switch (clock) {
    case encoder: {
        const long sample = k + encoder_lead_;
        s.encoder_ring[static_cast<std::size_t>(sample) % s.encoder_ring.size()] =
            detect(ServoPlant::position(state.x), sample);
        return EventEffect::none;
    }
    case controller: return control(k, s);
    default: {
        if (k < hold_lag_) return EventEffect::none;
        if (!apply_hold(k - hold_lag_, state.t, s)) return EventEffect::none;
        const bool jumped = plant_.refresh_sines(state.t, state.x);
        return jumped || plant_.guards_see_input() ? EventEffect::restart : EventEffect::derivative;
    }
    }
}

EventEffect ServoSystem::control(long k, State& s) const {
    s.detected = s.encoder_ring[static_cast<std::size_t>(k) % s.encoder_ring.size()];
    auto& held = s.hold_ring[static_cast<std::size_t>(k) % s.hold_ring.size()];
    if (const auto* open = std::get_if<OpenLoop>(&drive_)) {
        held = open->thrust(k);
        s.thrust = held[0];
    } else {
        const ClosedLoop& loop = std::get<ClosedLoop>(drive_);
        const LoopInput input = loop.input(k);
        s.reference = input.reference;
        if (s.friction_model) {
            s.friction_fed_back = loop.friction_feedback * s.friction_model->step(s.detected, s.thrust);
        }
        s.thrust = controller_.step(s.controller, s.reference, s.detected) + input.excitation + s.friction_fed_back;
        held = {s.thrust, 0, 0, 0};
    }
    if (amplifier_.shapes()) held = amplified(held);
    if (process_noise_rms_ == 0) return EventEffect::none;
    s.plant.disturbance = process_noise_rms_ * process_noise_at(k);
    return EventEffect::restart;
}

// A hold has one value. A cubic keeps its form: values and slopes at both ends go through the amplifier's curve.
std::array<double, 4> ServoSystem::amplified(const std::array<double, 4>& u) const {
    if (u[1] == 0 && u[2] == 0 && u[3] == 0) return {amplifier_(u[0]), 0, 0, 0};
    const double next = u[0] + u[1] + u[2] + u[3];
    const double from = amplifier_.slope(u[0]) * u[1];
    const double to = amplifier_.slope(next) * (u[1] + 2 * u[2] + 3 * u[3]);
    const double start = amplifier_(u[0]), rise = amplifier_(next) - start;
    return {start, from, 3 * rise - 2 * from - to, from + to - 2 * rise};
}

// Whether that changes the thrust.
bool ServoSystem::apply_hold(long k, double t, State& s) const {
    const auto& coefficients = s.hold_ring[static_cast<std::size_t>(k) % s.hold_ring.size()];
    const bool constant = coefficients[1] == 0 && coefficients[2] == 0 && coefficients[3] == 0;
    HeldInput& input = s.plant.input;
    if (constant && input.rate == 0 && input.coefficient[0] == coefficients[0]) return false;
    input = {coefficients, t, constant ? 0.0 : 1 / sample_time_};
    return true;
}

} // namespace tribode
