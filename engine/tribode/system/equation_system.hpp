#pragma once
#include "tribode/hybrid/piecewise_affine.hpp"
#include "tribode/system/compiled_c.hpp"
#include "tribode/system/equations.hpp"
#include "tribode/system/root_finder.hpp"
#include "tribode/system/tape.hpp"

#include <map>
#include <set>

namespace tribode {

// Equations as a hybrid system: parameters are put in as numbers, everything is differentiated and made into tapes.
//
// Relations. Each a < b and a <= b that depends on t or x, is in a rate or in the condition of a `when`, and not
// below no_event, is an event: its value is held between events, and a guard is positive while it is right. Where the
// guard crosses zero, the value changes. So a branch (select) changes at a located instant and never within a step, and
// outputs take relations as they are. A guard is watched only where its relation matters: not in the branch of a select
// that the discrete state closes, not behind the false half of an `all`. Below a function that has values on one side of
// zero only, as in sqrt(max(h, 0)), the branch follows its operands at once: held, it would have no value where a step
// leads beyond the instant that is still to be located.
//
// Roundings. A floor in such a place is an event too: its value is held, and two relations watch its operand. It rises where
// the operand goes beyond the next whole number, falls where it goes below its own, and is taken anew where a reset
// changes the operand.
//
// What was before. A term below `before` is the value that it had when the present instant began: before a sample sets anything
// or relations change. So an event can tell whether something has come to where it is by a jump, whatever has made it jump.
//
// An event. The order of things at one instant is:
//
//     the relations whose guards crossed change, all together
//     repeat, at most max_rounds times:
//         conditions := those of all `when`s
//         the first `when` in declared order whose condition holds and did not when last looked at: carry it out;
//             relations whose operands it changed, or which have come to matter, are taken anew
//         none: end
//     relations that changed above, if the motion has turned away from the side they changed to: change back
//
// So an event that an earlier one of the same instant has taken away does not happen, and one that it has caused does.
// A relation that is taken anew is compared as it is written; operands that differ by rounding of their terms, of their
// states and of the time are equal. One that has just changed compares operands that are equal, but for rounding: it
// keeps the side it changed to, unless what has been carried out leaves the surface at rest under a push towards that
// side, or moving away from it: then it is ready to change again. So a ball that is reflected, or put, onto the
// floor is above it, however the floor's height rounds. What is true at the start is no event, unless the `when` says so.
// A sample does the same after its clock's values are set. The subject of an entry of the event log is the place of its `when`, from 0.
//
// Algebraic variables follow from states, discrete variables and held relations, so after each change at an instant they
// are solved for again. A relation of theirs that is then on its other side changes, and they are solved for again,
// until all agree. How far off the solution may be counts as rounding, and at an event also how far it was off before.
//
// Sensitivities (with_sensitivities()). Where a relation crosses zero, dt/dp = -g_p / g', with g_p and g' the derivatives of its
// margin by the parameter, along the run, and by time. The derivatives of all that happens at the instant are those with its
// time: before it s becomes s + x' dt/dp, behind it s - x' dt/dp, with x' of before and behind. So an event may set what it
// likes, cause others, or only open a branch. At samples and at the start dt/dp is zero. Where a relation touches zero
// only, or several cross at once that come apart with a parameter, there is no derivative, and the run ends with NoSolution.
//
// The system is affine where all rates and guards are affine in x, with coefficients that do not depend on t, plus a
// polynomial in t of degree 3 at most, whatever d is. Then the exact integrator runs it.
class EquationSystem final : public HybridSystem, public PiecewiseAffine {
  public:
    static constexpr int max_rounds = 100;

    // Throws InputError where a name stands twice, a clock has no period, a term depends on a foreign variable, the algebraic
    // equations are structurally singular.
    explicit EquationSystem(Equations equations);

