// The exact method: against references of another road, against the variable-step method on random machines, and
// against the balance of energy.
#include "physics/oracle.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/solver/simulator.hpp"

#include <fstream>
#include <map>
#include <random>
#include <sstream>

namespace tribode {
namespace {

constexpr SolverOptions exact_solver{.method = Method::exact};

using Columns = std::map<std::string, std::vector<std::string>>;

Columns read_golden(const std::string& name) {
    std::ifstream file(std::string(TRIBODE_SOURCE_DIR) + "/tests/golden/" + name);
    EXPECT_TRUE(file) << name;
    Columns columns;
    std::vector<std::string> names;
    for (std::string line; std::getline(file, line);) {
        std::istringstream cells(line);
        std::size_t i = 0;
        for (std::string cell; std::getline(cells, cell, ','); ++i) {
            if (columns.size() <= i && names.size() == i) {
                names.push_back(cell);
                columns[cell];
            } else {
                columns[names[i]].push_back(cell);
            }
        }
    }
    return columns;
}

// At every tenth sample, as the files have them.
void expect_golden_trace(const std::vector<double>& found, const std::vector<std::string>& golden, double tolerance) {
    ASSERT_EQ(golden.size(), found.size() / 10 + 1);
    for (std::size_t i = 0; i < golden.size(); ++i) EXPECT_NEAR(found[10 * i], std::stod(golden[i]), tolerance) << i;
}

void expect_golden_events(const EventLog& found, const Columns& golden) {
    const auto& t = golden.at("t");
    ASSERT_EQ(found.size(), t.size());
    for (std::size_t i = 0; i < t.size(); ++i) {
        EXPECT_EQ(std::to_string(found[i].subject), golden.at("element")[i]) << t[i];
        EXPECT_EQ(name_of(static_cast<SlipState>(found[i].kind)), golden.at("kind")[i]) << t[i];
        EXPECT_NEAR(found[i].t, std::stod(t[i]), 1e-10); // a reversal slower than most: rounding of v over v'
    }
}

// Positions of 1 mm round to 1e-19 m, over a thousand samples and as many events; velocities and forces follow with
// the fastest rates of the friction, 200 1/s and 4e6 N/m.
constexpr double position_bound = 1e-15, velocity_bound = 200 * position_bound, force_bound = 4e6 * position_bound;

TEST(ExactGolden, open_loop_runs_are_those_of_the_golden_files) {
    for (const auto& [name, amplitude, frequency] : {std::tuple{"g1", 15.0, 10.0}, {"g2", 30.0, 34.0}}) {
        const Columns golden = read_golden(std::string(name) + ".csv");
        const auto run =
            run_open_loop(bare_description(), problems::sampled_sine(amplitude, frequency, 5e-4, 1001), exact_solver);
        expect_golden_trace(run.trace.x, golden.at("x"), position_bound);
        expect_golden_trace(run.trace.v, golden.at("v"), velocity_bound);
        expect_golden_trace(run.trace.f, golden.at("f"), force_bound);
        expect_golden_events(run.events, read_golden(std::string(name) + "_events.csv"));
    }
}

TEST(ExactGolden, the_closed_loop_run_is_that_of_the_golden_file) {
    Json table = bare_description();
    table["current_loop_hz"] = 750.0;
    add_loop(table, {.kp = 2.05e4,
                     .ki = 1.8e5,
                     .kd = 653,
                     .input_delay = 5e-4,
                     .output_delay = 4.18e-4,
                     .encoder_resolution = 1e-7});
    const Columns golden = read_golden("loop.csv");
    const auto run =
        run_closed_loop(table, std::vector<double>(1001), problems::sampled_sine(15, 10, 5e-4, 1001), exact_solver);
    expect_golden_trace(run.trace.x, golden.at("x"), position_bound);
    expect_golden_trace(run.trace.v, golden.at("v"), velocity_bound);
    expect_golden_trace(run.trace.f, golden.at("f"), force_bound);
    expect_golden_trace(run.trace.y, golden.at("y"), 1e-20); // the same encoder steps
    expect_golden_trace(run.trace.u, golden.at("u"), 1e-11); // 100 N, kd/Ts = 1.3e6 N/m times roundings of 1e-19 m
    expect_golden_events(run.events, read_golden("loop_events.csv"));
}

// Coulomb level, elements, modes, lag and fractional delays at once.
TEST(ExactOracle, closed_loop_stick_slip_with_fractional_delays_is_that_of_the_oracle) {
    problems::ServoProblem table = problems::linear_motor_table();
    table.coulomb = 3;
    table.lag_hz = 750;
    const problems::LoopSettings loop{.kp = 2.5e3,
                                      .ki = 6e3,
                                      .kd = 218,
                                      .derivative_filter_hz = 300,
                                      .input_delay = 7.3e-4,
                                      .output_delay = 1.37e-3,
                                      .encoder_resolution = 1e-7};
    const auto excitation = problems::sampled_sine(20, 10, 5e-4, 1001);
    const auto reference = problems::sampled_sine(1e-4, 3, 5e-4, 1001);
    const auto solution = problems::solve_loop_exactly(table, loop, reference, excitation);
    Json machine = description_of(table);
    add_loop(machine, loop);
    const auto run = run_closed_loop(machine, reference, excitation, exact_solver);
    EXPECT_LT(largest_difference(run.trace.x, solution.x), position_bound);
    EXPECT_LT(largest_difference(run.trace.v, solution.v), velocity_bound);
    EXPECT_LT(largest_difference(run.trace.y, solution.y), 1e-20); // the same encoder steps
    EXPECT_LT(largest_time_difference(run.events, solution.events), 1e-10);
    long of_the_level = 0;
    for (const auto& event : run.events) of_the_level += event.subject == ServoPlant::coulomb_subject;
    EXPECT_GT(of_the_level, 10);
}

// ---- energy

// A servo system that keeps the books of its energy at every event and every sample instant, between which the motion
// is smooth, the thrust is held and every element either sticks or slips one way.
class Bookkeeper final : public HybridSystem {
  public:
    Bookkeeper(const MachineModel& machine, Drive drive) : machine_(machine), servo_(machine, std::move(drive)) {}

