#include "problems/exact_servo.hpp"

#include "problems/exponential_ladder.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace tribode::problems {

namespace {

// Time is counted in whole ticks, so that sample instants, delays and events never drift apart.
using Ticks = std::int64_t;
constexpr int sample_level = 44;              // a sample time is 2^44 ticks
constexpr int scan_level = sample_level - 6;  // events are looked for every T_s/64
constexpr std::size_t max_samples = 1u << 18; // 2^18 2^44 ticks still fit

int sign_of(Real value) { return value > 0 ? 1 : value < 0 ? -1 : 0; }

void require(bool holds, const char* what) {
    if (!holds) throw std::invalid_argument(what);
}

void check(const ServoProblem& problem) {
    Real gain = problem.rigid_gain;
    for (const auto& mode : problem.modes) gain += mode.gain;
    require(gain > 0, "the gains of the rigid body and the modes must add up to a positive number");
    require(problem.sample_time > 0, "the sample time must be positive");
    require(problem.coulomb >= 0 && problem.lag_hz >= 0, "the Coulomb level and the lag must not be negative");
    for (const auto& element : problem.elements)
        require(element.K > 0 && element.F > 0, "K and F of an element must be positive");
}

// The machine in motion. State: x0, x0', then q_j, q_j' per mode, z_i per element, the lagged thrust (where
// there is a lag), the thrust reference and the Coulomb force, both constant between events.
class Servo {
  public:
    explicit Servo(const ServoProblem& problem);

    void advance_to(Ticks end);
    // From now on this thrust reference [N] is held.
    void hold(double reference);

    double position() const { return static_cast<double>(position_.dot(state_)); }
    double velocity() const { return static_cast<double>(velocity_.dot(state_)); }
    double friction() const;
    Ticks ticks(double seconds) const { return std::llround(static_cast<Real>(seconds) / tick_); }
    std::vector<ServoEvent> take_events() { return std::move(events_); }

  private:
    int first_element() const { return 2 + 2 * static_cast<int>(problem_.modes.size()); }
    bool held_by_coulomb() const { return problem_.coulomb > 0 && direction_ == 0; }
    bool sticks(std::size_t i) const { return !slips_[i]; }
    Real limit(std::size_t i) const { return static_cast<Real>(problem_.elements[i].F) / problem_.elements[i].K; }
    Real deflection(const RealVector& state, std::size_t i) const { return state(first_element() + i); }
    // How far element i is deflected in the direction of motion; in either one while that is unknown.
    Real outward(const RealVector& state, std::size_t i) const {
        const Real z = deflection(state, i);
        return direction_ == 0 ? std::abs(z) : direction_ * z;
    }

    RealVector free_friction() const;
    Real holding_force(const RealVector& state) const { return state.dot(thrust_ - restoring_ - springs_); }
    RealMatrix rates() const;
    const ExponentialLadder& ladder();

    bool quiet(const RealVector& state) const;
    void change_slip_states();
    void reverse();
    void note(int element, EventKind kind);
    EventKind slip_kind() const { return direction_ > 0 ? EventKind::slip_forward : EventKind::slip_backward; }

    ServoProblem problem_;
    Real tick_; // [s]
    int reference_index_, coulomb_index_;
    RealVector position_, velocity_, thrust_, springs_; // linear forms: state -> y, v, thrust, sum K_i z_i
    RealVector restoring_;                              // linear form: the effective thrust at which dv/dt = 0

