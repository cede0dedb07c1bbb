#include "tribode/diagnosis/system_screening.hpp"
#include "tribode/diagnosis/lane_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <set>

namespace tribode {

namespace {

constexpr std::size_t max_rows = 4000; // of the errors: of more, some are left out evenly
constexpr double min_share = 1e-3;     // of the squared errors, for a term to be worth a fit
// Of a pair: times what the better one explains alone, or of what that one leaves.
constexpr double min_of_pair = 1.2, rest_of_pair = 0.7;
constexpr std::size_t max_pairs = 60;
constexpr double rest_of_sum = 0.7; // of what a shorter one leaves: as much as a sum may leave
constexpr std::size_t max_sums = 6;
constexpr double too_large = 10;         // an effect of a probe, times the errors
constexpr double runs_away = 1e3;        // the effect of a lag or a mode, times the errors: its steps may be too long
constexpr std::size_t lanes_of_pack = 8; // one for each amplitude
constexpr std::size_t finer = 4;         // times the steps of the model, for what is faster
constexpr int max_probe_sizes = 4;       // to make it smaller
constexpr double alike = 0.95;           // cosine of the angle between what two terms explain
constexpr double told_apart = 1e-3;      // of the effect of a probe, beside what free values can do; less is rounding

class Screen {
  public:
    Screen(const SystemModel& model, const std::vector<double>& values, const std::vector<double>& errors,
           const std::vector<SystemTerm>& terms, const SystemFit& fit)
        : model_(model),
          values_(values),
          terms_(terms),
          fit_(fit),
          finer_(fit),
          careful_(fit),
          samples_(errors.size()),
          stride_(std::max<std::size_t>(1, errors.size() / max_rows)),
          error_(thinned(errors)),
          basis_(free_directions(errors)),
          open_(rest(error_)),
          effect_(terms.size()) {
        finer_.begin_search(finer * fit.substeps());
        careful_.begin_search();
    }

    // Terms that follow one another, whose amplitudes have a lane each.
    std::vector<std::vector<std::size_t>> packs() const {
        std::vector<std::vector<std::size_t>> made;
        std::size_t lanes = lanes_of_pack;
        for (std::size_t i = 0; i < terms_.size(); ++i) {
            if (lanes + terms_[i].amplitudes > lanes_of_pack) {
                made.emplace_back();
                lanes = 0;
            }
            made.back().push_back(i);
            lanes += terms_[i].amplitudes;
        }
        return made;
    }

    // The effect of each amplitude at its start, less what free values can do.
    void simulate(const std::vector<std::size_t>& pack) {
        const auto together = effects_together(pack);
        for (std::size_t n = 0; n < pack.size(); ++n) {
            const SystemTerm& term = terms_[pack[n]];
            effect_[pack[n]] = Eigen::MatrixXd::Zero(error_.size(), static_cast<Eigen::Index>(term.amplitudes));
            for (std::size_t a = 0; a < term.amplitudes; ++a) {
                simulate(pack[n], a, together[n].empty() ? nullptr : &together[n][a]);
            }
        }
    }

    std::vector<ScreenedTerms> singles() {
        std::vector<ScreenedTerms> found;
        std::vector<Eigen::VectorXd> part(terms_.size()); // of the errors, that each explains
        explained_.assign(terms_.size(), 0);
        for (std::size_t i = 0; i < terms_.size(); ++i) {
            Eigen::VectorXd coefficients;
            explained_[i] = solved(effect_[i], coefficients);
            if (explained_[i] > min_share * open_.squaredNorm()) {
                found.push_back({{i}, {started(terms_[i], coefficients.data())}, share(explained_[i])});
                part[i] = (effect_[i] * coefficients).normalized();
            }
        }
        std::stable_sort(found.begin(), found.end(), by_share);
        std::vector<std::size_t> distinct;
        for (auto& one : found) {
            const std::size_t i = one.terms[0];
            one.is_alike = std::ranges::any_of(distinct, [&](std::size_t d) { return part[d].dot(part[i]) > alike; });
            if (!one.is_alike) distinct.push_back(i);
        }
        return found;
    }

