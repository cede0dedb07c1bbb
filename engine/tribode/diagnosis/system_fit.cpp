#include "tribode/diagnosis/system_fit.hpp"
#include "tribode/base/error.hpp"
#include "tribode/diagnosis/fixed_steps.hpp"
#include "tribode/diagnosis/gap.hpp"
#include "tribode/diagnosis/lane_fit.hpp"
#include "tribode/diagnosis/lasting_errors.hpp"
#include "tribode/diagnosis/normal_equations.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"
#include "tribode/experiment/system_run.hpp"
#include "tribode/system/contacts.hpp"
#include "tribode/system/input_delays.hpp"
#include "tribode/system/sensitivities.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <set>

namespace tribode {

namespace {

// By how much a value moves for a difference quotient: until the outputs move by this share of their scale, rms. That is far
// above what the solver's errors add to a long run, and far below where equations bend. A value may move by so much of its
// own scale at most.
constexpr double visible = 1e-3, max_step = 10;
// The shortest beginning of the records that is fitted, and the samples of it for each value.
constexpr std::size_t max_growth = 64, samples_per_value = 10;
// Factors of the damping that are tried side by side.
constexpr std::array side_by_side = {1.0 / 25, 1.0 / 5, 1.0, 6.0, 36.0, 216.0, 1296.0, 7776.0};
constexpr int stiff_iterations = 2, iterations_of_halved = 3; // at least, in halved steps
constexpr int iterations_of_all = 3;                          // over all samples, after a fit over some
constexpr int iterations_of_all_in_search = 1;
constexpr double least_gain_of_part = 0.03;  // where more of the records will be fitted
constexpr double quick_gain = 0.5;           // what an iteration of a quick fit leaves of the squared errors
constexpr double most_bent = 0.375;          // of a step, for what corrects it
constexpr std::size_t most_bends = 4;        // of the trials
constexpr double as_good_a_step = 1.01;      // of the squared errors of the best
constexpr double near_known = 0.1;           // of the errors, between two ends of fits that are one
constexpr double differs_by_chance = 1.05;   // of the mean squared errors, over some samples
constexpr double rounding_of_records = 1e-5; // of the times, in samples
constexpr double nearly = 10;                // times what is negligible, left by the shortest steps
constexpr double agreed = 4;                 // times what is negligible: fixed steps and those of another solver
constexpr int most_generalized = 3;          // iterations from least squares to generalized ones
constexpr double far_less_than_chance = 0.1; // of chi square

void keep_within_limits(const SystemModel& model, std::vector<double>& values) {
    for (std::size_t i = 0; i < model.parameters.size(); ++i) {
        values[i] = std::clamp(values[i], model.parameters[i].low, model.parameters[i].high);
    }
}

// The derivatives of a start value that follows from others (SystemModel::Beginning) by the values of a record.
struct MovesOfBeginning {
    std::size_t state;
    std::vector<double> by; // parameters, then start values of the record
};

// Those of which some are not zero.
std::vector<MovesOfBeginning> moves_of_beginnings(const SystemModel& model, const std::vector<double>& values,
                                                  std::size_t r, const SystemRecord& record) {
    if (model.beginnings.empty()) return {};
    std::vector<MovesOfBeginning> all;
    for (const auto& one : model.beginnings) all.push_back({one.state, {}});
    const auto at = model.begun(values, r, record);
    const std::size_t count = model.parameters.size() + model.starts.size();
    for (std::size_t v = 0; v < count; ++v) {
        auto moved = values;
        double& value = moved[v < model.parameters.size() ? v : v + r * model.starts.size()];
        const double before = value;
        value += std::sqrt(std::numeric_limits<double>::epsilon()) * std::max(std::abs(value), 1e-3);
        const auto there = model.begun(moved, r, record);
        for (auto& one : all) {
            one.by.push_back((there.states[one.state].start - at.states[one.state].start) / (value - before));
        }
    }
    std::erase_if(all, [](const auto& one) { return std::ranges::all_of(one.by, [](double d) { return d == 0; }); });
    return all;
}

// Adds to the derivatives by each value those by what follows from it.
void add_chained(const std::vector<double>& by_value, const std::vector<std::vector<double>>& by_start,
                 std::vector<std::vector<std::vector<double>>>& all) {
    for (std::size_t v = 0; v < by_value.size(); ++v) {
        for (std::size_t o = 0; by_value[v] != 0 && o < by_start.size(); ++o) {
            for (std::size_t k = 0; k < by_start[o].size(); ++k) all[v][o][k] += by_value[v] * by_start[o][k];
        }
    }
}

} // namespace

Eigen::MatrixXd basis_of(Eigen::MatrixXd columns) {
    for (Eigen::Index c = 0; c < columns.cols(); ++c) {
        const double norm = columns.col(c).norm();
        if (norm > 0) columns.col(c) /= norm;
    }
    if (columns.cols() == 0) return columns;
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(columns);
    qr.setThreshold(1e-6);
    return qr.householderQ() * Eigen::MatrixXd::Identity(columns.rows(), qr.rank());
}

Eigen::MatrixXd inverse_of_normal(const Eigen::MatrixXd& columns) {
    Eigen::VectorXd norm = columns.colwise().norm();
    Eigen::MatrixXd normal = columns.transpose() * columns;
    for (Eigen::Index i = 0; i < normal.rows(); ++i) {
        for (Eigen::Index k = 0; k < normal.cols(); ++k) {
            const double scale = norm[i] * norm[k];
            normal(i, k) = scale > 0 ? normal(i, k) / scale : (i == k ? 1 : 0);
        }
    }
    const Eigen::VectorXd back = norm.unaryExpr([](double n) { return n > 0 ? 1 / n : 0; });
    return back.asDiagonal() * bounded_inverse(normal) * back.asDiagonal();
}

namespace {

// Without states and clocks nothing is between the rows: outputs follow from the inputs of each, at whatever instants.
std::vector<std::vector<double>> outputs_of_rows(Equations equations, const SystemRecord& record, std::size_t samples,
                                                 const std::vector<std::size_t>& measured) {
    std::vector<std::size_t> given; // inputs that have a column, which become discrete variables
    const std::size_t first = equations.discrete.size();
    const auto inputs = equations.inputs;
    for (std::size_t i = 0; i < inputs.size() && i < record.inputs.size(); ++i) {
        if (record.inputs[i].empty()) continue;
        given.push_back(i);
        std::erase_if(equations.inputs, [&](const auto& one) { return one.symbol == inputs[i].symbol; });
        equations.discrete.push_back({inputs[i].name, inputs[i].unit, inputs[i].value, inputs[i].symbol, {}});
    }
    close_contacts(equations);
    const EquationSystem system(std::move(equations));
    SystemState state = system.initial_state();
    std::vector<double> y(system.equations().outputs.size());
    std::vector<std::vector<double>> outputs(measured.size(), std::vector<double>(samples));
    for (std::size_t k = 0; k < samples; ++k) {
        state.t = record.t[k];
        const auto values = system.discrete_values(state);
        for (std::size_t n = 0; n < given.size(); ++n) values[first + n] = record.inputs[given[n]][k];
        system.outputs(state, y);
        for (std::size_t o = 0; o < measured.size(); ++o) outputs[o][k] = y[measured[o]];
    }
    return outputs;
}

bool all_finite(const std::vector<std::vector<double>>& lists) {
    return std::all_of(lists.begin(), lists.end(), [](const auto& values) {
        return std::all_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); });
    });
}

