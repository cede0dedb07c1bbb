#pragma once
#include <vector>

namespace tribode::problems {

// A servo machine with a rigid body, vibration modes, Maxwell-slip friction, viscous friction and a Coulomb
// level, solved exactly between its events. A reference for tests: it shares no code with the engine.
//
//     y = x0 + sum q_j,   x0'' = k0 e,   q_j'' + 2 zeta_j w_j q_j' + w_j^2 q_j = k_j e,   e = thrust - f
//     f = sum_i (K_i z_i + D_i dz_i/dt) + D_v v + Coulomb force,   v = dy/dt
//     dz_i/dt = v in stick; z_i rests at +-F_i/K_i in slip, until v reverses
//     Coulomb: level * sgn(v); at v = 0 whatever holds the table, up to the level
//
// D_i acts in stick only, so f_i jumps where an element with D_i begins to slip; z_i is bounded, f_i is not.
struct ServoProblem {
    struct Mode {
        double gain;    // k_j [m/(N s^2)]
        double freq_hz; // f_j [Hz]
        double zeta;    // damping ratio
    };
    struct Element {
        double K;       // stiffness [N/m]
        double F;       // limit of |K z| [N], half the swing
        double D = 0.0; // damping in stick [N s/m]
    };

    double rigid_gain = 0.0; // k0 [m/(N s^2)]; may be zero where there is a mode
    std::vector<Mode> modes = {};
    std::vector<Element> elements = {};
    double viscous = 0.0;        // D_v [N s/m]
    double coulomb = 0.0;        // level of the set-valued friction [N]
    double lag_hz = 0.0;         // corner frequency of the thrust's first-order lag [Hz]; 0: none
    double sample_time = 0.0005; // T_s [s]
};

// The linear-motor-driven table: two modes and twenty elements whose F are half of the printed swings.
ServoProblem linear_motor_table();

enum class EventKind { slip_forward, slip_backward, stick };

// A change of an element's slip state. A reversal gives one stick per element that slipped; where it leads
// straight through the Coulomb level, element 0 has a stick and a slip at the same time.
struct ServoEvent {
    double t;    // [s]
    int element; // counted from 1 in the problem's order; 0 is the Coulomb level
    EventKind kind;
};

// Values at the sample instants k T_s (left limits) and the events in time order.
struct ServoSolution {
    std::vector<double> t, x, v, f; // [s], [m], [m/s], [N]: position y, velocity, friction force
    std::vector<ServoEvent> events;
};

// Open loop from rest: u[k] [N] acts from k T_s + input_delay until the next one. Sample instants 0 ..
// u.size()-1.
//
// Accuracy: 64-bit significands, events to T_s 2^-44 (3e-17 s at 500 us). Two reversals of the velocity less
// than T_s/64 apart are not seen. Runs up to 2^18 samples. Throws std::invalid_argument on a problem that
// makes no sense.
ServoSolution solve_exactly(const ServoProblem& problem, const std::vector<double>& u, double input_delay = 0.0);

// The loop around the machine. With e = r - y, T = T_s, a = exp(-2 pi derivative_filter_hz T):
//     I += ki T e;   d = a d + (1 - a)(e - e_prev)/T;   u = kp e + I + kd d + exc
// y[k] is the position at k T_s - output_delay, rounded to the encoder's resolution (halves upwards); u[k]
// acts from k T_s + input_delay. All states are zero at the start; no anti-windup.
struct LoopSettings {
    double kp = 0.0;                   // [N/m]
    double ki = 0.0;                   // [N/(m s)]
    double kd = 0.0;                   // [N s/m]
    double derivative_filter_hz = 0.0; // [Hz]; 0: none, a = 0
    double input_delay = 0.0;          // [s], any fraction of T_s, also more than one
    double output_delay = 0.0;         // [s], as above
    double encoder_resolution = 0.0;   // [m]; 0: not rounded
};

struct LoopSolution {
    std::vector<double> t, r, u, y, x, v, f; // y: detected position; the others as above
    std::vector<ServoEvent> events;
};

// Closed loop from rest; r [m] and exc [N] have one entry per sample instant.
LoopSolution solve_loop_exactly(const ServoProblem& problem, const LoopSettings& loop, const std::vector<double>& r,
                                const std::vector<double>& exc);

} // namespace tribode::problems
