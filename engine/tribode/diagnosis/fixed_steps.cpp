#include "tribode/diagnosis/fixed_steps.hpp"
#include "tribode/base/error.hpp"
#include "tribode/system/input_delays.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tribode {

namespace {

// Instants that are closer are one, in sample periods: what is measured at an instant is measured with the input of that
// instant, which acts from there on.
constexpr double same_instant = 1e-7;

constexpr std::size_t most_delays = 6;

double value_of(const std::array<double, 4>& piece, double s) {
    return piece[0] + s * (piece[1] + s * (piece[2] + s * piece[3]));
}

} // namespace

std::optional<FixedSteps> FixedSteps::of(const SystemModel& model) {
    const auto& given = model.equations;
    const bool has_more =
        !given.discrete.empty() || !given.whens.empty() || !given.clocks.empty() || !given.contacts.empty() ||
        !given.sensitivities.empty() ||
        std::any_of(given.states.begin(), given.states.end(), [](const auto& state) { return state.is_algebraic(); });
    if (has_more) return std::nullopt;
    Equations equations = deep_copy(given);
    std::vector<DelayedInput> delays;
    try {
        delays = take_out_delays(equations, false);
    } catch (const InputError&) {
        return std::nullopt;
    }
    if (equations.states.empty() && !delays.empty()) return std::nullopt; // rows need not be instants
    if (delays.size() > most_delays) return std::nullopt;
    FixedSteps made;
    std::vector<Term> variables, constants, rates, outputs, seconds;
    for (const auto& state : equations.states) {
        variables.push_back(state.symbol);
        rates.push_back(state.rate);
        made.starts_.push_back(state.start);
    }
    variables.push_back(equations.time);
    for (const auto& input : equations.inputs) variables.push_back(input.symbol);
    for (const auto& delayed : delays) {
        const auto input = std::find_if(equations.inputs.begin(), equations.inputs.end(),
                                        [&](const auto& one) { return one.symbol == delayed.input; });
        made.delayed_.push_back(static_cast<std::size_t>(input - equations.inputs.begin()));
        variables.push_back(delayed.symbol);
        seconds.push_back(delayed.seconds);
    }
    for (const auto& parameter : equations.parameters) {
        constants.push_back(parameter.symbol);
        made.parameters_.push_back(parameter.value);
    }
    for (const std::size_t output : model.measured) outputs.push_back(equations.outputs[output].value);
    for (const auto& parameter : model.parameters) made.moved_parameters_.push_back(parameter.place);
    made.moved_starts_ = model.starts;
    made.input_count_ = equations.inputs.size();
    made.output_count_ = outputs.size();
    for (const auto& input : equations.inputs) made.own_inputs_.push_back(input.value);
    const std::size_t states = equations.states.size();
    const Tape::Parts parts = {states, variables.size() - states, constants.size()};
    variables.insert(variables.end(), constants.begin(), constants.end());
    const auto& graph = *equations.graph;
    made.rates_ = Tape(graph, variables, rates, parts);
    made.outputs_ = Tape(graph, variables, outputs, parts);
    made.delays_ = Tape(graph, variables, seconds, parts);
    return made;
}

FixedSteps::Course FixedSteps::course(const SystemRecord& record, std::size_t samples, Interpolation between) const {
    Course c{.begin = record.t.front(), .samples = std::min(samples, record.size())};
    for (std::size_t i = 0; i < input_count_; ++i) {
        const bool has_column = i < record.inputs.size() && !record.inputs[i].empty();
        if (!has_column) {
            c.inputs.push_back({{own_inputs_[i], 0, 0, 0}});
        } else if (is_static()) {
            c.inputs.push_back(input_samples(record.inputs[i], 1, 0, Interpolation::hold).pieces);
        } else {
            c.inputs.push_back(input_of(record, i, between).pieces);
        }
    }
    if (is_static()) {
        for (std::size_t k = 0; k < c.samples; ++k) c.intervals.push_back({record.t[k], 0, k, true});
        return c;
    }
    c.period = median_step(record.t);
    c.holds = between == Interpolation::hold;
    const double near = same_instant * c.period;
    const auto grid = [&](std::size_t k) { return c.begin + static_cast<double>(k) * c.period; };
    std::size_t piece = 0, sample = 0;
    double next_grid = grid(0);
    while (sample < c.samples) {
        const double at = record.t[sample] + near; // of the next output
        if (next_grid <= at) {
            // An output at this instant or right behind it takes the new piece.
            const bool is_sample = at - next_grid <= 2 * near;
            c.intervals.push_back({next_grid, 0, piece, is_sample});
            if (is_sample) ++sample;
            next_grid = grid(++piece);
        } else {
            c.intervals.push_back({record.t[sample], 0, piece > 0 ? piece - 1 : 0, true});
            ++sample;
        }
    }
    for (std::size_t i = 0; i + 1 < c.intervals.size(); ++i) {
        c.intervals[i].length = c.intervals[i + 1].start - c.intervals[i].start;
    }
    return c;
}

