#include "tribode/diagnosis/fixed_steps.hpp"
#include "tribode/base/aligned_vector.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/lanes.hpp"
#include "tribode/system/contacts.hpp"
#include "tribode/system/input_delays.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

namespace tribode {

namespace {

// Instants that are closer are one, in sample periods: what is measured at an instant is measured with the input of that
// instant, which acts from there on.
constexpr double same_instant = 1e-7;

constexpr std::size_t most_delays = 6;
constexpr std::size_t most_lanes = 8;
constexpr double as_long = 0.9; // of the longest of some runs side by side, for another one to be among them

using Piece = std::array<double, 4>; // a cubic over a sample

double value_of(const Piece& piece, double s) { return piece[0] + s * (piece[1] + s * (piece[2] + s * piece[3])); }

} // namespace

std::optional<FixedSteps> FixedSteps::of(const SystemModel& model) {
    const auto& given = model.equations;
    const bool has_more =
        given.discrete.size() > given.contacts.size() || given.contacts.size() > 1 || !given.whens.empty() ||
        !given.clocks.empty() || !given.sensitivities.empty() ||
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
    std::vector<Term> variables, constants, rates, outputs, seconds, holding;
    std::size_t velocity = 0;
    if (!equations.contacts.empty()) {
        const auto contact = equations.contacts.front();
        const auto state = std::ranges::find(equations.states, contact.quantity, &Equations::State::symbol);
        if (contact.law != Equations::Contact::Law::friction || state == equations.states.end()) return std::nullopt;
        velocity = static_cast<std::size_t>(state - equations.states.begin());
        // As outputs they become terms of the states.
        for (const Term term : {contact.force, contact.release}) equations.outputs.push_back({{}, {}, term});
        try {
            close_contacts(equations);
        } catch (const InputError&) {
            return std::nullopt;
        }
        holding = {equations.outputs[equations.outputs.size() - 2].value, equations.outputs.back().value};
    }
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
    if (!given.contacts.empty()) variables.push_back(given.contacts.front().mode);
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
    for (const auto& one : model.beginnings) {
        if (std::ranges::find(model.starts, one.state) == model.starts.end()) made.beginnings_.push_back(one);
    }
    std::vector<Term> at_rest;
    for (const auto& one : made.beginnings_) at_rest.push_back(one.at_rest);
    made.at_rest_ = Tape(graph, variables, at_rest, parts);
    if (!holding.empty()) made.friction_ = Friction{velocity, Tape(graph, variables, holding, parts)};
    return made;
}

FixedSteps::Course FixedSteps::course(const SystemRecord& record, std::size_t used, Interpolation between,
                                      std::size_t n) const {
    used = std::min(used, record.size());
    Course c{.begin = record.t.front(), .samples = (used + n - 1) / n};
    for (const auto& one : beginnings_) {
        c.measured_first.push_back(one.measured ? record.first_measured(*one.measured) : std::nullopt);
    }
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
        for (std::size_t k = 0; k < c.samples; ++k) c.intervals.push_back({record.t[k * n], 0, k * n, true});
        return c;
    }
    c.period = sample_time(record.t);
    c.holds = between == Interpolation::hold && n * record.every == 1;
    const double near = same_instant * c.period;
    if (n * record.every > 1) { // the pieces are not the inputs at the samples
        for (std::size_t i = 0; i < c.inputs.size(); ++i) {
            auto& pieces = c.inputs[i];
            auto& values = c.at_samples.emplace_back();
            for (std::size_t k = 0; k < used; k += n) {
                if (record.every > 1 && pieces.size() > 1) {
                    values.push_back(record.inputs[i][k]);
                    continue;
                }
                const double place = (record.t[k] - c.begin) / c.period, piece = std::floor(place + same_instant);
                const auto last = static_cast<double>(pieces.size() - 1);
                values.push_back(value_of(pieces[static_cast<std::size_t>(std::clamp(piece, 0.0, last))],
                                          pieces.size() == 1 ? 0 : std::clamp(place - piece, 0.0, 1.0)));
            }
            if (n > 1 && pieces.size() > 1) pieces = straightened(pieces, n);
        }
        c.period *= static_cast<double>(n);
    }
    const auto grid = [&](std::size_t k) { return c.begin + static_cast<double>(k) * c.period; };
    std::size_t piece = 0, sample = 0;
    double next_grid = grid(0);
    while (sample < c.samples) {
        const double at = record.t[sample * n] + near; // of the next output
        if (next_grid <= at) {
            // An output at this instant or right behind it takes the new piece.
            const bool is_sample = at - next_grid <= 2 * near;
            c.intervals.push_back({next_grid, 0, piece, is_sample});
            if (is_sample) ++sample;
            next_grid = grid(++piece);
        } else {
            c.intervals.push_back({record.t[sample * n], 0, piece > 0 ? piece - 1 : 0, true});
            ++sample;
        }
    }
    for (std::size_t i = 0; i + 1 < c.intervals.size(); ++i) {
        c.intervals[i].length = c.intervals[i + 1].start - c.intervals[i].start;
    }
    return c;
}

