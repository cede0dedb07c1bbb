#pragma once
#include "tribode/base/json.hpp"
#include "tribode/system/equations.hpp"

namespace tribode {

// Equations as text that another program reads back: the same graph, so the same numbers to the bit. Throws InputError where
// a clock calls a function from outside, which cannot be written down.
Json equations_json(const Equations& equations);

// Throws InputError where the text is none of the above.
Equations equations_from(const Json& json);

} // namespace tribode
