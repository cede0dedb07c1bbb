#pragma once
#include "tribode/script/symbols.hpp"

namespace tribode {

// tb.table1 and tb.table2: tables as functions of numbers and of symbolic values.
void add_lookups(LuaState& lua, const std::shared_ptr<Symbols>& symbols);

} // namespace tribode