bool FixedSteps::Course::begins_as(const Course& other) const {
    const double near = same_instant * period;
    if (intervals.size() < other.intervals.size() || holds != other.holds ||
        at_samples.empty() != other.at_samples.empty() || !(std::abs(period - other.period) < near)) {
        return false;
    }
    return std::equal(other.intervals.begin(), other.intervals.end(), intervals.begin(),
                      [&](const Interval& a, const Interval& b) {
                          return a.piece == b.piece && a.is_sample == b.is_sample &&
                                 std::abs((a.start - other.begin) - (b.start - begin)) < near;
                      });
}

// Up to so many runs side by side, the first of which is the longest: its intervals are those of all. A number of each is beside that
// of the others: place i * lanes + lane.
template <std::size_t lanes>
class FixedSteps::Run {
  public:
    Run(const FixedSteps& model, Simulations simulations)
        : m_(model),
          course_(*simulations.front().course),
          n_(m_.starts_.size()),
          mode_(1 + m_.input_count_ + m_.delayed_.size()),
          x_(n_ * lanes),
          stage_(n_ * lanes),
          slopes_(4 * n_ * lanes),
          u_((mode_ + 1) * lanes),
          p_(std::max<std::size_t>(m_.parameters_.size(), 1) * lanes),
          y_(m_.output_count_ * lanes),
          delay_(m_.delayed_.size() * lanes),
          behind_(m_.delayed_.size() * lanes),
          runs_(simulations.size()) {
        // A lane that has no run of its own does what the first one does.
        const auto run = [&](std::size_t l) { return simulations[l < runs_ ? l : 0]; };
        const auto own = [&](std::size_t l) -> const std::vector<double>& { return *run(l).values; };
        for (std::size_t l = 0; l < lanes; ++l) {
            courses_[l] = run(l).course;
            later_[l] = courses_[l]->begin - course_.begin;
            has_one_course_ = has_one_course_ && courses_[l] == &course_;
            for (std::size_t i = 0; i < m_.parameters_.size(); ++i) p_[i * lanes + l] = m_.parameters_[i];
            for (std::size_t i = 0; i < n_; ++i) x_[i * lanes + l] = m_.starts_[i];
            for (std::size_t i = 0; i < m_.moved_parameters_.size(); ++i) {
                p_[m_.moved_parameters_[i] * lanes + l] = own(l)[i];
            }
            for (std::size_t i = 0; i < m_.moved_starts_.size(); ++i) {
                x_[m_.moved_starts_[i] * lanes + l] = own(l)[m_.moved_parameters_.size() + i];
            }
        }
        rates_.emplace(m_.rates_, p_.data());
        outputs_.emplace(m_.outputs_, p_.data());
        if (m_.friction_) holding_.emplace(m_.friction_->holding, p_.data());
        if (!m_.delayed_.empty())
            Tape::SideBySide<lanes>(m_.delays_, p_.data()).evaluate(x_.data(), u_.data(), delay_.data());
        if (!m_.beginnings_.empty()) begin();
    }