    const std::vector<StateVariable>& states() const override { return variables_; }
    const std::vector<SampleClock>& clocks() const override { return clocks_; }
    // The last one crosses where events cause each other without end.
    std::size_t guard_count() const override { return relations_.size() + (has_endless_guard() ? 1 : 0); }
    SystemState initial_state() const override { return initial_state(0); }
    // Start values, at another time [s], not negative. Throws NoSolution.
    SystemState initial_state(double t) const;
    void derivative(double t, std::span<const double> x, const DiscreteState& d, std::span<double> dxdt) const override;
    bool rates(double t, std::span<const double> x, const DiscreteState& d, std::span<double> dxdt) const override;
    bool jacobian(double t, std::span<const double> x, const DiscreteState& d, std::span<double> matrix) const override;
    const SparsityPattern* jacobian_pattern() const override { return &jacobian_pattern_; }
    void sparse_jacobian(double t, std::span<const double> x, const DiscreteState& d,
                         std::span<double> entries) const override;
    void guards(double t, std::span<const double> x, const DiscreteState& d, std::span<double> g) const override;
    bool encloses_guards() const override { return true; }
    void enclose_guards(const Enclosure& t, std::span<const Enclosure> x, const DiscreteState& d,
                        std::span<Enclosure> g) const override;
    bool depends_on_time_alone(GuardId guard) const override {
        return guard < relations_.size() && relations_[guard].of_time_alone;
    }
    EventEffect on_crossing(GuardId guard, SystemState& state, EventLog& log) const override;
    EventEffect on_crossings(std::span<const GuardId> guards, SystemState& state, EventLog& log) const override;
    EventEffect on_sample(ClockId clock, long k, SystemState& state) const override;
    const PiecewiseAffine* piecewise_affine() const override { return this; }
    std::optional<std::string> why_not_affine() const override { return why_not_affine_; }
    AffineForm affine_form(const DiscreteState& d) const override;
    void append_affine_key(const DiscreteState& d, AffineKey& key) const override;
    bool has_varying_input(const DiscreteState&) const override { return varies_; }
    void rate_coefficient(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                          std::span<double> coefficient) const override;
    void guard_coefficient(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                           std::span<double> coefficient) const override;
    bool ends_run(const SystemState& state) const override { return memory(*state.discrete).stopped; }
    std::string guard_name(GuardId guard, const SystemState& state) const override;

    // From now on what a run evaluates most often is machine code, with the same bits. Throws Error where that cannot
    // be had; then the tapes stay. Above max_compiled instructions it is not tried: a compiler takes many seconds then.
    static constexpr std::size_t max_compiled = 5'000;
    void compile(const CCompiler& compiler);

    // One value per output of the equations.
    void outputs(const SystemState& state, std::span<double> y) const;

    // The places of the `when`s that the last sample made true: on_sample has no log.
    std::span<const int> fired_by_sample(const SystemState& state) const { return memory(*state.discrete).fired; }

    // The discrete variables, in the order of the equations.
    std::span<const double> discrete(const SystemState& state) const;
    // The same to write to, for what comes from outside; nothing is done about events.
    std::span<double> discrete_values(SystemState& state) const;

    // All that a run is at an instant, as lists of numbers by name, and back: a run that begins with it goes on as if it had
    // not stopped. Throws InputError where a list is missing or has another length, or a state is not finite.
    using Snapshot = std::map<std::string, std::vector<double>>;
    Snapshot snapshot(const SystemState& state) const;
    SystemState restored(const Snapshot& snapshot) const;

    const Equations& equations() const { return equations_; }
    std::size_t instruction_count() const { return rate_.instruction_count(); } // of the right side

  private:
    struct Memory;
    enum class Crossed : char { no, to_hold, to_fail };
    struct Rounding {
        std::vector<double> value, rate; // of the states; zero where they are no algebraic variables
    };

    // Of a relation, what bounds of its margin are found from: the parts of guard_ and rate_ that it needs.
    struct BoundedMargin {
        Tape margin, rates;               // of the states that the margin depends on
        std::vector<std::size_t> states;  // these, and
        std::vector<std::size_t> sources; // with those that their rates depend on
        Tape rates_of_sources;
    };

    // What is evaluated of all relations and `when`s, as bits.
    static constexpr unsigned char of_margins = 1, of_activity = 2, of_conditions = 4, everything = 7;

    // The work at one instant. Its memory serves one instant of a run after the other.
    struct Instant {
        SystemState* state = nullptr;
        Memory* memory = nullptr;
        std::vector<double> margins, active; // of the relations, as last looked at
        unsigned char stale = everything;    // what depends on something that has been written since
        long writes = 0;                     // of something that margins or dx/dt depend on
        std::vector<double> margins_before, active_before;
        std::vector<Crossed> crossed; // of the relations: at this instant
        std::vector<char> touched;    // whether their operands have been written since,
        std::vector<char> turned;     // or what the operands' rates of change depend on
        std::vector<double> rates, conditions, ahead;
        std::vector<double> uncertain; // of the states: how far off algebraic variables may be
        Rounding rounding;
        std::vector<Enclosure> inputs, rate_bounds, bounds;        // of the states; of dx/dt; of the margins,
        std::vector<long> bounded_at;                              // after so many writes
        std::vector<std::unique_ptr<const BoundedMargin>> bounded; // of many relations, made as they are needed
        std::vector<std::size_t> list, written;
        std::vector<char> counted; // of the list: whether nothing but its counter has changed
        std::vector<double> operands;
        std::vector<Enclosure> after;    // bounds of margins once all has been carried out
        std::vector<int> fired;          // by crossings
        std::vector<std::size_t> places; // written as guards crossed zero
        bool moved = false;              // whether x or dx/dt have changed
    };

