#pragma once
#include "tribode/hybrid/hybrid_system.hpp"

#include <optional>
#include <span>
#include <vector>

namespace tribode {

// x(t0 + s h) = sum terms_k s^k for 0 <= s <= 1: a method's own interpolation of one of its steps.
struct StepPolynomial {
    double t0 = 0, h = 0; // [s]
    std::size_t states = 0;
    int degree = 0;
    std::vector<double> terms; // (states x degree + 1)

    double* term(int k) { return terms.data() + static_cast<std::size_t>(k) * states; }
    const double* term(int k) const { return terms.data() + static_cast<std::size_t>(k) * states; }
    void resize(std::size_t state_count, int new_degree);
    void evaluate(double s, std::span<double> x) const; // Horner's scheme
    double time(double s) const { return t0 + s * h; }
    void begin_at(double t); // the same polynomial on [t, t0 + h]
};

// Finds where guards cross zero downward along a step's interpolation, not by their signs at the ends of the step but by
// bounds of each guard and of its rate of change over the whole of it. A guard that is above zero, or does not decrease,
// does not cross; one that decreases throughout crosses once or not at all; else the interval is halved [Moore 2009]. A
// system that encloses its guards (HybridSystem::enclose_guards) gives rigorous bounds: then no crossing is missed, however
// short, down to a few roundings of the time. For others the bounds come from Chebyshev interpolation of the guard,
// degree 8, its last coefficients taken as its error: then two opposite crossings between its nodes may be missed.
class EventSearch {
  public:
    explicit EventSearch(const HybridSystem& system);

    // Where a search came to: the first instant at which guards are below zero that were not before, or, where none
    // crosses, up to where that is certain.
    struct Found {
        double at;
        bool crosses;
    };

    // Of a step, s in [0, 1]. The guards that cross there, to rounding of the time, go to `crossed`, in declared order. A
    // step whose guards take very many pieces to follow is searched in part, so that it can be shortened.
    Found first_crossing(const StepPolynomial& step, const DiscreteState& d, std::vector<GuardId>& crossed);

    // Guards that depend on the time alone, before any step is taken; an instant in (t, t_end].
    Found next_time_event(double t, double t_end, std::span<const double> x, const DiscreteState& d);
    bool has_time_guards() const { return !time_guards_.empty(); }

    long guard_evaluations() const { return guard_evaluations_; }

  private:
    static constexpr int nodes = 8;                           // degree of the Chebyshev interpolation
    static constexpr int few_pieces = 256, max_pieces = 5000; // of one step

    struct Piece {
        std::vector<double> control; // Bernstein coefficients of the states on it, (states x degree + 1)
        std::vector<GuardId> open;   // guards that may cross on it
    };

    std::optional<double> search(std::size_t level, double low, double high, const DiscreteState& d,
                                 std::vector<GuardId>& crossed);
    void bound(const Piece& piece, double low, double high, const DiscreteState& d);
    void bound_by_samples(double low, double high, const DiscreteState& d);
    void guards_at(double s, const DiscreteState& d);
    void tighten(std::vector<GuardId>& open, double low, double high, const DiscreteState& d);
    void leave_out_zeros(const DiscreteState& d);
    std::optional<double> look_at_points(const DiscreteState& d, std::vector<GuardId>& crossed);
    double locate(GuardId guard, double low, double high, const DiscreteState& d);
    Piece& piece(std::size_t level);

    const HybridSystem& system_;
    const std::size_t guard_count_;
    const bool encloses_;
    std::vector<GuardId> time_guards_;
    const StepPolynomial* step_ = nullptr;
    bool only_time_ = false;
    int pieces_left_ = 0;
    int patience_ = max_pieces; // pieces of the next step, less where guards could not be told from zero
    double searched_to_ = 0;    // up to which nothing crosses, where pieces_left_ has run out
    std::vector<Piece> pieces_; // by level
    std::vector<Enclosure> states_, bounds_, enclosed_;
    std::vector<double> x_, g_, samples_; // samples_: (guards x nodes + 1)
    long guard_evaluations_ = 0;
};

} // namespace tribode
