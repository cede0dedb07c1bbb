#include "tribode/diagnosis/model_fit.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/normal.hpp"
#include "tribode/diagnosis/prediction_statistics.hpp"
#include "tribode/diagnosis/response.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numeric>

namespace tribode {

namespace {

double square_of(const std::vector<double>& x) {
    double sum = 0;
    for (const double value : x) sum += value * value;
    return sum;
}

Eigen::Map<const Eigen::VectorXd> mapped(const std::vector<double>& x) {
    return {x.data(), static_cast<Eigen::Index>(x.size())};
}

// Numbers from which secants pay: below, differences cost no more than the steps they might spoil.
constexpr Eigen::Index min_for_secants = 4;
// A step that falls by less than this share of what the Jacobian promises shows that it is out of date.
constexpr double min_promise_kept = 0.25;
constexpr double nearly_noise = 1.5; // chi square per sample
constexpr double max_looser = 100;   // factor of the tolerance
constexpr double max_field_step = 2; // standard deviations in one step: as far as differences can be trusted
// Slopes of more entries are not kept [of 8 bytes].
constexpr Eigen::Index max_kept = 4'000'000;
constexpr std::size_t max_generations = 3; // of slopes: the first comes from the hypothesis without its last effect

} // namespace

struct SimulatedRecords {
    struct Record {
        std::size_t number;
        std::shared_ptr<const std::vector<double>> position;
    };
    std::vector<std::shared_ptr<const Candidate>> effects;
    std::vector<double> values, nominal;
    std::vector<Record> records;
};

struct Slopes {
    // Of samples of a record, whitened by the floor of this innovation.
    struct Block {
        std::size_t number, first, end;
        double innovation;
        Eigen::Index row;
    };
    // A parameter of an effect, or, without one, an uncertain field.
    struct Column {
        std::shared_ptr<const Candidate> effect;
        std::size_t place;

        bool operator==(const Column&) const = default;
    };
    std::vector<Block> blocks;
    std::vector<Column> columns;
    Eigen::MatrixXd jacobian;