// Terms stand below no_event for the sake of fixed steps, which locate no events. A solver that controls its error cannot step
// over a jump, so one at an instant becomes an event.
void locate_jumps_in_time(Equations& equations) {
    const Expressions& graph = *equations.graph;
    std::set<Term> known = {equations.time};
    for (const auto& parameter : equations.parameters) known.insert(parameter.symbol);
    Expressions::Replacement events;
    for (Term term = 0; term < graph.size(); ++term) {
        if (graph[term].op != Op::no_event) continue;
        const Term choice = graph[term].a;
        if (graph[choice].op != Op::select || graph.is_continuous(choice)) continue;
        const auto variables = graph.variables_of(std::array{graph[choice].a});
        const bool is_known = std::ranges::all_of(variables, [&](Term variable) { return known.contains(variable); });
        if (is_known && std::ranges::find(variables, equations.time) != variables.end()) events[term] = choice;
    }
    equations.replace(events);
}

} // namespace

bool FoundMinimum::is_near(const std::vector<double>& others) const {
    const auto size = static_cast<Eigen::Index>(values.size());
    if (curvature.rows() != size || others.size() != values.size()) return false;
    const Eigen::VectorXd apart =
        Eigen::Map<const Eigen::VectorXd>(others.data(), size) - Eigen::Map<const Eigen::VectorXd>(values.data(), size);
    return apart.dot(curvature * apart) < near_known * near_known * sum;
}

SystemFit::SystemFit(const std::vector<SystemRecord>& records, std::vector<double> scale, Interpolation between,
                     std::vector<std::size_t> used)
    : records_(records),
      scale_(std::move(scale)),
      between_(between),
      used_(std::move(used)) {}

std::optional<SystemTrace> SystemFit::simulate(const SystemModel& model, const std::vector<double>& values,
                                               std::size_t r, std::size_t samples, std::string* problem) const {
    return run(model, values, r, samples, problem, nullptr, {});
}

