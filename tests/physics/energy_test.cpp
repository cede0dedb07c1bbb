// Where the work of the thrust goes, and what a friction loop takes of it.
#include "physics/oracle.hpp"
#include "tribode/solver/simulator.hpp"

namespace tribode {
namespace {

// Energies and works along a run, by the trapezoidal rule over a fine grid of outputs.
class EnergyMeter final : public Observer {
  public:
    EnergyMeter(const ServoSystem& system, const MachineModel& machine) : system_(system), machine_(machine) {}

    void output(const SystemState& state) override {
        const auto now = system_.outputs(state);
        const double damped = modal_damping_power(state.x);
        if (started_) {
            const double travel = now.position - before_.position, dt = state.t - t_;
            input_work += now.thrust * travel; // constant between two sample instants, which are on the grid
            friction_work += (before_.friction + now.friction) / 2 * travel;
            modal_loss += (damped_ + damped) / 2 * dt;
        }
        started_ = true;
        before_ = now;
        damped_ = damped;
        t_ = state.t;
        t.push_back(state.t);
        y.push_back(now.position);
        f.push_back(now.friction);
        friction_loss.push_back(friction_work - spring_energy(state, now.position));
        motion = motion_energy(state.x);
    }

    double input_work = 0, friction_work = 0, modal_loss = 0, motion = 0; // [J]
    std::vector<double> t, y, f;
    std::vector<double> friction_loss; // work of the friction that is not in its springs [J]

  private:
    // sum over bodies of (q'^2 + w^2 q^2)/(2 k); the velocity of the rigid body is what the modes leave of
    // the point's
    double motion_energy(std::span<const double> x) const {
        double rigid = x[1], sum = 0;
        for (std::size_t j = 0; j < machine_.modes.size(); ++j) rigid -= x[3 + 2 * j];
        sum += rigid * rigid / (2 * machine_.rigid_gain);
        for (std::size_t j = 0; j < machine_.modes.size(); ++j) {
            const double omega = 2 * std::numbers::pi * machine_.modes[j].freq_hz, q = x[2 + 2 * j], v = x[3 + 2 * j];
            sum += (v * v + omega * omega * q * q) / (2 * machine_.modes[j].gain);
        }
        return sum;
    }
    double modal_damping_power(std::span<const double> x) const {
        double sum = 0;
        for (std::size_t j = 0; j < machine_.modes.size(); ++j) {
            const auto& mode = machine_.modes[j];
            const double v = x[3 + 2 * j];
            sum += 2 * mode.zeta * 2 * std::numbers::pi * mode.freq_hz * v * v / mode.gain;
        }
        return sum;
    }
    double spring_energy(const SystemState& state, double position) const {
        const auto& rolling = ServoSystem::values(state).plant.rolling;
        double sum = 0;
        for (std::size_t i = 0; i < machine_.elements.size(); ++i) {
            const double travel = rolling.slip[i] == SlipState::stick ? position - rolling.reference : 0;
            sum += machine_.elements[i].stiffness * std::pow(rolling.z[i] + travel, 2) / 2;
        }
        return sum;
    }

    const ServoSystem& system_;
    const MachineModel& machine_;
    bool started_ = false;
    ServoPlant::Outputs before_{};
    double damped_ = 0, t_ = 0;
};

EnergyMeter measured(const MachineModel& machine, double amplitude, double frequency_hz, long samples,
                     long per_sample) {
    const ServoSystem system(
        machine, OpenLoop{[=](long k) {
            const double t = static_cast<double>(k) * 5e-4;
            return std::array{amplitude * std::sin(2 * std::numbers::pi * frequency_hz * t), 0., 0., 0.};
        }});
    EnergyMeter meter(system, machine);
    Simulator run(system, {.method = Method::erk, .relative_tolerance = 1e-9, .absolute_tolerance = 1e-13});
    std::vector<double> grid;
    for (long k = 0; k < samples; ++k) {
        for (long i = 0; i < per_sample; ++i) {
            grid.push_back((static_cast<double>(k) + static_cast<double>(i) / static_cast<double>(per_sample)) * 5e-4);
        }
    }
    grid.push_back(static_cast<double>(samples) * 5e-4);
    run.observe(&meter);
    run.set_output_grid(grid);
    EXPECT_TRUE(run.advance_to(grid.back()).ok());
    return meter;
}

TEST(Energy, work_of_the_thrust_is_motion_and_springs_and_losses) {
    const MachineModel machine = machine_of(bare_description());
    const EnergyMeter coarse = measured(machine, 15, 10, 600, 10), fine = measured(machine, 15, 10, 600, 40);
    const auto imbalance = [](const EnergyMeter& m) {
        return std::abs(m.input_work - m.motion - m.modal_loss - m.friction_work) / m.input_work;
    };
    EXPECT_GT(fine.input_work, 0);
    // What is left is the trapezoidal rule: h^2, at kinks and at the jump of the damping of one element h.
    EXPECT_LT(imbalance(coarse), 1e-4);
    EXPECT_LT(imbalance(fine), 1e-5);
}

TEST(Energy, friction_never_gives_back_more_than_its_springs_hold) {
    const EnergyMeter m = measured(machine_of(bare_description()), 15, 10, 600, 20);
    double worst = 0;
    for (std::size_t i = 1; i < m.friction_loss.size(); ++i) {
        worst = std::min(worst, m.friction_loss[i] - m.friction_loss[i - 1]);
    }
    EXPECT_GT(worst, -1e-9 * m.friction_loss.back()); // the trapezoidal rule across a kink
    EXPECT_GT(m.friction_loss.back(), 0.1 * m.input_work);
}

// In a steady oscillation of amplitude A an element with the limit X_i < A takes 4 F_i (A - X_i) a period.
TEST(Hysteresis, the_loop_of_a_steady_oscillation_has_the_area_of_the_closed_form) {
    Json description = bare_description();
    description.erase("modes");
    description["friction"]["viscous"] = 0.0;
    description["friction"]["elements"].back()["D"] = 0.0;
    const MachineModel machine = machine_of(description);
    const long period = 100; // samples, of 20 Hz
    const EnergyMeter m = measured(machine, 30, 20, 40 * period, 20);
    const std::size_t last = m.y.size() - 1, first = last - static_cast<std::size_t>(period) * 20;
    // The loop is closed: the oscillation has settled.
    const auto [low, high] = std::minmax_element(m.y.begin() + static_cast<std::ptrdiff_t>(first), m.y.end());
    const double amplitude = (*high - *low) / 2;
    ASSERT_NEAR(m.y[last], m.y[first], 1e-3 * amplitude);
    double area = 0, expected = 0;
    long slipping = 0;
    for (std::size_t i = first; i < last; ++i) area += (m.f[i] + m.f[i + 1]) / 2 * (m.y[i + 1] - m.y[i]);
    for (const auto& element : machine.elements) {
        if (element.limit() >= amplitude) continue;
        expected += 4 * element.level * (amplitude - element.limit());
        ++slipping;
    }
    EXPECT_GT(slipping, 10);
    EXPECT_LT(slipping, 20);                      // and some do not, so that the condition matters
    EXPECT_NEAR(area, expected, 2e-3 * expected); // the loop closes to 1e-3
}

} // namespace
} // namespace tribode
