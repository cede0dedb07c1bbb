#pragma once
#include "tribode/base/lanes.hpp"
#include "tribode/experiment/servo_recorder.hpp"
#include "tribode/machine/servo_numbers.hpp"
#include "tribode/solver/extrapolated_midpoint.hpp"
#include "tribode/solver/sensitivity_series.hpp"

#include <memory>
#include <span>
#include <string>
#include <vector>

namespace tribode {

// Derivatives of a run by one parameter p, at the sample instants of the controller: as the columns of ServoTrace, and those of
// its channels.
struct ServoSensitivity {
    std::string name;
    std::vector<double> u; // du/dp [N by the unit of p]
    std::vector<double> y; // dy/dp of the detected position before it is rounded [m by the unit of p]
    std::vector<double> x; // dx/dp
    std::vector<double> v; // dv/dp
};

// A servo system that carries the derivatives of its run along: between its events and samples they are propagated by
// SensitivitySeries, or by ExtrapolatedMidpoint where forces are not affine; at them they change as the states and values do. One
// system serves one run by a solver that locates events, from its initial_state() on, and may ask its drive for a sample twice.
//
// Rounding by the encoder is passed over, as if its slope were one.
class SensitiveServoSystem final : public ServoSystem {
  public:
    // Throws InputError where a run has no derivatives: the machine has forces of which they are not known, u varies between
    // samples, or friction is fed back.
    SensitiveServoSystem(const MachineModel& model, Drive drive, std::uint64_t seed, Start start,
                         std::vector<ServoDirection> directions, ServoChannels channels);

    void expect_samples(long count) const;                      // in all, so that their memory is taken at once
    const std::vector<ServoSensitivity>& sensitivities() const; // at the samples reached

    SystemState initial_state() const override;
    EventEffect on_crossing(GuardId guard, SystemState& state, EventLog& log) const override;
    EventEffect on_sample(ClockId clock, long k, SystemState& state) const override;

  private:
    // At a sample, as in ServoSensitivity.
    struct Row {
        Lanes u, y, x, v;
    };

    // Of up to lane_count parameters, side by side.
    struct Group {
        std::vector<ServoDirection> by;
        SensitivitySeries series;
        ServoPlantTangent plant;
        ExtrapolatedMidpoint midpoint;
        std::size_t first = 0; // place in the results
        Lanes output_delay, input_delay, noise_rms, process_noise_rms, thrust, reference, excitation;
        bool moves_input = false, has_noise = false, has_process_noise = false, has_excitation = false; // any of these
        bool is_amplified = false; // else the amplifier passes on what it gets, whatever the parameters are
        Lanes kp, ki, kd, derivative_filter_hz; // as in PidController, and its state
        Lanes integral, derivative, previous_error;
        std::vector<LoopFilterStates> filters = {};           // of each parameter
        std::vector<CascadeController::State> cascade = {};   // the same
        std::vector<Lanes> encoder_ring = {}, hold_ring = {}; // as in ServoSystem::State
        std::vector<Lanes> s = {}, q = {};                    // of each state dx/dp, and dx'/dp at fixed x
        std::vector<Lanes> z = {};                            // of the midpoint rule: s, then x
        std::vector<Row> rows = {};                           // that are not in the results yet
        SensitivitySeries::Pattern* pattern = nullptr;
    };

    // What changes during the run, besides the state. s, q and f have the height of SensitivitySeries.
    struct Run {
        std::vector<Group> groups = {};
        std::vector<ServoSensitivity> results = {};
        std::vector<double> f = {};                // x' where the step begins
        std::vector<double> x = {}, f_before = {}; // where it begins; before a jump
        double t = 0;                              // [s]
        bool is_new_pattern = true;                // or it may be
        AffineKey key = {};
        double jump = -1;        // when the input or the disturbance jumped last [s]
        bool jump_moves = false; // with the input delay
    };

    // Of what is filled up to the height of the series.
    auto of_states(auto& values) const { return std::span(values).first(states().size()); }
    void take_apart(Group& group) const;
    void add_group(std::vector<ServoDirection> directions) const;
    void propagate(const SystemState& state) const;
    bool propagate_curved(double h, const ServoPlant::State& s, Group& group) const;
    void find_patterns(const ServoPlant::State& s) const;
    void add_jump(const Lanes& shift, Group& group) const;
    Lanes detected(const Group& group, double y, const Lanes& by, long k) const;
    void control(long k, const MachineController::State& before, State& s) const;
    Lanes controller_step(Group& group, const State& s, const MachineController::State& before, const Lanes& reference,
                          const Lanes& position) const;
    Lanes pid_step(const PidController& pid, Group& group, const State& s, const PidController::State& before,
                   const Lanes& error_by) const;
    double cascade_step(const CascadeController& cascade, const CascadeController& by, CascadeController::State& own,
                        const State& s, const CascadeController::State& before, double reference,
                        double position) const;
    double amplified(const Amplifier& by, double u, double u_by) const;

    const Controller settings_;
    const ServoChannels channels_;
    const std::unique_ptr<Run> run_;
};

} // namespace tribode