template <std::size_t lanes>
void FixedSteps::run(const Course& course, std::span<const std::vector<double>> sets, std::size_t substeps,
                     std::vector<double>& all) const {
    const std::size_t n = starts_.size(), given = 1 + input_count_ + delayed_.size();
    std::vector<double> x(n * lanes), stage(n * lanes), slopes(4 * n * lanes), u(given * lanes),
        p(std::max<std::size_t>(parameters_.size(), 1) * lanes), y(output_count_ * lanes),
        delay(delayed_.size() * lanes);
    // A lane that has no set of its own does what the first one does.
    const auto own = [&](std::size_t l) -> const std::vector<double>& { return sets[l < sets.size() ? l : 0]; };
    for (std::size_t l = 0; l < lanes; ++l) {
        for (std::size_t i = 0; i < parameters_.size(); ++i) p[i * lanes + l] = parameters_[i];
        for (std::size_t i = 0; i < n; ++i) x[i * lanes + l] = starts_[i];
        for (std::size_t i = 0; i < moved_parameters_.size(); ++i) p[moved_parameters_[i] * lanes + l] = own(l)[i];
        for (std::size_t i = 0; i < moved_starts_.size(); ++i) {
            x[moved_starts_[i] * lanes + l] = own(l)[moved_parameters_.size() + i];
        }
    }
    if (!delayed_.empty()) delays_.evaluate_lanes<lanes>({x.data(), u.data(), p.data()}, delay.data());

    // The inputs at the time of each lane. `behind`: of each delayed one the piece that it is in.
    const auto piece_of = [&](std::size_t input, double place) -> const std::array<double, 4>& {
        const auto& pieces = course.inputs[input];
        return pieces[std::min(static_cast<std::size_t>(std::max(place, 0.0)), pieces.size() - 1)];
    };
    double t[lanes];
    const auto set_time = [&](std::size_t piece, const std::vector<double>& behind) {
        for (std::size_t l = 0; l < lanes; ++l) u[l] = t[l];
        const double start = course.begin + static_cast<double>(piece) * course.period;
        for (std::size_t i = 0; i < input_count_; ++i) {
            const auto& pieces = course.inputs[i];
            const auto& now = pieces[std::min(piece, pieces.size() - 1)];
            for (std::size_t l = 0; l < lanes; ++l) {
                u[(1 + i) * lanes + l] = value_of(now, (t[l] - start) / course.period);
            }
        }
        for (std::size_t d = 0; d < delayed_.size(); ++d) {
            for (std::size_t l = 0; l < lanes; ++l) {
                const double place = behind[d * lanes + l];
                const double s = (t[l] - delay[d * lanes + l] - course.begin) / course.period - place;
                u[(1 + input_count_ + d) * lanes + l] =
                    place < 0 ? course.inputs[delayed_[d]].front()[0] : value_of(piece_of(delayed_[d], place), s);
            }
        }
    };
    std::vector<double> behind(delayed_.size() * lanes), cut((delayed_.size() + 2) * lanes);
    const auto find_pieces = [&](const double* at) {
        for (std::size_t d = 0; d < delayed_.size(); ++d) {
            for (std::size_t l = 0; l < lanes; ++l) {
                behind[d * lanes + l] =
                    std::floor((at[l] - delay[d * lanes + l] - course.begin) / course.period + same_instant);
            }
        }
    };
    std::size_t sample = 0;
    for (const auto& interval : course.intervals) {
        std::fill_n(t, lanes, interval.start);
        if (interval.is_sample) {
            find_pieces(t);
            set_time(interval.piece, behind);
            outputs_.evaluate_lanes<lanes>({x.data(), u.data(), p.data()}, y.data());
            for (std::size_t l = 0; l < sets.size(); ++l) {
                for (std::size_t o = 0; o < output_count_; ++o) {
                    all[(l * output_count_ + o) * course.samples + sample] = y[o * lanes + l];
                }
            }
            ++sample;
        }
        if (!(interval.length > 0)) continue;
        // Where a delayed input changes within the interval, steps end too: in each lane somewhere else.
        const std::size_t parts = delayed_.size() + 1;
        for (std::size_t l = 0; l < lanes; ++l) {
            double stops[most_delays + 2];
            stops[0] = interval.start;
            for (std::size_t d = 0; d < delayed_.size(); ++d) {
                const double since = course.begin + delay[d * lanes + l];
                const double change = since + std::ceil((interval.start - since) / course.period) * course.period;
                const double stop = std::clamp(change, interval.start, interval.start + interval.length);
                std::size_t place = d + 1;
                for (; stops[place - 1] > stop; --place) stops[place] = stops[place - 1];
                stops[place] = stop;
            }
            stops[parts] = interval.start + interval.length;
            for (std::size_t i = 0; i <= parts; ++i) cut[i * lanes + l] = stops[i];
        }
        const auto steps = static_cast<std::size_t>(
            std::max(1.0, std::ceil(static_cast<double>(substeps) * interval.length / course.period - 1e-9)));
        for (std::size_t part = 0; part < parts; ++part) {
            const double *from = &cut[part * lanes], *to = &cut[(part + 1) * lanes];
            double h[lanes], middle[lanes], start[lanes], first[lanes], last[lanes];
            for (std::size_t l = 0; l < lanes; ++l) {
                h[l] = (to[l] - from[l]) / static_cast<double>(steps);
                middle[l] = 0.5 * (from[l] + to[l]);
                start[l] = from[l];
                // What jumps where a delayed input begins has the value of this part at both of its ends.
                first[l] = std::min(from[l] + same_instant * course.period, middle[l]);
                last[l] = std::max(to[l] - same_instant * course.period, middle[l]);
            }
            find_pieces(middle);
            for (std::size_t step = 0; step < steps; ++step) {
                const auto slope = [&](double share, std::size_t of, const double* where) {
                    for (std::size_t l = 0; l < lanes; ++l) {
                        t[l] = std::clamp(start[l] + (static_cast<double>(step) + share) * h[l], first[l], last[l]);
                    }
                    if (course.holds && (step > 0 || of > 0)) { // the inputs are those of the step's start
                        std::copy_n(t, lanes, u.begin());
                    } else if (of != 2) { // which is at the same time as the one before it
                        set_time(interval.piece, behind);
                    }
                    rates_.evaluate_lanes<lanes>({where, u.data(), p.data()}, &slopes[of * n * lanes]);
                };
                const auto move = [&](double share, std::size_t of) {
                    for (std::size_t i = 0; i < n; ++i) {
                        for (std::size_t l = 0; l < lanes; ++l) {
                            stage[i * lanes + l] = x[i * lanes + l] + share * h[l] * slopes[(of * n + i) * lanes + l];
                        }
                    }
                };
                slope(0, 0, x.data());
                move(0.5, 0);
                slope(0.5, 1, stage.data());
                move(0.5, 1);
                slope(0.5, 2, stage.data());
                move(1, 2);
                slope(1, 3, stage.data());
                for (std::size_t i = 0; i < n; ++i) {
                    for (std::size_t l = 0; l < lanes; ++l) {
                        const auto of = [&](std::size_t s) { return slopes[(s * n + i) * lanes + l]; };
                        x[i * lanes + l] += h[l] / 6 * (of(0) + 2 * (of(1) + of(2)) + of(3));
                    }
                }
            }
        }
    }
}

std::vector<double> FixedSteps::outputs(const Course& course, std::span<const std::vector<double>> sets,
                                        std::size_t substeps) const {
    std::vector<double> all(sets.size() * output_count_ * course.samples, std::numeric_limits<double>::quiet_NaN());
    if (sets.size() == 1) {
        run<1>(course, sets, substeps, all);
    } else if (sets.size() <= 4) {
        run<4>(course, sets, substeps, all);
    } else {
        run<8>(course, sets, substeps, all);
    }
    return all;
}

} // namespace tribode
