#pragma once
#include "tribode/effect/clues.hpp"
#include "tribode/effect/effect.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace tribode {

// One quantity that a fit may move.
struct FitParameter {
    std::string name;         // the effect's parameter: "dF", "harmonics[1].F"; any other where the form has `convert`
    double low, high;         // bounds, in SI
    bool logarithmic = false; // moved by factors; low > 0 then
    double step = 0;          // of differences: a factor less one, or in SI
};
FitParameter factor(std::string name, double low, double high); // moved by factors
FitParameter angle(std::string name);                           // [rad], any number of turns

// A form in which a fit looks for an effect. Some effects have several, simpler and richer ones.
struct EffectForm {
    std::string form = {}; // what tells it from the other forms
    // Parameters that this form fixes: a number, or the name of a choice. Those that are neither fixed nor fitted are what
    // they are where they are left out.
    std::vector<std::pair<std::string, std::variant<double, std::string>>> fixed = {};
    std::vector<FitParameter> parameters;
    // The effect's numbers, as Effect::numbers(), from the fitted values, where these are not parameters of the effect.
    void (*convert)(std::span<const double> values, std::span<double> numbers) = nullptr;

    std::vector<std::vector<double>> starts = {}; // likeliest first
    // Where the residual force does not tell a start: points to simulate, of which the best are taken. With `size`, the
    // parameter of that index is scaled to fit best by the response at the point.
    std::vector<std::vector<double>> probes = {};
    std::optional<std::size_t> size = {};
    std::size_t tried = 2; // of starts and probes, the best so many are fitted
    // A form of more parameters, with starts near these values, for where they leave more than noise.
    std::function<EffectForm(std::span<const double>)> richer = {};
    // Where a fit of the kind's only simpler kind begins that takes the place of this one at these values; empty: none does nearly
    // the same. Without this function it begins as elsewhere.
    std::function<std::vector<double>(std::span<const double>)> as_simpler = {};
    bool on_beginnings = false; // sought on beginnings too, which have fewer local minima
    bool rugged = false;        // chi square has many local minima over a whole record: fitted on beginnings that grow
};

// A form of a kind of effect, ready to be fitted: its names are resolved.
class Candidate : public EffectForm {
  public:
    // Throws std::logic_error where the form names a parameter that the kind does not have.
    Candidate(const EffectKind& kind, EffectForm described);

    const EffectKind& kind() const { return shape_.kind(); }
    // The effect at values of the parameters. Throws InputError where the kind does not allow one.
    Effect at(std::span<const double> values) const;
    // Its numbers there, as Effect::numbers(), allowed or not.
    std::vector<double> numbers_at(std::span<const double> values) const;
    std::shared_ptr<const Candidate> richer_near(std::span<const double> values) const; // nullptr: there is none

  private:
    Effect shape_;                    // with what is fixed
    std::vector<double> numbers_;     // of the shape
    std::vector<std::size_t> places_; // of each parameter in the numbers
};

// All forms of the effects wanted that this machine and record can show, starts within the bounds.
std::vector<Candidate> candidates(const Clues& clues, const std::function<bool(const EffectKind&)>& wanted);

} // namespace tribode