    // The system is constant, its books are not.
    mutable long double work = 0;         // of the thrust [J]
    mutable long double slip_loss = 0;    // elements and Coulomb level in slip [J]
    mutable long double viscous_loss = 0; // all that goes with v^2 and q'^2 [J]

    // Kinetic energy, and what the springs of modes and elements hold.
    double stored(const SystemState& state) const {
        const auto& rolling = ServoSystem::values(state).plant.rolling;
        double rigid = state.x[1], sum = 0;
        for (std::size_t j = 0; j < machine_.modes.size(); ++j) {
            const auto& mode = machine_.modes[j];
            const double omega = 2 * std::numbers::pi * mode.freq_hz, q = state.x[2 + 2 * j], rate = state.x[3 + 2 * j];
            rigid -= rate;
            sum += (rate * rate + omega * omega * q * q) / (2 * mode.gain);
        }
        for (std::size_t i = 0; i < machine_.elements.size(); ++i) {
            const double travel = rolling.slip[i] == SlipState::stick ? state.x[0] - rolling.reference : 0;
            sum += machine_.elements[i].stiffness * std::pow(rolling.z[i] + travel, 2) / 2;
        }
        return sum + rigid * rigid / (2 * machine_.rigid_gain);
    }

    const std::vector<StateVariable>& states() const override { return servo_.states(); }
    const std::vector<SampleClock>& clocks() const override { return servo_.clocks(); }
    std::size_t guard_count() const override { return servo_.guard_count(); }
    SystemState initial_state() const override { return servo_.initial_state(); }
    void derivative(double t, std::span<const double> x, const DiscreteState& d,
                    std::span<double> dxdt) const override {
        servo_.derivative(t, x, d, dxdt);
    }
    void guards(double t, std::span<const double> x, const DiscreteState& d, std::span<double> g) const override {
        servo_.guards(t, x, d, g);
    }
    const PiecewiseAffine* piecewise_affine() const override { return servo_.piecewise_affine(); }
    EventEffect on_crossing(GuardId guard, SystemState& state, EventLog& log) const override {
        book(state);
        const EventEffect effect = servo_.on_crossing(guard, state, log);
        before_ = state;
        return effect;
    }
    EventEffect on_sample(ClockId clock, long k, SystemState& state) const override {
        book(state);
        const EventEffect effect = servo_.on_sample(clock, k, state);
        before_ = state;
        return effect;
    }
    std::string guard_name(GuardId guard, const SystemState& state) const override {
        return servo_.guard_name(guard, state);
    }

