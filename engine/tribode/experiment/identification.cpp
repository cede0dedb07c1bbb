#include "tribode/experiment/identification.hpp"
#include "tribode/analysis/signal.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_path.hpp"
#include "tribode/experiment/simulation.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/FFT>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <complex>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <limits>
#include <numbers>
#include <optional>
#include <span>

namespace tribode {

namespace {

using Complex = std::complex<double>;
using Spectrum = Eigen::VectorXcd;

constexpr double max_change = 1;     // of the logarithm of a parameter in one step
constexpr double farthest = 9;       // from the start
constexpr std::size_t min_lines = 8; // of a band
// A friction law that becomes so steep that its run takes so many times the steps is dry friction, or on its way there.
constexpr long most_more_work = 4;

// Numbers of the machine that are moved by one factor.
struct Moved {
    std::string name, unit;
    std::vector<std::size_t> places; // in MachineModel::numbers()
    std::size_t shown = 0;           // the number that stands for them
};

bool is_inside(const std::string& path, const std::string& around) {
    return path.size() > around.size() && path.starts_with(around) &&
           (path[around.size()] == '.' || path[around.size()] == '[');
}

enum class Match { none, inside, itself };

// Whether the path is what the pattern names, or inside of it. [*] of the pattern stands for every index.
Match match(const std::string& path, const std::string& pattern) {
    std::string general;
    std::size_t from = 0;
    for (std::size_t star = pattern.find("[*]"); star != std::string::npos; star = pattern.find("[*]", from)) {
        general += pattern.substr(from, star - from);
        const std::size_t begin = general.size(), end = path.find(']', begin);
        if (end == std::string::npos || path.compare(0, begin, general) != 0) return Match::none;
        general += path.substr(begin, end + 1 - begin);
        from = star + 3;
    }
    general += pattern.substr(from);
    return path == general ? Match::itself : is_inside(path, general) ? Match::inside : Match::none;
}

struct Number {
    std::string path, unit;
    double value;
};

std::vector<Number> numbers_of(const MachineModel& machine) {
    std::vector<Number> numbers;
    each_number(machine, [&](const double& number, const auto& path, std::string_view unit, Allowed, const About&) {
        numbers.push_back({path(), std::string(unit), number});
    });
    return numbers;
}

// friction.elements[3] of friction.elements[3].F; empty of others.
std::string element_of(const std::string& path) {
    const std::size_t end = path.find("].");
    return path.starts_with("friction.elements[") && end != std::string::npos ? path.substr(0, end + 1) : "";
}

std::vector<Moved> moved_numbers(const MachineModel& machine, std::vector<std::string> paths) {
    const std::vector<Number> numbers = numbers_of(machine);
    const bool usual = paths.empty();
    if (usual) {
        paths = {"rigid_gain_per_kg", "modes", "friction", "input_delay_s"};
        for (std::size_t i = 0; i < machine.effects.size(); ++i) {
            if (machine.effects[i].kind().is_friction_law) paths.push_back(fmt::format("effects[{}]", i + 1));
        }
    }
    std::vector<Moved> moved;
    const auto known = [&](const std::string& name) {
        return std::ranges::find(moved, name, &Moved::name) != moved.end();
    };
    for (const auto& pattern : paths) {
        bool found = false;
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            const auto& [path, unit, value] = numbers[i];
            const Match how = match(path, pattern);
            if (how == Match::none) continue;
            found = true;
            if (value == 0) {
                if (usual || path != pattern) continue;
                throw InputError(fmt::format("{} = 0 is no start of a fit, which moves parameters by factors: give it "
                                             "another value",
                                             path));
            }
            const std::string element = how == Match::itself ? "" : element_of(path);
            // Exponents are chosen with the law, and shares could be moved against the level that they share.
            const auto ends = [&path = path](const char* name) { return path.ends_with(name); };
            if (usual && std::ranges::any_of(std::array{".exponent", ".transition", "].share"}, ends)) continue;
            if (!element.empty()) {
                if (!known(element)) moved.push_back({element, "N", {}, i});
                Moved& one = *std::ranges::find(moved, element, &Moved::name);
                one.places.push_back(i);
                if (path.ends_with(".F")) one.shown = i;
            } else if (!known(path)) {
                moved.push_back({path, unit, {i}, i});
            }
        }
        if (!found && !usual) {
            std::vector<std::string> all;
            for (const auto& number : numbers) all.push_back(number.path);
            throw InputError(fmt::format("\"{}\" is no number of the machine and has none in it{}", pattern,
                                         suggestion(pattern, all)));
        }
    }
    if (moved.empty()) throw InputError("the machine has no number to be fitted that is not zero");
    return moved;
}

// The shares of the elements of one generalized Maxwell-slip friction. Their sum is 1: those that are not moved take up what the others
// leave, each in proportion.
struct Shares {
    std::vector<std::size_t> moved, others; // places in MachineModel::numbers()

