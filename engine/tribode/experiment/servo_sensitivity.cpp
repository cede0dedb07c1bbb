#include "tribode/experiment/servo_sensitivity.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace tribode {

namespace {

// x clipped to +-limit, differentiated.
double clipped(double x, double by, double limit, double limit_by) {
    return std::abs(x) > limit ? std::copysign(1.0, x) * limit_by : by;
}

// dt*/dp of the contact of a backlash that has closed at this instant; none where it has not. dx/dp is dx.
std::optional<double> closing_shift(const ServoPlant::Parameters& p, const ServoPlant::State& s,
                                    std::span<const double> x, std::span<const double> dx,
                                    const std::optional<Backlash>& by) {
    if (!p.backlash || std::abs(static_cast<int>(s.contact)) != 1) return std::nullopt;
    const std::size_t other = 2 + 2 * p.modes.size();
    const double ahead = p.backlash->load_side ? -1 : 1, side = static_cast<double>(s.contact);
    const double half = p.backlash->gap / 2;
    if (std::abs(side * ahead * (x[0] - x[other]) - half) > ServoPlant::contact_margin * half) return std::nullopt;
    return (side * by->gap / 2 - ahead * (dx[0] - dx[other])) / (ahead * (x[1] - x[other + 1]));
}

} // namespace

SensitiveServoSystem::SensitiveServoSystem(const MachineModel& model, Drive drive, std::uint64_t seed, Start start,
                                           std::vector<ServoDirection> directions, ServoChannels channels)
    : ServoSystem(model, std::move(drive), seed, start),
      settings_(model.controller),
      channels_(channels),
      run_(std::make_unique<Run>(Run{.series = SensitivitySeries(plant().states().size(), directions.size())})) {
    const auto refuse = [](const std::string& reason) {
        throw InputError(fmt::format("sensitivities: a run of this machine has none: {}", reason));
    };
    if (const auto reason = why_not_affine()) refuse(*reason);
    if (model.input == InputKind::band_limited && std::holds_alternative<OpenLoop>(drive_)) {
        refuse("u varies between its samples (input = \"band_limited\")");
    }
    if (friction_model_) refuse("the modeled friction is fed back (friction_feedback)");
    for (auto& by : directions) {
        run_->results.push_back({.name = by.name});
        ServoPlantTangent tangent(plant(), by.numbers.plant);
        const Amplifier& amplifier = by.numbers.amplifier;
        const bool is_amplified =
            amplifier_.shapes() || amplifier.limit != 0 || amplifier.half_width != 0 || amplifier.gain != 0;
        run_->directions.push_back({std::move(by), std::move(tangent), is_amplified});
    }
}

void SensitiveServoSystem::expect_samples(long count) const {
    for (auto& result : run_->results) {
        const auto reserve = [&](bool recorded, std::vector<double>& values) {
            if (recorded) values.reserve(static_cast<std::size_t>(std::max(count, 0L)));
        };
        reserve(channels_.u, result.u);
        reserve(channels_.y, result.y);
        reserve(channels_.motion, result.x);
        reserve(channels_.motion, result.v);
    }
}

SystemState SensitiveServoSystem::initial_state() const {
    SystemState state = ServoSystem::initial_state();
    const State& s = values(state);
    Run& run = *run_;
    const std::size_t height = run.series.height(), count = run.directions.size();
    run.s.assign(height * count, 0.0);
    run.q.assign(height * count, 0.0);
    run.f.assign(height, 0.0);
    run.f_before.assign(height, 0.0);
    run.x = state.x;
    run.t = state.t;
    run.pattern = nullptr;
    for (std::size_t p = 0; p < count; ++p) {
        Direction& direction = run.directions[p];
        const ServoNumbers& by = direction.by.numbers;
        direction.plant.start(by.start.position, by.start.velocity, s.plant, column_of(p));
        direction.encoder_ring.assign(s.encoder_ring.size(), 0.0);
        direction.hold_ring.assign(s.hold_ring.size(), 0.0);
        for (long k = 0; k < encoder_lead_; ++k) {
            const double t = static_cast<double>(k) * sample_time_ - output_delay_;
            direction.encoder_ring[static_cast<std::size_t>(k)] =
                detected(direction, start_.position + start_.velocity * t,
                         by.start.position + by.start.velocity * t - start_.velocity * by.output_delay, k);
        }
    }
    return state;
}

