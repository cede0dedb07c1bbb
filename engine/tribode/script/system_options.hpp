#pragma once
#include "tribode/base/field_reader.hpp"
#include "tribode/script/lua_function.hpp"
#include "tribode/script/symbols.hpp"
#include "tribode/script/vector_names.hpp"
#include "tribode/system/equations.hpp"

#include <fmt/format.h>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// What the functions on systems of equations read from their options table, which is at index 1 of the stack.

// The system as it was given, its contacts open. [-0, +0]
Equations given_system(lua_State* lua, const char* function);

// The system, its contacts closed. [-0, +0]
Equations system_of(lua_State* lua, const char* function);

// All other options as plain data, without those of `special`. [-0, +0]
Json plain_options(lua_State* lua, std::initializer_list<std::string_view> special, const char* function);

// { name = number } into the variables of a list. [-0, +0]
template <class Variables, class Member>
void read_values(const Json& options, const char* key, Variables& variables, Member member, const char* function) {
    if (!options.contains(key)) return;
    std::vector<std::string> names;
    for (const auto& variable : variables) names.push_back(variable.name);
    const std::string where = fmt::format("{}: {}", function, key);
    const Json flat = flattened(options[key], names, where);
    FieldReader values(flat, where);
    for (auto& variable : variables) {
        variable.*member = values.number(variable.name, variable.unit, Allowed::finite, variable.*member);
    }
    values.finish();
}

// States and discrete variables.
std::vector<std::string> names_of_values(const Equations& equations);

// A mode is given by its name.
double discrete_value(FieldReader& values, const Equations::Discrete& discrete);

// The inputs: { u = 3, v = function(t) return … end, w = { sample_time_s =, values = {…}, … } }. [-0, +0]
void read_inputs(lua_State* lua, Equations& equations, const std::shared_ptr<Symbols>& symbols, double start,
                 const char* function);

// Of the names of discrete variables that hold samples of an input, what follows the name of the input.
bool is_held_part(std::string_view name);

// Where the functions of a system are called while it runs.
class RunningOn {
  public:
    RunningOn(Symbols& symbols, lua_State* lua) : symbols_(symbols), before_(symbols.running) { symbols.running = lua; }
    ~RunningOn() { symbols_.running = before_; }
    RunningOn(const RunningOn&) = delete;
    RunningOn& operator=(const RunningOn&) = delete;

  private:
    Symbols& symbols_;
    lua_State* before_;
};

} // namespace tribode