  private:
    // The time since the last entry.
    void book(const SystemState& now) const {
        if (!before_.discrete || now.t == before_.t) return;
        const auto& plant = ServoSystem::values(before_).plant;
        const double travel = now.x[0] - before_.x[0];
        work += static_cast<long double>(plant.input.coefficient[0]) * travel;
        for (std::size_t i = 0; i < machine_.elements.size(); ++i) {
            slip_loss += sign(plant.rolling.slip[i]) * machine_.elements[i].level * travel;
        }
        if (machine_.dry.present()) slip_loss += sign(plant.dry) * machine_.dry.coulomb * travel;
        if (has_viscous_loss()) viscous_loss += viscous_loss_until(now.t);
    }

    bool has_viscous_loss() const {
        const auto damped = [](const auto& element) { return element.damping > 0; };
        return machine_.viscous > 0 || std::any_of(machine_.elements.begin(), machine_.elements.end(), damped) ||
               std::any_of(machine_.modes.begin(), machine_.modes.end(), [](const auto& m) { return m.zeta > 0; });
    }

    // Gauss quadrature with five points, of order ten: on half a millisecond of at most 100 Hz, (2 pi 0.05)^10/10! = 1e-12
    // of a thousandth of the whole. The motion is integrated once more from the last entry, for its dense output.
    double viscous_loss_until(double t) const {
        constexpr std::array<std::pair<double, double>, 5> points = {std::pair{0.0, 128.0 / 225},
                                                                     {0.5384693101056831, 0.47862867049936647},
                                                                     {-0.5384693101056831, 0.47862867049936647},
                                                                     {0.906179845938664, 0.23692688505618908},
                                                                     {-0.906179845938664, 0.23692688505618908}};
        SystemState state = before_;
        const auto integrator = make_integrator(servo_, exact_solver);
        integrator->restart(state);
        integrator->step(t);
        const double half = (t - before_.t) / 2;
        double sum = 0;
        std::vector<double> x(state.x.size());
        for (const auto& [at, weight] : points) {
            integrator->interpolate(before_.t + half * (1 + at), x);
            sum += half * weight * viscous_power(x);
        }
        return sum;
    }

    double viscous_power(std::span<const double> x) const {
        double sum = (machine_.viscous + ServoSystem::values(before_).plant.rolling.damping) * x[1] * x[1];
        for (std::size_t j = 0; j < machine_.modes.size(); ++j) {
            const auto& mode = machine_.modes[j];
            sum += 4 * std::numbers::pi * mode.zeta * mode.freq_hz * x[3 + 2 * j] * x[3 + 2 * j] / mode.gain;
        }
        return sum;
    }

    const MachineModel machine_;
    const ServoSystem servo_;
    mutable SystemState before_; // after the last entry
};

// What is missing in the books, relative to the sizes of their entries.
double imbalance(const Json& description, double amplitude, double frequency_hz, double duration) {
    const MachineModel machine = machine_of(description);
    const Bookkeeper books(machine, OpenLoop{[=](long k) {
                               const double t = static_cast<double>(k) * 5e-4;
                               const double u = amplitude * std::sin(2 * std::numbers::pi * frequency_hz * t);
                               return std::array{u, 0., 0., 0.};
                           }});
    Simulator run(books, exact_solver);
    EXPECT_TRUE(run.advance_to(duration).ok());
    EXPECT_GT(run.events().size(), static_cast<std::size_t>(100 * duration)); // it does slip
    EXPECT_GT(books.slip_loss, 0.1 * books.work);
    const long double missing = books.work - books.stored(run.state()) - books.slip_loss - books.viscous_loss;
    return static_cast<double>(std::abs(missing) / books.work);
}

Json without_viscous_losses() {
    Json d = bare_description();
    d["friction"]["viscous"] = 0.0;
    d["friction"]["elements"].back()["D"] = 0.0;
    for (auto& mode : d["modes"]) mode["zeta"] = 0.0;
    return d;
}

// All terms in closed form, over a minute and a hundred thousand events.
TEST(ExactEnergy, work_is_motion_springs_and_slip_to_rounding_over_a_minute) {
    EXPECT_LT(imbalance(without_viscous_losses(), 30, 10, 60), 1e-12);
}

TEST(ExactEnergy, the_balance_holds_with_the_coulomb_level) {
    Json d = without_viscous_losses();
    d["friction"]["coulomb"] = 4.0;
    EXPECT_LT(imbalance(d, 30, 10, 20), 1e-12);
}

TEST(ExactEnergy, the_balance_holds_with_every_viscous_loss) {
    EXPECT_LT(imbalance(bare_description(), 30, 10, 3), 1e-12);
    Json d = bare_description();
    d["friction"]["coulomb"] = 4.0;
    EXPECT_LT(imbalance(d, 30, 10, 3), 1e-12);
}

// ---- random machines

class Dice {
  public:
    explicit Dice(unsigned seed) : engine_(seed) {}
    bool chance(double probability) { return uniform(0, 1) < probability; }
    double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine_); }
    double over_decades(double low, double high) { return std::exp(uniform(std::log(low), std::log(high))); }
    long whole(long low, long high) { return std::uniform_int_distribution<long>(low, high)(engine_); }

