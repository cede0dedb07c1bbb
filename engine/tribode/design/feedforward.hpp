#pragma once
#include "tribode/analysis/modal_model.hpp"
#include "tribode/base/json.hpp"
#include "tribode/base/options.hpp"

#include <complex>
#include <string>
#include <vector>

namespace tribode {

// What a feedforward is asked for: the reference steps from 0 to `distance` at k = 0.
struct MoveTask {
    double sample_time = 5e-4; // Ts [s]
    double distance = 5e-4;    // [m]
    double duration = 0.05;    // until the end is reached [s]; rounded to whole samples
    double horizon = 0.3;      // for which the sequences are given [s], at least the duration

    std::size_t settling_sample() const;
    std::size_t length() const; // of the sequences, both ends of the horizon included
};

// The interface of all designs: two sequences, one value per sample. Thrust u_ff[k] is held from instant k to the next;
// r*[k] is where the position of the model should be at instant k, without the dead times of the loop. After the
// last sample both keep their last value.
struct Feedforward {
    std::string method;
    MoveTask task;
    std::vector<double> reference; // r*[k] [m]
    std::vector<double> thrust;    // u_ff[k] [N]

    // F_u(z) = (1 - z^-1) sum_k u_ff[k] z^-k / distance [N/m]: from the step of the reference to the thrust (Fig. 16).
    std::complex<double> thrust_response(double frequency_hz) const;
};

struct FeedforwardOptions {
    std::string method = "deadbeat"; // one of methods()
    MoveTask task;
    int smoothness = 1;        // deadbeat: order of the difference of u_ff of which the squares are least, 1 to 4
    std::string shaper = "zv"; // input_shaping: "zv" or "zvd"
    int shaped_modes = 0;      // input_shaping: how many, from the lowest; 0: all

    static const std::vector<std::string>& methods(); // deadbeat, zero_phase, s_curve, input_shaping

    static void describe(auto& o, auto& fields) {
        fields.choice("method", o.method, methods(), "[the design](feedforward.md)");
        fields.number("sample_time_s", o.task.sample_time, "s", Allowed::positive, "of the controller");
        fields.number("distance_m", o.task.distance, "m", Allowed::finite, "of the step; not zero");
        fields.number("duration_s", o.task.duration, "s", Allowed::positive, "of the move");
        fields.number("horizon_s", o.task.horizon, "s", Allowed::positive,
                      "length of the sequences, at least `duration_s` and at most 10⁶ samples");
        fields.integer("smoothness", o.smoothness, 1, 4,
                       "for `\"deadbeat\"`: the order of the difference of the thrust that is minimized");
        fields.choice("shaper", o.shaper, {"zv", "zvd"}, "for `\"input_shaping\"`");
        fields.integer("shaped_modes", o.shaped_modes, 0, 20,
                       "for `\"input_shaping\"`: the number of modes, from the lowest; 0: all");
    }
    void check(const FieldReader& fields) const;
};

// Throws InputError where the model or the duration does not allow the design.
Feedforward design_feedforward(const ModalModel& model, const FeedforwardOptions& options);

// As a table { method, sample_time_s, distance_m, duration_s, horizon_s, reference_m = {...}, thrust_N = {...} }; reading
// it back, horizon_s follows from the lists. Throws InputError where the lists are empty or not equally long.
Json to_json(const Feedforward& feedforward);
Feedforward feedforward_from_json(const Json& json, const std::string& where);

} // namespace tribode
