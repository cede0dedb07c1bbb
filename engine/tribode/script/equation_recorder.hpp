#pragma once
#include "tribode/script/called_functions.hpp"
#include "tribode/script/symbols.hpp"
#include "tribode/system/units.hpp"

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

struct lua_State;

namespace tribode {

// What a function of equations sees as its argument: names, with a dot for each part they belong to, and terms.
struct Scope {
    std::vector<std::string> names;
    std::vector<Term> terms;

    void add(const std::string& name, Term term) {
        names.push_back(name);
        terms.push_back(term);
    }
};

// `script.lua:7: ` of the function at `index`. [-0, +0]
std::string line_of(lua_State* lua, int index);

// One table `s` of a scope: nested by the dots, unknown names refused. [-0, +1]
void push_scope(lua_State* lua, const Scope& scope, const std::function<void(std::size_t)>& push_value);

// The table `s` of numbers at run time, without the refusals: it is made at each sample. [-0, +1]
void push_values(lua_State* lua, const Scope& scope, std::span<const double> values);

// What a function returned, by name.
struct Recorded {
    std::string name, unit;
    Term term = 0;
    std::string what = {};    // for messages, with its line
    Dimension dimension = {}; // of the term
    std::string advice = {};  // where it is not what is wanted
};

// Throws InputError where the term has another unit; `what` of the entry it is, as "the derivative".
void require_unit(const Recorded& entry, const Dimension& wanted, const char* what);

// Makes terms of Lua functions of equations. A function is called once on symbolic values, and then on numbers: where
// these say something else than what was recorded, it has a branch that cannot be, and is refused.
class EquationRecorder {
  public:
    // What the functions take: a table of all variables, or the only variable by itself.
    enum class Argument { table, value };

    EquationRecorder(lua_State* lua, Symbols& symbols, Argument argument = Argument::table)
        : lua_(lua),
          symbols_(symbols),
          argument_(argument),
          graph_(*symbols.graph),
          units_(graph_),
          called_(lua) {}

    ~EquationRecorder();
    EquationRecorder(const EquationRecorder&) = delete;
    EquationRecorder& operator=(const EquationRecorder&) = delete;

    // All of them, before the first function is recorded.
    void add(const std::string& name, Term term, const std::string& unit);
    const Scope& scope() const { return scope_; }

    // What the function on top of the stack returns: one value (`single`), or a table of them by name. [-1, +0]
    // Throws InputError, which begins with the line of the function and `what`.
    std::vector<Recorded> record(const std::string& what, bool single);

    // The variable of this name. Throws InputError where there is none.
    Recorded named(const std::string& name, const std::string& what);

  private:
    class Numbers;

    void push_symbols();
    void make_numbers();
    void push_numbers();
    void add_returned(int index, const std::string& name, const std::string& place, std::vector<Recorded>& list);
    void check_units(Recorded& entry, const std::string& what);
    std::vector<Recorded> returned(const std::string& what, const std::string& line, bool single);
    Term result_at(int index, const std::string& what);
    std::optional<double> number_returned(int result, const Recorded& entry, bool single) const;
    void compare(int function, const std::vector<Recorded>& recorded, const std::string& what, const std::string& line,
                 bool single);
    bool is_at_jump(Term root, const std::vector<Term>& inputs, const std::vector<double>& point) const;
    std::vector<Term> expressions_of_scope() const;
    [[noreturn]] void refuse_branch(const std::string& what, const std::string& line) const;

    lua_State* lua_;
    Symbols& symbols_;
    Argument argument_;
    Expressions& graph_;
    Units units_;
    CalledFunctions called_; // of the function that is recorded
    Scope scope_;
    std::unordered_map<Term, std::size_t> place_; // in the scope
    std::map<std::string, std::size_t> vectors_;  // their sizes
    // In the registry; LUA_NOREF: not made yet. The scope as symbolic values, at the first point of comparison, and as numbers_.
    int symbols_table_ = -2, first_table_ = -2, numbers_table_ = -2;
    std::shared_ptr<Numbers> numbers_;
};

} // namespace tribode