  private:
    std::mt19937_64 engine_;
};

struct RandomRun {
    Json machine;
    std::vector<double> u, reference; // u is the excitation where there is a controller
    bool closed_loop = false;
};

// Masses of 1 g to 100 t; forces that move them by about a tenth of a millimetre in a sample or two hundred.
RandomRun random_run(unsigned seed) {
    Dice dice(seed);
    const double mass = dice.over_decades(1e-3, 1e5), ts = 5e-4, force = mass * dice.over_decades(0.01, 100);
    Json d = {{"Ts", ts}, {"rigid_gain_per_kg", 1 / mass}, {"modes", Json::array()}};
    for (long j = dice.whole(-1, 3); j > 0; --j) {
        d["modes"].push_back({{"gain", dice.over_decades(1e-2, 1) / mass},
                              {"freq_hz", dice.over_decades(2, 500)},
                              {"zeta", dice.chance(0.3) ? 0.0 : dice.over_decades(1e-4, 1)}});
    }
    Json& friction = d["friction"];
    friction["viscous"] = dice.chance(0.4) ? 0.0 : mass * dice.over_decades(1e-3, 100);
    friction["coulomb"] = dice.chance(0.6) ? 0.0 : force * dice.over_decades(0.01, 2);
    friction["elements"] = Json::array();
    for (long i = dice.whole(-2, 12); i > 0; --i) {
        // From loose to 500 rad/s and, now and then, 1e9 N/m; some never slip.
        const double rate = dice.over_decades(0.1, 500);
        const double stiffness = dice.chance(0.03) && mass > 10 ? 1e9 : mass * rate * rate;
        Json element = {{"K", stiffness}, {"F", force * dice.over_decades(1e-3, dice.chance(0.1) ? 1e3 : 0.5)}};
        if (dice.chance(0.15)) element["D"] = mass * dice.over_decades(1e-2, 100);
        friction["elements"].push_back(element);
        if (dice.chance(0.1)) friction["elements"].push_back(element); // the same break point
    }
    if (dice.chance(0.3)) d["current_loop_hz"] = dice.over_decades(50, 1500);
    if (dice.chance(0.3)) d["input_delay_s"] = dice.uniform(0, 3) * ts;
    if (dice.chance(0.3)) d["output_delay_s"] = dice.uniform(0, 3) * ts;
    RandomRun run;
    const long samples = dice.whole(50, 120);
    run.closed_loop = dice.chance(0.25);
    if (run.closed_loop) {
        const double omega = dice.over_decades(5, 60);
        d["controller"] = {{"type", "pid"}, {"kp", mass * omega * omega}, {"kd", 1.4 * mass * omega}};
    }
    const double omega = dice.over_decades(20, 600);
    const long kind = dice.whole(0, 3);
    for (long k = 0; k < samples; ++k) {
        const double sine = std::sin(omega * static_cast<double>(k) * ts);
        const double shape = kind == 0 ? sine : kind == 1 ? (sine > 0 ? 1 : -1) : kind == 2 ? dice.uniform(-1, 1) : 0;
        // Kind 3: no motion for a while, then a step.
        run.u.push_back(force * (kind == 3 ? (k < samples / 2 ? 0 : 1) : shape));
        run.reference.push_back(0);
    }
    run.machine = d;
    return run;
}

