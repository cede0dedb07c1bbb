#pragma once
#include "tribode/experiment/servo_recorder.hpp"
#include "tribode/machine/servo_numbers.hpp"
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
// SensitivitySeries, at them they change as the states and values do. One system serves one run by the exact solver, from its
// initial_state() on, and may ask its drive for a sample twice.
//
// Rounding by the encoder is passed over, as if its slope were one.
class SensitiveServoSystem final : public ServoSystem {
  public:
    // Throws InputError where a run has no derivatives: the machine is not piecewise affine, u varies between samples, or
    // friction is fed back.
    SensitiveServoSystem(const MachineModel& model, Drive drive, std::uint64_t seed, Start start,
                         std::vector<ServoDirection> directions, ServoChannels channels);

    void expect_samples(long count) const; // in all, so that their memory is taken at once
    const std::vector<ServoSensitivity>& sensitivities() const { return run_->results; }

    SystemState initial_state() const override;
    EventEffect on_crossing(GuardId guard, SystemState& state, EventLog& log) const override;
    EventEffect on_sample(ClockId clock, long k, SystemState& state) const override;

  private:
    // Of one parameter.
    struct Direction {
        ServoDirection by;
        ServoPlantTangent plant;
        bool is_amplified; // else the amplifier passes on what it gets, whatever p is
        MachineController::State controller = {};
        std::vector<double> encoder_ring = {}, hold_ring = {}; // as in ServoSystem::State
    };

    // What changes during the run, besides the state.
    struct Run {
        SensitivitySeries series;
        std::vector<Direction> directions = {};
        std::vector<ServoSensitivity> results = {};
        std::vector<double> s = {}, q = {};            // dx/dp, and dx'/dp at fixed x: (height x directions)
        std::vector<double> f = {};                    // (height): x' where the step begins
        std::vector<double> x = {}, f_before = {};     // where it begins; before a jump
        double t = 0;                                  // [s]
        SensitivitySeries::Pattern* pattern = nullptr; // null: it may have changed
        AffineKey key = {};
        double jump = -1;        // when the input or the disturbance jumped last [s]
        bool jump_moves = false; // with the input delay
    };

    double* column(std::size_t p) const { return run_->s.data() + p * run_->series.height(); }
    std::span<double> column_of(std::size_t p) const { return {column(p), states().size()}; }
    void propagate(const SystemState& state) const;
    void find_pattern(const ServoPlant::State& s) const;
    void add_jump(double shift, std::size_t p) const;
    double detected(const Direction& direction, double y, double by, long k) const;
    void control(long k, const MachineController::State& before, State& s) const;
    double controller_step(Direction& direction, const State& s, const MachineController::State& before,
                           double reference, double position) const;
    double amplified(const Direction& direction, double u, double by) const;

    const Controller settings_;
    const ServoChannels channels_;
    const std::unique_ptr<Run> run_;
};

} // namespace tribode