    // After singles().
    std::vector<ScreenedTerms> pairs(const std::function<bool()>& late) const {
        std::vector<ScreenedTerms> found;
        auto some = best_of_each_form();
        std::erase_if(some, [&](std::size_t i) { return terms_[i].is_flexible; });
        const double all = open_.squaredNorm();
        for (std::size_t a = 0; a < some.size(); ++a) {
            for (std::size_t b = a + 1; b < some.size() && !late(); ++b) {
                if (terms_[some[a]].kind() == terms_[some[b]].kind()) continue;
                const auto columns = columns_of({some[a], some[b]});
                const Eigen::MatrixXd gram = columns.transpose() * columns;
                const Eigen::VectorXd right = columns.transpose() * open_;
                const Eigen::VectorXd c = gram.ldlt().solve(right);
                const double together = 2 * c.dot(right) - c.dot(gram * c);
                const double best = std::max(explained_[some[a]], explained_[some[b]]);
                const bool is_worth = together > min_of_pair * best || all - together < rest_of_pair * (all - best);
                if (std::isfinite(together) && is_worth) {
                    found.push_back({{some[a], some[b]}, {}, share(together)});
                }
            }
        }
        std::stable_sort(found.begin(), found.end(), by_share);
        // Pairs of the same names say the same about the system: the best shape of each stays. What has no name is its shape.
        const auto name_of = [&](std::size_t i) {
            return terms_[i].name == nameless_term ? terms_[i].kind() : terms_[i].name;
        };
        std::set<std::string> named;
        std::erase_if(found, [&](const ScreenedTerms& pair) {
            return !named.insert(name_of(pair.terms[0]) + "+" + name_of(pair.terms[1])).second;
        });
        if (found.size() > max_pairs) found.resize(max_pairs);
        for (auto& pair : found) {
            const std::size_t i = pair.terms[0], j = pair.terms[1];
            Eigen::VectorXd coefficients;
            solved(columns_of({i, j}), coefficients);
            pair.starts = {started(terms_[i], coefficients.data()),
                           started(terms_[j], coefficients.data() + effect_[i].cols())};
        }
        return found;
    }

    // After singles().
    std::vector<ScreenedTerms> sums(const std::function<bool()>& late) const {
        std::map<std::string, std::vector<std::size_t>> of; // each derivative and output: the best term of each form
        for (const std::size_t i : best_of_each_form()) {
            if (!terms_[i].variables.empty() && !terms_[i].is_flexible) of[terms_[i].equation].push_back(i);
        }
        std::vector<ScreenedTerms> found;
        for (const auto& [equation, some] : of) {
            std::set<std::string> variables;
            for (const std::size_t i : some) variables.insert(terms_[i].variables.begin(), terms_[i].variables.end());
            for (auto a = variables.begin(); a != variables.end(); ++a) {
                for (auto b = std::next(a); b != variables.end() && !late(); ++b) {
                    std::vector<std::size_t> own;
                    for (const std::size_t i : some) {
                        const auto is_own = [&](const std::string& name) { return name == *a || name == *b; };
                        if (std::ranges::all_of(terms_[i].variables, is_own)) own.push_back(i);
                    }
                    add_best_sums(own, found);
                }
            }
        }
        std::stable_sort(found.begin(), found.end(), by_share);
        std::set<std::set<std::size_t>> known; // functions of one variable belong to several pairs
        std::erase_if(found, [&](const ScreenedTerms& sum) {
            return !known.insert({sum.terms.begin(), sum.terms.end()}).second;
        });
        if (found.size() > max_sums) found.resize(max_sums);
        for (auto& sum : found) {
            Eigen::VectorXd coefficients;
            solved(columns_of(sum.terms), coefficients);
            Eigen::Index place = 0;
            for (const std::size_t i : sum.terms) {
                sum.starts.push_back(started(terms_[i], coefficients.data() + place));
                place += effect_[i].cols();
            }
        }
        return found;
    }

