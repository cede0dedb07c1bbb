#pragma once
#include "tribode/hybrid/enclosure.hpp"
#include "tribode/system/expressions.hpp"

#include <array>
#include <memory>

namespace tribode {

// Interval arithmetic, rounded outward: each result holds every value that the operation has on numbers of the
// operands, and every rate of change that it has where the operands change at the given rates (the chain rule)
// [Moore 2009]. Where an operand leaves the domain of a function, where the function jumps, or where a condition is
// undecided between branches, the rate is that of all numbers.
Enclosure apply(Op op, const Enclosure& a, const Enclosure& b, const Enclosure& c);

// A table at x, y on the sides `side` (Op::lookup), with its derivatives by x and y; null where they are zero.
using TableSlopes = std::array<std::shared_ptr<const LookupTable>, 2>;
Enclosure look_up(const LookupTable& table, const TableSlopes& slopes, const Enclosure& x, const Enclosure& y,
                  const Enclosure& side);

// factor a b, and sums, as the instructions of a tape have them.
Enclosure product(double factor, const Enclosure& a, const Enclosure& b);
Enclosure sum(const Enclosure& a, const Enclosure& b);

} // namespace tribode
