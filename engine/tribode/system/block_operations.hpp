#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace tribode {

// The same operation on numbers that stand side by side, eight or four at a time, to the bits of one after the other.
constexpr std::size_t smallest_block = 4;

// One number for all results, one behind another, or every second one.
enum class Step : std::uint8_t { none, one, two };

enum class BlockOperation : std::uint8_t {
    add,
    subtract,
    multiply,
    divide,
    negate,
    less, // conditions: 1 or 0
    less_equal,
    equal,
    select, // a != 0: b, else c
    lesser, // a < b: a, else b
    greater // a < b: b, else a
};

// The operands of result i stand at a[i], b[i] and c[i], or a[2 i], ...
struct BlockOperands {
    std::array<const double*, 3> first;
    std::array<Step, 3> step;
};

// `count` results, a multiple of the smallest block; operands of step two may be read one place beyond the last.
void operate_in_blocks(BlockOperation operation, const BlockOperands& operands, std::size_t count, double* results);

// factors[i] a[i] b[i], of which a sum is made in their order.
struct BlockSummand {
    const double* factors;
    std::array<const double*, 2> first;
    std::array<Step, 2> step;
};

void sum_in_blocks(std::span<const BlockSummand> summands, std::size_t count, double* results);

} // namespace tribode