  private:
    // Its values where one amplitude is a share of what it starts with and the others are neutral.
    static std::vector<double> probe(const SystemTerm& term, std::size_t amplitude, double share) {
        std::vector<double> own;
        for (std::size_t p = 0; p < term.parameters.size(); ++p) {
            const double start = term.parameters[p].start;
            if (p >= term.amplitudes) {
                own.push_back(start);
            } else {
                own.push_back(p == amplitude ? term.neutral[p] + share * (start - term.neutral[p]) : term.neutral[p]);
            }
        }
        return own;
    }

    // `first`: the errors with the whole of this amplitude, where they are known.
    void simulate(std::size_t i, std::size_t amplitude, const std::vector<double>* first) {
        const SystemTerm& term = terms_[i];
        // An effect far larger than the errors, such as that of a negative damping over a long record, says nothing to first
        // order about one as large as they are: then with less of the amplitude.
        double share = 1;
        for (int attempt = 0; attempt < max_probe_sizes; ++attempt) {
            std::vector<double> there;
            if (attempt == 0 && first) {
                there = *first;
            } else {
                const auto own = probe(term, amplitude, share);
                there = errors(extended(model_, term, own), more_values(model_, values_, own));
            }
            if (there.size() != samples_) {
                share *= 0.01;
                continue;
            }
            const Eigen::VectorXd moved = error_ - thinned(there); // what it adds to the outputs
            if (moved.norm() < 1e-9 * std::sqrt(static_cast<double>(error_.size()))) break;
            const double excess = moved.norm() / (too_large * error_.norm());
            if (excess > 1 && attempt + 1 < max_probe_sizes) {
                share *= 0.3 / excess;
                continue;
            }
            // What free values do as well is not told apart from them.
            const Eigen::VectorXd left = rest(moved);
            if (left.norm() > told_apart * moved.norm()) {
                effect_[i].col(static_cast<Eigen::Index>(amplitude)) = left / share;
            }
            break;
        }
    }

    // The errors with each amplitude of some terms: all of these are in one model, and all but one of each lane are neutral. Nothing of
    // those that add states or hold something at rest, of delays, which would take the others' time, and of limits, which are neutral
    // only where nothing else moves what they limit.
    std::vector<std::vector<std::vector<double>>> effects_together(const std::vector<std::size_t>& pack) const {
        std::vector<std::vector<std::vector<double>>> found(pack.size());
        if (fit_.substeps() == 0) return found;
        SystemModel more = model_;
        std::vector<double> values = values_;
        struct Place {
            std::size_t in_pack, first_value;
        };
        std::vector<Place> places;
        for (std::size_t n = 0; n < pack.size(); ++n) {
            const SystemTerm& term = terms_[pack[n]];
            const auto neutral = probe(term, term.amplitudes, 0);
            SystemModel with_it = extended(more, term, neutral);
            const bool is_alone = with_it.equations.states.size() > more.equations.states.size() ||
                                  with_it.equations.contacts.size() > more.equations.contacts.size() ||
                                  term.name == "delay" ||
                                  std::ranges::any_of(term.neutral, [](double value) { return value != 0; });
            if (is_alone) continue;
            places.push_back({n, more.parameters.size()});
            values = more_values(more, values, neutral);
            more = std::move(with_it);
        }
        if (places.empty()) return found;
        const auto lanes = LaneFit::of(fit_, more, values, fit_.substeps());
        if (!lanes) return found;
        std::vector<std::vector<double>> sets;
        for (const auto& place : places) {
            const SystemTerm& term = terms_[pack[place.in_pack]];
            for (std::size_t a = 0; a < term.amplitudes; ++a) {
                sets.push_back(values);
                sets.back()[place.first_value + a] = term.parameters[a].start;
            }
        }
        auto errors = lanes->errors(sets);
        auto next = errors.begin();
        for (const auto& place : places) {
            auto& own = found[place.in_pack];
            const auto end = next + static_cast<std::ptrdiff_t>(terms_[pack[place.in_pack]].amplitudes);
            // Where a run fails it may be the others' fault.
            if (std::all_of(next, end, [&](const auto& one) { return one.size() == samples_; })) {
                own.assign(std::make_move_iterator(next), std::make_move_iterator(end));
            }
            next = end;
        }
        return found;
    }