    void over(std::size_t substeps, Outputs all) {
        std::size_t sample = 0;
        const bool is_together = m_.delayed_.empty() && !m_.friction_;
        AlignedVector<double> cut((m_.delayed_.size() + 2) * lanes);
        for (const auto& interval : course_.intervals) {
            if (interval.is_sample) take_outputs(interval, sample++, all);
            if (!(interval.length > 0)) continue;
            const auto steps = static_cast<std::size_t>(
                std::max(1.0, std::ceil(static_cast<double>(substeps) * interval.length / course_.period - 1e-9)));
            if (is_together) {
                pass_together(interval, steps);
                continue;
            }
            // Where a delayed input changes within the interval, steps end too: in each lane somewhere else.
            const std::size_t parts = m_.delayed_.size() + 1;
            for (std::size_t l = 0; l < lanes; ++l) {
                double stops[most_delays + 2];
                stops[0] = interval.start;
                for (std::size_t d = 0; d < m_.delayed_.size(); ++d) {
                    const double since = course_.begin + delay_[d * lanes + l];
                    const double change = since + std::ceil((interval.start - since) / course_.period) * course_.period;
                    const double stop = std::clamp(change, interval.start, interval.start + interval.length);
                    std::size_t place = d + 1;
                    for (; stops[place - 1] > stop; --place) stops[place] = stops[place - 1];
                    stops[place] = stop;
                }
                stops[parts] = interval.start + interval.length;
                for (std::size_t i = 0; i <= parts; ++i) cut[i * lanes + l] = stops[i];
            }
            for (std::size_t part = 0; part < parts; ++part) {
                pass(interval.piece, &cut[part * lanes], &cut[(part + 1) * lanes], steps);
            }
        }
    }

  private:
    using Each = std::array<double, lanes>;

    // States whose start values follow from the records. One may follow another one before it.
    void begin() {
        set_inputs_of(course_.intervals.front(), 0);
        Tape::SideBySide<lanes> at_rest(m_.at_rest_, p_.data());
        AlignedVector<double> values(m_.beginnings_.size() * lanes);
        for (std::size_t b = 0; b < m_.beginnings_.size(); ++b) {
            at_rest.evaluate(x_.data(), u_.data(), values.data());
            for (std::size_t l = 0; l < lanes; ++l) {
                x_[m_.beginnings_[b].state * lanes + l] =
                    courses_[l]->measured_first[b].value_or(values[b * lanes + l]);
            }
        }
    }

    void set_inputs_of(const Course::Interval& interval, std::size_t sample) {
        if (m_.delayed_.empty()) {
            set_inputs(interval.piece, interval.start);
        } else {
            Each t;
            t.fill(interval.start);
            find_pieces(t);
            set_inputs(interval.piece, t);
        }
        for (std::size_t i = 0; i < course_.at_samples.size(); ++i) {
            for (std::size_t l = 0; l < lanes; ++l) {
                const auto& values = courses_[l]->at_samples[i];
                u_[(1 + i) * lanes + l] = values[std::min(sample, values.size() - 1)];
            }
        }
    }

    void take_outputs(const Course::Interval& interval, std::size_t sample, Outputs all) {
        set_inputs_of(interval, sample);
        if (m_.friction_) find_modes();
        outputs_->evaluate(x_.data(), u_.data(), y_.data());
        for (std::size_t l = 0; l < runs_; ++l) {
            const std::size_t samples = courses_[l]->samples;
            for (std::size_t o = 0; sample < samples && o < m_.output_count_; ++o) {
                all[l][o * samples + sample] = y_[o * lanes + l];
            }
        }
    }

    // Of each delayed input the piece that it is in at these instants.
    void find_pieces(const Each& t) {
        for (std::size_t d = 0; d < m_.delayed_.size(); ++d) {
            for (std::size_t l = 0; l < lanes; ++l) {
                behind_[d * lanes + l] =
                    std::floor((t[l] - delay_[d * lanes + l] - course_.begin) / course_.period + same_instant);
            }
        }
    }

    const Piece& piece_of(std::size_t l, std::size_t input, double place) const {
        const auto& pieces = courses_[l]->inputs[input];
        return pieces[std::min(static_cast<std::size_t>(std::max(place, 0.0)), pieces.size() - 1)];
    }

