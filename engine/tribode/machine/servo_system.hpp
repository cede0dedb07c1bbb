#pragma once
#include "tribode/hybrid/piecewise_affine.hpp"
#include "tribode/machine/friction_model.hpp"
#include "tribode/machine/machine_controller.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/plant/servo_plant.hpp"

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <variant>
#include <vector>

namespace tribode {

// What the loop is asked to do at sample k.
struct LoopInput {
    double reference = 0;  // r[k] [m]
    double excitation = 0; // added to the controller's output [N]
};

// Closed loop: the machine's controller makes u from r and y. `input` is called once a sample, in order.
//
// friction_feedback is the share of the modeled friction that the drive adds, Fig. 6 of the paper:
//
//     u[k] = C(z) (r[k] - y[k]) + excitation + friction_feedback fh[k]
//
// with fh from friction_model, the machine's own if there is none, driven by the detected position y[k] as in the
// analyses (MeasuredFriction), relaxed at the first sample. Laws that grow with the load see the thrust of the sample before.
// friction_feedback is finite and not negative; 0: none.
struct ClosedLoop {
    std::function<LoopInput(long k)> input;
    double friction_feedback = 0;
    std::optional<FrictionModel> friction_model = {};
};

// Open loop: u between sample k and the next as a cubic in (t - t_k)/Ts; {u[k], 0, 0, 0} is a zero-order hold [N].
struct OpenLoop {
    std::function<std::array<double, 4>(long k)> thrust;
};

using Drive = std::variant<ClosedLoop, OpenLoop>;

// A servo machine with its sampled parts: ServoPlant, encoder, controller and hold.
//
// Delays are clock offsets, exact for any fraction of a sample, with no history buffer: y[k] is read at the earlier
// instant k Ts - output_delay, u[k] is handed on at the later instant k Ts + input_delay. Whole samples of delay
// become places in a ring. Where the three meet at one instant the order is encoder, controller, hold.
class ServoSystem : public HybridSystem, public PiecewiseAffine {
  public:
    enum Clock : ClockId { encoder, controller, hold };

    // Position and velocity of the driven point at t = 0; all else rests.
    struct Start {
        double position = 0; // [m]
        double velocity = 0; // [m/s]
    };

    struct State final : DiscreteValues<State> {
        ServoPlant::State plant;
        MachineController::State controller;
        double reference = 0;                           // r[k] [m]
        double thrust = 0;                              // u[k] [N]
        double detected = 0;                            // y[k] [m]
        std::optional<MeasuredFriction> friction_model; // where friction is fed back
        double friction_fed_back = 0;                   // its part of u[k] [N]
        std::vector<double> encoder_ring;               // y[k] at k mod size
        std::vector<std::array<double, 4>> hold_ring;   // u[k] as coefficients, at k mod size
    };

    // The model is copied. seed: of sensor and process noise.
    ServoSystem(const MachineModel& model, Drive drive, std::uint64_t seed = 0, Start start = {0.0, 0.0});

    const ServoPlant& plant() const { return plant_; }
    double sample_time() const { return sample_time_; }
    static const State& values(const SystemState& state) { return static_cast<const State&>(*state.discrete); }
    ServoPlant::Outputs outputs(const SystemState& state) const {
        return plant_.outputs(state.t, state.x, values(state).plant);
    }

    const std::vector<StateVariable>& states() const override { return plant_.states(); }
    const std::vector<SampleClock>& clocks() const override { return clocks_; }
    std::size_t guard_count() const override { return plant_.guard_count(); }
    SystemState initial_state() const override;
    void derivative(double t, std::span<const double> x, const DiscreteState& d, std::span<double> dxdt) const override;
    bool jacobian(double t, std::span<const double> x, const DiscreteState& d, std::span<double> matrix) const override;
    void guards(double t, std::span<const double> x, const DiscreteState& d, std::span<double> g) const override;
    const PiecewiseAffine* piecewise_affine() const override { return this; }
    void linear_part(std::span<double> matrix) const override { plant_.linear_part(matrix); }
    std::optional<std::string> why_not_affine() const override { return plant_.why_not_affine(); }
    std::optional<std::string> why_not_nearly_affine() const override { return plant_.why_not_nearly_affine(); }
    AffineForm affine_form(const DiscreteState& d) const override { return plant_.affine_form(plant_state(d)); }
    void append_affine_key(const DiscreteState& d, AffineKey& key) const override {
        plant_.append_affine_key(plant_state(d), key);
    }
    bool has_varying_input(const DiscreteState& d) const override { return plant_.has_varying_input(plant_state(d)); }
    void rate_coefficient(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                          std::span<double> coefficient) const override {
        plant_.rate_coefficient(n, t0, h, c, plant_state(d), coefficient);
    }
    void guard_coefficient(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                           std::span<double> coefficient) const override {
        plant_.guard_coefficient(n, t0, h, c, plant_state(d), coefficient);
    }
    std::size_t forcing_count() const override { return plant_.forcing_count(); }
    void forcing(double t, std::span<const double> x, const DiscreteState& d, std::span<double> w) const override {
        plant_.forcing(t, x, plant_state(d), w);
    }
    EventEffect on_crossing(GuardId guard, SystemState& state, EventLog& log) const override;
    EventEffect on_sample(ClockId clock, long k, SystemState& state) const override;
    std::string guard_name(GuardId guard, const SystemState& state) const override;

  private:
    friend class SensitiveServoSystem; // the same samples, differentiated
    ServoSystem(const MachineModel& model, ServoAxis axis, Drive drive, std::uint64_t seed, Start start);

    static const ServoPlant::State& plant_state(const DiscreteState& d) { return static_cast<const State&>(d).plant; }
    double detect(double position, long k) const;
    double sensor_noise_at(long k) const;  // as a multiple of its rms
    double process_noise_at(long k) const; // the same
    std::array<double, 4> amplified(const std::array<double, 4>& u) const;
    EventEffect control(long k, State& s) const;
    bool apply_hold(long k, double t, State& s) const;

    ServoPlant plant_;
    Amplifier amplifier_;
    std::vector<PeriodicEncoderError> encoder_errors_;
    MachineController controller_;
    std::optional<MeasuredFriction> friction_model_; // as it starts
    Drive drive_;
    std::uint64_t seed_;
    Start start_;
    double sample_time_, output_delay_, encoder_resolution_, noise_rms_, process_noise_rms_;
    long encoder_lead_ = 0; // samples whose encoder instant lies before t = 0
    long hold_lag_ = 0;     // whole samples of input delay
    std::vector<SampleClock> clocks_;
};

} // namespace tribode