    // Steps that follow the model are short enough for the small effect of a term too, unless it is faster than all else. A lag or a mode
    // may be.
    std::vector<double> errors(const SystemModel& more, const std::vector<double>& values) const {
        const bool has_more = more.equations.states.size() > model_.equations.states.size();
        for (const SystemFit* fit : {&fit_, &finer_}) {
            auto there = fit->errors(more, values);
            if (there.size() != samples_) continue;
            if (!has_more || (error_ - thinned(there)).norm() < runs_away * error_.norm()) return there;
        }
        return careful_.errors(more, values);
    }

    static bool by_share(const ScreenedTerms& a, const ScreenedTerms& b) { return a.explained > b.explained; }
    // The best sum of two of these terms, and of three, where each explains much of what fewer leave.
    void add_best_sums(const std::vector<std::size_t>& some, std::vector<ScreenedTerms>& found) const {
        const Eigen::MatrixXd columns = columns_of(some), gram = columns.transpose() * columns;
        const Eigen::VectorXd right = columns.transpose() * open_;
        std::vector<Eigen::Index> begin(1, 0);
        for (const std::size_t i : some) begin.push_back(begin.back() + effect_[i].cols());
        const auto explained = [&](const std::vector<std::size_t>& places) {
            std::vector<Eigen::Index> own;
            for (const std::size_t n : places) {
                for (Eigen::Index c = begin[n]; c < begin[n + 1]; ++c) own.push_back(c);
            }
            const Eigen::MatrixXd g = gram(own, own);
            const Eigen::VectorXd r = right(own), c = g.ldlt().solve(r);
            const double squares = 2 * c.dot(r) - c.dot(g * c);
            return std::isfinite(squares) ? squares : 0;
        };
        double least = 0; // that the next longer one has to explain
        const auto add_best = [&](const std::vector<std::size_t>& best, double squares) {
            if (squares < least || best.empty()) return;
            ScreenedTerms sum{.terms = {}, .starts = {}, .explained = share(squares)};
            for (const std::size_t n : best) sum.terms.push_back(some[n]);
            found.push_back(std::move(sum));
        };
        const double all = open_.squaredNorm();
        for (const std::size_t i : some) least = std::max(least, explained_[i]);
        least = all - rest_of_sum * (all - least);
        std::vector<std::size_t> two, three;
        double of_two = 0, of_three = 0;
        for (std::size_t i = 0; i < some.size(); ++i) {
            for (std::size_t j = i + 1; j < some.size(); ++j) {
                if (const double squares = explained({i, j}); squares > of_two) {
                    of_two = squares;
                    two = {i, j};
                }
                for (std::size_t k = j + 1; k < some.size(); ++k) {
                    if (const double squares = explained({i, j, k}); squares > of_three) {
                        of_three = squares;
                        three = {i, j, k};
                    }
                }
            }
        }
        add_best(two, of_two);
        least = all - rest_of_sum * (all - of_two);
        add_best(three, of_three);
    }

    double share(double squares) const { return squares / std::max(error_.squaredNorm(), 1e-300); }

    Eigen::VectorXd thinned(const std::vector<double>& errors) const {
        Eigen::VectorXd rows(static_cast<Eigen::Index>((errors.size() + stride_ - 1) / stride_));
        for (Eigen::Index k = 0; k < rows.size(); ++k) rows[k] = errors[static_cast<std::size_t>(k) * stride_];
        return rows;
    }

    Eigen::MatrixXd free_directions(const std::vector<double>& errors) const {
        const Eigen::MatrixXd full = fit_.jacobian(model_, values_, errors);
        Eigen::MatrixXd free(error_.size(), full.cols());
        for (Eigen::Index c = 0; c < full.cols(); ++c) {
            for (Eigen::Index k = 0; k < error_.size(); ++k) {
                free(k, c) = full(k * static_cast<Eigen::Index>(stride_), c);
            }
        }
        return basis_of(std::move(free));
    }