    RealVector state_;
    std::vector<bool> slips_;
    int direction_ = 0; // sign of v; 0: held by the Coulomb level, or not yet moved
    Ticks now_ = 0;
    std::vector<ServoEvent> events_;
    std::map<std::vector<bool>, ExponentialLadder> ladders_; // by slips_ and, last, whether the Coulomb level holds
};

Servo::Servo(const ServoProblem& problem)
    : problem_(problem),
      tick_(std::ldexp(static_cast<Real>(problem.sample_time), -sample_level)),
      slips_(problem.elements.size(), false) {
    check(problem);
    const int lag_index = first_element() + static_cast<int>(problem.elements.size());
    reference_index_ = lag_index + (problem.lag_hz > 0 ? 1 : 0);
    coulomb_index_ = reference_index_ + 1;
    state_ = RealVector::Zero(coulomb_index_ + 1);
    position_ = velocity_ = thrust_ = springs_ = restoring_ = state_;

    thrust_(lag_index) = 1; // without a lag this is the reference itself
    Real total_gain = problem.rigid_gain;
    position_(0) = velocity_(1) = 1;
    for (std::size_t j = 0; j < problem.modes.size(); ++j) {
        const auto& mode = problem.modes[j];
        const Real omega = 2 * std::numbers::pi_v<Real> * mode.freq_hz;
        total_gain += mode.gain;
        position_(2 + 2 * j) = velocity_(3 + 2 * j) = 1;
        restoring_(2 + 2 * j) = omega * omega;
        restoring_(3 + 2 * j) = 2 * mode.zeta * omega;
    }
    restoring_ /= total_gain;
    for (std::size_t i = 0; i < problem.elements.size(); ++i) springs_(first_element() + i) = problem.elements[i].K;
}

// f as a linear form while the table moves.
RealVector Servo::free_friction() const {
    Real damping = problem_.viscous;
    for (std::size_t i = 0; i < slips_.size(); ++i)
        if (sticks(i)) damping += problem_.elements[i].D;
    RealVector form = springs_ + damping * velocity_;
    form(coulomb_index_) = 1;
    return form;
}

double Servo::friction() const {
    const RealVector form = held_by_coulomb() ? RealVector(thrust_ - restoring_) : free_friction();
    return static_cast<double>(form.dot(state_));
}

RealMatrix Servo::rates() const {
    RealMatrix a = RealMatrix::Zero(state_.size(), state_.size());
    const RealVector effective = held_by_coulomb() ? restoring_ : RealVector(thrust_ - free_friction());
    a(0, 1) = 1;
    a.row(1) = problem_.rigid_gain * effective;
    for (std::size_t j = 0; j < problem_.modes.size(); ++j) {
        const auto& mode = problem_.modes[j];
        const Real omega = 2 * std::numbers::pi_v<Real> * mode.freq_hz;
        a(2 + 2 * j, 3 + 2 * j) = 1;
        a.row(3 + 2 * j) = mode.gain * effective;
        a(3 + 2 * j, 2 + 2 * j) -= omega * omega;
        a(3 + 2 * j, 3 + 2 * j) -= 2 * mode.zeta * omega;
    }
    for (std::size_t i = 0; i < slips_.size(); ++i)
        if (sticks(i) && !held_by_coulomb()) a.row(first_element() + i) = velocity_;
    if (problem_.lag_hz > 0) {
        const Real corner = 2 * std::numbers::pi_v<Real> * problem_.lag_hz;
        a(reference_index_ - 1, reference_index_ - 1) = -corner;
        a(reference_index_ - 1, reference_index_) = corner;
    }
    return a;
}

const ExponentialLadder& Servo::ladder() {
    std::vector<bool> key = slips_;
    key.push_back(held_by_coulomb());
    auto found = ladders_.find(key);
    if (found == ladders_.end())
        found = ladders_.emplace(std::move(key), ExponentialLadder(rates(), tick_, scan_level + 1)).first;
    return found->second;
}

// Whether every slip state may last at this state.
bool Servo::quiet(const RealVector& state) const {
    if (held_by_coulomb()) return std::abs(holding_force(state)) <= problem_.coulomb;
    if (direction_ * velocity_.dot(state) < 0) return false;
    for (std::size_t i = 0; i < slips_.size(); ++i)
        if (sticks(i) && outward(state, i) >= limit(i)) return false;
    return true;
}

void Servo::advance_to(Ticks end) {
    while (now_ < end) {
        const ExponentialLadder& flow = ladder();
        const auto step = [&](int level) {
            state_ = flow.step(state_, level);
            now_ += Ticks{1} << level;
        };
        const int longest = std::bit_width(static_cast<std::uint64_t>(end - now_)) - 1;
        int level = std::min(longest, scan_level);

        // The motion keeps its direction up to a reversal, so within one step the quiet states come first,
        // then the others: descending the ladder is a bisection, and it ends one tick before the first state
        // that is not quiet.
        if (quiet(flow.step(state_, level))) {
            step(level);
            if (!held_by_coulomb() && direction_ == 0) direction_ = sign_of(velocity_.dot(state_));
            continue;
        }
        while (--level >= 0)
            if (quiet(flow.step(state_, level))) step(level);
        step(0);
        change_slip_states();
    }
}

void Servo::hold(double reference) {
    require(std::isfinite(reference), "the thrust reference must be finite");
    state_(reference_index_) = reference;
    change_slip_states(); // without a lag the jump may tear the table from the Coulomb level at once
}

void Servo::change_slip_states() {
    const Real v = velocity_.dot(state_);
    if (!held_by_coulomb() && direction_ == 0) direction_ = sign_of(v);
    if (direction_ * v < 0) reverse();
    if (held_by_coulomb() && !quiet(state_)) {
        direction_ = sign_of(holding_force(state_));
        state_(coulomb_index_) = direction_ * static_cast<Real>(problem_.coulomb);
        note(0, slip_kind());
    }
    if (direction_ == 0) return;
    for (std::size_t i = 0; i < slips_.size(); ++i) {
        if (slips_[i] || outward(state_, i) < limit(i)) continue;
        slips_[i] = true;
        state_(first_element() + i) = direction_ * limit(i);
        note(static_cast<int>(i) + 1, slip_kind());
    }
}

void Servo::reverse() {
    direction_ = -direction_;
    if (problem_.coulomb > 0) {
        direction_ = 0;
        state_(1) -= velocity_.dot(state_); // at rest exactly, for as long as the Coulomb level holds
        state_(coulomb_index_) = 0;
        note(0, EventKind::stick);
    }
    for (std::size_t i = 0; i < slips_.size(); ++i) {
        if (!slips_[i]) continue;
        slips_[i] = false;
        note(static_cast<int>(i) + 1, EventKind::stick);
    }
}

void Servo::note(int element, EventKind kind) { events_.push_back({static_cast<double>(now_ * tick_), element, kind}); }

// Runs the machine with u[k] = control(k, y[k]), where y[k] is the position one output delay before the
// sample instant. At one instant: measure, record the left limit and compute u, then let the hold change.
ServoSolution run(const ServoProblem& problem, double input_delay, double output_delay, std::size_t count,
                  const std::function<double(std::size_t, double)>& control) {
    require(count <= max_samples, "at most 2^18 samples");
    require(input_delay >= 0 && output_delay >= 0, "delays must not be negative");
    Servo servo(problem);
    const auto instant = [](std::size_t k) { return static_cast<Ticks>(k) << sample_level; };
    const Ticks in = servo.ticks(input_delay), out = servo.ticks(output_delay);
    ServoSolution solution;
    std::vector<double> u, y;
    for (std::size_t held = 0; solution.t.size() < count;) {
        const std::size_t k = solution.t.size();
        const Ticks measure = instant(y.size()) - out, hold = instant(held) + in;
        if (measure <= std::min(instant(k), hold)) {
            servo.advance_to(measure); // before t = 0 the table is at zero
            y.push_back(servo.position());
        } else if (instant(k) <= hold) {
            servo.advance_to(instant(k));
            solution.t.push_back(static_cast<double>(k) * problem.sample_time);
            solution.x.push_back(servo.position());
            solution.v.push_back(servo.velocity());
            solution.f.push_back(servo.friction());
            u.push_back(control(k, y[k]));
        } else {
            servo.advance_to(hold);
            servo.hold(u[held++]);
        }
    }
    solution.events = servo.take_events();
    return solution;
}

// The sampled controller with the encoder before it.
class Controller {
  public:
    Controller(const LoopSettings& loop, double sample_time)
        : loop_(loop),
          sample_time_(sample_time),
          forget_(loop.derivative_filter_hz > 0
                      ? std::exp(-2 * std::numbers::pi * loop.derivative_filter_hz * sample_time)
                      : 0.0) {}