// To the instant of the state, with the discrete values since the last one.
void SensitiveServoSystem::propagate(const SystemState& state) const {
    Run& run = *run_;
    const double h = state.t - run.t;
    if (!(h > 0)) return;
    const ServoPlant::State& s = values(state).plant;
    if (!run.pattern) find_pattern(s);
    const std::size_t n = states().size(), height = run.series.height();
    plant().derivative(run.t, run.x, s, std::span(run.f).first(n));
    const auto here = ServoPlantTangent::here(plant(), run.x, s, 1);
    for (std::size_t p = 0; p < run.directions.size(); ++p) {
        run.directions[p].plant.rates(here, run.x, s, 1, {run.q.data() + p * height, n});
    }
    run.series.propagate(*run.pattern, run.t, h, run.f.data(), run.q.data(), run.s.data());
    run.x = state.x;
    run.t = state.t;
}

void SensitiveServoSystem::find_pattern(const ServoPlant::State& s) const {
    Run& run = *run_;
    run.key.clear();
    plant().append_affine_key(s, run.key);
    for (const auto& direction : run.directions) {
        const double stiffness = direction.plant.stiffness(), damping = direction.plant.damping();
        if (stiffness != 0) run.key.push_back(std::bit_cast<std::uint64_t>(stiffness));
        if (damping != 0) run.key.push_back(std::bit_cast<std::uint64_t>(damping));
        run.key.push_back((stiffness != 0 ? 1u : 0u) + (damping != 0 ? 2u : 0u));
    }
    run.pattern = &run.series.pattern(run.key, [&](SensitivitySeries::Pattern& pattern) {
        const std::size_t n = states().size();
        std::vector<double> partial(run.directions.size() * n * n), unit(n);
        for (std::size_t j = 0; j < n; ++j) {
            unit[j] = 1;
            const auto here = ServoPlantTangent::here(plant(), unit, s, 0);
            for (std::size_t p = 0; p < run.directions.size(); ++p) {
                run.directions[p].plant.rates(here, unit, s, 0, std::span(partial).subspan((p * n + j) * n, n));
            }
            unit[j] = 0;
        }
        run.series.set_matrices(pattern, plant().affine_form(s).a, partial);
    });
}

// Where the rates jump from f_before to f, at a time that moves by `shift` with p.
void SensitiveServoSystem::add_jump(double shift, std::size_t p) const {
    const Run& run = *run_;
    double* s = column(p);
    for (std::size_t i = 0; i < states().size(); ++i) s[i] += (run.f_before[i] - run.f[i]) * shift;
}

EventEffect SensitiveServoSystem::on_crossing(GuardId guard, SystemState& state, EventLog& log) const {
    Run& run = *run_;
    propagate(state);
    const std::size_t n = states().size(), logged = log.size();
    const ServoPlant::State& s = values(state).plant;
    const ContactState contact = s.contact;
    const SlipState dry = s.dry;
    plant().derivative(state.t, state.x, s, std::span(run.f_before).first(n));
    const EventEffect effect = ServoSystem::on_crossing(guard, state, log);
    const auto changes = std::span<const Event>(log).subspan(logged);
    run.x = state.x;
    if (changes.empty() && s.contact == contact) return effect; // nothing but rounding of the velocity
    run.pattern = nullptr;
    const bool stopped = std::any_of(changes.begin(), changes.end(), [](const Event& event) {
        return static_cast<SlipState>(event.kind) == SlipState::stick;
    });
    // Dry friction jumps where the velocity comes to zero, and where a jump of the thrust, or of the force of a contact that
    // closes, lets the axis go.
    const bool by_jump = state.t == run.jump, released = s.dry != dry && !stopped;
    const bool by_contact =
        released && !by_jump &&
        closing_shift(plant().parameters(), s, state.x, state.x, plant().parameters().backlash).has_value();
    const bool is_jump = s.dry != dry && (stopped || by_jump || by_contact);
    if (is_jump) plant().derivative(state.t, state.x, s, std::span(run.f).first(n));
    for (std::size_t p = 0; p < run.directions.size(); ++p) {
        Direction& direction = run.directions[p];
        const auto dx = column_of(p);
        if (is_jump) {
            const double shift = by_contact       ? *closing_shift(plant().parameters(), s, state.x, dx,
                                                                   direction.by.numbers.plant.plant.backlash)
                                 : !by_jump       ? -dx[1] / run.f_before[1]
                                 : run.jump_moves ? direction.by.numbers.input_delay
                                                  : 0;
            add_jump(shift, p);
            if (s.dry == SlipState::stick) dx[1] = 0;
        }
        if (s.contact != contact) {
            direction.plant.after_contact(contact, state.x, run.f_before, s, dx);
        } else if (stopped) {
            direction.plant.after_reversal(changes, s, dx);
        } else if (changes.front().subject != ServoPlant::coulomb_subject) {
            direction.plant.after_slips(changes, s, dx);
        }
    }
    return effect;
}