std::optional<SystemTrace> SystemFit::run(const SystemModel& model, const std::vector<double>& values, std::size_t r,
                                          std::size_t samples, std::string* problem, Derivatives* derivatives,
                                          const Ended& ended) const {
    const auto failed = [&](const std::string& why) {
        if (problem) *problem = why;
        return std::nullopt;
    };
    const SystemRecord& record = records_[r];
    samples = std::min(samples, record.size());
    for (const double value : values) {
        if (!std::isfinite(value)) return failed("a value is not finite");
    }
    Equations equations = model.begun(values, r, record);
    try {
        if (equations.states.empty() && equations.clocks.empty() && equations.whens.empty() &&
            equations.contacts.empty()) {
            if (derivatives) return failed("there are no variational equations without states");
            SystemTrace trace{.outputs = outputs_of_rows(std::move(equations), record, samples, model.measured)};
            if (!all_finite(trace.outputs)) return failed("outputs are not finite");
            return trace;
        }
        std::vector<std::string> state_names, output_names;
        for (const auto& state : equations.states) state_names.push_back(state.name);
        for (const std::size_t output : model.measured) output_names.push_back(equations.outputs[output].name);
        const std::vector<double> instants(record.t.begin(), record.t.begin() + static_cast<std::ptrdiff_t>(samples));
        const double begin = record.t.front(), period = sample_time(record.t);
        // A clock of the system sees the input of its own instant, and what is measured at an instant is measured with both, which act
        // from there on. Times of a record are rounded.
        const double later = rounding_of_records * period;
        for (auto& clock : equations.clocks) clock.offset += later;
        const double after = equations.clocks.empty() ? 1e-7 * period : 2 * later;
        std::vector<std::string> by; // what the derivatives are by
        std::size_t own_values = 0;  // of these; then the start values that follow from them
        std::vector<MovesOfBeginning> begun;
        if (derivatives) {
            for (const auto& parameter : model.parameters) by.push_back(equations.parameters[parameter.place].name);
            for (const std::size_t state : model.starts) by.push_back(equations.states[state].name + ".start");
            own_values = by.size();
            begun = moves_of_beginnings(model, values, r, record);
            for (const auto& one : begun) by.push_back(equations.states[one.state].name + ".start");
            check_delays(equations, by);
        }
        const auto delays = take_out_delays(equations);
        const auto inputs = equations.inputs; // the list changes
        for (std::size_t i = 0; i < inputs.size(); ++i) {
            const bool is_given = i < record.inputs.size() && !record.inputs[i].empty();
            if (!is_given) {
                for (const auto& delayed : delays) {
                    if (delayed.input == inputs[i].symbol) equations.replace({{delayed.symbol, delayed.input}});
                }
                continue;
            }
            const auto place = std::find_if(equations.inputs.begin(), equations.inputs.end(),
                                            [&](const auto& one) { return one.symbol == inputs[i].symbol; });
            equations.inputs.erase(place);
            const InputSamples pieces = input_of(record, i, between_);
            connect_samples(equations, inputs[i], pieces, begin);
            for (const auto& delayed : delays) {
                if (delayed.input != inputs[i].symbol) continue;
                InputSamples late = pieces;
                late.offset = begin + delayed.delay;
                // What came before the record is not known: its first value.
                connect_samples(
                    equations,
                    {equations.graph->name(delayed.symbol), inputs[i].unit, record.inputs[i].front(), delayed.symbol},
                    std::move(late), begin);
            }
        }
        locate_jumps_in_time(equations);
        close_contacts(equations);
        if (derivatives) equations = with_sensitivities(std::move(equations), by);
        const EquationSystem system(std::move(equations));
        SystemRunOptions options;
        options.start = begin;
        options.end = instants.back() + 2 * after;
        options.output_times = instants;
        for (double& t : options.output_times) t += after;
        options.solver.relative_tolerance = 1e-9;
        options.solver.absolute_tolerance = 1e-11;
        // Values far off make equations that take millions of steps; none that is near a measurement does.
        options.solver.max_steps = 2'000 + 25 * static_cast<long>(samples);
        const SystemRun run = run_system(system, options, {.late = ended});
        if (!run.outcome.ok()) return failed(run.outcome.message);
        for (std::size_t v = 0; derivatives && v < by.size(); ++v) {
            auto& columns = derivatives->emplace_back();
            for (const auto& name : output_names) {
                columns.push_back(run.sensitivities[v].table[name].values);
                if (columns.back().size() < samples) return failed("the run ended early");
                columns.back().resize(samples);
            }
            if (!all_finite(columns)) return failed("derivatives are not finite");
        }
        if (derivatives) {
            for (std::size_t b = 0; b < begun.size(); ++b)
                add_chained(begun[b].by, (*derivatives)[own_values + b], *derivatives);
            derivatives->resize(own_values);
        }
        SystemTrace trace;
        const auto take = [&](const std::vector<std::string>& names, std::vector<std::vector<double>>& into) {
            for (const auto& name : names) {
                into.push_back(run.table[name].values);
                if (into.back().size() < samples) return false;
                into.back().resize(samples);
            }
            return all_finite(into);
        };
        if (!take(output_names, trace.outputs) || !take(state_names, trace.states)) {
            return failed("outputs or states are not finite");
        }
        return trace;
    } catch (const InputError& error) {
        return failed(error.what()); // values at which the equations have no solution
    }
}