    double detect(double position) const {
        const double step = loop_.encoder_resolution;
        return step > 0 ? step * std::floor(position / step + 0.5) : position;
    }

    double thrust(double error) {
        integral_ += loop_.ki * sample_time_ * error;
        slope_ = forget_ * slope_ + (1 - forget_) * (error - last_error_) / sample_time_;
        last_error_ = error;
        return loop_.kp * error + integral_ + loop_.kd * slope_;
    }

  private:
    LoopSettings loop_;
    double sample_time_, forget_;
    double integral_ = 0.0, slope_ = 0.0, last_error_ = 0.0;
};

} // namespace

ServoProblem linear_motor_table() {
    // Swing F_m [N] and stiffness [N/mm] as printed.
    constexpr double printed[][2] = {{1.12, 2226.6}, {0.60, 602.1}, {0.33, 165.1}, {0.54, 154.9}, {0.49, 81.6},
                                     {0.46, 56.8},   {0.16, 15.8},  {0.36, 30.0},  {0.25, 17.9},  {0.73, 45.8},
                                     {0.73, 36.2},   {0.88, 29.3},  {1.34, 26.8},  {1.23, 16.4},  {0.77, 7.7},
                                     {0.72, 3.6},    {0.97, 2.0},   {1.08, 1.1},   {1.74, 0.9},   {0.89, 0.3}};
    ServoProblem table;
    table.rigid_gain = 94.28e-3;
    table.modes = {{13.08e-3, 33.32, 2.48e-2}, {5.27e-3, 82.22, 3.22e-3}};
    for (const auto& [swing, stiffness] : printed) table.elements.push_back({1000 * stiffness, swing / 2});
    table.elements.back().D = 10.0;
    table.viscous = 2.35;
    return table;
}

ServoSolution solve_exactly(const ServoProblem& problem, const std::vector<double>& u, double input_delay) {
    return run(problem, input_delay, 0.0, u.size(), [&](std::size_t k, double) { return u[k]; });
}

LoopSolution solve_loop_exactly(const ServoProblem& problem, const LoopSettings& loop, const std::vector<double>& r,
                                const std::vector<double>& exc) {
    require(r.size() == exc.size(), "r and exc must have the same length");
    LoopSolution solution;
    Controller controller(loop, problem.sample_time);
    ServoSolution machine =
        run(problem, loop.input_delay, loop.output_delay, r.size(), [&](std::size_t k, double position) {
            solution.y.push_back(controller.detect(position));
            solution.u.push_back(controller.thrust(r[k] - solution.y[k]) + exc[k]);
            return solution.u[k];
        });
    solution.t = std::move(machine.t);
    solution.r = r;
    solution.x = std::move(machine.x);
    solution.v = std::move(machine.v);
    solution.f = std::move(machine.f);
    solution.events = std::move(machine.events);
    return solution;
}

} // namespace tribode::problems
