#pragma once
#include "tribode/system/expressions.hpp"

#include <optional>

namespace tribode {

// The condition at whose change a function jumps though its operands go on: at the cut of atan(y, x), and at a pole of tan.
std::optional<Term> jump_of(Expressions& graph, Op op, Term a, Term b);

// Such a function as it goes on from where the condition has the value `held`: by a whole turn beyond the cut, as large as it
// becomes beyond the pole.
Term without_jump(Expressions& graph, Op op, Term a, Term b, Term held);

} // namespace tribode
