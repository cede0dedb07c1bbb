#pragma once
#include "hybrid/hybrid_system.hpp"
#include "system/compiled_c.hpp"
#include "system/equations.hpp"
#include "system/tape.hpp"

#include <set>

namespace tribode {

// Equations as a hybrid system: parameters are put in as numbers, everything is differentiated and made into tapes.
//
// Relations. Each a < b and a <= b that depends on t or x, stands in a rate or in the condition of a `when`, and not
// below no_event, is an event: its value is held between events, and a guard is positive while it is right. Where the
// guard falls, the value changes. So a branch (select) changes at a located instant and never within a step, and
// outputs take relations as they are. A guard is watched only where its relation matters: not in the branch of a select
// that the discrete state closes, not behind the false half of an `all`.
//
// An event. Then the conditions are looked at, and each `when` whose condition was false and is true now is carried
// out, in declared order, on the values that those before it left. Where one changes the operands of a relation, or
// makes it matter, the relation is taken anew, exactly; one that compares what has just crossed, so that it agrees with
// the crossing. Again from the conditions, until none has become true; after
// most_rounds the run ends as chattering. What is true at the start is no event. A sample does the same after its
// clock's values are set. The subject of an entry of the event log is the place of its `when`, from 0.
//
// The system is affine where all rates and guards are affine in x, with coefficients that do not depend on t, plus a
// polynomial in t of degree 3 at most, whatever d is. Then the exact integrator runs it.
class EquationSystem final : public HybridSystem {
  public:
    static constexpr int most_rounds = 100;

    // Throws InputError where a name stands twice, a clock has no period, a term depends on a foreign variable.
    explicit EquationSystem(Equations equations);

    const std::vector<StateVariable>& states() const override { return variables_; }
    const std::vector<SampleClock>& clocks() const override { return clocks_; }
    std::size_t guard_count() const override { return relations_.size() + 1; }
    SystemState initial_state() const override;
    void derivative(double t, std::span<const double> x, const DiscreteState& d, std::span<double> dxdt) const override;
    bool jacobian(double t, std::span<const double> x, const DiscreteState& d, std::span<double> matrix) const override;
    void guards(double t, std::span<const double> x, const DiscreteState& d, std::span<double> g) const override;
    EventEffect on_crossing(GuardId guard, SystemState& state, EventLog& log) const override;
    EventEffect on_sample(ClockId clock, long k, SystemState& state) const override;
    std::optional<std::string> why_not_affine() const override { return why_not_affine_; }
    void affine_derivative(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                           std::span<double> coefficient) const override;
    void affine_guards(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                       std::span<double> coefficient) const override;
    std::optional<AffinePattern> affine_pattern(const DiscreteState& d) const override;
    std::string guard_name(GuardId guard, const SystemState& state) const override;

    // From now on what a run evaluates most often is machine code, with the same bits. Throws Error where that cannot
    // be had; then the tapes stay. Above most_compiled instructions it is not tried: a compiler takes many seconds then.
    static constexpr std::size_t most_compiled = 5'000;
    void compile(const CCompiler& compiler);

    // One value per output of the equations.
    void outputs(const SystemState& state, std::span<double> y) const;

    // The places of the `when`s that the last sample made true: on_sample has no log.
    std::span<const int> fired_by_sample(const SystemState& state) const { return memory(*state.discrete).fired; }

    // The discrete variables, in the order of the equations.
    std::span<const double> discrete(const SystemState& state) const;

    const Equations& equations() const { return equations_; }
    std::size_t instruction_count() const { return rate_.instruction_count(); } // of the right side

  private:
    struct Memory final : DiscreteValues<Memory> {
        std::vector<double> values;     // the discrete variables, then what is held of each relation, 1 or 0
        std::vector<double> conditions; // of each `when`, as last seen
        std::vector<double> active;     // of each relation, whether it matters now
        // Of each relation, when it last crossed or was taken anew [s], and its margin then. As long as nothing moves, it
        // is right as it is, though the located instant may lie a rounding before the crossing.
        std::vector<double> taken, taken_margin;
        std::vector<int> fired; // by the last sample
        bool restless = false;  // most_rounds were not enough
    };
    static const Memory& memory(const DiscreteState& d) { return static_cast<const Memory&>(d); }