    double start_of(std::size_t piece) const { return course_.begin + static_cast<double>(piece) * course_.period; }

    // Instants are those of the first run's course; others began later.
    void set_time(double t) {
        for (std::size_t l = 0; l < lanes; ++l) u_[l] = t + later_[l];
    }
    void set_time(const Each& t) {
        for (std::size_t l = 0; l < lanes; ++l) u_[l] = t[l] + later_[l];
    }

    // Of all lanes, at one instant, without delays.
    void set_inputs(std::size_t piece, double t) {
        set_time(t);
        const double share = (t - start_of(piece)) / course_.period, place = static_cast<double>(piece);
        for (std::size_t i = 0; i < m_.input_count_; ++i) {
            if (has_one_course_) {
                std::fill_n(&u_[(1 + i) * lanes], lanes, value_of(piece_of(0, i, place), share));
                continue;
            }
            for (std::size_t l = 0; l < lanes; ++l) u_[(1 + i) * lanes + l] = value_of(piece_of(l, i, place), share);
        }
    }

    void set_inputs(std::size_t piece, const Each& t) {
        set_time(t);
        const double start = start_of(piece), at = static_cast<double>(piece);
        for (std::size_t i = 0; i < m_.input_count_; ++i) {
            for (std::size_t l = 0; l < lanes; ++l) {
                u_[(1 + i) * lanes + l] = value_of(piece_of(l, i, at), (t[l] - start) / course_.period);
            }
        }
        for (std::size_t d = 0; d < m_.delayed_.size(); ++d) {
            const std::size_t input = m_.delayed_[d];
            for (std::size_t l = 0; l < lanes; ++l) {
                const double place = behind_[d * lanes + l];
                const double s = (t[l] - delay_[d * lanes + l] - course_.begin) / course_.period - place;
                u_[(1 + m_.input_count_ + d) * lanes + l] =
                    place < 0 ? courses_[l]->inputs[input].front()[0] : value_of(piece_of(l, input, place), s);
            }
        }
    }

    // All lanes from the start of an interval to its end.
    void pass_together(const Course::Interval& interval, std::size_t steps) {
        piece_ = interval.piece;
        const double end = interval.start + interval.length, middle = 0.5 * (interval.start + end);
        first_.fill(std::min(interval.start + same_instant * course_.period, middle));
        last_.fill(std::max(end - same_instant * course_.period, middle));
        are_inputs_set_ = false;
        const double length = (end - interval.start) / static_cast<double>(steps);
        for (std::size_t step = 0; step < steps; ++step) {
            advance(interval.start + static_cast<double>(step) * length, length);
        }
    }

    // From one instant of each lane to another, between which no input jumps.
    void pass(std::size_t piece, const double* from, const double* to, std::size_t steps) {
        piece_ = piece;
        Each middle, length;
        for (std::size_t l = 0; l < lanes; ++l) {
            length[l] = (to[l] - from[l]) / static_cast<double>(steps);
            middle[l] = 0.5 * (from[l] + to[l]);
            // What jumps where a delayed input begins has the value of this part at both of its ends.
            first_[l] = std::min(from[l] + same_instant * course_.period, middle[l]);
            last_[l] = std::max(to[l] - same_instant * course_.period, middle[l]);
        }
        find_pieces(middle);
        are_inputs_set_ = false;
        look_anew_ = true;
        for (std::size_t step = 0; step < steps; ++step) {
            Each start;
            for (std::size_t l = 0; l < lanes; ++l) start[l] = from[l] + static_cast<double>(step) * length[l];
            if (m_.friction_) {
                stick_and_slip(start, length);
            } else {
                advance(start, length);
            }
        }
    }

    void go_to(const Each& start, const Each& length, double share) {
        Each t;
        for (std::size_t l = 0; l < lanes; ++l) t[l] = std::clamp(start[l] + share * length[l], first_[l], last_[l]);
        if (course_.holds && are_inputs_set_) { // the inputs are those of the part's start
            set_time(t);
        } else {
            set_inputs(piece_, t);
            are_inputs_set_ = true;
        }
    }