double SystemFit::noise() const {
    double sum = 0, count = 0;
    for (const auto& record : records_) {
        for (std::size_t o = 0; o < record.outputs.size(); ++o, ++count) {
            std::vector<double> measured = record.outputs[o];
            std::erase_if(measured, [](double y) { return std::isnan(y); });
            const double own = std::max(white_noise(measured), rounding_noise(measured)) / scale_[o];
            const double noise = std::max(own, solvers_errors);
            sum += noise * noise;
        }
    }
    return std::sqrt(sum / std::max(count, 1.0));
}

double SystemFit::noise_in(const std::vector<double>& errors) const {
    double noise = 0;
    auto e = errors.begin();
    for (std::size_t r = 0; r < records_.size(); ++r) {
        for (std::size_t o = 0; o < scale_.size(); ++o) {
            std::vector<double> measured(records_[r].outputs[o].begin(),
                                         records_[r].outputs[o].begin() + static_cast<std::ptrdiff_t>(used_[r]));
            std::erase_if(measured, [](double y) { return std::isnan(y); }); // has no error
            const std::vector<double> left(e, e + static_cast<std::ptrdiff_t>(measured.size()));
            e += static_cast<std::ptrdiff_t>(measured.size());
            const double own =
                std::max({white_noise(left), rounding_noise(measured, left) / scale_[o], solvers_errors});
            noise += own * own * static_cast<double>(measured.size());
        }
    }
    return std::sqrt(noise / static_cast<double>(std::max<std::size_t>(errors.size(), 1)));
}

std::vector<double> SystemFit::errors(const SystemModel& model, const std::vector<double>& values) const {
    const auto lanes = LaneFit::of(*this, model, values, substeps_);
    if (lanes) return lanes->errors({values})[0];
    return fixed_steps_only_ ? std::vector<double>() : errors_by_runs(model, values, {});
}

std::vector<double> SystemFit::errors_by_runs(const SystemModel& model, const std::vector<double>& values,
                                              const Ended& ended) const {
    std::vector<double> all;
    for (std::size_t r = 0; r < records_.size(); ++r) {
        if (!append_errors(model, values, r, all, ended)) return {};
    }
    return all;
}

bool SystemFit::append_errors(const SystemModel& model, const std::vector<double>& values, std::size_t r,
                              std::vector<double>& all, const Ended& ended) const {
    if (used_[r] == 0) return true;
    const auto trace = run(model, values, r, used_[r], nullptr, nullptr, ended);
    if (!trace) return false;
    for (std::size_t o = 0; o < trace->outputs.size(); ++o) {
        for (std::size_t k = 0; k < used_[r]; ++k) {
            const double measured = records_[r].outputs[o][k];
            if (!std::isnan(measured)) all.push_back((measured - trace->outputs[o][k]) / scale_[o]);
        }
    }
    return true;
}

double SystemFit::sum_of_squares(const std::vector<double>& errors) {
    if (errors.empty()) return std::numeric_limits<double>::infinity();
    double sum = 0;
    for (const double e : errors) sum += e * e;
    return std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
}

std::vector<std::size_t> SystemFit::rows_before() const {
    std::vector<std::size_t> rows(1, 0);
    for (std::size_t r = 0; r < records_.size(); ++r) rows.push_back(rows.back() + records_[r].measured(used_[r]));
    return rows;
}

std::optional<Eigen::MatrixXd> SystemFit::exact_jacobian(const SystemModel& model, const std::vector<double>& values,
                                                         const std::vector<double>& errors, const Ended& ended) const {
    const auto first_row = rows_before();
    Eigen::MatrixXd matrix =
        Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(errors.size()), static_cast<Eigen::Index>(values.size()));
    for (std::size_t r = 0; r < records_.size(); ++r) {
        if (used_[r] == 0) continue;
        Derivatives derivatives;
        if (!run(model, values, r, used_[r], nullptr, &derivatives, ended)) return std::nullopt;
        for (std::size_t v = 0; v < derivatives.size(); ++v) {
            const std::size_t place = v < model.parameters.size() ? v : v + r * model.starts.size(); // of all values
            std::size_t row = first_row[r];
            for (std::size_t o = 0; o < scale_.size(); ++o) {
                for (std::size_t k = 0; k < used_[r]; ++k) {
                    if (std::isnan(records_[r].outputs[o][k])) continue;
                    matrix(static_cast<Eigen::Index>(row++), static_cast<Eigen::Index>(place)) =
                        derivatives[v][o][k] / scale_[o];
                }
            }
        }
    }
    return matrix;
}

