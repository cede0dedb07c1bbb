#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/diagnosis/system_screening.hpp"

#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace tribode {

// A model with the terms found so far, fitted to what is shown of the records, and what it makes of the rest.
struct SystemCandidate {
    SystemModel model;
    std::vector<double> values;
    std::vector<SystemTerm> terms; // all that it has beyond the first model
    std::vector<std::string> texts;
    std::vector<double> fitted;    // errors over what is shown
    std::vector<double> predicted; // over the rest
    Eigen::MatrixXd curvature;     // of the fitted errors, where it is known: see FoundMinimum
    std::size_t library = 1;       // from how many terms these were chosen
    std::size_t substeps = 0;      // of a sample, that its simulation needs; 0: not known
    // Whether the fitted part leaves nothing but white noise, and the whole records, to which it is fitted then, too. What
    // it would predict beyond them is off by what its values are, and not by what it lacks.
    bool is_noise = false;

    // The same model in other words, as a constant in a derivative and an offset of the input.
    bool equals(const SystemCandidate& other) const;

    // Whether it explains no more of the fitted errors of a model with fewer terms than the best of as many frequencies as were
    // looked at explains of errors at random that are correlated as those are. False where it has no frequency.
    bool is_chance_beside(const SystemCandidate& fewer) const;

    std::string names_from(std::size_t term) const; // "overflow in der(x1) of x1 and lag in input u"
    // What its errors would be on other records of this kind, rms: predicted errors as they are, fitted ones with what the
    // parameters take out of them. Where all are fitted, by the Bayesian information criterion [Schwarz 1978], extended by what
    // the best of many terms explains by chance [Chen 2008].
    double score() const;
};

// What the errors of candidates have in common.
struct SystemErrors {
    Stretches stretches;
    double noise = 0; // in the outputs over their scale, rms
};

// Looks for the terms that a model lacks.
class SystemSearch {
  public:
    // `scale`: of each measured output. All must outlive it. `late`: whether to end; fits end where they are.
    SystemSearch(const SystemModel& model, const std::vector<SystemRecord>& records, std::vector<double> scale,
                 std::function<bool()> late, const RunControl& control);

    // The model without anything added. Of the ways in which inputs may run between their samples the one that suits the
    // records best is kept. Throws InputError where the model cannot be simulated on a record.
    SystemCandidate begin();

    // The same for a model with what was found: the way that suited a model that lacked it may have made up for a part of it.
    void reconsider_inputs(SystemCandidate& candidate);

    // Fits of the likeliest terms and pairs of terms beside those of `current`, the best score first. To the best of the single
    // terms, screened again where each was fitted, a second one is sought: two terms that both move the free values far
    // show to first order only beside each other. Where none leaves noise alone, terms are also sought over segments of the records.
    // The way of the inputs that suits the best of them is kept.
    std::vector<SystemCandidate> next(const SystemCandidate& current);

    // Without the terms that others make unnecessary.
    SystemCandidate pruned(SystemCandidate candidate) const;

    // With terms of fewer parameters in the place of richer ones, where these do as well: a power law with an exponent of one is a dead
    // zone. Nothing where none does.
    std::optional<SystemCandidate> simplified(const SystemCandidate& candidate) const;

    // With the signs of the values that were given, where these suit as well: where only a product is told, both may have changed.
    SystemCandidate with_given_signs(SystemCandidate candidate) const;

    // With other terms in the place of some, one at a time, where these suit the others better: what was found first may have stood for
    // something else that was missing then. Nothing where none does.
    std::optional<SystemCandidate> exchanged(const SystemCandidate& candidate) const;

    SystemCandidate without(const SystemCandidate& candidate, std::size_t term) const; // not fitted

    // Without some terms, and with those of another candidate from this one on behind the others; not fitted.
    SystemCandidate with_others(const SystemCandidate& candidate, const std::set<std::size_t>& left_out,
                                const SystemCandidate& other, std::size_t first) const;