    // Whether these know all that others do.
    bool replaces(const Slopes& other) const {
        return std::ranges::equal(blocks, other.blocks,
                                  [](const Block& a, const Block& b) {
                                      return a.number == b.number && a.first == b.first && a.end == b.end;
                                  }) &&
               std::ranges::all_of(other.columns,
                                   [&](const Column& one) { return std::ranges::find(columns, one) != columns.end(); });
    }
    // Writes a column for the records; false where it is not known for all of them.
    bool recall(const Column& column, const std::vector<Evidence>& records, Eigen::Ref<Eigen::VectorXd> to) const {
        const auto known = std::ranges::find(columns, column);
        if (known == columns.end()) return false;
        Eigen::Index row = 0;
        for (const auto& record : records) {
            const auto covers = [&](const Block& b) {
                return b.number == record.number && b.first <= record.first && b.end >= record.measurement.size();
            };
            const auto block = std::ranges::find_if(blocks, covers);
            if (block == blocks.end()) return false;
            const auto samples = static_cast<Eigen::Index>(record.samples());
            // A floor that was estimated anew differs in little but its size.
            to.segment(row, samples) =
                block->innovation / record.floor.innovation *
                jacobian.col(known - columns.begin())
                    .segment(block->row + static_cast<Eigen::Index>(record.first - block->first), samples);
            row += samples;
        }
        return true;
    }
};

double Hypothesis::sum_of_squares() const { return square_of(nominal); }

namespace {

// Sum of the squares of so many fields beyond which they lie once in a thousand machines: the quantile of chi square by Wilson and
// Hilferty's approximation.
double tolerated(double fields) {
    return fields * std::pow(1 - 2 / (9 * fields) + normal_quantile(0.999) * std::sqrt(2 / (9 * fields)), 3);
}

} // namespace

bool Hypothesis::within_tolerance() const {
    return nominal.empty() || sum_of_squares() < tolerated(static_cast<double>(nominal.size()));
}

void Hypothesis::hold_within_tolerance() {
    if (within_tolerance()) return;
    constexpr double just_within = 0.999;
    const double share = just_within * std::sqrt(tolerated(static_cast<double>(nominal.size())) / sum_of_squares());
    for (double& off : nominal) off *= share;
    simulated.reset();
    slopes.clear();
}

std::span<const double> Hypothesis::values_of(std::size_t effect) const {
    std::size_t begin = 0;
    for (std::size_t i = 0; i < effect; ++i) begin += effects[i]->parameters.size();
    return std::span(values).subspan(begin, effects[effect]->parameters.size());
}

void Hypothesis::remove(std::size_t effect) {
    const auto own = values_of(effect);
    const auto begin = values.begin() + (own.data() - values.data());
    values.erase(begin, begin + static_cast<std::ptrdiff_t>(own.size()));
    effects.erase(effects.begin() + static_cast<std::ptrdiff_t>(effect));
    settled = false;
}

ModelFit::ModelFit(const MachineModel& machine, const std::vector<Evidence>& evidence)
    : machine_(machine),
      evidence_(evidence),
      fields_(machine.uncertain_fields()) {}

std::size_t ModelFit::sample_count() const {
    std::size_t count = 0;
    for (const auto& record : evidence_) count += record.samples();
    return count;
}

double ModelFit::factor(const Hypothesis& h, std::size_t field) const {
    // A factor of so many deviations: never below zero, and fields that are off together as by a gain stay so on a straight
    // way, which a fit can go in long steps.
    return std::exp(fields_[field].deviation * h.nominal[field]);
}

MachineModel ModelFit::machine(const Hypothesis& h) const {
    MachineModel machine = machine_;
    const auto numbers = machine.numbers();
    for (std::size_t i = 0; i < h.nominal.size(); ++i) {
        for (const std::size_t place : fields_[i].places) *numbers[place] *= factor(h, i);
    }
    std::vector<Effect> effects = machine.effects;
    for (std::size_t i = 0; i < h.effects.size(); ++i) {
        effects.push_back(h.effects[i]->at(h.values_of(i)));
    }
    return machine.with_effects(std::move(effects));
}

std::vector<ModelFit::Position> ModelFit::positions(const Hypothesis& h) const {
    std::optional<MachineModel> machine;
    const auto* known = h.simulated.get();
    if (known && (known->effects != h.effects || known->values != h.values || known->nominal != h.nominal)) {
        known = nullptr;
    }
    std::vector<Position> all;
    for (const auto& record : evidence_) {
        const auto same = [&](const auto& one) {
            return one.number == record.number && one.position->size() == record.measurement.size();
        };
        if (known) {
            const auto it = std::ranges::find_if(known->records, same);
            if (it != known->records.end()) {
                all.push_back(it->position);
                continue;
            }
        }
        try {
            if (!machine) machine = this->machine(h);
        } catch (const InputError&) {
            return {}; // effects that cannot be together, as a delay below zero
        }
        auto position = simulated_position(*machine, record.measurement);
        if (!position) return {};
        all.push_back(std::make_shared<const std::vector<double>>(std::move(*position)));
    }
    return all;
}

std::vector<double> ModelFit::errors(const Hypothesis& h, const std::vector<Position>& positions) const {
    std::vector<double> all;
    if (positions.empty()) return all;
    all.reserve(sample_count() + h.nominal.size());
    for (std::size_t i = 0; i < evidence_.size(); ++i) {
        const Evidence& record = evidence_[i];
        std::vector<double> gap = record.measurement.position();
        for (std::size_t k = 0; k < gap.size(); ++k) gap[k] -= (*positions[i])[k];
        const auto white = record.floor.whitened(gap);
        all.insert(all.end(), white.begin() + static_cast<std::ptrdiff_t>(record.first), white.end());
    }
    all.insert(all.end(), h.nominal.begin(), h.nominal.end());
    return all;
}

std::vector<double> ModelFit::errors(const Hypothesis& h) const { return errors(h, positions(h)); }

double ModelFit::chi_square(const Hypothesis& h) const {
    const auto all = errors(h);
    return all.empty() ? std::numeric_limits<double>::infinity() : square_of(all);
}

void ModelFit::evaluate(Hypothesis& h) const {
    const auto path = positions(h);
    const auto all = errors(h, path);
    h.chi_square = all.empty() ? std::numeric_limits<double>::infinity() : square_of(all);
    if (!path.empty()) remember(h, path);
}

void ModelFit::remember(Hypothesis& h, const std::vector<Position>& path) const {
    auto simulated = std::make_shared<SimulatedRecords>(SimulatedRecords{h.effects, h.values, h.nominal, {}});
    for (std::size_t i = 0; i < path.size(); ++i) simulated->records.push_back({evidence_[i].number, path[i]});
    h.simulated = std::move(simulated);
}

// A number as the fit sees it: its logarithm where it is moved by factors, else in units of its difference step.
struct ModelFit::Coordinate {
    bool field;
    std::size_t index;
    Slopes::Column name;
    bool logarithmic;
    double unit, low, high; // value = unit coordinate; bounds of the coordinate
    double step;            // of differences