Simulation simulated(const RandomRun& run, const SolverOptions& solver) {
    const MachineModel machine = machine_of(run.machine);
    DriveRecord record;
    record.t = instants(run.u.size());
    if (run.closed_loop) {
        record.reference = run.reference;
        record.excitation = run.u;
    } else {
        record.u = run.u;
    }
    return simulate(machine, record, {.solver = solver});
}

double largest(const std::vector<double>& values) {
    double most = 0;
    for (const double value : values) most = std::max(most, std::abs(value));
    return most;
}

TEST(ExactAgainstErk, they_agree_on_thousands_of_random_machines) {
    long moved = 0, slipped = 0, given_up = 0;
    for (unsigned seed = 1; seed <= 2000; ++seed) {
        const RandomRun run = random_run(seed);
        const Simulation exact = simulated(run, exact_solver);
        // Masses of all sizes go different ways: atol belongs to the size of the motion. That of a force is 1e6 N/m times
        // as large, and machines of a few grams move by forces of 1e-5 N.
        const double size = largest(exact.trace.x);
        const auto with = [&](double atol) {
            return simulated(run, {.method = Method::erk,
                                   .relative_tolerance = 1e-10,
                                   .absolute_tolerance = std::max(atol * size, 1e-24)});
        };
        Simulation erk = with(1e-13);
        if (!erk.outcome.ok()) erk = with(1e-10);
        ASSERT_TRUE(exact.outcome.ok()) << "seed " << seed << ": " << exact.outcome.message << run.machine;
        if (!erk.outcome.ok()) { // where 1e10 N/m and the like leave it no step
            ++given_up;
            continue;
        }
        moved += size > 0;
        slipped += !exact.events.empty();
        // A hundred samples of a few steps of 1e-10 each.
        EXPECT_LE(largest_difference(exact.trace.x, erk.trace.x), 3e-8 * size)
            << "seed " << seed << ", events " << exact.events.size() << " and " << erk.events.size() << ": "
            << run.machine;
    }
    EXPECT_GT(moved, 1700);
    EXPECT_GT(slipped, 1300);
    EXPECT_LE(given_up, 4);
}

// One effect that keeps a machine piecewise affine, of the size of its forces and motions.
void add_affine_effect(Dice& dice, RandomRun& run) {
    const double force = largest(run.u), size = dice.over_decades(1e-6, 1e-3);
    const auto add = [&](const char* name, const Json& parameters) {
        run.machine["effects"].push_back({{"name", name}, {"parameters", parameters}});
    };
    switch (dice.whole(0, 5)) {
    case 0: return add("spring_force", {{"k", force / size}, {"y0", dice.uniform(-1, 1) * size}});
    case 1: return add("constant_force", {{"F", 0.5 * force * dice.uniform(-1, 1)}});
    case 2: return add("dead_zone", {{"half_width", 0.5 * force * dice.uniform(0, 1)}});
    case 3: return add("thrust_saturation", {{"limit", force * dice.uniform(0.2, 1)}});
    case 4: return add("asymmetric_friction", {{"dF_pos", force * dice.over_decades(0.01, 1)}});
    default:
        run.machine["modes"] = Json::array();
        return add("backlash", {{"gap_m", size},
                                {"load_fraction", dice.uniform(0.2, 0.8)},
                                {"contact_hz", dice.over_decades(20, 300)},
                                {"contact_zeta", dice.over_decades(0.02, 0.5)},
                                {"sensor", dice.chance(0.5) ? "motor" : "load"}});
    }
}

TEST(ExactAgainstErk, they_agree_with_piecewise_affine_effects) {
    long slipped = 0, given_up = 0;
    for (unsigned seed = 1; seed <= 1000; ++seed) {
        Dice dice(seed + 10000);
        RandomRun run = random_run(seed);
        run.machine["effects"] = Json::array();
        add_affine_effect(dice, run);
        const Simulation exact = simulated(run, exact_solver);
        ASSERT_TRUE(exact.outcome.ok()) << "seed " << seed << ": " << exact.outcome.message << run.machine;
        const double size = largest(exact.trace.x);
        const Simulation erk = simulated(
            run,
            {.method = Method::erk, .relative_tolerance = 1e-10, .absolute_tolerance = std::max(1e-12 * size, 1e-24)});
        if (!erk.outcome.ok()) {
            ++given_up;
            continue;
        }
        slipped += !exact.events.empty();
        EXPECT_LE(largest_difference(exact.trace.x, erk.trace.x), 3e-8 * size)
            << "seed " << seed << ", events " << exact.events.size() << " and " << erk.events.size() << ": "
            << run.machine;
    }
    EXPECT_GT(slipped, 650);
    EXPECT_LE(given_up, 3);
}