    void complete(const std::vector<double*>& numbers) const {
        double left = 1, sum = 0;
        for (const std::size_t place : moved) left -= *numbers[place];
        for (const std::size_t place : others) sum += *numbers[place];
        for (const std::size_t place : others) *numbers[place] *= left / sum;
    }
};

// Where all shares would be moved, the last one is taken from `moved`.
std::vector<Shares> tied_shares(const MachineModel& machine, std::vector<Moved>& moved) {
    const std::vector<Number> numbers = numbers_of(machine);
    std::vector<Shares> tied;
    for (std::size_t i = 0; i < machine.effects.size(); ++i) {
        if (machine.effects[i].kind().name != "gms_friction") continue;
        const std::string around = fmt::format("effects[{}].parameters.elements[", i + 1);
        Shares shares;
        for (std::size_t place = 0; place < numbers.size(); ++place) {
            const std::string& path = numbers[place].path;
            if (!path.starts_with(around) || !path.ends_with("].share")) continue;
            const bool is_moved = std::ranges::find(moved, path, &Moved::name) != moved.end();
            (is_moved ? shares.moved : shares.others).push_back(place);
        }
        if (shares.moved.empty()) continue;
        if (shares.others.empty()) {
            shares.others = {shares.moved.back()};
            shares.moved.pop_back();
            std::erase_if(moved, [&](const Moved& one) { return one.name == numbers[shares.others[0]].path; });
        }
        tied.push_back(std::move(shares));
    }
    return tied;
}

// The largest length up to `count` whose Fourier transform is quick.
std::size_t quick_length(std::size_t count) {
    for (std::size_t n = count;; --n) {
        std::size_t rest = n;
        for (const std::size_t factor : {2u, 3u, 5u}) {
            while (rest % factor == 0) rest /= factor;
        }
        if (rest == 1) return n;
    }
}

double mean_of(std::span<const double> values) {
    double sum = 0;
    for (const double value : values) sum += value;
    return sum / static_cast<double>(values.size());
}

struct Band {
    Eigen::Index first, count; // lines of a record's spectrum
};

struct FittedRecord {
    std::string source;
    DriveRecord drive;
    bool is_followed = false; // u with the observer
    std::size_t used = 0;     // of its differences, the last ones
    std::vector<Band> bands;

    double floor = 0;           // variance of a sample of y below which no residual is believed [m^2]
    mutable long most_work = 0; // steps of a run, set by the first one; 0: not yet, or no limit

    // Of the differences of a white signal with the variance `floor`, at a line.
    double floor_at(double line) const {
        const double half_turn = std::numbers::pi * line / static_cast<double>(used);
        return static_cast<double>(used) * floor * 4 * std::pow(std::sin(half_turn), 2);
    }

    // Of the differences of x.
    Spectrum spectrum(const std::vector<double>& x) const {
        std::vector<double> difference(used);
        const std::size_t first = x.size() - used;
        for (std::size_t k = 0; k < used; ++k) difference[k] = x[first + k] - x[first + k - 1];
        Eigen::FFT<double> fft;
        std::vector<Complex> lines;
        fft.fwd(lines, difference);
        return Eigen::Map<const Spectrum>(lines.data(), static_cast<Eigen::Index>(used / 2 + 1));
    }
};

// The records with a machine at some parameters.
class Fit {
  public:
    Fit(const MachineModel& machine, const IdentifyOptions& options, const RunControl& control)
        : machine_(machine),
          control_(control) {
        machine_.encoder_resolution = 0;
        machine_.noise_rms = 0;
        machine_.process_noise_rms = 0;
        moved = moved_numbers(machine_, options.parameters);
        shares_ = tied_shares(machine_, moved);
        if (moved.empty()) throw InputError("the only share of gms_friction is 1, there is nothing to be fitted");
        const double mass = machine.rigid_gain > 0 ? 1 / machine.rigid_gain : 0; // without one it comes back by itself
        const double omega = 2 * std::numbers::pi * options.observer;
        observer_ = PidController{
            .kp = mass * omega * omega, .kd = 1.4 * mass * omega, .derivative_filter_hz = 10 * options.observer};
        const auto numbers = machine_.numbers();
        for (const auto& one : moved) start_.push_back(numbers_at(numbers, one.places));
        // Runs that can be differentiated, see SensitiveServoSystem, also where parameters that are equal at the start, such as
        // the levels of a Stribeck curve, are not.
        const auto n = static_cast<Eigen::Index>(moved.size());
        const MachineModel elsewhere = at(Eigen::VectorXd::LinSpaced(n, 0.01, 0.02));
        exact_ = !refused(elsewhere, message) && resolved(Method::automatic, elsewhere) == Method::exact &&
                 machine_.input == InputKind::hold && machine_.initial == InitialKind::rest;
    }