    // Belongs to a state, whose copies begin with one of their own: what it holds outlives no instant.
    class OwnInstant {
      public:
        OwnInstant() = default;
        OwnInstant(const OwnInstant&) {}
        OwnInstant& operator=(const OwnInstant&) { return *this; }
        Instant& get() {
            if (!instant_) instant_ = std::make_unique<Instant>();
            return *instant_;
        }

      private:
        std::unique_ptr<Instant> instant_;
    };

    struct Memory final : DiscreteValues<Memory> {
        // Discrete variables; what is held of each relation, 1 or 0; the counters; what was before.
        std::vector<double> values;
        std::vector<double> conditions; // of each `when`, as last seen
        std::vector<double> active;     // of each relation, whether it matters now
        // Of each relation, how far it was beyond its zero when it was taken, by rounding: its guard is that much higher, so
        // that it begins at zero or above.
        std::vector<double> slack;
        std::vector<int> fired; // by the last sample; where they are endless, by the last events
        bool restless = false;  // max_rounds were not enough
        bool unsettled = false; // a condition that is true at the start is an event, still to be carried out
        bool stopped = false;   // an event that ends the run has been carried out
        std::vector<Equations::Function::Call> opened; // of each clock: of a function with memory, else empty
        OwnInstant instant;
    };
    static const Memory& memory(const DiscreteState& d) { return static_cast<const Memory&>(d); }
    // What of the memory a snapshot holds: the rest follows from it.
    static std::vector<std::pair<const char*, std::vector<double>*>> lists_of(Memory& memory);

    struct Relation {
        Term held = 0;       // a variable
        Term margin = 0;     // positive where the relation holds
        bool strict = false; // whether it fails at a margin of zero
        Term active = 0;     // where it matters
        bool of_time_alone = false, of_algebraic = false;
        std::vector<std::size_t> whens; // whose condition it is part of
        std::string text;
        // Of a floor: it is counted on by so much where the relation comes to hold, and so holds no longer.
        std::optional<std::size_t> counter;
        double step = 0;
    };

    struct Counter {
        Term held = 0;    // a variable
        Term operand = 0; // of the floor
    };

    struct Before {
        Term held = 0; // a variable
        Term of = 0;
    };

    // A matrix of terms without its zeros, column by column.
    struct Sparse {
        std::vector<MatrixPlace> entries;
        Tape tape;
    };

    // Algebraic variables that are solved for together.
    struct Block {
        std::vector<std::size_t> places; // among the states
        Tape residuals;
        Sparse jacobian;
    };

    // New values for places in (t, x, values of the memory).
    struct Update {
        std::string name; // of the event or clock
        std::vector<std::size_t> targets;
        Tape tape;
        unsigned char seen_by = 0; // what depends on the targets
        bool moves = false;        // whether one of them is a state or dx/dt depends on it
    };

    struct Call {
        std::vector<std::size_t> targets;
        Tape reads;
    };

    // What the values that a clock sets can change: the derivative; states, guards and conditions.
    struct Reach {
        bool motion = false, events = false;
    };

    // How the margin of a relation changes: by time, by the states it depends on, and in all by each parameter.
    struct RelationRate {
        std::vector<std::size_t> states;
        std::vector<Term> terms;
        Tape tape; // of the terms
    };

    // dt/dp of an event by each parameter; why it has none, in a sentence.
    struct EventShift {
        std::vector<double> by;
        std::string problem;
    };