    double read(const Hypothesis& h) const {
        const double value = field ? h.nominal[index] : h.values[index];
        return logarithmic ? std::log(value) : value / unit;
    }
    void write(Hypothesis& h, double coordinate) const {
        const double value = logarithmic ? std::exp(coordinate) : coordinate * unit;
        (field ? h.nominal[index] : h.values[index]) = value;
    }
};

std::vector<ModelFit::Coordinate> ModelFit::coordinates(const Hypothesis& h, bool fields) const {
    std::vector<Coordinate> list;
    std::size_t index = 0;
    for (const auto& effect : h.effects) {
        for (std::size_t place = 0; place < effect->parameters.size(); ++place, ++index) {
            const FitParameter& p = effect->parameters[place];
            const Slopes::Column name{effect, place};
            if (p.logarithmic) {
                list.push_back({false, index, name, true, 1, std::log(p.low), std::log(p.high), p.step});
            } else {
                const double unit = 100 * p.step;
                list.push_back({false, index, name, false, unit, p.low / unit, p.high / unit, 0.01});
            }
        }
    }
    for (std::size_t i = 0; fields && i < h.nominal.size(); ++i) {
        list.push_back({true, i, {nullptr, i}, false, 1, -8, 8, 0.05});
    }
    return list;
}

void ModelFit::fit(Hypothesis& h, const Options& options) const {
    const auto moved = coordinates(h, options.move_fields);
    const auto n = static_cast<Eigen::Index>(moved.size());
    auto path = positions(h);
    std::vector<double> e = errors(h, path);
    h.converged = false;
    if (e.empty()) {
        h.chi_square = std::numeric_limits<double>::infinity();
        return;
    }
    h.chi_square = square_of(e);
    if (h.settled) {
        h.converged = true;
        return;
    }
    Eigen::MatrixXd jacobian(static_cast<Eigen::Index>(e.size()), n);
    const RunControl workers{.stop = options.stop, .progress = {}, .workers = options.workers};
    const auto go_on = [&] {
        if (workers.stop_requested()) throw EndedEarly("a fit was interrupted");
    };
    const auto differentiate = [&](const std::vector<std::size_t>& places) {
        for_each_index(places.size(), workers, "", [&](std::size_t place) {
            const std::size_t i = places[place];
            Hypothesis there = h;
            const double here = moved[i].read(h);
            // Away from a bound.
            double step = here + moved[i].step > moved[i].high ? -moved[i].step : moved[i].step;
            moved[i].write(there, here + step);
            std::vector<double> column = errors(there);
            if (column.empty()) { // the other way, then
                step = -step;
                moved[i].write(there, std::clamp(here + step, moved[i].low, moved[i].high));
                column = errors(there);
            }
            if (column.empty()) column = e;
            jacobian.col(static_cast<Eigen::Index>(i)) = (mapped(column) - mapped(e)) / step;
        });
        go_on();
    };
    std::vector<std::size_t> all_places(moved.size()), unknown, of_effects;
    std::iota(all_places.begin(), all_places.end(), std::size_t{0});
    std::ranges::copy_if(all_places, std::back_inserter(of_effects), [&](std::size_t i) { return !moved[i].field; });
    const auto samples = static_cast<Eigen::Index>(sample_count());
    for (const std::size_t i : all_places) {
        auto column = jacobian.col(static_cast<Eigen::Index>(i));
        const bool known = std::ranges::any_of(h.slopes, [&](const auto& slopes) {
            return slopes->recall(moved[i].name, evidence_, column.head(samples));
        });
        if (!known) unknown.push_back(i);
        // The fields count as errors of their own.
        column.tail(column.size() - samples).setZero();
        if (moved[i].field) column[samples + static_cast<Eigen::Index>(moved[i].index)] = 1;
    }
    // Where more than noise is left, something is missing, and the minimum without it need not be known to the last digit.
    const auto tolerance = [&] {
        return options.tolerance * std::clamp(h.chi_square / static_cast<double>(samples), 1.0, max_looser);
    };
    double damping = 1e-3;
    // Where there are many numbers, a Jacobian is carried on for a few steps by Broyden's secants.
    const int max_secants = n < min_for_secants ? 0 : static_cast<int>(n) / 2;
    int secants = max_secants; // steps since the Jacobian was differenced
    bool exact = false;        // it belongs to the present numbers
    // The columns of effects do: they change faster than those of the fields.
    bool nearly_exact = false;
    bool differenced = false; // there is one
    for (int iteration = 0; iteration < options.iterations && n > 0;) {
        if (std::chrono::steady_clock::now() > options.deadline) break;
        if (!differenced && unknown.size() < moved.size()) {
            // As an earlier fit left it: good for a few steps.
            differentiate(unknown);
            secants = max_secants - std::max(1, static_cast<int>(n) / 2);
            nearly_exact = unknown == of_effects;
        } else if (!exact && secants >= max_secants) {
            const bool in_part = differenced && !nearly_exact && 2 * of_effects.size() <= moved.size();
            differentiate(in_part ? of_effects : all_places);
            exact = !in_part;
            nearly_exact = true;
            secants = 0;
        }
        differenced = true;
        const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
        const Eigen::VectorXd gradient = jacobian.transpose() * mapped(e);
        bool improved = false, kept = true;
        double fall = 0;
        struct Trial {
            Hypothesis h;
            Eigen::VectorXd step;
            std::vector<Position> path = {};
            std::vector<double> errors = {};
        };
        const auto placed = [&](const Eigen::VectorXd& change) {
            Trial trial{h, Eigen::VectorXd(n)};
            for (Eigen::Index i = 0; i < n; ++i) {
                const auto& c = moved[static_cast<std::size_t>(i)];
                // A factor of e^1.5 in one step is as far as differences can be trusted.
                const double most = c.logarithmic ? 1.5 : 1e9;
                const double here = c.read(h);
                const double there = std::clamp(here - std::clamp(change[i], -most, most), c.low, c.high);
                c.write(trial.h, there);
                trial.step[i] = there - here;
            }
            return trial;
        };
        const auto simulate = [&](Trial& trial) {
            trial.path = positions(trial.h);
            trial.errors = errors(trial.h, trial.path);
            trial.h.chi_square =
                trial.errors.empty() ? std::numeric_limits<double>::infinity() : square_of(trial.errors);
        };
        const auto beyond_linear = [&](const Trial& trial) -> Eigen::VectorXd {
            return mapped(trial.errors) - mapped(e) - jacobian * trial.step;
        };
        for (int attempt = 0; attempt < (exact ? 7 : 2) && !improved; ++attempt) {
            Eigen::MatrixXd damped = normal;
            for (Eigen::Index i = 0; i < n; ++i)
                damped(i, i) += damping * normal(i, i) + 1e-12 * normal.trace() / static_cast<double>(n) + 1e-300;
            go_on();
            const auto solver = damped.ldlt();
            Eigen::VectorXd change = solver.solve(gradient);
            // Fields and effects that do alike move together or not at all.
            double farthest = 0;
            for (Eigen::Index i = 0; i < n; ++i)
                if (moved[static_cast<std::size_t>(i)].field) farthest = std::max(farthest, std::abs(change[i]));
            if (farthest > max_field_step) change *= max_field_step / farthest;
            Trial next = placed(change);
            // No step is worth a run where the Jacobian promises next to nothing.
            const double promised = -2 * gradient.dot(next.step) - next.step.dot(normal * next.step);
            if (promised < 0.01 * tolerance() * h.chi_square) break;
            simulate(next);
            if (exact && !(next.h.chi_square < h.chi_square) && !next.errors.empty()) {
                // The way down may be a narrow valley that bends: what the errors did beyond the linear tells how
                // [Transtrum 2012].
                const Eigen::VectorXd bend = solver.solve(jacobian.transpose() * beyond_linear(next));
                if (bend.dot(normal * bend) < change.dot(normal * change)) {
                    next = placed(change + bend);
                    simulate(next);
                }
            }
            if (next.h.chi_square < h.chi_square) {
                fall = (h.chi_square - next.h.chi_square) / next.h.chi_square;
                kept = h.chi_square - next.h.chi_square > min_promise_kept * promised;
                jacobian.noalias() +=
                    beyond_linear(next) * (next.step.transpose() / std::max(next.step.squaredNorm(), 1e-300));
                h = std::move(next.h);
                e = std::move(next.errors);
                path = std::move(next.path);
                improved = true;
                // Where noise is left, what is not at its minimum yet lies along a valley that damping would not let it
                // follow.
                const bool is_near = h.chi_square < nearly_noise * static_cast<double>(samples);
                damping = std::max(damping / (attempt > 0 ? 2 : is_near ? 1000 : 8), 1e-9);
            } else {
                damping = std::min(damping * 6, 1e9);
            }
        }
        if (improved || exact) ++iteration; // else it is done again with another Jacobian
        const bool settled = !improved || fall < tolerance();
        if (settled && exact) {
            h.converged = true;
            break;
        }
        // What a carried Jacobian finds no way down from is looked at anew.
        secants = settled || (!exact && !kept) ? max_secants : secants + 1;
        if (improved) exact = nearly_exact = false;
    }
    if (options.left_out_errors) h.left_out_errors = mapped(e);
    if ((options.standard_errors || options.left_out_errors) && n > 0) {
        if (!exact) differentiate(all_places);
        differenced = true;
        std::vector<std::size_t> rows;
        for (const auto& record : evidence_) rows.push_back(record.samples());
        if (options.standard_errors) {
            const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
            // Columns that the record does not show have no finite error.
            const Eigen::MatrixXd inverse = normal.completeOrthogonalDecomposition().pseudoInverse();
            // The floor's predictor leaves correlations where noise decides when an element slips. A field that is moved
            // is an error of variance one.
            Eigen::VectorXd weight = mapped(e);
            weight.tail(weight.size() - samples).setOnes();
            const Eigen::MatrixXd correlated =
                covariance_of_correlated_errors(inverse, weight.asDiagonal() * jacobian, rows);
            h.standard_errors.assign(h.values.size(), 0.0);
            for (Eigen::Index i = 0; i < n; ++i) {
                const auto& c = moved[static_cast<std::size_t>(i)];
                if (c.field) continue;
                const double deviation = std::sqrt(std::max({inverse(i, i), correlated(i, i), 0.0}));
                h.standard_errors[c.index] = c.logarithmic ? h.values[c.index] * deviation : c.unit * deviation;
            }
        }
        if (options.left_out_errors) h.left_out_errors = errors_of_left_out_parts(jacobian, mapped(e), rows);
    }
    remember(h, path);
    if (differenced && jacobian.size() <= max_kept) {
        auto own = std::make_shared<Slopes>();
        Eigen::Index row = 0;
        for (const auto& record : evidence_) {
            own->blocks.push_back(
                {record.number, record.first, record.measurement.size(), record.floor.innovation, row});
            row += static_cast<Eigen::Index>(record.samples());
        }
        for (const auto& c : moved) own->columns.push_back(c.name);
        own->jacobian = std::move(jacobian);
        std::erase_if(h.slopes, [&](const auto& older) { return own->replaces(*older); });
        h.slopes.insert(h.slopes.begin(), std::move(own));
        if (h.slopes.size() > max_generations) h.slopes.erase(h.slopes.begin() + 1);
    }
}

} // namespace tribode