// ---- collocation

// One effect that leaves a machine affine but for a smooth force. A ripple of many wells over the way would make the run
// chaotic: erk itself then goes elsewhere with each tolerance.
void add_smooth_effect(Dice& dice, RandomRun& run) {
    const double force = largest(run.u), size = dice.over_decades(2e-4, 1e-2);
    const double mass = 1 / run.machine["rigid_gain_per_kg"].get<double>();
    const auto add = [&](const char* name, const Json& parameters) {
        run.machine["effects"].push_back({{"name", name}, {"parameters", parameters}});
    };
    switch (dice.whole(0, 4)) {
    case 0:
        return add("force_ripple",
                   {{"harmonics",
                     {{{"F", 0.5 * force * dice.uniform(0, 1)}, {"period_m", size}, {"phase", dice.uniform(-3, 3)}}}}});
    case 1: return add("cubic_stiffness", {{"k3", force / (size * size * size)}, {"y0", 0.1 * size}});
    case 2: return add("quadratic_drag", {{"c", mass * dice.over_decades(0.1, 1000)}});
    case 3:
        return add("position_dependent_friction",
                   {{"mode", "sine"}, {"a", 0.5}, {"period_m", size}, {"phase", dice.uniform(-3, 3)}});
    default: return add("time_varying_friction", {{"kind", "sine"}, {"a", 0.5}, {"T", dice.over_decades(0.01, 10)}});
    }
}

TEST(CollocationAgainstErk, they_agree_on_random_machines_with_smooth_forces) {
    long slipped = 0, given_up = 0;
    for (unsigned seed = 1; seed <= 1000; ++seed) {
        Dice dice(seed + 20000);
        RandomRun run = random_run(seed);
        run.machine["effects"] = Json::array();
        add_smooth_effect(dice, run);
        const auto with = [&](Method method, double relative, double absolute) {
            return simulated(
                run,
                {.method = method, .relative_tolerance = relative, .absolute_tolerance = std::max(absolute, 1e-24)});
        };
        const double size = largest(with(Method::collocation, 1e-6, 1e-9).trace.x);
        const Simulation found = with(Method::collocation, 1e-9, 1e-11 * size),
                         erk = with(Method::erk, 1e-10, 1e-12 * size);
        ASSERT_TRUE(found.outcome.ok()) << "seed " << seed << ": " << found.outcome.message << run.machine;
        if (!erk.outcome.ok()) {
            ++given_up;
            continue;
        }
        slipped += !found.events.empty();
        EXPECT_LE(largest_difference(found.trace.x, erk.trace.x), 1e-6 * size)
            << "seed " << seed << ", events " << found.events.size() << " and " << erk.events.size() << ": "
            << run.machine;
    }
    EXPECT_GT(slipped, 650);
    EXPECT_LE(given_up, 3);
}

// The same machines by the road of the oracle, which takes longer: those of few elements in open loop.
TEST(ExactOracle, random_machines_are_those_of_the_oracle) {
    long compared = 0;
    for (unsigned seed = 1; seed <= 1000; ++seed) {
        const RandomRun run = random_run(seed);
        const Json& d = run.machine;
        if (run.closed_loop || d["friction"]["elements"].size() > 5) continue;
        problems::ServoProblem problem;
        problem.rigid_gain = d["rigid_gain_per_kg"];
        problem.viscous = d["friction"]["viscous"];
        problem.coulomb = d["friction"]["coulomb"];
        problem.lag_hz = d.value("current_loop_hz", 0.0);
        for (const auto& m : d["modes"]) problem.modes.push_back({m["gain"], m["freq_hz"], m["zeta"]});
        for (const auto& e : d["friction"]["elements"]) {
            problem.elements.push_back({e["K"], e["F"], e.value("D", 0.0)});
        }
        const auto oracle = problems::solve_exactly(problem, run.u, d.value("input_delay_s", 0.0));
        const Simulation exact = simulated(run, exact_solver);
        const double size = largest(oracle.x), difference = largest_difference(exact.trace.x, oracle.x);
        ++compared;
        // A hundred samples round to 1e-14.
        EXPECT_LE(difference, 1e-12 * size) << "seed " << seed << ": " << run.machine;
        // The oracle ends with the left limit of the last sample, before what its thrust does.
        EventLog events = exact.events;
        while (!events.empty() && events.back().t >= exact.trace.t.back()) events.pop_back();
        EXPECT_LT(largest_time_difference(events, oracle.events), 1e-9) << "seed " << seed; // v = 0, slowly
    }
    EXPECT_GT(compared, 300);
}