    void add(FittedRecord record, const IdentifyOptions& options) {
        const double line = 1 / (static_cast<double>(record.used) * machine_.sample_time);
        const auto last = static_cast<Eigen::Index>(record.used / 2);
        const auto top = options.f_max > 0 ? std::min(last, static_cast<Eigen::Index>(options.f_max / line)) : last;
        auto first = std::max<Eigen::Index>(1, static_cast<Eigen::Index>(std::ceil(options.f_min / line)));
        while (first <= top) {
            auto count = std::max(static_cast<Eigen::Index>(min_lines),
                                  static_cast<Eigen::Index>(options.band * static_cast<double>(first)));
            if (first + 2 * count > top + 1) count = top + 1 - first; // nothing is left over at the end
            record.bands.push_back({first, count});
            first += count;
        }
        records.push_back(std::move(record));
    }

    std::vector<Moved> moved;
    std::vector<FittedRecord> records;

    // With the controller of the record's runs.
    MachineModel at(const Eigen::VectorXd& logarithm, const FittedRecord& record) const {
        MachineModel machine = at(logarithm);
        if (record.is_followed) {
            machine.controller = observer_;
            machine.closed_loop = true;
        }
        return machine;
    }

    MachineModel at(const Eigen::VectorXd& logarithm) const {
        MachineModel machine = machine_;
        const auto numbers = machine.numbers();
        for (std::size_t j = 0; j < moved.size(); ++j) {
            const double factor = std::exp(logarithm[static_cast<Eigen::Index>(j)]);
            for (std::size_t i = 0; i < moved[j].places.size(); ++i) {
                *numbers[moved[j].places[i]] = start_[j][i] * factor;
            }
        }
        for (const auto& one : shares_) one.complete(numbers);
        return machine;
    }

    // As the record drives it.
    ServoRun run(const MachineModel& machine, const FittedRecord& record, ServoRunOptions options) const {
        stop_if_asked();
        const DriveRecord& drive = record.drive;
        if (!record.is_followed) return driven_run(machine, drive, std::move(options));
        const std::size_t last = drive.t.size() - 1;
        options.start = {mean_of(std::span(drive.measured).first(10)), 0.0};
        const auto input = [&drive, last](long k) {
            const std::size_t place = std::min(static_cast<std::size_t>(k), last);
            return LoopInput{drive.measured[place], drive.u[place]};
        };
        return ServoRun(machine, ClosedLoop{input, 0}, options);
    }

    enum class Accuracy { residual, difference };

    // Measured less simulated position; none where there is no such machine, or its run ends early or takes too many steps.
    std::optional<std::vector<double>> residual(const MachineModel& machine, const FittedRecord& record,
                                                std::string& why, Accuracy accuracy = Accuracy::residual) const {
        if (refused(machine, why)) return std::nullopt;
        ServoRunOptions options;
        // Exact machines ignore it. A step ends with the sample at the latest, so errors are far below these bounds: of
        // residuals they must not count beside what a long record averages, of differences beside what a parameter changes.
        const bool differs = accuracy == Accuracy::difference;
        options.solver.relative_tolerance = differs ? 1e-3 : 1e-6;
        options.solver.absolute_tolerance = (differs ? 10 : 0.1) * std::sqrt(record.floor);
        options.purpose = Purpose::search;
        ServoRun run = this->run(machine, record, options);
        ++simulations_;
        const auto last = static_cast<long>(record.drive.t.size()) - 1;
        RunOutcome outcome;
        for (long reached = 0; reached < last && outcome.ok();) {
            reached = std::min(last, reached + 1000);
            outcome = run.advance_to(reached);
            if (!differs && record.most_work > 0 && work_of(run) > record.most_work) {
                why = fmt::format("{}: the run takes more than {} times the steps of the one with the start values",
                                  record.source, most_more_work);
                ++laborious_;
                return std::nullopt;
            }
        }
        if (!outcome.ok()) {
            why = record.source + ": " + outcome.message;
            return std::nullopt;
        }
        if (!exact_ && record.most_work == 0) record.most_work = most_more_work * work_of(run);
        std::vector<double> rest = record.drive.measured;
        for (std::size_t k = 0; k < rest.size(); ++k) rest[k] -= run.trace().y[k];
        return rest;
    }