Eigen::MatrixXd SystemFit::jacobian(const SystemModel& model, const std::vector<double>& values,
                                    const std::vector<double>& errors) const {
    // The errors may be those of another solver: from what steps of one length make of the same values they differ by more than a small
    // move changes.
    if (const auto lanes = LaneFit::of(*this, model, values, substeps_)) {
        const auto own = lanes->errors({values})[0];
        // Steps whose length is given may run away from values that a solver follows.
        if (!own.empty()) return lanes->jacobian(values, own);
    }
    return jacobian_by_runs(model, values, errors, nullptr, {});
}

// `steps`: by how much each value moves for a difference; the next call begins with them.
Eigen::MatrixXd SystemFit::jacobian_by_runs(const SystemModel& model, const std::vector<double>& values,
                                            const std::vector<double>& errors, std::vector<double>* steps,
                                            const Ended& ended) const {
    if (auto exact = exact_jacobian(model, values, errors, ended)) return *std::move(exact);
    const auto rows = static_cast<Eigen::Index>(errors.size());
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(rows, static_cast<Eigen::Index>(values.size()));
    std::vector<double> moved = values, own_steps;
    if (!steps) steps = &own_steps;
    steps->resize(values.size(), 0);
    const auto first_row = rows_before();
    for (std::size_t i = 0; i < values.size(); ++i) {
        // A start value concerns one record only.
        std::size_t first = 0, end = records_.size();
        if (i >= model.parameters.size()) {
            first = (i - model.parameters.size()) / model.starts.size();
            end = first + 1;
        }
        double scale = std::abs(values[i]), low = -std::numeric_limits<double>::infinity(), high = -low;
        if (i < model.parameters.size()) {
            scale = std::max(scale, model.parameters[i].scale);
            low = model.parameters[i].low;
            high = model.parameters[i].high;
        } else {
            const auto& state =
                model.equations.states[model.starts[(i - model.parameters.size()) % model.starts.size()]];
            scale = std::max({scale, std::abs(state.start), 1e-3 * state.nominal});
        }
        if (!(scale > 0)) scale = 1;
        double& step = (*steps)[i];
        if (!(step > 0)) step = 1e-5 * scale;
        bool back = false; // towards smaller values
        for (int attempt = 0; attempt < 4; ++attempt) {
            double move = back ? -step : step;
            if (values[i] + move > high || values[i] + move < low) move = -move;
            if (values[i] + move > high || values[i] + move < low)
                move = high - values[i] > values[i] - low ? high - values[i] : low - values[i];
            if (move == 0) break;
            moved[i] = values[i] + move;
            std::vector<double> other;
            bool runs = true;
            for (std::size_t r = first; r < end && runs; ++r) runs = append_errors(model, moved, r, other, ended);
            moved[i] = values[i];
            if (!runs) {
                if (back) step *= 0.01;
                back = !back;
                continue;
            }
            double squares = 0;
            for (std::size_t k = 0; k < other.size(); ++k) {
                const std::size_t row = first_row[first] + k;
                const double difference = errors[row] - other[k];
                squares += difference * difference;
                matrix(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(i)) = difference / move;
            }
            const double change = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(other.size(), 1)));
            if (change > 0.1 * visible && change < 10 * visible) break;
            const double next =
                std::min(step * (change > 0 ? std::clamp(visible / change, 1e-4, 1e3) : 1e3), max_step * scale);
            if (next == step || (next > step && std::abs(move) < step)) break; // as far as it may move
            step = next;
        }
    }
    return matrix;
}

