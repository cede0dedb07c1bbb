#include "tribode/diagnosis/model_fit.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/normal.hpp"
#include "tribode/diagnosis/response.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

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

} // namespace

double Hypothesis::sum_of_squares() const { return square_of(nominal); }

bool Hypothesis::within_tolerance() const {
    const double n = static_cast<double>(nominal.size());
    if (n == 0) return true;
    // The quantile of chi square by Wilson and Hilferty's approximation.
    return sum_of_squares() < n * std::pow(1 - 2 / (9 * n) + normal_quantile(0.999) * std::sqrt(2 / (9 * n)), 3);
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
    // Many deviations off a field is as good as any other there; below zero it would be none.
    return std::max(1 + fields_[field].deviation * h.nominal[field], 0.01);
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

std::vector<double> ModelFit::errors(const Hypothesis& h) const {
    std::optional<MachineModel> machine;
    try {
        machine = this->machine(h);
    } catch (const InputError&) {
        return {}; // effects that cannot be together, as a delay below zero
    }
    std::vector<double> all;
    all.reserve(sample_count() + h.nominal.size());
    for (const auto& record : evidence_) {
        auto position = simulated_position(*machine, record.measurement);
        if (!position) return {};
        for (std::size_t k = 0; k < position->size(); ++k) {
            (*position)[k] = record.measurement.position()[k] - (*position)[k];
        }
        const auto white = record.floor.whitened(*position);
        all.insert(all.end(), white.begin() + static_cast<std::ptrdiff_t>(record.first), white.end());
    }
    all.insert(all.end(), h.nominal.begin(), h.nominal.end());
    return all;
}

double ModelFit::chi_square(const Hypothesis& h) const {
    const auto all = errors(h);
    return all.empty() ? std::numeric_limits<double>::infinity() : square_of(all);
}

// A number as the fit sees it: its logarithm where it is moved by factors, else in units of its difference step.
struct ModelFit::Coordinate {
    bool field;
    std::size_t index;
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
        for (const auto& p : effect->parameters) {
            if (p.logarithmic) {
                list.push_back({false, index, true, 1, std::log(p.low), std::log(p.high), p.step});
            } else {
                const double unit = 100 * p.step;
                list.push_back({false, index, false, unit, p.low / unit, p.high / unit, 0.01});
            }
            ++index;
        }
    }
    for (std::size_t i = 0; fields && i < h.nominal.size(); ++i) {
        list.push_back({true, i, false, 1, -8, 8, 0.05});
    }
    return list;
}

void ModelFit::fit(Hypothesis& h, const Options& options) const {
    const auto moved = coordinates(h, options.move_fields);
    const auto n = static_cast<Eigen::Index>(moved.size());
    std::vector<double> e = errors(h);
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
    const auto differentiate = [&] {
        for_each_index(moved.size(), workers, "", [&](std::size_t i) {
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
    double damping = 1e-3;
    // Where there are many numbers, a Jacobian is carried on for a few steps by Broyden's secants.
    const int max_secants = n < min_for_secants ? 0 : static_cast<int>(n) / 2;
    int secants = max_secants; // steps since the Jacobian was differenced
    bool exact = false;        // it belongs to the present numbers
    for (int iteration = 0; iteration < options.iterations && n > 0; ++iteration) {
        if (std::chrono::steady_clock::now() > options.deadline) break;
        if (!exact && secants >= max_secants) {
            differentiate();
            exact = true;
            secants = 0;
        }
        const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
        const Eigen::VectorXd gradient = jacobian.transpose() * mapped(e);
        bool improved = false;
        double fall = 0;
        for (int attempt = 0; attempt < (exact ? 7 : 2) && !improved; ++attempt) {
            Eigen::MatrixXd damped = normal;
            for (Eigen::Index i = 0; i < n; ++i)
                damped(i, i) += damping * normal(i, i) + 1e-12 * normal.trace() / static_cast<double>(n) + 1e-300;
            go_on();
            const Eigen::VectorXd change = damped.ldlt().solve(gradient);
            Hypothesis next = h;
            Eigen::VectorXd step(n);
            for (Eigen::Index i = 0; i < n; ++i) {
                const auto& c = moved[static_cast<std::size_t>(i)];
                // A factor of e^1.5 or a standard deviation in one step is as far as differences can be trusted.
                const double most = c.logarithmic ? 1.5 : c.field ? 1 : 1e9;
                const double here = c.read(h);
                const double there = std::clamp(here - std::clamp(change[i], -most, most), c.low, c.high);
                c.write(next, there);
                step[i] = there - here;
            }
            const auto there = errors(next);
            const double chi = there.empty() ? std::numeric_limits<double>::infinity() : square_of(there);
            if (chi < h.chi_square) {
                fall = (h.chi_square - chi) / chi;
                next.chi_square = chi;
                const Eigen::VectorXd rest = mapped(there) - mapped(e) - jacobian * step;
                jacobian.noalias() += rest * (step.transpose() / std::max(step.squaredNorm(), 1e-300));
                h = std::move(next);
                e = there;
                improved = true;
                damping = std::max(damping / (attempt == 0 ? 8 : 2), 1e-9);
            } else {
                damping = std::min(damping * 6, 1e9);
            }
        }
        const bool settled = !improved || fall < options.tolerance;
        if (settled && exact) {
            h.converged = true;
            break;
        }
        if (improved) exact = false;
        // What a carried Jacobian finds no way down from is looked at anew.
        secants = settled ? max_secants : secants + 1;
    }
    if (!options.standard_errors || n == 0) return;
    if (!exact) differentiate();
    const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
    // Columns that the record does not show have no finite error.
    const Eigen::MatrixXd covariance = normal.completeOrthogonalDecomposition().pseudoInverse();
    h.standard_errors.assign(h.values.size(), 0.0);
    for (Eigen::Index i = 0; i < n; ++i) {
        const auto& c = moved[static_cast<std::size_t>(i)];
        if (c.field) continue;
        const double deviation = std::sqrt(std::max(covariance(i, i), 0.0));
        h.standard_errors[c.index] = c.logarithmic ? h.values[c.index] * deviation : c.unit * deviation;
    }
}

} // namespace tribode