    Eigen::VectorXd rest(const Eigen::VectorXd& v) const { return v - basis_ * (basis_.transpose() * v); }

    double solved(const Eigen::MatrixXd& columns, Eigen::VectorXd& coefficients) const {
        coefficients = Eigen::VectorXd::Zero(columns.cols());
        if (columns.cols() == 0 || !(columns.norm() > 0)) return 0;
        Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(columns);
        qr.setThreshold(1e-8);
        coefficients = qr.solve(open_);
        return open_.squaredNorm() - (open_ - columns * coefficients).squaredNorm();
    }

    // The amplitudes that the coefficients ask for, within bounds.
    static std::vector<double> started(const SystemTerm& term, const double* coefficients) {
        std::vector<double> values;
        for (std::size_t p = 0; p < term.parameters.size(); ++p) {
            const auto& parameter = term.parameters[p];
            double value = parameter.start;
            if (p < term.amplitudes) {
                value = term.neutral[p] + coefficients[p] * (parameter.start - term.neutral[p]);
            }
            values.push_back(std::clamp(value, parameter.low, parameter.high));
        }
        return values;
    }

    std::vector<std::size_t> best_of_each_form() const {
        std::map<std::string, std::size_t> best;
        for (std::size_t i = 0; i < terms_.size(); ++i) {
            if (effect_[i].cols() == 0 || !(effect_[i].norm() > 0)) continue;
            const auto [place, is_new] = best.try_emplace(terms_[i].form(), i);
            if (!is_new && explained_[i] > explained_[place->second]) place->second = i;
        }
        std::vector<std::size_t> places;
        for (const auto& [form, i] : best) places.push_back(i);
        std::sort(places.begin(), places.end());
        return places;
    }

    Eigen::MatrixXd columns_of(const std::vector<std::size_t>& some) const {
        Eigen::Index count = 0;
        for (const std::size_t i : some) count += effect_[i].cols();
        Eigen::MatrixXd columns(error_.size(), count);
        count = 0;
        for (const std::size_t i : some) {
            columns.middleCols(count, effect_[i].cols()) = effect_[i];
            count += effect_[i].cols();
        }
        return columns;
    }

    const SystemModel& model_;
    const std::vector<double>& values_;
    const std::vector<SystemTerm>& terms_;
    const SystemFit& fit_;
    SystemFit finer_;   // a quarter of its steps
    SystemFit careful_; // finds how short steps have to be
    std::size_t samples_, stride_;
    Eigen::VectorXd error_;
    Eigen::MatrixXd basis_; // of what free values can do
    Eigen::VectorXd open_;  // what they leave of the errors
    std::vector<Eigen::MatrixXd> effect_;
    std::vector<double> explained_; // by each term alone
};

} // namespace

namespace {

Screen screen_of(const SystemModel& model, const std::vector<double>& values, const std::vector<double>& errors,
                 const std::vector<SystemTerm>& terms, const SystemFit& fit, const RunControl& control,
                 const std::function<bool()>& late) {
    Screen screen(model, values, errors, terms, fit);
    const auto packs = screen.packs();
    for_each_index(packs.size(), control, fmt::format("screening {} terms", terms.size()), [&](std::size_t n) {
        if (!late()) screen.simulate(packs[n]);
    });
    return screen;
}

} // namespace

std::vector<ScreenedTerms> screened_singles(const SystemModel& model, const std::vector<double>& values,
                                            const std::vector<double>& errors, const std::vector<SystemTerm>& terms,
                                            const SystemFit& fit, const RunControl& control,
                                            const std::function<bool()>& late) {
    return screen_of(model, values, errors, terms, fit, control, late).singles();
}

Screening screened_terms(const SystemModel& model, const std::vector<double>& values, const std::vector<double>& errors,
                         const std::vector<SystemTerm>& terms, const SystemFit& fit, const RunControl& control,
                         const std::function<bool()>& late) {
    Screen screen = screen_of(model, values, errors, terms, fit, control, late);
    Screening found;
    found.singles = screen.singles();
    found.pairs = screen.pairs(late);
    found.sums = screen.sums(late);
    return found;
}

} // namespace tribode
