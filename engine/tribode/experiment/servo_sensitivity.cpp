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

} // namespace

SensitiveServoSystem::SensitiveServoSystem(const MachineModel& model, Drive drive, std::uint64_t seed, Start start,
                                           std::vector<ServoDirection> directions, ServoChannels channels)
    : ServoSystem(model, std::move(drive), seed, start),
      settings_(model.controller),
      channels_(channels),
      run_(std::make_unique<Run>()) {
    const auto refuse = [](const std::string& reason) {
        throw InputError(fmt::format("sensitivities: a run of this machine has none: {}", reason));
    };
    if (const auto reason = plant().why_not_differentiable()) refuse(*reason);
    if (model.input == InputKind::band_limited && std::holds_alternative<OpenLoop>(drive_)) {
        refuse("u varies between its samples (input = \"band_limited\")");
    }
    if (friction_model_) refuse("the modeled friction is fed back (friction_feedback)");
    for (const auto& by : directions) run_->results.push_back({.name = by.name});
    for (std::size_t begin = 0; begin < directions.size(); begin += lane_count) {
        const std::size_t count = std::min(lane_count, directions.size() - begin);
        std::vector<ServoDirection> own(count);
        std::move(directions.begin() + static_cast<std::ptrdiff_t>(begin),
                  directions.begin() + static_cast<std::ptrdiff_t>(begin + count), own.begin());
        add_group(std::move(own));
        run_->groups.back().first = begin;
    }
}