SystemFit::Result SystemFit::fit(const SystemModel& model, std::vector<double> start, int iterations,
                                 const Ended& ended) const {
    keep_within_limits(model, start);
    auto lanes = LaneFit::of(*this, model, start, substeps_);
    Result result{.values = start};
    if (fixed_steps_only_ && !lanes) return result;
    if (lanes && substeps_ > 0) lanes->lengthen(start);
    if (lanes && iterations > 1) {
        // Most of the way over fewer samples, where steps of their length do. From there the noise of all samples moves the values
        // a little.
        if (LaneFit coarse = *lanes; coarse.thin_out(start)) {
            Result there = descend(model, start, 2 * iterations, ended, &coarse);
            if (there.gave_up) return there;
            const auto before = lanes->errors({start, there.values});
            if (sum_of_squares(before[1]) < sum_of_squares(before[0])) {
                result.values = there.values;
                iterations = std::min(iterations, is_search_ ? iterations_of_all_in_search : iterations_of_all);
            }
        }
    }
    while (lanes && result.iterations < iterations) {
        const int before = result.iterations;
        result = descend(model, std::move(result.values), iterations - before, ended, &*lanes);
        result.iterations += before;
        if (result.gave_up) return result;
        if (result.errors.empty()) break;
        if (is_search_) {
            result.substeps = lanes->substeps();
            if (lanes->are_short_enough(result.values, result.errors)) return result;
            if (!lanes->halve(result.values)) {
                // Equations with a kink want short steps although they are not stiff.
                if (lanes->are_short_enough(result.values, result.errors, nearly)) return result;
                break;
            }
            iterations = std::max(iterations, result.iterations + iterations_of_halved);
            continue;
        }
        // What steps of one length make of the values that were found is compared with steps of the length that they need.
        auto errors = errors_by_runs(model, result.values, {});
        double sum = 0;
        for (std::size_t k = 0; k < errors.size(); ++k) {
            sum += (errors[k] - result.errors[k]) * (errors[k] - result.errors[k]);
        }
        const double off = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(errors.size(), 1)));
        if (!errors.empty() && off < agreed * lanes->negligible(errors)) {
            result.errors = std::move(errors);
            result.sum = sum_of_squares(result.errors);
            return result;
        }
        if (errors.empty() || !lanes->halve(result.values)) break;
    }
    if (fixed_steps_only_) return {.values = std::move(start)};
    // What fixed steps cannot follow is stiff or runs away. A run takes long then, and what lies near a measurement is rarely so.
    if (FixedSteps::of(model.with(start))) iterations = std::min(iterations, stiff_iterations);
    return descend(model, std::move(start), iterations, ended, nullptr);
}