    // To what is shown, from its values; false where it cannot be simulated.
    bool fit(SystemCandidate& candidate) const;

    Interpolation interpolation() const { return between_; }
    std::vector<Interpolation> ways() const; // in which the inputs may run between their samples
    const std::vector<double>& scale() const { return scale_; }
    // To the whole records with the samples that count in the search, see thinned(): one of `every`; and to all samples.
    SystemFit fit_of_all() const { return {searched_, scale_, between_, whole_}; }
    SystemFit fit_of_all_samples(Interpolation between) const;
    std::size_t every() const { return searched_.front().every; }
    const std::vector<SystemRecord>& searched() const { return searched_; }
    SystemErrors errors() const; // of candidates
    bool late() const { return late_(); }

  private:
    struct Hypothesis {
        SystemCandidate from;
        ScreenedTerms terms;      // beside those of `from`
        bool is_followed = false; // its values are those of a fit to segments
    };

    void hide_parts();
    SystemCandidate with_fewer_samples(SystemCandidate candidate);
    void reconsider_inputs(std::vector<SystemCandidate>& found); // which are in the order of their scores
    SystemCandidate with_way_over_segments(SystemCandidate candidate);
    std::vector<Interpolation> first_ways() const;
    SystemFit fit_of_shown() const { return fit_of(shown_); }
    SystemFit fit_of(const std::vector<SystemRecord>& records, std::size_t substeps = 0) const {
        SystemFit made{records, scale_, between_, whole_};
        made.begin_search(substeps);
        return made;
    }
    // `found`: where this model ended before; false, too, where it ends there again.
    bool fit(SystemCandidate& candidate, int iterations, bool growing = false,
             const FoundMinimum* found = nullptr) const;
    void keep_signs(SystemModel& model, const std::vector<double>& given) const;
    bool fit_from_afar(SystemCandidate& candidate) const;
    void fit_whole(SystemCandidate& candidate, int iterations) const; // where white noise is all that is left then
    std::vector<SystemTerm> terms_beside(const SystemCandidate& current, bool with_nameless) const;
    SystemCandidate started(const Hypothesis& hypothesis, const std::vector<SystemTerm>& terms) const;
    std::optional<SystemCandidate> sized(SystemCandidate candidate) const;
    SystemCandidate with_given_values(SystemCandidate candidate) const;
    // `from_afar`: also from starts that do not begin where the model is without the terms.
    std::vector<SystemCandidate> fitted(const std::vector<Hypothesis>& list, const std::vector<SystemTerm>& terms,
                                        bool from_afar) const;
    std::vector<Hypothesis> deepened(const SystemCandidate& current, const std::vector<SystemCandidate>& found,
                                     const std::vector<SystemTerm>& terms) const;
    void add_friction_by_direction(const SystemCandidate& current, const std::vector<SystemTerm>& terms,
                                   std::vector<Hypothesis>& list) const;
    void add_timing(const SystemCandidate& one, const std::vector<SystemTerm>& terms, std::set<std::string>& forms,
                    std::vector<Hypothesis>& list) const;
    std::vector<SystemCandidate> flexible(const SystemCandidate& current, const Screening& screening,
                                          const std::vector<SystemTerm>& terms) const;
    std::vector<SystemCandidate> followed(const SystemCandidate& current) const;
    std::vector<ScreenedTerms> chosen(const Screening& screening, const std::vector<SystemTerm>& terms,
                                      bool from_afar) const;

    const SystemModel& first_;
    const std::vector<SystemRecord>& records_;
    std::vector<double> scale_;
    std::function<bool()> late_;
    const RunControl& control_;
    std::vector<SystemRecord> searched_; // the same, perhaps with fewer samples
    std::vector<SystemRecord> shown_;    // without what is hidden from the search
    std::vector<SystemRecord> hidden_;   // and with nothing else
    std::vector<std::size_t> whole_;
    bool is_followed_ = false; // the first model, by fixed steps
    Interpolation between_ = Interpolation::hold;
};

} // namespace tribode