void SensitiveServoSystem::add_group(std::vector<ServoDirection> directions) const {
    std::vector<const ServoPlantNumbers*> plants;
    for (const auto& by : directions) plants.push_back(&by.numbers.plant);
    const std::size_t n = states().size();
    std::vector<double> scale;
    for (const auto& state : states()) scale.push_back(state.scale);
    Group group{.by = {},
                .series = SensitivitySeries(n, directions.size()),
                .plant = ServoPlantTangent(plant(), plants),
                .midpoint = ExtrapolatedMidpoint(std::move(scale), padded(n) + padded(n) / lane_count)};
    for (std::size_t p = 0; p < directions.size(); ++p) {
        const ServoDirection& by = directions[p];
        const ServoNumbers& numbers = by.numbers;
        group.output_delay[p] = numbers.output_delay;
        group.input_delay[p] = numbers.input_delay;
        group.noise_rms[p] = numbers.noise_rms;
        group.process_noise_rms[p] = numbers.process_noise_rms;
        group.thrust[p] = by.thrust;
        group.reference[p] = by.reference;
        group.excitation[p] = by.excitation;
        if (const auto* pid = std::get_if<PidController>(&numbers.controller)) {
            group.kp[p] = pid->kp;
            group.ki[p] = pid->ki;
            group.kd[p] = pid->kd;
            group.derivative_filter_hz[p] = pid->derivative_filter_hz;
        }
        const Amplifier& amplifier = numbers.amplifier;
        group.moves_input = group.moves_input || numbers.input_delay != 0;
        group.has_excitation = group.has_excitation || by.excitation != 0;
        group.has_noise = group.has_noise || numbers.noise_rms != 0;
        group.has_process_noise = group.has_process_noise || numbers.process_noise_rms != 0;
        group.is_amplified = group.is_amplified || amplifier_.shapes() || amplifier.limit != 0 ||
                             amplifier.half_width != 0 || amplifier.gain != 0 || amplifier.exponent != 0;
    }
    group.by = std::move(directions);
    run_->groups.push_back(std::move(group));
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

const std::vector<ServoSensitivity>& SensitiveServoSystem::sensitivities() const {
    for (auto& group : run_->groups) take_apart(group);
    return run_->results;
}

// The rows of a group, in which its parameters stand side by side, become entries of the results.
void SensitiveServoSystem::take_apart(Group& group) const {
    const auto append = [&](bool recorded, const Lanes Row::*of, std::vector<double> ServoSensitivity::*to) {
        for (std::size_t p = 0; p < group.by.size() && recorded; ++p) {
            std::vector<double>& column = run_->results[group.first + p].*to;
            column.resize(column.size() + group.rows.size());
            double* next = column.data() + column.size() - group.rows.size();
            for (const Row& row : group.rows) *next++ = (row.*of)[p];
        }
    };
    append(channels_.u, &Row::u, &ServoSensitivity::u);
    append(channels_.y, &Row::y, &ServoSensitivity::y);
    append(channels_.motion, &Row::x, &ServoSensitivity::x);
    append(channels_.motion, &Row::v, &ServoSensitivity::v);
    group.rows.clear();
}

SystemState SensitiveServoSystem::initial_state() const {
    SystemState state = ServoSystem::initial_state();
    const State& s = values(state);
    Run& run = *run_;
    const std::size_t n = states().size();
    run.f.assign(padded(n), 0.0);
    run.f_before.assign(padded(n), 0.0);
    run.x = state.x;
    run.t = state.t;
    run.is_new_pattern = true;
    for (auto& group : run.groups) {
        group.s.assign(padded(n), Lanes{});
        group.q.assign(padded(n), Lanes{});
        Lanes position, velocity;
        for (std::size_t p = 0; p < group.by.size(); ++p) {
            position[p] = group.by[p].numbers.start.position;
            velocity[p] = group.by[p].numbers.start.velocity;
        }
        group.plant.start(position, velocity, s.plant, of_states(group.s));
        group.encoder_ring.assign(s.encoder_ring.size(), Lanes{});
        group.hold_ring.assign(s.hold_ring.size(), Lanes{});
        group.filters.assign(group.by.size(), {});
        group.cascade.assign(group.by.size(), {});
        for (long k = 0; k < encoder_lead_; ++k) {
            const double t = static_cast<double>(k) * sample_time_ - output_delay_;
            const Lanes by = position + velocity * t - start_.velocity * group.output_delay;
            group.encoder_ring[static_cast<std::size_t>(k)] =
                detected(group, start_.position + start_.velocity * t, by, k);
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
    if (run.is_new_pattern) find_patterns(s);
    if (plant().is_affine_in(s)) {
        plant().derivative(run.t, run.x, s, of_states(run.f));
        for (auto& group : run.groups) {
            group.plant.rates(run.x, s, 1, of_states(group.q));
            group.series.propagate(*group.pattern, run.t, h, run.f, group.q, group.s);
        }
    } else {
        for (auto& group : run.groups) {
            if (propagate_curved(h, s, group)) continue;
            throw NoSolution(fmt::format(
                "sensitivities: between t = {:.9g} s and {:.9g} s the derivatives are no numbers", run.t, state.t));
        }
    }
    run.x = state.x;
    run.t = state.t;
}

// With x once more, from where the step begins.
bool SensitiveServoSystem::propagate_curved(double h, const ServoPlant::State& s, Group& group) const {
    const Run& run = *run_;
    const std::size_t n = states().size(), height = group.series.height();
    group.z.resize(height + height / lane_count);
    std::copy(group.s.begin(), group.s.end(), group.z.begin());
    std::copy(run.x.begin(), run.x.end(), group.z[height].of.data());
    const auto rates = [&](double t, std::span<const Lanes> z, std::span<Lanes> slope) {
        const std::span<const double> x(z[height].of.data(), n);
        group.plant.curved_rates(t, x, s, z.first(n), {slope[height].of.data(), n}, of_states(group.q));
        group.series.rates(*group.pattern, group.q, z.first(height), slope.first(height));
    };
    if (!group.midpoint.advance(run.t, h, group.z, rates)) return false;
    std::copy_n(group.z.begin(), height, group.s.begin());
    return true;
}

void SensitiveServoSystem::find_patterns(const ServoPlant::State& s) const {
    Run& run = *run_;
    for (auto& group : run.groups) {
        run.key.clear();
        plant().append_affine_key(s, run.key);
        for (const Lanes* numbers : {&group.plant.stiffness(), &group.plant.damping()}) {
            std::uint64_t present = 0;
            for (std::size_t p = 0; p < lane_count; ++p) {
                if ((*numbers)[p] == 0) continue;
                run.key.push_back(std::bit_cast<std::uint64_t>((*numbers)[p]));
                present |= std::uint64_t{1} << p;
            }
            run.key.push_back(present);
        }
        group.pattern = &group.series.pattern(run.key, [&](SensitivitySeries::Pattern& pattern) {
            const std::size_t n = states().size();
            std::vector<Lanes> partial(n * n);
            std::vector<double> unit(n);
            for (std::size_t j = 0; j < n; ++j) {
                unit[j] = 1;
                group.plant.rates(unit, s, 0, std::span(partial).subspan(j * n, n));
                unit[j] = 0;
            }
            group.series.set_matrices(pattern, plant().affine_form(s).a, partial);
        });
    }
    run.is_new_pattern = false;
}

// Where the rates jump from f_before to f, at a time that moves by `shift` with each parameter.
void SensitiveServoSystem::add_jump(const Lanes& shift, Group& group) const {
    const Run& run = *run_;
    for (std::size_t i = 0; i < states().size(); ++i) group.s[i] += (run.f_before[i] - run.f[i]) * shift;
}

EventEffect SensitiveServoSystem::on_crossing(GuardId guard, SystemState& state, EventLog& log) const {
    Run& run = *run_;
    propagate(state);
    const std::size_t logged = log.size();
    const ServoPlant::State& s = values(state).plant;
    const ContactState contact = s.contact;
    const SlipState dry = s.dry;
    plant().derivative(state.t, state.x, s, of_states(run.f_before));
    const EventEffect effect = ServoSystem::on_crossing(guard, state, log);
    const auto changes = std::span<const Event>(log).subspan(logged);
    run.x = state.x;
    if (changes.empty() && s.contact == contact) return effect; // nothing but rounding of the velocity
    run.is_new_pattern = true;
    const bool stopped = std::any_of(changes.begin(), changes.end(), [](const Event& event) {
        return static_cast<SlipState>(event.kind) == SlipState::stick;
    });
    // Dry friction jumps where the velocity comes to zero, and where a jump of the thrust, or of the force of a contact that
    // closes, lets the axis go.
    const bool by_jump = state.t == run.jump, released = s.dry != dry && !stopped;
    const bool by_contact = released && !by_jump && run.groups.front().plant.has_closed(state.x, s);
    const bool is_jump = s.dry != dry && (stopped || by_jump || by_contact);
    if (is_jump) plant().derivative(state.t, state.x, s, of_states(run.f));
    for (auto& group : run.groups) {
        if (is_jump) {
            Lanes shift;
            if (by_contact) {
                shift = group.plant.closing_shift(state.x, s, group.s);
            } else if (!by_jump) {
                shift = -group.s[1] / run.f_before[1];
            } else if (run.jump_moves) {
                shift = group.input_delay;
            }
            add_jump(shift, group);
            if (s.dry == SlipState::stick) group.s[1] = Lanes{};
        }
        if (s.contact != contact) {
            group.plant.after_contact(contact, state.x, run.f_before, s, group.s);
        } else if (stopped) {
            group.plant.after_reversal(changes, s, group.s);
        } else if (changes.front().subject != ServoPlant::coulomb_subject) {
            group.plant.after_slips(changes, state.t, state.x, s, group.s);
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
        for (auto& group : run.groups) {
            // It is read at k Ts - output_delay.
            const Lanes by = group.s[0] - state.x[1] * group.output_delay;
            group.encoder_ring[place] = detected(group, state.x[0], by, sample);
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
        const bool moves =
            std::any_of(run.groups.begin(), run.groups.end(), [](const Group& group) { return group.moves_input; });
        if (moves) plant().derivative(state.t, state.x, s.plant, of_states(run.f_before));
        const auto effect = ServoSystem::on_sample(clock, k, state);
        run.x = state.x; // the states of sine forces are set anew
        if (k < hold_lag_) return effect;
        if (moves) plant().derivative(state.t, state.x, s.plant, of_states(run.f));
        const std::size_t place = static_cast<std::size_t>(k - hold_lag_) % s.hold_ring.size();
        for (auto& group : run.groups) {
            if (moves) add_jump(group.input_delay, group);
            group.plant.input = group.hold_ring[place];
            group.plant.refresh_sines(state.t, group.s);
        }
        run.jump = state.t;
        run.jump_moves = true;
        return effect;
    }
    }
}

// Of the position y, with dy/dp.
Lanes SensitiveServoSystem::detected(const Group& group, double y, const Lanes& by, long k) const {
    Lanes sum = by;
    for (std::size_t p = 0; p < group.by.size() && !encoder_errors_.empty(); ++p) {
        for (std::size_t i = 0; i < encoder_errors_.size(); ++i) {
            const PeriodicEncoderError& error = encoder_errors_[i];
            const PeriodicEncoderError& error_by = group.by[p].numbers.encoder_errors[i];
            const double angle = 2 * std::numbers::pi * y / error.period;
            const double angle_by =
                2 * std::numbers::pi * by[p] / error.period - angle * error_by.period / error.period;
            const double first = angle + error.phase, second = 2 * angle + error.second_phase;
            sum[p] += error_by.amplitude * std::sin(first) + error_by.second_amplitude * std::sin(second) +
                      error.amplitude * std::cos(first) * (angle_by + error_by.phase) +
                      error.second_amplitude * std::cos(second) * (2 * angle_by + error_by.second_phase);
        }
    }
    return group.has_noise ? sum + group.noise_rms * sensor_noise_at(k) : sum;
}

void SensitiveServoSystem::control(long k, const MachineController::State& before, State& s) const {
    Run& run = *run_;
    const auto* loop = std::get_if<ClosedLoop>(&drive_);
    const std::size_t encoder_place = static_cast<std::size_t>(k) % s.encoder_ring.size();
    const std::size_t hold_place = static_cast<std::size_t>(k) % s.hold_ring.size();
    for (auto& group : run.groups) {
        const Lanes& y = group.encoder_ring[encoder_place];
        Lanes u = group.thrust * s.thrust;
        if (loop) {
            u = controller_step(group, s, before, group.reference * s.reference, y);
            if (group.has_excitation) u += group.excitation * loop->input(k).excitation;
        }
        group.hold_ring[hold_place] = u;
        for (std::size_t p = 0; p < group.by.size() && group.is_amplified; ++p) {
            group.hold_ring[hold_place][p] = amplified(group.by[p].numbers.amplifier, s.thrust, u[p]);
        }
        if (group.has_process_noise) group.plant.disturbance = group.process_noise_rms * process_noise_at(k);
        group.rows.push_back({u, y, group.s[0], group.s[1]});
        constexpr std::size_t most_rows = 64; // few, so that they stay in the cache
        if (group.rows.size() == most_rows) take_apart(group);
    }
}

// As MachineController::step, whose state was `before`.
Lanes SensitiveServoSystem::controller_step(Group& group, const State& s, const MachineController::State& before,
                                            const Lanes& reference, const Lanes& position) const {
    if (const auto* pid = std::get_if<PidController>(&settings_)) {
        return pid_step(*pid, group, s, before.pid, reference - position);
    }
    Lanes u;
    const auto* cascade = std::get_if<CascadeController>(&settings_);
    for (std::size_t p = 0; p < group.by.size() && cascade; ++p) {
        const auto& by = std::get<CascadeController>(group.by[p].numbers.controller);
        u[p] = cascade_step(*cascade, by, group.cascade[p], s, before.cascade, reference[p], position[p]);
    }
    return u;
}

TRIBODE_CLONES Lanes SensitiveServoSystem::pid_step(const PidController& pid, Group& group, const State& s,
                                                    const PidController::State& before, const Lanes& error_by) const {
    const double ts = sample_time_, error = s.reference - s.detected;
    double a = 0;
    Lanes a_by;
    if (pid.derivative_filter_hz > 0) {
        const double rate = -2 * std::numbers::pi * ts;
        a = std::exp(rate * pid.derivative_filter_hz);
        a_by = rate * group.derivative_filter_hz * a;
    }
    group.integral += ts * (group.ki * error + pid.ki * error_by);
    group.derivative = a_by * before.derivative + a * group.derivative - a_by * (error - before.previous_error) / ts +
                       (1 - a) * (error_by - group.previous_error) / ts;
    group.previous_error = error_by;
    Lanes u = group.kp * error + pid.kp * error_by + group.integral + group.kd * s.controller.pid.derivative +
              pid.kd * group.derivative;
    for (std::size_t p = 0; p < group.by.size() && !pid.filters.empty(); ++p) {
        u[p] = group.filters[p].step(pid.filters, u[p], ts);
    }
    return u;
}

double SensitiveServoSystem::cascade_step(const CascadeController& cascade, const CascadeController& by,
                                          CascadeController::State& own, const State& s,
                                          const CascadeController::State& before, double reference,
                                          double position) const {
    const double ts = sample_time_;
    if (!own.started) own = {true, position, position, 0, {}, std::vector<double>(cascade.delay_samples, 0.0)};
    const bool began = before.started;
    const double mean = s.controller.cascade.previous_mean;
    const double velocity = (mean - (began ? before.previous_mean : s.detected)) / ts;
    const double mean_by = (position + own.previous_position) / 2;
    const double velocity_by = (mean_by - own.previous_mean) / ts;
    own.previous_position = position;
    own.previous_mean = mean_by;
    const double wanted = cascade.kp * (s.reference - s.detected) - velocity;
    const double wanted_by = by.kp * (s.reference - s.detected) + cascade.kp * (reference - position) - velocity_by;
    double u = cascade.kv * wanted, u_by = by.kv * wanted + cascade.kv * wanted_by;
    if (cascade.ki != 0 || by.ki != 0) {
        const double integral = before.integral + cascade.ki * ts * wanted;
        const double integral_by = own.integral + ts * (by.ki * wanted + cascade.ki * wanted_by);
        u += cascade.kv * integral;
        u_by += by.kv * integral + cascade.kv * integral_by;
        // Beyond the limit it may rest.
        if (s.controller.cascade.integral == integral) own.integral = integral_by;
    }
    if (!cascade.filters.empty()) {
        auto filters = before.filters;
        u = filters.step(cascade.filters, u, ts);
        u_by = own.filters.step(cascade.filters, u_by, ts);
    }
    own.pending.push_back(clipped(u, u_by, cascade.limit, by.limit));
    const double output = own.pending.front();
    own.pending.erase(own.pending.begin());
    return output;
}

// As Amplifier, with du/dp.
double SensitiveServoSystem::amplified(const Amplifier& a_by, double u, double by) const {
    const Amplifier& a = amplifier_;
    const double w = std::clamp(u, -a.limit, a.limit), w_by = clipped(u, by, a.limit, a_by.limit);
    const double beyond = std::abs(w) - a.half_width;
    if (beyond <= 0) return 0;
    const double towards = std::copysign(1.0, w), beyond_by = towards * w_by - a_by.half_width;
    if (a.exponent == 1 && a_by.exponent == 0) return towards * (a_by.gain * beyond + a.gain * beyond_by);
    const double share = beyond / a.size, power = std::pow(share, a.exponent);
    const double power_by = a.exponent * power / share * beyond_by + a_by.size * (1 - a.exponent) * power +
                            a.size * power * std::log(share) * a_by.exponent;
    return towards * (a_by.gain * a.size * power + a.gain * power_by);
}

} // namespace tribode