EventEffect SensitiveServoSystem::on_sample(ClockId clock, long k, SystemState& state) const {
    Run& run = *run_;
    propagate(state);
    State& s = static_cast<State&>(*state.discrete);
    switch (clock) {
    case encoder: {
        const auto effect = ServoSystem::on_sample(clock, k, state);
        const long sample = k + encoder_lead_;
        const std::size_t place = static_cast<std::size_t>(sample) % s.encoder_ring.size();
        for (std::size_t p = 0; p < run.directions.size(); ++p) {
            Direction& direction = run.directions[p];
            // It is read at k Ts - output_delay.
            const double by = column(p)[0] - state.x[1] * direction.by.numbers.output_delay;
            direction.encoder_ring[place] = detected(direction, state.x[0], by, sample);
        }
        return effect;
    }
    case controller: {
        const MachineController::State before = s.controller;
        const auto effect = ServoSystem::on_sample(clock, k, state);
        control(k, before, s);
        if (process_noise_rms_ > 0) {
            run.jump = state.t;
            run.jump_moves = false;
        }
        return effect;
    }
    default: {
        const bool moves = std::any_of(run.directions.begin(), run.directions.end(), [](const Direction& direction) {
            return direction.by.numbers.input_delay != 0;
        });
        const std::size_t n = states().size();
        if (moves) plant().derivative(state.t, state.x, s.plant, std::span(run.f_before).first(n));
        const auto effect = ServoSystem::on_sample(clock, k, state);
        run.x = state.x; // the states of sine forces are set anew
        if (k < hold_lag_) return effect;
        if (moves) plant().derivative(state.t, state.x, s.plant, std::span(run.f).first(n));
        const std::size_t place = static_cast<std::size_t>(k - hold_lag_) % s.hold_ring.size();
        for (std::size_t p = 0; p < run.directions.size(); ++p) {
            Direction& direction = run.directions[p];
            if (moves) add_jump(direction.by.numbers.input_delay, p);
            direction.plant.input = direction.hold_ring[place];
            direction.plant.refresh_sines(state.t, column_of(p));
        }
        run.jump = state.t;
        run.jump_moves = true;
        return effect;
    }
    }
}

// Of the position y, with dy/dp.
double SensitiveServoSystem::detected(const Direction& direction, double y, double by, long k) const {
    const ServoNumbers& numbers = direction.by.numbers;
    double sum = by;
    for (std::size_t i = 0; i < encoder_errors_.size(); ++i) {
        const PeriodicEncoderError& error = encoder_errors_[i];
        const PeriodicEncoderError& error_by = numbers.encoder_errors[i];
        const double angle = 2 * std::numbers::pi * y / error.period;
        const double angle_by = 2 * std::numbers::pi * by / error.period - angle * error_by.period / error.period;
        const double first = angle + error.phase, second = 2 * angle + error.second_phase;
        sum += error_by.amplitude * std::sin(first) + error_by.second_amplitude * std::sin(second) +
               error.amplitude * std::cos(first) * (angle_by + error_by.phase) +
               error.second_amplitude * std::cos(second) * (2 * angle_by + error_by.second_phase);
    }
    return numbers.noise_rms == 0 ? sum : sum + numbers.noise_rms * sensor_noise_at(k);
}

void SensitiveServoSystem::control(long k, const MachineController::State& before, State& s) const {
    Run& run = *run_;
    const auto* loop = std::get_if<ClosedLoop>(&drive_);
    const std::size_t encoder_place = static_cast<std::size_t>(k) % s.encoder_ring.size();
    const std::size_t hold_place = static_cast<std::size_t>(k) % s.hold_ring.size();
    for (std::size_t p = 0; p < run.directions.size(); ++p) {
        Direction& direction = run.directions[p];
        const ServoDirection& by = direction.by;
        const double y = direction.encoder_ring[encoder_place];
        double u = by.thrust * s.thrust;
        if (loop) {
            u = controller_step(direction, s, before, by.reference * s.reference, y);
            if (by.excitation != 0) u += by.excitation * loop->input(k).excitation;
        }
        direction.hold_ring[hold_place] = amplified(direction, s.thrust, u);
        if (by.numbers.process_noise_rms != 0) {
            direction.plant.disturbance = by.numbers.process_noise_rms * process_noise_at(k);
        }
        ServoSensitivity& result = run.results[p];
        if (channels_.u) result.u.push_back(u);
        if (channels_.y) result.y.push_back(y);
        if (!channels_.motion) continue;
        result.x.push_back(column(p)[0]);
        result.v.push_back(column(p)[1]);
    }
}