    // Of all records; none where one of them ends early.
    std::optional<std::vector<std::vector<double>>> residuals(const Eigen::VectorXd& logarithm) const {
        std::vector<std::vector<double>> all;
        for (const auto& record : records) {
            auto one = residual(at(logarithm, record), record, message);
            if (!one) return std::nullopt;
            all.push_back(std::move(*one));
        }
        return all;
    }

    std::vector<Spectrum> spectra(const std::vector<std::vector<double>>& residuals) const {
        std::vector<Spectrum> all;
        for (std::size_t r = 0; r < records.size(); ++r) all.push_back(records[r].spectrum(residuals[r]));
        return all;
    }

    // Mean power of each band, record after record. The floor keeps that of a record without noise from zero, where the
    // maximum of the likelihood would lie.
    std::vector<double> powers(const std::vector<Spectrum>& residual) const {
        std::vector<double> all;
        for (std::size_t r = 0; r < records.size(); ++r) {
            for (const auto& band : records[r].bands) {
                const double sum = residual[r].segment(band.first, band.count).squaredNorm();
                const double middle = static_cast<double>(band.first) + static_cast<double>(band.count - 1) / 2;
                all.push_back(sum / static_cast<double>(band.count) + records[r].floor_at(middle));
            }
        }
        return all;
    }

    double objective(const std::vector<double>& powers) const {
        double sum = 0;
        std::size_t next = 0;
        for (const auto& record : records) {
            for (const auto& band : record.bands) sum += static_cast<double>(band.count) * std::log(powers[next++]);
        }
        return sum;
    }

    // Derivatives of the residual's spectrum by the logarithms of the parameters, of one record.
    Eigen::MatrixXcd derivatives(const Eigen::VectorXd& logarithm, std::size_t r,
                                 const std::vector<double>& residual_here) const {
        const FittedRecord& record = records[r];
        const auto lines = static_cast<Eigen::Index>(record.used / 2 + 1);
        Eigen::MatrixXcd columns(lines, static_cast<Eigen::Index>(moved.size()));
        if (exact_) {
            ServoRunOptions options;
            options.solver.method = Method::exact;
            options.channels = {.t = false, .r = false, .u = false, .motion = false};
            for (std::size_t j = 0; j < moved.size(); ++j) {
                options.sensitivities.push_back(servo_direction(
                    moved[j].name,
                    [&](double c) {
                        Eigen::VectorXd there = logarithm;
                        there[static_cast<Eigen::Index>(j)] += c;
                        return at(there, record);
                    },
                    1.0 / 64));
            }
            ServoRun run = this->run(at(logarithm, record), record, options);
            run.advance_to(static_cast<long>(record.drive.t.size()) - 1);
            ++simulations_;
            const auto& found = run.sensitivities();
            for (std::size_t j = 0; j < found.size(); ++j) {
                columns.col(static_cast<Eigen::Index>(j)) = -record.spectrum(found[j].y);
            }
            return columns;
        }
        constexpr double step = 1e-3;
        const auto base = residual(at(logarithm, record), record, message, Accuracy::difference);
        const Spectrum here = record.spectrum(base ? *base : residual_here);
        for_each_index(moved.size(), control_, "", [&](std::size_t j) {
            Eigen::VectorXd there = logarithm;
            const auto place = static_cast<Eigen::Index>(j);
            there[place] += step;
            std::string why;
            const auto rest = residual(at(there, record), record, why, Accuracy::difference);
            if (rest) {
                columns.col(place) = (record.spectrum(*rest) - here) / step;
            } else {
                columns.col(place).setZero();
            }
        });
        stop_if_asked();
        return columns;
    }

    // Of all records.
    std::vector<Eigen::MatrixXcd> derivatives(const Eigen::VectorXd& logarithm,
                                              const std::vector<std::vector<double>>& residuals) const {
        std::vector<Eigen::MatrixXcd> all;
        for (std::size_t r = 0; r < records.size(); ++r) all.push_back(derivatives(logarithm, r, residuals[r]));
        return all;
    }

    // From differences of runs, one for each parameter.
    bool derivatives_are_costly() const { return !exact_; }

    void stop_if_asked() const {
        if (control_.stop_requested()) throw EndedEarly("an identification was interrupted");
    }

    mutable std::string message; // of a run that ended early, or of a machine that is none

    long simulations() const { return simulations_; } // of a record
    long laborious() const { return laborious_; }     // of these given up for their many steps

    // Numbers that are tied to moved ones.
    std::vector<std::size_t> tied_places() const {
        std::vector<std::size_t> places;
        for (const auto& one : shares_) places.insert(places.end(), one.others.begin(), one.others.end());
        return places;
    }

  private:
    // Where parameters bound one another, a step may leave what they allow.
    static bool refused(const MachineModel& machine, std::string& why) {
        try {
            for (const auto& effect : machine.effects) effect.require_allowed();
            machine.with_fields(Json::object(), Json::object(), "the machine"); // checks all
        } catch (const InputError& error) {
            why = error.what();
            return true;
        }
        return false;
    }