    void put_in_parameters();
    void keep_what_was_before();
    void hold_relations();
    void differentiate_relations();
    Term add_counter(Term floor);
    bool find_conditions_read() const;
    void keep_in_domain(const std::vector<Term>& order, Expressions::Replacement& held);
    void mark_active();
    void join_clocks();
    void make_tapes();
    void recognize_affine();
    Tape tape_of(const std::vector<Term>& terms) const;
    Sparse sparse_jacobian(const std::vector<Term>& rows, const std::vector<Term>& columns, std::vector<Term>& terms);
    void make_blocks();
    SystemState start_values(double t) const;
    std::optional<std::string> solve_algebraic(double t, std::span<double> x, const Memory& values,
                                               std::vector<double>& uncertain) const;
    bool algebraic_rates(double t, std::span<const double> x, const Memory& values, std::span<double> dxdt,
                         Rounding& rounding) const;
    Update update_of(const std::string& name, const Equations::Assignments& set) const;
    std::size_t place_of(Term target) const;
    static bool write(const std::vector<std::size_t>& places, std::span<const double> values, SystemState& state);
    bool carry_out(const Update& update, SystemState& state) const;
    bool has_endless_guard() const { return !relations_.empty() || !equations_.whens.empty(); }
    std::size_t held_place(std::size_t relation) const { return 1 + equations_.states.size() + value_place(relation); }
    std::size_t value_place(std::size_t relation) const { return equations_.discrete.size() + relation; } // in values
    std::size_t counter_value_place(std::size_t counter) const { return value_place(relations_.size()) + counter; }
    std::size_t before_value_place(std::size_t before) const { return counter_value_place(counters_.size()) + before; }
    Instant& instant_of(SystemState& state) const;
    void begin_instant(SystemState& state, std::vector<std::size_t>& changed) const;
    void look(Instant& now) const;
    void mark_written(Instant& now, std::size_t place) const;
    void keep_active(Instant& now) const;
    std::vector<double> correct_algebraic(SystemState& state) const;
    void make_consistent(Instant& now) const;
    void find_rates(Instant& now, double t, std::span<const double> x) const;
    void enclose_margins(Instant& now, double t, std::span<const double> x, bool with_rates,
                         std::span<const std::size_t> relations) const;
    BoundedMargin make_bounded_margin(std::size_t relation) const;
    const BoundedMargin& bounded_margin(Instant& now, std::size_t relation) const;
    void bound_margins();
    void hold(Instant& now, std::size_t relation, bool holds) const;
    std::size_t count(Instant& now, std::size_t relation) const;
    void take_anew(Instant& now, std::span<const std::size_t> written) const;
    void settle(Instant& now, std::vector<int>& fired) const;
    bool turn_back(Instant& now, std::span<const GuardId> guards) const;
    void move_beyond(std::span<const GuardId> guards, SystemState& state) const;
    EventEffect carry_out_crossings(std::span<const GuardId> guards, SystemState& state, EventLog& log) const;
    EventShift shift_of(std::span<const GuardId> guards, const SystemState& state, std::span<const double> rates) const;
    Interval rate_ahead(Instant& now, std::size_t relation) const;
    void find_dependences();
    void find_active(SystemState& state) const;
    void put_matrix(const Sparse& sparse, std::size_t rows, const Memory& values, std::span<double> matrix) const;
    void affine_coefficient(const Sparse& matrix, const std::vector<Tape>& by_time, int n, double t0, double h,
                            std::span<const double> c, const DiscreteState& d, std::span<double> coefficient) const;
    std::set<Term> moving_terms(const std::vector<Term>& order) const;

    Equations equations_;
    std::vector<StateVariable> variables_;
    std::vector<SampleClock> clocks_;
    std::vector<Relation> relations_;
    std::vector<Counter> counters_;
    std::vector<Before> befores_;
    std::vector<Term> rates_, conditions_, guard_terms_;
    std::vector<Term> inputs_; // of every tape: t, x, values of the memory
    Tape rate_, output_, condition_;
    Tape guard_, active_;                        // of each relation: its margin, whether it matters
    Tape counted_;                               // of each counter: its operand
    Tape before_;                                // of each `before`: its operand
    std::vector<BoundedMargin> bounded_margins_; // of the relations; of none, where they are many
    // Of each place in inputs_: the relations whose margin depends on it; and those whose margin's rate of change does.
    std::vector<std::vector<std::size_t>> relations_of_, moved_relations_of_;
    bool reads_conditions_ = false;      // as they are written, after a crossing
    std::vector<char> may_turn_;         // of each relation: whether a `when` writes one of these
    std::vector<char> moves_;            // of each place: whether it is a state or dx/dt depends on it
    std::vector<unsigned char> seen_by_; // of each place: what depends on it
    Sparse jacobian_, guard_jacobian_;
    SparsityPattern jacobian_pattern_;
    std::vector<std::size_t> algebraic_;       // places among the states
    std::vector<Block> blocks_;                // of the algebraic variables, in the order in which they are solved for
    Tape algebraic_by_time_;                   // derivatives of the algebraic equations by t
    Expressions::Replacement differentiated_;  // parameters of sensitivities, by their values
    std::vector<RelationRate> relation_rates_; // of the relations, where there are sensitivities
    std::vector<Update> when_updates_, clock_updates_;
    std::vector<std::optional<Call>> calls_; // of the clocks
    std::vector<Reach> reach_;               // of the clocks

    std::optional<std::string> why_not_affine_;
    static constexpr int max_degree = 3;
    std::vector<Tape> rate_by_time_, guard_by_time_; // n-th derivatives by t, n = 1 .. max_degree
    bool varies_ = false;                            // b or h depend on t
    // What A and G depend on: modes and numbers, as places in values; and relations.
    std::vector<std::size_t> matrix_values_, matrix_relations_;
};

} // namespace tribode
