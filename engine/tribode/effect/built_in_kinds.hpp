#pragma once
#include "tribode/effect/effect.hpp"

namespace tribode {

// The kinds of effect/kinds/. The function is made at configuration, from the names of the files.
std::vector<const EffectKind*> built_in_kinds();

} // namespace tribode