    static long work_of(const ServoRun& run) {
        const RunStatistics statistics = run.statistics();
        return statistics.steps + statistics.rejected_steps;
    }

    static std::vector<double> numbers_at(const std::vector<double*>& numbers, const std::vector<std::size_t>& places) {
        std::vector<double> values;
        for (const std::size_t place : places) values.push_back(*numbers[place]);
        return values;
    }

    MachineModel machine_;
    const RunControl& control_;
    std::vector<Shares> shares_;
    std::vector<std::vector<double>> start_;
    PidController observer_;
    bool exact_ = false;
    mutable std::atomic<long> simulations_ = 0, laborious_ = 0;
};

// Half the Hessian and half the gradient of V, and what the latter is made of.
struct Normal {
    Eigen::MatrixXd hessian;
    Eigen::VectorXd gradient;
    Eigen::MatrixXd by_line, by_band; // sums of the squares of the gradient's parts

    Normal(const Fit& fit, const std::vector<Eigen::MatrixXcd>& derivatives, const std::vector<Spectrum>& spectra,
           const std::vector<double>& powers) {
        const auto n = static_cast<Eigen::Index>(fit.moved.size());
        hessian = by_line = by_band = Eigen::MatrixXd::Zero(n, n);
        gradient = Eigen::VectorXd::Zero(n);
        std::size_t next = 0;
        for (std::size_t r = 0; r < fit.records.size(); ++r) {
            const Eigen::MatrixXcd& columns = derivatives[r];
            for (const auto& band : fit.records[r].bands) {
                const double power = powers[next++];
                const auto part = columns.middleRows(band.first, band.count);
                const auto rest = spectra[r].segment(band.first, band.count);
                hessian += (part.adjoint() * part).real() / power;
                // One row for each line.
                const Eigen::MatrixXd scores = (part.conjugate().array().colwise() * rest.array()).real() / power;
                const Eigen::VectorXd sum = scores.colwise().sum();
                gradient += sum;
                by_line += scores.transpose() * scores;
                by_band += sum * sum.transpose();
            }
        }
    }
};

// Sums of the squares of the gradient's parts by intervals of time: both factors are whitened by the power of the bands. What the
// residual has at reversals or while an axis sticks, rounding above all, is correlated over all lines.
Eigen::MatrixXd squares_by_time(const Fit& fit, const std::vector<Eigen::MatrixXcd>& derivatives,
                                const std::vector<Spectrum>& spectra, const std::vector<double>& powers) {
    constexpr Eigen::Index intervals = 60; // of each record: long beside a standstill, many enough for a variance
    const auto n = static_cast<Eigen::Index>(fit.moved.size());
    Eigen::MatrixXd squares = Eigen::MatrixXd::Zero(n, n);
    Eigen::FFT<double> fft;
    fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
    std::size_t next = 0;
    for (std::size_t r = 0; r < fit.records.size(); ++r) {
        const auto& record = fit.records[r];
        Eigen::VectorXd weights = Eigen::VectorXd::Zero(spectra[r].size());
        for (const auto& band : record.bands) {
            weights.segment(band.first, band.count).setConstant(1 / std::sqrt(powers[next++]));
        }
        const auto samples = static_cast<Eigen::Index>(record.used);
        const auto whitened = [&](const auto& lines) {
            const Spectrum weighted = lines.cwiseProduct(weights.template cast<Complex>());
            Eigen::VectorXd values(samples);
            fft.inv(values.data(), weighted.data(), samples);
            return values;
        };
        const Eigen::VectorXd rest = whitened(spectra[r]);
        Eigen::MatrixXd sums(intervals, n);
        for (Eigen::Index j = 0; j < n; ++j) {
            const Eigen::VectorXd product = whitened(derivatives[r].col(j)).cwiseProduct(rest);
            for (Eigen::Index i = 0; i < intervals; ++i) {
                const Eigen::Index from = i * samples / intervals, to = (i + 1) * samples / intervals;
                sums(i, j) = product.segment(from, to - from).sum() * static_cast<double>(samples) / 2; // Parseval
            }
        }
        squares += sums.transpose() * sums;
    }
    return squares;
}

// Broyden's method: the derivatives after a step, from what it changed in the spectra; in other directions, at right angles in
// the metric of the Hessian's diagonal, they stay.
void correct(std::vector<Eigen::MatrixXcd>& derivatives, const Eigen::VectorXd& step, const Eigen::MatrixXd& hessian,
             const std::vector<Spectrum>& before, const std::vector<Spectrum>& after) {
    const Eigen::VectorXd along = hessian.diagonal().cwiseProduct(step);
    const double length = along.dot(step);
    if (!(length > 0)) return;
    for (std::size_t r = 0; r < derivatives.size(); ++r) {
        const Spectrum missed = after[r] - before[r] - derivatives[r] * step;
        derivatives[r] += missed * (along / length).transpose();
    }
}

// Which parameters the records determine: the others are left out, one after another, worst first.
std::vector<Eigen::Index> determined(const Eigen::MatrixXd& hessian, const std::vector<bool>& free) {
    std::vector<Eigen::Index> places;
    for (Eigen::Index j = 0; j < hessian.rows(); ++j) {
        if (free[static_cast<std::size_t>(j)] && hessian(j, j) > 0) places.push_back(j);
    }
    while (!places.empty()) {
        const Eigen::MatrixXd part = hessian(places, places);
        const Eigen::VectorXd scale = part.diagonal().cwiseSqrt().cwiseInverse();
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scale.asDiagonal() * part * scale.asDiagonal());
        const Eigen::VectorXd errors = (part.inverse().diagonal() / 2).cwiseAbs().cwiseSqrt();
        Eigen::Index worst = 0;
        const double largest = errors.maxCoeff(&worst);
        // Known to a factor of e at least.
        if (solver.eigenvalues()[0] > 1e-12 && largest < 1) return places;
        if (solver.eigenvalues()[0] <= 1e-12) solver.eigenvectors().col(0).cwiseAbs().maxCoeff(&worst);
        places.erase(places.begin() + worst);
    }
    return places;
}