// ---- the same bytes

std::vector<double> table_run(const std::vector<double>& grid, long piece) {
    const MachineModel machine = machine_of(reference_description());
    const ServoSystem system(machine, ClosedLoop{[](long k) {
                                 return LoopInput{1e-4 * std::sin(0.01 * static_cast<double>(k)),
                                                  15 * std::sin(0.03 * static_cast<double>(k))};
                             }});
    Simulator run(system, exact_solver);
    ServoRecorder recorder(system);
    run.observe(&recorder);
    run.set_output_grid(grid);
    for (long k = piece; k <= 1200; k += piece) EXPECT_TRUE(run.advance_to(static_cast<double>(k) * 5e-4).ok());
    std::vector<double> all = recorder.trace().x;
    for (const Event& event : run.events()) all.push_back(event.t);
    return all;
}

TEST(ExactBytes, neither_the_output_grid_nor_pieces_of_a_run_change_them) {
    const auto whole = table_run({}, 1200);
    EXPECT_GT(whole.size(), 1300u);
    EXPECT_EQ(table_run({0.01, 0.01003, 0.0101, 0.3, 0.31, 0.59}, 1200), whole);
    EXPECT_EQ(table_run(instants(10000, 6e-5), 1200), whole);
    for (const long piece : {1L, 3L, 100L}) EXPECT_EQ(table_run({}, piece), whole) << piece;
}

TEST(ExactBytes, a_sweep_gives_the_same_on_any_number_of_workers) {
    SweepOptions options;
    options.frequency_hz = {20, 40, 60, 90, 120, 150};
    options.settle_time = 0.05;
    options.settle_time_limit = 0.2;
    options.measure_time = 0.05;
    options.solver = exact_solver;
    std::vector<std::vector<double>> found;
    for (const unsigned workers : {1u, 2u, 5u}) {
        RunControl control;
        control.workers = workers;
        const SweepResult result = run_sweep(machine_of(reference_description()), options, control);
        std::vector<double> numbers;
        for (const auto& point : result.points) {
            for (const auto& response : point.response) {
                numbers.push_back(response.real());
                numbers.push_back(response.imag());
            }
        }
        found.push_back(numbers);
    }
    ASSERT_EQ(found[0].size(), 6u * 2 * analysis_count);
    EXPECT_GT(std::abs(found[0][0]), 0);
    EXPECT_EQ(found[0], found[1]);
    EXPECT_EQ(found[0], found[2]);
}

// Elements that stick cost nothing in a step: of 20 and of 2000, the same few slip.
TEST(ExactWork, does_not_grow_with_the_number_of_elements_at_rest) {
    std::vector<RunStatistics> work;
    for (const int at_rest : {20, 2000}) {
        Json d = bare_description();
        // All together as stiff as one that never slips.
        for (int i = 0; i < at_rest; ++i) {
            d["friction"]["elements"].push_back({{"K", 2048.0 / at_rest}, {"F", 100.0}});
        }
        work.push_back(run_open_loop(d, problems::sampled_sine(15, 10, 5e-4, 2001), exact_solver).statistics);
    }
    EXPECT_GT(work[0].events, 100);
    // Rounding of the sum of their stiffnesses may move an event from one step to another, not more.
    EXPECT_NEAR(static_cast<double>(work[1].derivative_evaluations),
                static_cast<double>(work[0].derivative_evaluations),
                0.02 * static_cast<double>(work[0].derivative_evaluations));
    EXPECT_NEAR(static_cast<double>(work[1].guard_evaluations), static_cast<double>(work[0].guard_evaluations),
                0.02 * static_cast<double>(work[0].guard_evaluations));
    EXPECT_LT(static_cast<double>(work[1].derivative_evaluations), 2.0 * static_cast<double>(work[1].steps));
}

} // namespace
} // namespace tribode