    void go_to(double start, double length, double share) {
        const double t = std::clamp(start + share * length, first_[0], last_[0]);
        if (course_.holds && are_inputs_set_) {
            set_time(t);
        } else {
            set_inputs(piece_, t);
            are_inputs_set_ = true;
        }
    }

    static double of_lane(const Each& values, std::size_t l) { return values[l]; }
    static double of_lane(double value, std::size_t) { return value; }

    // A step of each lane, or of all: Each or a number.
    template <class Time>
    void advance(const Time& start, const Time& length) {
        const auto slope = [&](std::size_t of, const double* where) {
            rates_->evaluate(where, u_.data(), &slopes_[of * n_ * lanes]);
        };
        const auto move = [&](double share, std::size_t of) {
            for (std::size_t i = 0; i < n_; ++i) {
                for (std::size_t l = 0; l < lanes; ++l) {
                    stage_[i * lanes + l] =
                        x_[i * lanes + l] + share * of_lane(length, l) * slopes_[(of * n_ + i) * lanes + l];
                }
            }
        };
        go_to(start, length, 0);
        slope(0, x_.data());
        move(0.5, 0);
        go_to(start, length, 0.5);
        slope(1, stage_.data());
        move(0.5, 1);
        slope(2, stage_.data());
        move(1, 2);
        go_to(start, length, 1);
        slope(3, stage_.data());
        for (std::size_t i = 0; i < n_; ++i) {
            for (std::size_t l = 0; l < lanes; ++l) {
                const auto of = [&](std::size_t s) { return slopes_[(s * n_ + i) * lanes + l]; };
                x_[i * lanes + l] += of_lane(length, l) / 6 * (of(0) + 2 * (of(1) + of(2)) + of(3));
            }
        }
    }

    // The mode of the friction: 0 where it holds, 1 and 2 where it slips forward and backward.
    double& mode(std::size_t l) { return u_[mode_ * lanes + l]; }
    double& velocity(std::size_t l) { return x_[m_.friction_->velocity * lanes + l]; }
    static double direction(double mode) { return mode == 1 ? 1 : -1; }

    // By how much the force that holds each lane exceeds the one at which it lets go, and to which mode.
    void find_holding() {
        std::array<double, 2 * lanes> force;
        holding_->evaluate(x_.data(), u_.data(), force.data());
        for (std::size_t l = 0; l < lanes; ++l) {
            excess_[l] = std::abs(force[l]) - force[lanes + l];
            lets_go_to_[l] = force[l] > 0 ? 1 : 2;
        }
    }

    // What slips or lets go with the inputs as they are now.
    void find_modes() {
        find_holding();
        for (std::size_t l = 0; l < lanes; ++l) {
            if (mode(l) != 0) continue;
            if (velocity(l) != 0) {
                mode(l) = velocity(l) > 0 ? 1 : 2;
            } else if (excess_[l] > 0) {
                mode(l) = lets_go_to_[l];
            }
        }
    }

    // A step of each lane, in pieces where it sticks or slips on the way.
    void stick_and_slip(Each start, Each left) {
        constexpr int most_changes = 6; // in a step; what changes more often is held to its end
        for (int change = 0;; ++change) {
            if (std::exchange(look_anew_, false)) {
                go_to(start, left, 0);
                find_modes();
            }
            const AlignedVector<double>& before = before_ = x_;
            const Each holding = excess_;
            std::array<bool, lanes> held;
            for (std::size_t l = 0; l < lanes; ++l) held[l] = mode(l) == 0;
            advance(start, left);
            if (std::ranges::any_of(held, std::identity())) find_holding();
            Each share;
            bool changes = false;
            for (std::size_t l = 0; l < lanes; ++l) {
                share[l] = 1;
                const double v = velocity(l);
                if (!(left[l] > 0) || (held[l] ? !(excess_[l] > 0) : !(direction(mode(l)) * v < 0))) continue;
                changes = true;
                if (held[l]) {
                    share[l] = std::clamp(holding[l] / (holding[l] - excess_[l]), 0.0, 1.0);
                } else {
                    const std::size_t place = m_.friction_->velocity * lanes + l;
                    share[l] =
                        crossing(before[place], v, left[l] * slopes_[place], left[l] * slopes_[3 * n_ * lanes + place]);
                }
            }
            if (!changes) return;
            Each length;
            for (std::size_t l = 0; l < lanes; ++l) {
                length[l] = 0;
                if (share[l] == 1) continue;
                for (std::size_t i = 0; i < n_; ++i) x_[i * lanes + l] = before[i * lanes + l];
                length[l] = share[l] * left[l];
            }
            advance(start, length);
            bool is_over = true;
            for (std::size_t l = 0; l < lanes; ++l) {
                const double passed = share[l] == 1 ? left[l] : length[l];
                start[l] += passed;
                left[l] -= passed;
                if (share[l] == 1) continue;
                if (held[l]) {
                    mode(l) = lets_go_to_[l];
                } else {
                    mode(l) = 0;
                    velocity(l) = 0;
                }
                is_over = is_over && !(left[l] > 0);
            }
            look_anew_ = true;
            if (is_over) return;
            if (change == most_changes) {
                advance(start, left);
                return;
            }
        }
    }