void put_covariance(Identification& found, const Normal& normal, const Eigen::MatrixXd& by_time,
                    const std::vector<bool>& free) {
    const auto places = determined(normal.hessian, free);
    const auto n = static_cast<Eigen::Index>(places.size());
    const std::size_t all = found.parameters.size();
    found.covariance.assign(all, std::vector<double>(all, 0.0));
    for (auto& parameter : found.parameters) parameter.standard_error = std::numeric_limits<double>::infinity();
    if (n > 0) {
        // V is minus twice the logarithm of the likelihood but for the factor of H.
        const Eigen::MatrixXd inverse = (2 * normal.hessian(places, places)).inverse();
        const Eigen::VectorXd plain = inverse.diagonal().cwiseSqrt();
        Eigen::MatrixXd best = inverse;
        for (const auto* scores : {&normal.by_line, &normal.by_band, &by_time}) {
            const Eigen::MatrixXd one = inverse * (4 * (*scores)(places, places)) * inverse;
            // The larger of the two for each parameter, with the correlation of the one with more in all.
            const Eigen::VectorXd now = best.diagonal().cwiseSqrt(), other = one.diagonal().cwiseSqrt();
            if ((other.array() / plain.array()).sum() > (now.array() / plain.array()).sum()) best = one;
            const Eigen::VectorXd wanted = now.cwiseMax(other);
            const Eigen::VectorXd factor = wanted.cwiseQuotient(best.diagonal().cwiseSqrt());
            best = factor.asDiagonal() * best * factor.asDiagonal();
        }
        found.excess = (best.diagonal().cwiseSqrt().array() / plain.array()).mean();
        for (Eigen::Index j = 0; j < n; ++j) {
            auto& own = found.parameters[static_cast<std::size_t>(places[static_cast<std::size_t>(j)])];
            own.standard_error = std::abs(own.value) * std::sqrt(best(j, j));
            for (Eigen::Index k = 0; k < n; ++k) {
                const auto row = static_cast<std::size_t>(places[static_cast<std::size_t>(j)]);
                const auto column = static_cast<std::size_t>(places[static_cast<std::size_t>(k)]);
                found.covariance[row][column] =
                    best(j, k) * found.parameters[row].value * found.parameters[column].value;
            }
        }
    }
    std::vector<std::string> unknown;
    for (const auto& parameter : found.parameters) {
        if (!std::isfinite(parameter.standard_error)) unknown.push_back(parameter.name);
    }
    if (!unknown.empty()) {
        found.notes.push_back(
            fmt::format("The records do not determine {}: {}.", fmt::join(unknown, ", "),
                        unknown.size() == 1 ? "it has no standard error" : "they have no standard errors"));
    }
}

// Share of the power of x, without its mean, above `cycles` per sample.
double power_share_above(double cycles, std::span<const double> x) {
    const auto used = x.first(quick_length(x.size()));
    std::vector<double> centered(used.begin(), used.end());
    const double mean = mean_of(centered);
    for (double& value : centered) value -= mean;
    Eigen::FFT<double> fft;
    std::vector<std::complex<double>> lines;
    fft.fwd(lines, centered);
    const auto count = static_cast<double>(lines.size());
    double above = 0, all = 0;
    for (std::size_t l = 1; l <= lines.size() / 2; ++l) {
        const double power = std::norm(lines[l]);
        all += power;
        if (static_cast<double>(l) > cycles * count) above += power;
    }
    return all > 0 ? above / all : 0;
}

