#pragma once
#include "tribode/script/equation_recorder.hpp"
#include "tribode/script/lua_state.hpp"
#include "tribode/system/equations.hpp"

#include <map>
#include <optional>
#include <unordered_map>

namespace tribode {

// Ready parts of systems: friction, impact, play and the like, whose modes need not be written by hand. In Lua they are made by
// the functions of tb.parts, which docs/systems.md describes, and put among the `parts` of a system. Their options are functions
// of the variables of that system.

void add_ready_parts(LuaState& lua); // tb.parts

// Those of one system that is being read.
class ReadyParts {
  public:
    ReadyParts(lua_State* lua, Expressions& graph) : lua_(lua), graph_(graph) {}

    // Whether there is one at the index of the stack; then it gets variables in `made`. [-0, +0]
    bool declare(const std::string& name, int index, Equations& made);
    // What others see of them, by name.
    std::vector<std::pair<std::string, Term>> outputs() const;

    // The functions among their options, once all variables are known. [-0, +0]
    void record(EquationRecorder& recorder);

    // The outputs that follow from variables and rates of change at once.
    void define(std::unordered_map<Term, Term>& definition) const;

    // The outputs that do not, and the events, once all parts are connected: `known` is what was put in for their variables.
    void close(Equations& made, const Expressions::Replacement& known);

  private:
    struct Kind;
    static const std::vector<Kind>& kinds();
    friend void add_ready_parts(LuaState& lua);

    struct Part {
        const Kind* kind = nullptr;
        std::string name, unit;
        Term output = 0, mode = 0, held = 0; // variables; held: of what has play
        std::vector<int> references;         // of functions in the registry
        std::map<std::string, Recorded> options;

        Term operator[](const char* key) const { return options.at(key).term; }
        bool has(const char* key) const { return options.contains(key); }
    };

    Term in_mode(const Part& part, double mode);
    Term half_width(const Part& part) const;
    double value_at_start(Term term, const Equations& made) const;
    void check(const Part& part, const Equations& made) const;
    void close_play(const Part& part, Equations& made, std::vector<Equations::When>& whens);
    void close_relay(const Part& part, std::vector<Equations::When>& whens);
    void close_backlash(const Part& part, std::vector<Equations::When>& whens);
    Term pressed(const Part& part, double side) const;
    Term level(const Part& part) const;

    lua_State* lua_;
    Expressions& graph_;
    std::vector<Part> parts_;
};

} // namespace tribode