SystemFit::Result SystemFit::descend(const SystemModel& model, std::vector<double> start, int iterations,
                                     const Ended& ended, const LaneFit* lanes) const {
    Result result{.values = std::move(start)};
    // What is not of a search needs them, however late.
    result.errors =
        lanes ? lanes->errors({result.values})[0] : errors_by_runs(model, result.values, is_search_ ? ended : Ended());
    result.sum = sum_of_squares(result.errors);
    if (result.errors.empty() || result.values.empty()) return result;
    double damping = 1e-3;
    std::vector<double> steps;
    std::vector<Eigen::Index> ends; // of the records, among the errors
    for (const std::size_t end : rows_before()) ends.push_back(static_cast<Eigen::Index>(end));
    ends.erase(ends.begin());
    for (; result.iterations < iterations && !ended(); ++result.iterations) {
        if (found_ && result.iterations > 0 && found_->is_near(result.values)) {
            result.gave_up = true;
            break;
        }
        Eigen::MatrixXd j = lanes ? lanes->jacobian(result.values, result.errors)
                                  : jacobian_by_runs(model, result.values, result.errors, &steps, ended);
        // Values may be of any unit: each column has norm one, and what keeps the matrix regular is a share of each.
        Eigen::VectorXd norm = j.colwise().norm();
        for (Eigen::Index i = 0; i < norm.size(); ++i) {
            if (!(norm[i] > 0)) norm[i] = 1; // a value that the errors do not depend on stays
            j.col(i) /= norm[i];
        }
        const Eigen::Map<const Eigen::VectorXd> e(result.errors.data(), j.rows());
        const NormalEquations normal(j, static_cast<Eigen::Index>(model.parameters.size()), ends);
        const Eigen::VectorXd gradient = normal.product(e);
        if (is_search_ && lanes) result.curvature = norm.asDiagonal() * normal.matrix() * norm.asDiagonal();
        const auto damped_solution = [&](double with_damping, const Eigen::VectorXd& right) {
            return normal.damped_solution(with_damping + 1e-12, right);
        };
        const auto moved_by = [&](const Eigen::VectorXd& step) { // step: over the norms
            std::vector<double> next = result.values;
            for (std::size_t i = 0; i < next.size(); ++i) {
                const auto place = static_cast<Eigen::Index>(i);
                next[i] += step[place] / norm[place];
            }
            keep_within_limits(model, next);
            return next;
        };
        const auto moved = [&](double with_damping) { return moved_by(damped_solution(with_damping, gradient)); };
        const double before = result.sum;
        struct Tried {
            std::vector<double> values, errors;
            double damping, sum;
        };
        const auto take = [&](Tried& one) {
            result.values = std::move(one.values);
            result.errors = std::move(one.errors);
            result.sum = one.sum;
        };
        bool improved = false;
        if (lanes) {
            // Several dampings side by side cost no more than one.
            for (int attempt = 0; attempt < 2 && !improved && !ended(); ++attempt) {
                std::vector<std::vector<double>> sets;
                std::vector<double> dampings;
                for (const double factor : side_by_side) {
                    dampings.push_back(std::max(damping * factor, 1e-9));
                    sets.push_back(moved(dampings.back()));
                }
                const auto errors = lanes->errors(sets);
                std::vector<Tried> tried;
                for (std::size_t l = 0; l < sets.size(); ++l)
                    tried.push_back({sets[l], errors[l], dampings[l], sum_of_squares(errors[l])});
                const bool is_slow = std::ranges::min_element(tried, {}, &Tried::sum)->sum > quick_gain * before;
                if (is_slow) {
                    // As along a bent valley. How far the errors are bent along each step says how the step has to bend
                    // [Transtrum 2012].
                    std::vector<std::vector<double>> bent;
                    std::vector<double> bent_dampings;
                    Eigen::MatrixXd off(j.rows(), static_cast<Eigen::Index>(sets.size())); // from the errors here
                    off.setZero();
                    for (std::size_t l = 0; l < sets.size(); ++l) {
                        if (errors[l].empty()) continue;
                        off.col(static_cast<Eigen::Index>(l)) =
                            Eigen::Map<const Eigen::VectorXd>(errors[l].data(), j.rows()) - e;
                    }
                    const Eigen::MatrixXd products = normal.product(off);
                    // Of long steps first: those leave the valley, and gain most from being bent.
                    for (std::size_t l = 0; l < sets.size() && bent.size() < most_bends; ++l) {
                        if (errors[l].empty()) continue;
                        Eigen::VectorXd step(norm.size());
                        for (Eigen::Index i = 0; i < step.size(); ++i) {
                            const auto place = static_cast<std::size_t>(i);
                            step[i] = (sets[l][place] - result.values[place]) * norm[i];
                        }
                        const Eigen::VectorXd right = products.col(static_cast<Eigen::Index>(l)) + normal.times(step);
                        const Eigen::VectorXd bend = damped_solution(dampings[l], right);
                        if (!(bend.norm() < most_bent * step.norm())) continue;
                        bent.push_back(moved_by(step + bend));
                        bent_dampings.push_back(dampings[l]);
                    }
                    auto further = lanes->errors(bent);
                    for (std::size_t l = 0; l < bent.size(); ++l) {
                        const double sum = sum_of_squares(further[l]);
                        tried.push_back({std::move(bent[l]), std::move(further[l]), bent_dampings[l], sum});
                    }
                }
                // Where it is quick, the shortest step of those that gain nearly as much as the best: what the records hardly tell
                // stays where it is.
                const double least = std::ranges::min_element(tried, {}, &Tried::sum)->sum;
                improved = least < before;
                if (improved) {
                    const double enough = is_slow ? least : as_good_a_step * least;
                    std::erase_if(tried, [&](const Tried& one) { return !(one.sum <= enough); });
                    auto& shortest = *std::ranges::max_element(tried, {}, &Tried::damping);
                    damping = shortest.damping;
                    take(shortest);
                } else {
                    damping = std::max(damping, 1e-6) * side_by_side.back() * 6;
                }
            }
        } else {
            for (int attempt = 0; attempt < 10 && !improved && !ended(); ++attempt) {
                Tried next{moved(damping), {}, damping, 0};
                next.errors = errors_by_runs(model, next.values, ended);
                next.sum = sum_of_squares(next.errors);
                improved = next.sum < before;
                if (improved) take(next);
                damping = improved ? std::max(damping / 5, 1e-9) : std::max(damping * 6, 1e-6);
            }
        }
        const bool goes_on = improved && before - result.sum >= least_gain_ * before;
        if (found_ && !is_part_) {
            // Were each iteration that is left to gain what this one did.
            const double least =
                goes_on ? result.sum * std::pow(result.sum / before, iterations - 1 - result.iterations) : result.sum;
            const auto mean = [](double sum, std::size_t errors) { return sum / static_cast<double>(errors); };
            const double some = result.errors.size() == found_->errors ? 1 : differs_by_chance;
            result.gave_up = mean(least, result.errors.size()) > some * mean(found_->sum, found_->errors);
        }
        if (!goes_on || result.gave_up) break;
    }
    return result;
}

SystemFit::Result SystemFit::fit_growing(const SystemModel& model, std::vector<double> start, int iterations,
                                         const Ended& ended) const {
    std::vector<std::size_t> shares; // of the records, each twice as long as the one before
    for (std::size_t share = 2; share <= max_growth; share *= 2) {
        std::size_t samples = 0;
        for (const std::size_t used : used_) samples += used / share;
        if (samples < samples_per_value * std::max<std::size_t>(1, start.size())) break;
        shares.insert(shares.begin(), share);
    }
    for (const std::size_t share : shares) {
        SystemFit part = *this;
        part.is_part_ = true;
        part.least_gain_ = least_gain_of_part;
        for (std::size_t& used : part.used_) used = used > 0 ? std::max<std::size_t>(2, used / share) : 0;
        Result there = part.fit(model, std::move(start), iterations / 2, ended);
        if (there.gave_up) return there;
        start = std::move(there.values);
    }
    return fit(model, std::move(start), iterations, ended);
}