FittedRecord prepared(const MachineModel& machine, const GivenRecord& given, const RecordOptions& columns,
                      const IdentifyOptions& options) {
    FittedRecord record;
    record.source = given.name();
    const Table table = given.read(columns, DriveRecord::columns(), machine.sample_time);
    MachineModel reader = machine;
    record.is_followed = options.observer > 0 && machine.input == InputKind::hold && table.find("u");
    if (record.is_followed) reader.closed_loop = false; // of r, exc and u the last one is used
    record.drive = DriveRecord::from_table(table, reader, record.source);
    if (record.drive.measured.empty()) {
        throw InputError(record.source + ": there is no column y, the measured position that is fitted");
    }
    constexpr std::size_t least = 256;
    if (record.drive.t.size() < least) {
        throw InputError(
            fmt::format("{}: {} samples, must be {} at least", record.source, record.drive.t.size(), least));
    }
    const auto [low, high] = std::ranges::minmax(record.drive.measured);
    if (low == high) throw InputError(record.source + ": y is constant: nothing moves in this record");
    const double duration = static_cast<double>(record.drive.t.size()) * machine.sample_time;
    if (const double delay = machine.input_delay + machine.output_delay; delay >= duration) {
        throw InputError(fmt::format("{}: the delay of {:.6g} s is longer than the record of {:.6g} s", record.source,
                                     delay, duration));
    }
    const auto is_zero = [](const std::vector<double>& x) {
        return std::ranges::all_of(x, [](double value) { return value == 0; });
    };
    if (is_zero(record.drive.u) && is_zero(record.drive.reference) && is_zero(record.drive.excitation)) {
        throw InputError(fmt::format("{}: {} throughout: a record with an excitation is needed", record.source,
                                     record.drive.closed_loop() ? "r and exc are zero" : "u is zero"));
    }
    // As `tribode fra` refuses single sines and lines there; white noise has a tenth of its power above.
    constexpr double highest = 0.45, most = 0.5;
    for (const char* name : {"exc", "r", "u"}) {
        const Column* driver = table.find(name);
        if (!driver || is_zero(driver->values)) continue;
        if (power_share_above(highest, driver->values) > most) {
            throw InputError(
                fmt::format("{}: most of {} lies above 0.45 of the sampling rate ({:.6g} Hz), where a sine cannot be "
                            "told from its alias",
                            record.source, name, highest / machine.sample_time));
        }
        break;
    }
    if (const std::size_t samples = clipped_samples(record.drive.measured, machine.encoder_resolution)) {
        throw InputError(
            fmt::format("{}: y stands at its largest values ({:.6g} and {:.6g}) in {} samples and breaks off on "
                        "the way there: it seems clipped, a record below the limit is needed",
                        record.source, low, high, samples));
    }
    const double middle = mean_of(record.drive.measured);
    for (const double y : record.drive.measured) record.floor += (y - middle) * (y - middle);
    constexpr double exactness = 1e-7; // of an encoder, relative to the motion
    record.floor *= exactness * exactness / static_cast<double>(record.drive.t.size());
    record.used = quick_length(record.drive.t.size() - 1);
    return record;
}

} // namespace