// As MachineController::step, whose state was `before`.
double SensitiveServoSystem::controller_step(Direction& direction, const State& s,
                                             const MachineController::State& before, double reference,
                                             double position) const {
    const double ts = sample_time_;
    if (const auto* pid = std::get_if<PidController>(&settings_)) {
        const auto& by = std::get<PidController>(direction.by.numbers.controller);
        PidController::State& own = direction.controller.pid;
        const double error = s.reference - s.detected, error_by = reference - position;
        double a = 0, a_by = 0;
        if (pid->derivative_filter_hz > 0) {
            const double rate = -2 * std::numbers::pi * ts;
            a = std::exp(rate * pid->derivative_filter_hz);
            a_by = rate * by.derivative_filter_hz * a;
        }
        own.integral += ts * (by.ki * error + pid->ki * error_by);
        own.derivative = a_by * before.pid.derivative + a * own.derivative -
                         a_by * (error - before.pid.previous_error) / ts +
                         (1 - a) * (error_by - own.previous_error) / ts;
        own.previous_error = error_by;
        const double u_by = by.kp * error + pid->kp * error_by + own.integral + by.kd * s.controller.pid.derivative +
                            pid->kd * own.derivative;
        return pid->filters.empty() ? u_by : own.filters.step(pid->filters, u_by, ts);
    }
    const auto* cascade = std::get_if<CascadeController>(&settings_);
    if (!cascade) return 0;
    const auto& by = std::get<CascadeController>(direction.by.numbers.controller);
    CascadeController::State& own = direction.controller.cascade;
    if (!own.started) own = {true, position, position, 0, {}, std::vector<double>(cascade->delay_samples, 0.0)};
    const bool began = before.cascade.started;
    const double mean = s.controller.cascade.previous_mean;
    const double velocity = (mean - (began ? before.cascade.previous_mean : s.detected)) / ts;
    const double mean_by = (position + own.previous_position) / 2;
    const double velocity_by = (mean_by - own.previous_mean) / ts;
    own.previous_position = position;
    own.previous_mean = mean_by;
    const double wanted = cascade->kp * (s.reference - s.detected) - velocity;
    const double wanted_by = by.kp * (s.reference - s.detected) + cascade->kp * (reference - position) - velocity_by;
    double u = cascade->kv * wanted, u_by = by.kv * wanted + cascade->kv * wanted_by;
    if (cascade->ki != 0 || by.ki != 0) {
        const double integral = before.cascade.integral + cascade->ki * ts * wanted;
        const double integral_by = own.integral + ts * (by.ki * wanted + cascade->ki * wanted_by);
        u += cascade->kv * integral;
        u_by += by.kv * integral + cascade->kv * integral_by;
        // Beyond the limit it may rest.
        if (s.controller.cascade.integral == integral) own.integral = integral_by;
    }
    if (!cascade->filters.empty()) {
        auto filters = before.cascade.filters;
        u = filters.step(cascade->filters, u, ts);
        u_by = own.filters.step(cascade->filters, u_by, ts);
    }
    own.pending.push_back(clipped(u, u_by, cascade->limit, by.limit));
    const double output = own.pending.front();
    own.pending.erase(own.pending.begin());
    return output;
}

// As Amplifier, with du/dp.
double SensitiveServoSystem::amplified(const Direction& direction, double u, double by) const {
    if (!direction.is_amplified) return by;
    const Amplifier &a = amplifier_, &a_by = direction.by.numbers.amplifier;
    const double w = std::clamp(u, -a.limit, a.limit), w_by = clipped(u, by, a.limit, a_by.limit);
    const double beyond = std::abs(w) - a.half_width;
    if (beyond <= 0) return 0;
    const double towards = std::copysign(1.0, w);
    return towards * (a_by.gain * beyond + a.gain * (towards * w_by - a_by.half_width));
}

} // namespace tribode
