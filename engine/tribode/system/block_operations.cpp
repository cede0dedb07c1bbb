#include "tribode/system/block_operations.hpp"
#include "tribode/base/lanes.hpp"

// GCC 12 takes a block whose numbers are all set to one for uninitialized, where it has AVX-512.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

namespace tribode {

namespace {

// Numbers are read and written by reference: as results they would depend on the instructions that the caller may use.
struct Eight {
    static constexpr std::size_t count = 8;
    using Numbers __attribute__((vector_size(64), aligned(8), may_alias)) = double;
    [[gnu::always_inline]] static void repeat(double x, Numbers& numbers) { numbers = Numbers{x, x, x, x, x, x, x, x}; }
    [[gnu::always_inline]] static void take_every_second(const Numbers& a, const Numbers& b, Numbers& numbers) {
        numbers = __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14);
    }
};

struct Four {
    static constexpr std::size_t count = 4;
    using Numbers __attribute__((vector_size(32), aligned(8), may_alias)) = double;
    [[gnu::always_inline]] static void repeat(double x, Numbers& numbers) { numbers = Numbers{x, x, x, x}; }
    [[gnu::always_inline]] static void take_every_second(const Numbers& a, const Numbers& b, Numbers& numbers) {
        numbers = __builtin_shufflevector(a, b, 0, 2, 4, 6);
    }
};

template <class Block>
[[gnu::always_inline]] inline const typename Block::Numbers& numbers_at(const double* place) {
    return *reinterpret_cast<const typename Block::Numbers*>(place);
}
template <class Block>
[[gnu::always_inline]] inline typename Block::Numbers& numbers_at(double* place) {
    return *reinterpret_cast<typename Block::Numbers*>(place);
}

template <class Block>
[[gnu::always_inline]] inline void load(const double* first, Step step, std::size_t i,
                                        typename Block::Numbers& numbers) {
    if (step == Step::none) {
        Block::repeat(*first, numbers);
    } else if (step == Step::one) {
        numbers = numbers_at<Block>(first + i);
    } else {
        Block::take_every_second(numbers_at<Block>(first + 2 * i), numbers_at<Block>(first + 2 * i + Block::count),
                                 numbers);
    }
}

template <class Block>
[[gnu::always_inline]] inline void operate(BlockOperation operation, const BlockOperands& operands, std::size_t i,
                                           double* results) {
    typename Block::Numbers a{}, b{}, c{};
    const typename Block::Numbers no{}, yes = 1 - no;
    typename Block::Numbers& y = numbers_at<Block>(results + i);
    load<Block>(operands.first[0], operands.step[0], i, a);
    if (operation == BlockOperation::negate) {
        y = -a;
        return;
    }
    load<Block>(operands.first[1], operands.step[1], i, b);
    switch (operation) {
    case BlockOperation::add: y = a + b; break;
    case BlockOperation::subtract: y = a - b; break;
    case BlockOperation::multiply: y = a * b; break;
    case BlockOperation::divide: y = a / b; break;
    case BlockOperation::less: y = a < b ? yes : no; break;
    case BlockOperation::less_equal: y = a <= b ? yes : no; break;
    case BlockOperation::equal: y = a == b ? yes : no; break;
    case BlockOperation::select:
        load<Block>(operands.first[2], operands.step[2], i, c);
        y = a != no ? b : c;
        break;
    case BlockOperation::lesser: y = a < b ? a : b; break;
    case BlockOperation::greater: y = a < b ? b : a; break;
    case BlockOperation::negate: break;
    }
}

template <class Block>
[[gnu::always_inline]] inline void add_up(std::span<const BlockSummand> summands, std::size_t i, double* results) {
    typename Block::Numbers a{}, b{}, sum{};
    bool is_first = true;
    for (const auto& summand : summands) {
        load<Block>(summand.first[0], summand.step[0], i, a);
        load<Block>(summand.first[1], summand.step[1], i, b);
        a *= numbers_at<Block>(summand.factors + i);
        a *= b;
        if (is_first) {
            sum = a;
        } else {
            sum += a;
        }
        is_first = false;
    }
    numbers_at<Block>(results + i) = sum;
}

} // namespace

TRIBODE_CLONES void operate_in_blocks(BlockOperation operation, const BlockOperands& operands, std::size_t count,
                                      double* results) {
    std::size_t i = 0;
    for (; i + Eight::count <= count; i += Eight::count) operate<Eight>(operation, operands, i, results);
    if (i < count) operate<Four>(operation, operands, i, results);
}

TRIBODE_CLONES void sum_in_blocks(std::span<const BlockSummand> summands, std::size_t count, double* results) {
    std::size_t i = 0;
    for (; i + Eight::count <= count; i += Eight::count) add_up<Eight>(summands, i, results);
    if (i < count) add_up<Four>(summands, i, results);
}

} // namespace tribode