Identification identify(const MachineModel& machine, const std::vector<GivenRecord>& records,
                        const RecordOptions& columns, const IdentifyOptions& options, const RunControl& control) {
    if (records.empty()) throw InputError("an identification needs at least one record");
    Fit fit(machine, options, control);
    std::vector<std::vector<double>> positions;
    for (std::size_t i = 0; i < records.size(); ++i) {
        FittedRecord record = prepared(machine, records[i], columns, options);
        for (std::size_t k = 0; k < i; ++k) {
            refuse_repeated_record(record.source, record.drive.measured, records[k].name(), positions[k]);
        }
        positions.push_back(record.drive.measured);
        fit.add(std::move(record), options);
    }
    const auto n = static_cast<Eigen::Index>(fit.moved.size());

    Eigen::VectorXd at = Eigen::VectorXd::Zero(n);
    auto residuals = fit.residuals(at);
    if (!residuals) throw InputError("the machine cannot follow the record with its start values: " + fit.message);
    auto spectra = fit.spectra(*residuals);
    auto powers = fit.powers(spectra);
    double now = fit.objective(powers);
    if (!std::isfinite(now)) throw InputError("the records have values that are not finite");

    Identification found;
    double damping = 1e-3;
    // Costly ones are corrected after a step, and calculated again where they predict less than what comes, and before the end.
    std::vector<Eigen::MatrixXcd> derivatives;
    bool corrected = false;
    const auto calculate_again = [&] {
        derivatives = fit.derivatives(at, *residuals);
        corrected = false;
    };
    if (options.iterations > 0) calculate_again();
    const auto is_spent = [&] { return options.simulations > 0 && fit.simulations() >= options.simulations; };
    while (found.iterations < options.iterations && !found.converged && !is_spent()) {
        ++found.iterations;
        const Normal normal(fit, derivatives, spectra, powers);
        const double most_damping = corrected ? std::max(1.0, 40 * damping) : 1e8;
        bool better = false;
        while (!better && damping < most_damping) {
            Eigen::MatrixXd damped = normal.hessian;
            const double small = 1e-9 * damped.diagonal().maxCoeff();
            for (Eigen::Index j = 0; j < n; ++j) damped(j, j) += damping * damped(j, j) + small * 1e-6;
            const Eigen::VectorXd step =
                (-damped.ldlt().solve(normal.gradient)).cwiseMax(-max_change).cwiseMin(max_change);
            const Eigen::VectorXd tried = (at + step).cwiseMax(-farthest).cwiseMin(farthest);
            if (!step.allFinite()) {
                damping *= 10;
                continue;
            }
            auto there = fit.residuals(tried);
            const bool can_be_simulated = there.has_value();
            if (can_be_simulated) {
                auto lines = fit.spectra(*there);
                auto power = fit.powers(lines);
                const double value = fit.objective(power);
                if (value < now) {
                    const double gain = now - value;
                    const double predicted =
                        -(2 * normal.gradient.dot(step) + step.dot(normal.hessian * step)); // of lowering V
                    // A step that lowers V by 0.05 is one of a fifth of a standard error.
                    const bool small_step = gain < 0.05 && damping < 1;
                    found.converged = small_step && !corrected;
                    better = true;
                    if (fit.derivatives_are_costly()) correct(derivatives, tried - at, normal.hessian, spectra, lines);
                    at = tried;
                    residuals = std::move(there);
                    spectra = std::move(lines);
                    powers = std::move(power);
                    now = value;
                    damping = std::max(damping / 10, 1e-9);
                    if (!fit.derivatives_are_costly() || (!found.converged && (small_step || gain < predicted / 4))) {
                        calculate_again();
                    } else {
                        corrected = !found.converged;
                    }
                }
            }
            if (!better) damping *= can_be_simulated ? 6 : 36;
        }
        if (control.progress) {
            control.progress("identify", static_cast<std::size_t>(found.iterations),
                             static_cast<std::size_t>(options.iterations));
        }
        if (!better && corrected) {
            calculate_again();
            damping = 1e-3;
        } else if (!better) {
            found.converged = true; // no way down
        }
    }

    MachineModel fitted = fit.at(at), first = machine;
    found.machine = machine;
    const auto values = fitted.numbers(), starts = first.numbers(), results = found.machine.numbers();
    std::vector<bool> free;
    for (Eigen::Index j = 0; j < n; ++j) {
        const Moved& one = fit.moved[static_cast<std::size_t>(j)];
        for (const std::size_t place : one.places) *results[place] = *values[place];
        found.parameters.push_back({one.name, one.unit, *starts[one.shown], *values[one.shown]});
        free.push_back(std::abs(at[j]) < 0.999 * farthest);
    }
    for (const std::size_t place : fit.tied_places()) *results[place] = *values[place];
    if (corrected) calculate_again();
    if (options.iterations > 0) {
        put_covariance(found, Normal(fit, derivatives, spectra, powers),
                       squares_by_time(fit, derivatives, spectra, powers), free);
    }
    found.simulations = fit.simulations();
    found.residuals = std::move(*residuals);
    found.objective = now;
    for (const auto& record : fit.records) {
        // A drive may limit the thrust, and then it is right.
        if (const std::size_t samples = clipped_samples(record.drive.u, 0)) {
            found.notes.push_back(
                fmt::format("{}: u stands at its largest values in {} samples; that is right only if the "
                            "drive limited it, not the log.",
                            record.source, samples));
        }
    }
    if (!found.converged && options.iterations > 0) {
        found.notes.push_back(
            fmt::format("Not converged after {} iterations and {} simulations.", found.iterations, found.simulations));
    }
    if (fit.laborious() > 0) {
        found.notes.push_back(
            fmt::format("{} of {} simulations were given up because they took more than {} times the steps of those "
                        "with the start values: a friction law is too steep for the sampling, dry friction may "
                        "describe the machine better.",
                        fit.laborious(), found.simulations, most_more_work));
    }
    return found;
}

} // namespace tribode