    struct Relation {
        Term held = 0;       // a variable
        Term margin = 0;     // positive where the relation holds
        bool strict = false; // whether it fails at a margin of zero
        Term active = 0;     // where it matters
        // Others that compare the same two terms, and whether they hold on the side on which this one does.
        std::vector<std::pair<std::size_t, bool>> twins;
        std::string text;
    };

    // A matrix of terms without its zeros.
    struct Sparse {
        struct Entry {
            std::size_t row, column;
        };
        std::vector<Entry> entries;
        Tape tape;
    };

    // New values for places in (t, x, values of the memory).
    struct Update {
        std::string name; // of the event or clock
        std::vector<std::size_t> targets;
        Tape tape;
    };

    struct Call {
        std::vector<std::size_t> targets;
        Tape reads;
    };

    // What the values that a clock sets can change: the derivative; states, guards and conditions.
    struct Reach {
        bool motion = false, events = false;
    };

    void put_in_parameters();
    void hold_relations();
    void mark_active();
    void join_clocks();
    void make_tapes();
    void recognize_affine();
    Tape tape_of(const std::vector<Term>& terms) const;
    Sparse sparse_jacobian(const std::vector<Term>& rows, std::vector<Term>& terms);
    Update update_of(const std::string& name, const Equations::Assignments& set) const;
    std::size_t place_of(Term target) const;
    static bool write(const std::vector<std::size_t>& places, std::span<const double> values, SystemState& state);
    bool carry_out(const Update& update, SystemState& state) const;
    void margins_of(const SystemState& state, std::vector<double>& margins) const;
    void find_active(SystemState& state) const;
    void refresh_relations(const std::vector<double>& before, SystemState& state,
                           std::optional<std::size_t> crossed = std::nullopt) const;
    // Carries out what a `when` has come to hold for, until none comes any more; `fired`: their places.
    void settle(SystemState& state, std::vector<int>& fired, std::optional<std::size_t> crossed = std::nullopt) const;
    void affine_coefficient(const Sparse& matrix, const std::vector<Tape>& by_time, int n, double t0, double h,
                            std::span<const double> c, const DiscreteState& d, std::span<double> coefficient) const;
    std::set<Term> moving_terms(const std::vector<Term>& order) const;

    Equations equations_;
    std::vector<StateVariable> variables_;
    std::vector<SampleClock> clocks_;
    std::vector<Relation> relations_;
    std::vector<Term> rates_, conditions_, guard_terms_;
    std::vector<Term> inputs_; // of every tape: t, x, values of the memory
    Tape rate_, output_, condition_;
    Tape guard_, active_, margin_; // of each relation: its margin, whether it matters; margin_: both, in this order
    Sparse jacobian_, guard_jacobian_;
    std::vector<Update> when_updates_, clock_updates_;
    std::vector<std::optional<Call>> calls_; // of the clocks
    std::vector<Reach> reach_;               // of the clocks

    std::optional<std::string> why_not_affine_;
    static constexpr int most_degree = 3;
    std::vector<Tape> rate_by_time_, guard_by_time_; // n-th derivatives by t, n = 1 .. most_degree
    bool varies_ = false;                            // b or h depend on t
    // What A and G depend on: relations, modes and numbers, as places in values, and which number of the pattern each is
    // in: as its next digit to this base, or alone where that is 0.
    struct Digit {
        std::size_t place;
        double base;
        bool is_relation;
        std::size_t number = 0;
    };
    std::vector<Digit> pattern_;
    bool has_pattern_ = false; // they fit into a pattern, and nothing depends on t besides
};

} // namespace tribode
