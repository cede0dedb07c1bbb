#pragma once
#include "tribode/system/equations.hpp"

#include <string>

namespace tribode {

// The equations as a Lua file that returns them, tb.system{...}: the same equations, parameters and start values, with the
// names of the parts inside it joined by "_". Numbers read back to the same doubles. `heading`: comment lines before it.
// Throws InputError where something has no text: functions of the script that clocks call, tables.
std::string equations_lua(const Equations& equations, const std::string& heading);

} // namespace tribode