Eigen::MatrixXd SystemFit::covariance(const SystemModel& model, const std::vector<double>& values,
                                      const std::vector<double>& errors, double noise) const {
    return inverse_of_normal(jacobian(model, values, errors)) * (noise * noise);
}

std::vector<OutputErrors> SystemFit::by_output(const std::vector<double>& errors, const Eigen::MatrixXd& slopes) const {
    std::vector<OutputErrors> outputs(scale_.size());
    std::vector<std::vector<Eigen::Index>> places(scale_.size()); // of the errors of each
    Eigen::Index row = 0;
    for (std::size_t r = 0; r < records_.size(); ++r) {
        for (std::size_t o = 0; o < scale_.size(); ++o) {
            const auto& measured = records_[r].outputs[o];
            const std::size_t before = places[o].size();
            for (std::size_t k = 0; k < used_[r]; ++k) {
                if (!std::isnan(measured[k])) places[o].push_back(row++);
            }
            outputs[o].rows.push_back(places[o].size() - before);
        }
    }
    const Eigen::Map<const Eigen::VectorXd> all(errors.data(), row);
    for (std::size_t o = 0; o < scale_.size(); ++o) {
        outputs[o].errors = all(places[o]);
        if (slopes.rows() > 0) outputs[o].slopes = slopes(places[o], Eigen::all);
    }
    return outputs;
}

std::vector<double> SystemFit::standard_errors(const SystemModel& model, const std::vector<double>& values,
                                               const std::vector<double>& errors) const {
    std::vector<double> deviation(values.size(), std::numeric_limits<double>::infinity());
    if (errors.empty() || values.empty()) return deviation;
    // About these values, which need not be those of generalized least squares.
    const GeneralizedFit fit = generalized_fit(by_output(errors, jacobian(model, values, errors)));
    const Eigen::VectorXd variance = fit.covariance.diagonal() + fit.step.cwiseAbs2();
    for (std::size_t i = 0; i < deviation.size(); ++i) {
        const double own = variance[static_cast<Eigen::Index>(i)];
        if (own > 0) deviation[i] = std::sqrt(own);
    }
    return deviation;
}

SystemFit::Result SystemFit::generalized(const SystemModel& model, Result least, const Ended& ended) const {
    Result result = std::move(least);
    if (result.errors.empty() || result.values.empty()) return result;
    // Where more is left something is missing, whose errors are not those of a random force.
    const double most = std::pow(little_left * noise_in(result.errors), 2) * static_cast<double>(result.errors.size());
    if (!(result.sum < most)) return result;
    std::vector<ErrorModel> models;
    for (int iteration = 0; iteration < most_generalized && !ended(); ++iteration) {
        const auto outputs = by_output(result.errors, jacobian(model, result.values, result.errors));
        if (models.empty()) models = generalized_fit(outputs).models;
        if (std::ranges::all_of(models, [](const ErrorModel& one) { return one.ratio == 0; })) return result;
        const auto squares_of = [&](const std::vector<OutputErrors>& of) {
            double sum = 0;
            for (std::size_t o = 0; o < of.size(); ++o) {
                sum += models[o].whitened(of[o].errors.transpose(), of[o].rows).squaredNorm();
            }
            return sum;
        };
        const Eigen::Index size = static_cast<Eigen::Index>(result.values.size());
        Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(size, size);
        Eigen::VectorXd pull = Eigen::VectorXd::Zero(size);
        for (std::size_t o = 0; o < outputs.size(); ++o) {
            const Eigen::MatrixXd slopes = models[o].whitened(outputs[o].slopes.transpose(), outputs[o].rows);
            normal += slopes * slopes.transpose();
            pull += slopes * models[o].whitened(outputs[o].errors.transpose(), outputs[o].rows).transpose();
        }
        const double before = squares_of(outputs);
        bool improved = false;
        for (double damping = 1e-9; damping < 10 && !improved && !ended(); damping *= 1e3) {
            Eigen::MatrixXd damped = normal;
            for (Eigen::Index i = 0; i < size; ++i) {
                damped(i, i) = normal(i, i) > 0 ? normal(i, i) * (1 + damping) : 1;
            }
            const Eigen::VectorXd step = damped.ldlt().solve(pull);
            Result next = result;
            for (std::size_t i = 0; i < next.values.size(); ++i) next.values[i] += step[static_cast<Eigen::Index>(i)];
            keep_within_limits(model, next.values);
            next.errors = errors_by_runs(model, next.values, ended);
            next.sum = sum_of_squares(next.errors);
            if (!(next.sum < most)) continue;
            const double now = squares_of(by_output(next.errors));
            improved = now < before;
            if (!improved) continue;
            result = std::move(next);
            if (before - now < far_less_than_chance) return result;
        }
        if (!improved) break;
    }
    return result;
}

} // namespace tribode