    // The share of a step at which a velocity is zero that begins and ends so, with these slopes by the share.
    static double crossing(double begin, double end, double slope, double last_slope) {
        const double bend = 3 * (end - begin) - 2 * slope - last_slope, twist = 2 * (begin - end) + slope + last_slope;
        double low = 0, high = 1, s = std::clamp(begin / (begin - end), 0.0, 1.0);
        for (int i = 0; i < 8; ++i) {
            const double v = begin + s * (slope + s * (bend + s * twist));
            ((v < 0) == (begin < 0) ? low : high) = s;
            const double by = slope + s * (2 * bend + 3 * s * twist), next = s - v / by;
            s = next >= low && next <= high ? next : 0.5 * (low + high); // a root that is found stays
        }
        return s;
    }

    const FixedSteps& m_;
    const Course& course_;
    std::array<const Course*, lanes> courses_;
    bool has_one_course_ = true;
    std::size_t n_, mode_; // states; place of the mode in u
    AlignedVector<double> x_, stage_, slopes_, u_, p_, y_, delay_, behind_, before_;
    std::optional<Tape::SideBySide<lanes>> rates_, outputs_, holding_;
    std::size_t runs_, piece_ = 0;
    Each later_, first_, last_, excess_, lets_go_to_;
    bool are_inputs_set_ = false, look_anew_ = true; // what holds is to be found
};

// With the widest registers that the processor has, as Tape::SideBySide.
[[gnu::flatten]] TRIBODE_CLONES void FixedSteps::run_four(Simulations simulations, std::size_t substeps,
                                                          Outputs all) const {
    Run<4>(*this, simulations).over(substeps, all);
}

[[gnu::flatten]] TRIBODE_CLONES void FixedSteps::run_eight(Simulations simulations, std::size_t substeps,
                                                           Outputs all) const {
    Run<8>(*this, simulations).over(substeps, all);
}

std::vector<std::vector<double>> FixedSteps::outputs(Simulations simulations, std::size_t substeps) const {
    std::vector<std::vector<double>> all;
    for (const auto& one : simulations) {
        all.emplace_back(output_count_ * one.course->samples, std::numeric_limits<double>::quiet_NaN());
    }
    for (std::size_t first = 0, count = 0; first < simulations.size(); first += count) {
        const Course& leader = *simulations[first].course;
        const auto least = as_long * static_cast<double>(leader.intervals.size());
        const auto goes_beside = [&](const Course& one) {
            return one.group == leader.group && one.intervals.size() <= leader.intervals.size() &&
                   static_cast<double>(one.intervals.size()) >= least;
        };
        const std::size_t most = std::min(most_lanes, simulations.size() - first);
        for (count = 1; count < most && goes_beside(*simulations[first + count].course);) ++count;
        const auto some = simulations.subspan(first, count);
        const auto into = std::span(all).subspan(first, count);
        if (count == 1) {
            Run<1>(*this, some).over(substeps, into);
        } else if (count <= 4) {
            run_four(some, substeps, into);
        } else {
            run_eight(some, substeps, into);
        }
    }
    return all;
}

} // namespace tribode
