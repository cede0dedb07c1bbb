#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/diagnosis/system_terms.hpp"

#include <functional>
#include <vector>

namespace tribode {

// One term or several that a model may lack, and how a fit of them begins.
struct ScreenedTerms {
    std::vector<std::size_t> terms;          // places in the list that was screened
    std::vector<std::vector<double>> starts; // of the parameters of each
    double explained = 0;                    // share of the squared errors, to first order
    bool is_alike = false;                   // what it explains is nearly what a better single one does
};

struct Screening {
    std::vector<ScreenedTerms> singles, pairs; // what explains most first
    std::vector<ScreenedTerms> sums;           // of two or three functions of the same two variables
};

// What each term, and each two of them, would explain of the errors beside a move of all free values, to first order: each
// amplitude is simulated once, at its start. Pairs that explain little more than the better of the two are left out. A function of two
// variables that the library lacks is sought as a sum: of all sums of two and of three functions of these variables in one
// derivative or output, the best.
// `errors`: of the model at these values, over the part that `fit` counts. `late`: ends it, with what is known.
Screening screened_terms(const SystemModel& model, const std::vector<double>& values, const std::vector<double>& errors,
                         const std::vector<SystemTerm>& terms, const SystemFit& fit, const RunControl& control,
                         const std::function<bool()>& late);
// The same of each term alone.
std::vector<ScreenedTerms> screened_singles(const SystemModel& model, const std::vector<double>& values,
                                            const std::vector<double>& errors, const std::vector<SystemTerm>& terms,
                                            const SystemFit& fit, const RunControl& control,
                                            const std::function<bool()>& late);

} // namespace tribode
