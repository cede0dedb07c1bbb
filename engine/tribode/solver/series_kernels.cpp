#include "tribode/solver/series_kernels.hpp"
#include "tribode/solver/first_crossing.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace tribode {

namespace {

// Columns are processed in blocks of eight numbers. Without fused operations the results are the same bits whichever
// instructions the processor has. With a size known (Fixed > 0) the loops unroll and matrices stay in registers. Matrices have
// a column of zeros for each number that pads a column.
using Block __attribute__((vector_size(64), aligned(8), may_alias)) = double;
using Bits = long long __attribute__((vector_size(64)));
using Group __attribute__((vector_size(8 * guard_group), aligned(8), may_alias)) = double;
using GroupBits __attribute__((vector_size(8 * guard_group), aligned(8), may_alias)) = long long;
constexpr long long not_sign = std::numeric_limits<long long>::max(); // all bits of a number but that of its sign

const Block& block(const double* at) { return *reinterpret_cast<const Block*>(at); }
Block& block(double* at) { return *reinterpret_cast<Block*>(at); }
const Group& group(const double* at) { return *reinterpret_cast<const Group*>(at); }

// product = factor matrix x; four columns at a time, which do not wait for one another.
template <std::size_t FixedHeight, std::size_t FixedColumns>
[[gnu::always_inline]] inline void multiply(const double* matrix, std::size_t any_height, std::size_t any_columns,
                                            const double* x, double factor, double* product) {
    const std::size_t height = FixedHeight ? FixedHeight : any_height;
    const std::size_t columns = FixedColumns ? FixedColumns : any_columns; // a multiple of four
    for (std::size_t row = 0; row < height; row += block_size) {
        const auto column = [&](std::size_t j) -> const Block& { return block(matrix + j * height + row); };
        Block a = column(0) * x[0], b = column(1) * x[1], c = column(2) * x[2], d = column(3) * x[3];
        for (std::size_t j = 4; j < columns; j += 4) {
            a += column(j) * x[j];
            b += column(j + 1) * x[j + 1];
            c += column(j + 2) * x[j + 2];
            d += column(j + 3) * x[j + 3];
        }
        block(product + row) = ((a + b) + (c + d)) * factor;
    }
}

// The same of a column that is one block and in a register, where numbers are got faster than from memory. Blocks are results
// by reference: as values they would depend on the instructions that the caller may use.
template <int J>
[[gnu::always_inline]] inline void multiply_by_number(const Block& column, const Block& x, Block& product) {
    product = column * __builtin_shufflevector(x, x, J, J, J, J, J, J, J, J);
}
[[gnu::always_inline]] inline void multiply_block(const double* matrix, const Block& x, double factor, Block& product) {
    const auto column = [&](std::size_t j) -> const Block& { return block(matrix + j * block_size); };
    Block a, b, c, d, more;
    multiply_by_number<0>(column(0), x, a);
    multiply_by_number<1>(column(1), x, b);
    multiply_by_number<2>(column(2), x, c);
    multiply_by_number<3>(column(3), x, d);
    multiply_by_number<4>(column(4), x, more);
    a += more;
    multiply_by_number<5>(column(5), x, more);
    b += more;
    multiply_by_number<6>(column(6), x, more);
    c += more;
    multiply_by_number<7>(column(7), x, more);
    d += more;
    product = ((a + b) + (c + d)) * factor;
}

// Sets the signs of `found` where the size of a value is above `most`, or is no number: by the sign of most - size. GCC takes
// blocks as a whole for these operations, number by number for a comparison.
[[gnu::always_inline]] inline void find_above(const Block& most, const Block& value, Bits& found) {
    found |= (Bits)(most + (Block)((Bits)value | ~not_sign));
}

// By halves, which the processor combines as wholes.
[[gnu::always_inline]] inline bool any_of(const Bits& found) {
    const auto four =
        __builtin_shufflevector(found, found, 0, 1, 2, 3) | __builtin_shufflevector(found, found, 4, 5, 6, 7);
    const auto two = __builtin_shufflevector(four, four, 0, 1) | __builtin_shufflevector(four, four, 2, 3);
    return (two[0] | two[1]) < 0;
}

// 1/((n+1)(n+2))
constexpr auto reciprocals = [] {
    std::array<double, max_polynomial_terms> values{};
    for (std::size_t n = 0; n < values.size(); ++n) values[n] = 1 / static_cast<double>((n + 1) * (n + 2));
    return values;
}();

// 1/((n+1)(n+2)(n+3)(n+4))
constexpr auto fourth_reciprocals = [] {
    std::array<double, max_polynomial_terms> values{};
    for (std::size_t n = 0; n < values.size(); ++n) {
        values[n] = 1 / static_cast<double>((n + 1) * (n + 2) * (n + 3) * (n + 4));
    }
    return values;
}();

// From c_0 and c_1 = h f on, c_{n+1} = h/(n+1) A c_n, until two terms in a row are below half a unit in the last place of
// the largest, as a rule one of the first five, `least` at least. Returns the last n, or 0 where max_terms, an even
// number, do not do. Even and odd terms go each their own way by the square of A, c_{n+2} = h^2/((n+1)(n+2)) A^2 c_n: two
// chains that do not wait for one another. Where nothing is left of two terms but an eigenvector of A, of eigenvalue
// `rate`, numbers take its place.
[[gnu::always_inline]] inline int expand(const double* a, double rate, const double* least, std::size_t height,
                                         const double* f, double h, int max_terms, double* terms, double* limit) {
    const double* const square = a + height * height;
    const auto term = [&](int n) { return terms + static_cast<std::size_t>(n) * height; };
    const auto scale = [&](int from, double factor, int to) {
        for (std::size_t row = 0; row < height; row += block_size) {
            block(term(to) + row) = block(term(from) + row) * factor;
        }
    };
    // All states at one time: the terms are still in registers, and one branch that the processor cannot foresee takes the
    // place of one for each state. What pads a column is zero, and so is its limit; what is not a number is not small.
    const auto small = [&](int n) {
        Bits large{};
        for (std::size_t row = 0; row < height; row += block_size) {
            const Block most = block(limit + row);
            find_above(most, block(term(n) + row), large);
            find_above(most, block(term(n + 1) + row), large);
        }
        return !any_of(large);
    };
    const auto decay = [&](int n, double even, double odd) {
        Bits differ{};
        for (std::size_t row = 0; row < height; row += block_size) {
            const Block most = block(limit + row);
            find_above(most, block(term(n + 2) + row) - even * block(term(n) + row), differ);
            find_above(most, block(term(n + 3) + row) - odd * block(term(n + 1) + row), differ);
        }
        return !any_of(differ);
    };
    const auto set_limits = [&](int last) {
        for (std::size_t row = 0; row < height; row += block_size) {
            Block largest = block(least + row);
            for (int n = 0; n <= last; ++n) {
                const Block size = (Block)((Bits)block(term(n) + row) & not_sign);
                largest = size > largest ? size : largest;
            }
            block(limit + row) = half_ulp * largest;
        }
    };
    for (std::size_t row = 0; row < height; ++row) term(1)[row] = f[row] * h;
    multiply<0, 0>(a, height, height, term(1), h / 2, term(2));
    bool only_decay = false;
    for (int n = 1; n + 3 <= max_terms; n += 2) {
        const double even = h * h * reciprocals[static_cast<std::size_t>(n)];
        const double odd = h * h * reciprocals[static_cast<std::size_t>(n) + 1];
        if (only_decay) {
            scale(n, rate * rate * even, n + 2);
            scale(n + 1, rate * rate * odd, n + 3);
        } else {
            multiply<0, 0>(square, height, height, term(n), even, term(n + 2));
            multiply<0, 0>(square, height, height, term(n + 1), odd, term(n + 3));
        }
        if (n == 1) {
            set_limits(n + 3);
            continue;
        }
        if (small(n + 2)) return n + 3;
        if (!only_decay && rate != 0) only_decay = decay(n, rate * rate * even, rate * rate * odd);
    }
    // States at the end of a long chain have their largest terms later.
    set_limits(max_terms);
    return small(max_terms - 1) ? max_terms : 0;
}

// The same where a column is one block, which stays in a register. Four chains that overlap go by
// the fourth power of A, c_{n+4} = h^4/((n+1)...(n+4)) A^4 c_n.
[[gnu::always_inline]] inline int expand_block(const double* a, double rate, const double* least, const double* f,
                                               double h, int max_terms, double* terms, double* limit) {
    const double *square = a + block_size * block_size, *fourth_power = square + block_size * block_size;
    const auto term = [&](int n) -> Block& { return block(terms + static_cast<std::size_t>(n) * block_size); };
    const auto enlarge = [](Block& largest, const Block& value) {
        const Block size = (Block)((Bits)value & not_sign);
        largest = size > largest ? size : largest;
    };
    const auto are_small = [](const Block& most, const Block& first, const Block& second) {
        Bits large{};
        find_above(most, first, large);
        find_above(most, second, large);
        return !any_of(large);
    };
    // f number by number, as it was written just before.
    Block first = Block{f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7]} * h, second, third, fourth;
    multiply_block(a, first, h / 2, second);
    multiply_block(square, first, h * h * (1.0 / 6), third);
    multiply_block(square, second, h * h * (1.0 / 12), fourth);
    term(1) = first;
    term(2) = second;
    term(3) = third;
    term(4) = fourth;
    Block largest = block(least);
    for (int n = 0; n <= 4; ++n) enlarge(largest, term(n));
    Block most = half_ulp * largest;
    block(limit) = most;
    const double power = (h * h) * (h * h), decay = (rate * rate) * (rate * rate) * power;
    bool only_decay = false;
    for (int n = 1; n + 4 < max_terms; n += 4) {
        const double* reciprocal = fourth_reciprocals.data() + n;
        if (only_decay) {
            first *= decay * reciprocal[0];
            second *= decay * reciprocal[1];
            third *= decay * reciprocal[2];
            fourth *= decay * reciprocal[3];
        } else {
            const Block before_third = third, before_fourth = fourth;
            multiply_block(fourth_power, first, power * reciprocal[0], first);
            multiply_block(fourth_power, second, power * reciprocal[1], second);
            multiply_block(fourth_power, third, power * reciprocal[2], third);
            multiply_block(fourth_power, fourth, power * reciprocal[3], fourth);
            only_decay = rate != 0 && are_small(most, third - decay * reciprocal[2] * before_third,
                                                fourth - decay * reciprocal[3] * before_fourth);
        }
        term(n + 4) = first;
        term(n + 5) = second;
        term(n + 6) = third;
        term(n + 7) = fourth;
        if (are_small(most, third, fourth)) return are_small(most, first, second) ? n + 5 : std::min(n + 7, max_terms);
    }
    // States at the end of a long chain have their largest terms later.
    for (int n = 5; n <= max_terms; ++n) enlarge(largest, term(n));
    block(limit) = most = half_ulp * largest;
    return are_small(most, third, fourth) ? max_terms : 0;
}

// Eight rows of matrix f, and as many as a group has of matrix abs(f); the matrix has a multiple of four columns.
[[gnu::always_inline]] inline void multiply_rows(const double* matrix, std::size_t height, std::size_t columns,
                                                 const double* f, Block& product) {
    const auto column = [&](std::size_t j) -> const Block& { return block(matrix + j * height); };
    Block a = column(0) * f[0], b = column(1) * f[1], c = column(2) * f[2], d = column(3) * f[3];
    for (std::size_t j = 4; j < columns; j += 4) {
        a += column(j) * f[j];
        b += column(j + 1) * f[j + 1];
        c += column(j + 2) * f[j + 2];
        d += column(j + 3) * f[j + 3];
    }
    product = (a + b) + (c + d);
}
[[gnu::always_inline]] inline void multiply_sizes(const double* matrix, std::size_t height, std::size_t columns,
                                                  const double* f, Group& product) {
    const auto column = [&](std::size_t j) -> const Group& { return group(matrix + j * height); };
    const auto size = [&](std::size_t j) { return std::abs(f[j]); };
    Group a = column(0) * size(0), b = column(1) * size(1), c = column(2) * size(2), d = column(3) * size(3);
    for (std::size_t j = 4; j < columns; j += 4) {
        a += column(j) * size(j);
        b += column(j + 1) * size(j + 1);
        c += column(j + 2) * size(j + 2);
        d += column(j + 3) * size(j + 3);
    }
    product = (a + b) + (c + d);
}

// See propagate_columns(). A guard that begins at g and moves by first s + second s^2 and by at most `beyond` besides stays above
// zero; s and s^2 lie between 0 and 1, up to rounding, which the margin covers.
template <std::size_t FixedHeight, std::size_t FixedGroups>
[[gnu::always_inline]] inline bool propagate(const double* propagator, const double* rest, const double* g,
                                             std::size_t any_height, std::size_t any_groups, const double* f,
                                             double* moved) {
    const std::size_t height = FixedHeight ? FixedHeight : any_height;
    const std::size_t groups = FixedGroups ? FixedGroups : any_groups;
    const std::size_t rows = height + groups * 2 * guard_group;
    for (std::size_t row = 0; row < height; row += block_size) {
        multiply_rows(propagator + row, rows, height, f, block(moved + row));
    }
    const Group zero{}, crosses = zero - 1;
    GroupBits found{};
    for (std::size_t i = 0; i < groups; ++i) {
        const double* begin = g + i * guard_group;
        Block both;
        multiply_rows(propagator + height + 2 * i * guard_group, rows, height, f, both);
        const Group first = __builtin_shufflevector(both, both, 0, 1, 2, 3);
        const Group second = __builtin_shufflevector(both, both, 4, 5, 6, 7);
        Group beyond;
        multiply_sizes(rest + i * guard_group, groups * guard_group, height, f, beyond);
        const Group bent = first + (second < zero ? second : zero);
        // One by one, as they were written just before.
        const Group lowest = Group{begin[0], begin[1], begin[2], begin[3]} + (bent < zero ? bent : zero) - beyond;
        const Group sizes = (Group)((GroupBits)first & not_sign) + (Group)((GroupBits)second & not_sign) + beyond;
        found |= (GroupBits)(lowest > 1e-12 * sizes ? zero : crosses);
    }
    return ((found[0] | found[1]) | (found[2] | found[3])) == 0;
}

// The sum of all terms, x at the step's end, and of the sizes of those after the first; small ones come first.
template <std::size_t Fixed>
[[gnu::always_inline]] inline void sum_up(const double* terms, int order, std::size_t any_height, double* end,
                                          double* travel) {
    const std::size_t height = Fixed ? Fixed : any_height;
    for (std::size_t row = 0; row < height; row += block_size) {
        const auto term = [&](int n) -> const Block& {
            return block(terms + static_cast<std::size_t>(n) * height + row);
        };
        Block even{}, odd{}, even_sizes{}, odd_sizes{};
        int n = order;
        if (n % 2 == 0) {
            even = term(n--);
            even_sizes = (Block)((Bits)even & not_sign);
        }
        for (; n > 1; n -= 2) {
            const Block a = term(n), b = term(n - 1);
            odd += a;
            even += b;
            odd_sizes += (Block)((Bits)a & not_sign);
            even_sizes += (Block)((Bits)b & not_sign);
        }
        const Block first = term(1);
        block(travel + row) = odd_sizes + even_sizes + (Block)((Bits)first & not_sign);
        block(end + row) = term(0) + (odd + even + first);
    }
}

// sum c_n s^n, even and odd powers apart
template <std::size_t Fixed>
[[gnu::always_inline]] inline void evaluate(const double* terms, int order, std::size_t any_height, double s,
                                            double* x) {
    const std::size_t height = Fixed ? Fixed : any_height;
    const double square = s * s;
    for (std::size_t row = 0; row < height; row += block_size) {
        const auto term = [&](int n) -> const Block& {
            return block(terms + static_cast<std::size_t>(n) * height + row);
        };
        Block even{}, odd{};
        int n = order;
        if (n % 2 == 0) even = term(n--);
        for (; n > 0; n -= 2) {
            odd = odd * square + term(n);
            even = even * square + term(n - 1);
        }
        block(x + row) = even + odd * s;
    }
}

constexpr double negligible = 0x1p-50; // of a series of sensitivities, relative

// Adds the terms n + 1, ... of all columns where each follows from the two before it:
// t_{n+2} = 2 rate h/(n+2) t_{n+1} - (rate h)^2/((n+1)(n+2)) t_n. So all are multiples of the first two, and numbers do.
[[gnu::always_inline]] inline bool add_decay(double rate, double h, int n, int max_terms, const double* before,
                                             const double* term, const double* largest, std::size_t size,
                                             double* sums) {
    constexpr double tiny = std::numeric_limits<double>::min();
    Block most{};
    for (std::size_t i = 0; i < size; i += block_size) {
        const Block first = (Block)((Bits)block(before + i) & not_sign);
        const Block second = (Block)((Bits)block(term + i) & not_sign);
        const Block ratio = (first > second ? first : second) / (block(largest + i) + tiny);
        most = ratio > most ? ratio : most;
    }
    double part = 0; // of the largest terms
    for (std::size_t i = 0; i < block_size; ++i) part = most[i] > part ? most[i] : part;
    double a = 1, b = 0, next_a = 0, next_b = 1, sum_a = 0, sum_b = 0; // of `before` and `term`
    int small_terms = 0;
    for (; n < max_terms && small_terms < 2; ++n) {
        const double factor = h / (n + 1), once = 2 * rate * factor, twice = rate * rate * factor * h / n;
        const double new_a = next_a * once - a * twice, new_b = next_b * once - b * twice;
        sum_a += new_a;
        sum_b += new_b;
        small_terms = (std::abs(new_a) + std::abs(new_b)) * part <= negligible ? small_terms + 1 : 0;
        a = std::exchange(next_a, new_a);
        b = std::exchange(next_b, new_b);
    }
    if (small_terms < 2) return false;
    for (std::size_t i = 0; i < size; i += block_size) {
        block(sums + i) += block(before + i) * sum_a + block(term + i) * sum_b;
    }
    return true;
}

// Passes each row of A s to set(row, sum). The matrices are a copy: stores of blocks may be to anything else. With a size known s stays in registers.
template <std::size_t Fixed, class Set>
[[gnu::always_inline]] inline void multiply_lanes(const SensitivityMatrices m, const double* s, const Set& set) {
    Block fixed[Fixed ? Fixed : 1];
    for (std::size_t j = 0; j < Fixed; ++j) fixed[j] = block(s + j * lane_count);
    const auto column = [&](std::size_t j) -> const Block& {
        if constexpr (Fixed > 0) {
            return fixed[j];
        } else {
            return block(s + j * lane_count);
        }
    };
    const std::size_t columns = Fixed ? Fixed : m.states;
    for (std::size_t i = 0; i < m.full_rows; ++i) {
        const double* row = m.full + i * m.height;
        Block even{}, odd{};
        std::size_t j = 0;
        for (; j + 1 < columns; j += 2) {
            even += row[j] * column(j);
            odd += row[j + 1] * column(j + 1);
        }
        if (j < columns) even += row[j] * column(j);
        set(m.full_row[i], even + odd);
    }
    for (std::size_t i = 0; i < m.single_rows; ++i) {
        const auto& [row, of, value] = m.single[i];
        set(row, value * block(s + of * lane_count));
    }
}

// See expand_sensitivities(). Where nothing is left of two terms in a row but a state that decays by itself, at `rate`, and what a
// parameter makes of it, the next ones follow from these two: the eigenvalue is a double one of c and d together.
template <std::size_t Fixed>
[[gnu::always_inline]] inline bool expand_together(const SensitivityMatrices m, double h, int max_terms, double* room,
                                                   double* sums) {
    const std::size_t height = Fixed ? Fixed : m.height;
    const std::size_t value = height * lane_count, size = value + height; // where c begins
    double *before = room + size, *term = room, *next = room + 2 * size, *largest = room + 3 * size;
    double* const products = room + 4 * size;
    for (std::size_t i = 0; i < size; i += block_size) {
        const Block first = block(term + i);
        block(before + i) = Block{};
        block(next + i) = Block{};
        block(sums + i) = first;
        block(largest + i) = (Block)((Bits)first & not_sign);
    }
    // From one block to another: whether any counts, and whether any does not follow from the two before it.
    const auto counts = [&](std::size_t from, std::size_t to) __attribute__((always_inline)) {
        Bits found{};
        for (std::size_t i = from; i < to; i += block_size) {
            const Block limit = negligible * block(largest + i);
            find_above(limit, block(next + i), found);
        }
        return any_of(found);
    };
    const auto differs = [&](std::size_t from, std::size_t to, double once, double twice)
        __attribute__((always_inline)) {
        Bits found{};
        for (std::size_t i = from; i < to; i += block_size) {
            const Block limit = negligible * block(largest + i);
            const Block other = block(next + i) - (block(term + i) * once - block(before + i) * twice);
            find_above(limit, other, found);
        }
        return any_of(found);
    };
    int small_terms = 0, decaying_terms = 0;
    for (int n = 1; n < max_terms; ++n) {
        if (decaying_terms == 2) {
            return add_decay(m.rate, h, n, max_terms, before, term, largest, size, sums);
        }
        const double factor = h / (n + 1), once = 2 * m.rate * factor, twice = m.rate * m.rate * factor * h / n;
        const double* c = term + value;
        for (std::size_t row = 0; row < height; row += block_size) {
            Block even{}, odd{};
            for (std::size_t j = 0; j < height; j += 2) {
                even += block(m.a + j * height + row) * c[j];
                odd += block(m.a + (j + 1) * height + row) * c[j + 1];
            }
            const Block now = (even + odd) * factor;
            block(next + value + row) = now;
            block(sums + value + row) += now;
        }
        for (std::size_t i = 0; i < m.layers; ++i) {
            Block even{}, odd{};
            const double* right = m.right + i * value;
            for (std::size_t j = 0; j < height; j += 2) {
                even += block(right + j * lane_count) * c[j];
                odd += block(right + (j + 1) * lane_count) * c[j + 1];
            }
            block(products + i * lane_count) = even + odd;
        }
        const Block product = block(products); // mostly there is no other
        const auto set = [&](std::size_t row, const Block& sum) __attribute__((always_inline)) {
            const std::size_t at = row * lane_count;
            Block now = sum + block(m.left + at) * product;
            for (std::size_t i = 1; i < m.layers; ++i) {
                now += block(m.left + i * value + at) * block(products + i * lane_count);
            }
            now *= factor;
            block(next + at) = now;
            block(sums + at) += now;
        };
        multiply_lanes<Fixed>(m, term, set);
        // The largest terms are among the first, or come again.
        if (n < 6 || n % 4 == 0) {
            for (std::size_t i = 0; i < size; i += block_size) {
                const Block amount = (Block)((Bits)block(next + i) & not_sign);
                const Block earlier = block(largest + i);
                block(largest + i) = amount > earlier ? amount : earlier;
            }
        }
        // d decays as c does, or later: so it is looked at only then.
        const bool decays =
            m.rate != 0 && n > 4 && !differs(value, size, once, twice) && !differs(0, value, once, twice);
        decaying_terms = decays ? decaying_terms + 1 : 0;
        small_terms = counts(value, size) || counts(0, value) ? 0 : small_terms + 1;
        double* const free = before;
        before = term;
        term = next;
        next = free;
        if (small_terms >= 2 && n > 4) return true;
    }
    return false;
}

// Even and odd columns apart.
[[gnu::always_inline]] inline void multiply_in_pairs(const double* matrix, const Block& x, Block& product) {
    const auto column = [&](std::size_t j) -> const Block& { return block(matrix + j * block_size); };
    Block even{}, odd{}, more;
    multiply_by_number<0>(column(0), x, more);
    even += more;
    multiply_by_number<1>(column(1), x, more);
    odd += more;
    multiply_by_number<2>(column(2), x, more);
    even += more;
    multiply_by_number<3>(column(3), x, more);
    odd += more;
    multiply_by_number<4>(column(4), x, more);
    even += more;
    multiply_by_number<5>(column(5), x, more);
    odd += more;
    multiply_by_number<6>(column(6), x, more);
    even += more;
    multiply_by_number<7>(column(7), x, more);
    odd += more;
    product = even + odd;
}

// expand_together() for one or two parameters, of up to eight states and few layers: the states of d, and of c, are one block each, where
// lanes would be mostly empty. The operations on a number are the same, in the same order, and so are the bits.
constexpr std::size_t few_layers = 2;
template <std::size_t Parameters>
[[gnu::always_inline]] inline bool expand_few(const SensitivityMatrices m, double h, int max_terms, const double* room,
                                              double* sums) {
    constexpr std::size_t columns = Parameters + 1; // d of each parameter, then c
    constexpr std::size_t value = block_size * lane_count;
    Block before[columns] = {}, term[columns], next[columns], largest[columns], sum[columns],
          left[few_layers][Parameters];
    for (std::size_t p = 0; p < Parameters; ++p) {
        for (std::size_t row = 0; row < block_size; ++row) {
            term[p][row] = room[row * lane_count + p];
            for (std::size_t i = 0; i < m.layers; ++i) left[i][p][row] = m.left[i * value + row * lane_count + p];
        }
    }
    term[Parameters] = block(room + value);
    for (std::size_t k = 0; k < columns; ++k) {
        sum[k] = term[k];
        largest[k] = (Block)((Bits)term[k] & not_sign);
    }
    const auto counts = [&](std::size_t from, std::size_t to) __attribute__((always_inline)) {
        Bits found{};
        for (std::size_t k = from; k < to; ++k) find_above(negligible * largest[k], next[k], found);
        return any_of(found);
    };
    const auto differs = [&](std::size_t from, std::size_t to, double once, double twice)
        __attribute__((always_inline)) {
        Bits found{};
        for (std::size_t k = from; k < to; ++k) {
            const Block other = next[k] - (term[k] * once - before[k] * twice);
            find_above(negligible * largest[k], other, found);
        }
        return any_of(found);
    };
    const auto number = [](Block* blocks) { return reinterpret_cast<double*>(blocks); };
    bool ends = false;
    int small_terms = 0, decaying_terms = 0;
    for (int n = 1; n < max_terms && !ends; ++n) {
        if (decaying_terms == 2) {
            ends = add_decay(m.rate, h, n, max_terms, number(before), number(term), number(largest),
                             columns * block_size, number(sum));
            break;
        }
        const double factor = h / (n + 1), once = 2 * m.rate * factor, twice = m.rate * m.rate * factor * h / n;
        Block products[few_layers];
        for (std::size_t i = 0; i < m.layers; ++i) {
            multiply_in_pairs(m.right + i * value, term[Parameters], products[i]);
        }
        for (std::size_t k = 0; k < columns; ++k) {
            Block now;
            multiply_in_pairs(m.a, term[k], now);
            for (std::size_t i = 0; k < Parameters && i < m.layers; ++i) now += left[i][k] * products[i][k];
            next[k] = now * factor;
            sum[k] += next[k];
        }
        if (n < 6 || n % 4 == 0) {
            for (std::size_t k = 0; k < columns; ++k) {
                const Block amount = (Block)((Bits)next[k] & not_sign);
                largest[k] = amount > largest[k] ? amount : largest[k];
            }
        }
        const bool decays =
            m.rate != 0 && n > 4 && !differs(Parameters, columns, once, twice) && !differs(0, Parameters, once, twice);
        decaying_terms = decays ? decaying_terms + 1 : 0;
        small_terms = counts(Parameters, columns) || counts(0, Parameters) ? 0 : small_terms + 1;
        for (std::size_t k = 0; k < columns; ++k) {
            before[k] = term[k];
            term[k] = next[k];
        }
        ends = small_terms >= 2 && n > 4;
    }
    for (std::size_t row = 0; row < block_size; ++row) {
        block(sums + row * lane_count) = Block{};
        for (std::size_t p = 0; p < Parameters; ++p) sums[row * lane_count + p] = sum[p][row];
    }
    block(sums + value) = sum[Parameters];
    return ends;
}

template <std::size_t Fixed>
[[gnu::always_inline]] inline void move_together(const double* psi, const double* psi_p, const double* f,
                                                 const double* rates, std::size_t any_height, double* s) {
    const std::size_t height = Fixed ? Fixed : any_height;
    Block fixed[Fixed ? Fixed : 1];
    for (std::size_t j = 0; j < Fixed; ++j) fixed[j] = block(rates + j * lane_count);
    const auto column = [&](std::size_t j) -> const Block& {
        if constexpr (Fixed > 0) {
            return fixed[j];
        } else {
            return block(rates + j * lane_count);
        }
    };
    for (std::size_t row = 0; row < height; ++row) {
        Block by_rates{}, by_value{};
        for (std::size_t j = 0; j < height; ++j) {
            by_rates += psi[row * height + j] * column(j);
            by_value += block(psi_p + (row * height + j) * lane_count) * f[j];
        }
        block(s + row * lane_count) += by_rates + by_value;
    }
}

// sum = start + matrix x
template <std::size_t Fixed>
[[gnu::always_inline]] inline void add_product(const double* start, const double* matrix, std::size_t columns,
                                               std::size_t any_height, const double* x, double* sum) {
    const std::size_t height = Fixed ? Fixed : any_height;
    for (std::size_t row = 0; row < height; row += block_size) {
        Block even = block(start + row), odd{};
        std::size_t j = 0;
        for (; j + 1 < columns; j += 2) {
            even += block(matrix + j * height + row) * x[j];
            odd += block(matrix + (j + 1) * height + row) * x[j + 1];
        }
        if (j < columns) even += block(matrix + j * height + row) * x[j];
        block(sum + row) = even + odd;
    }
}

} // namespace

TRIBODE_CLONES void multiply_columns(const double* matrix, std::size_t height, std::size_t columns, const double* x,
                                     double* product) {
    if (columns != 8) return multiply<0, 0>(matrix, height, columns, x, 1, product);
    switch (height) {
    case 8: return multiply<8, 8>(matrix, 8, 8, x, 1, product);
    case 16: return multiply<16, 8>(matrix, 16, 8, x, 1, product);
    default: return multiply<0, 8>(matrix, height, 8, x, 1, product);
    }
}

TRIBODE_CLONES bool propagate_columns(const double* propagator, const double* rest, const double* g, std::size_t height,
                                      std::size_t groups, const double* f, double* moved) {
    if (height == 8 && groups == 1) return propagate<8, 1>(propagator, rest, g, 8, 1, f, moved);
    return propagate<0, 0>(propagator, rest, g, height, groups, f, moved);
}

TRIBODE_CLONES int expand_columns(const double* powers, double rate, const double* least, std::size_t height,
                                  const double* f, double h, int max_terms, double* terms, double* limit) {
    switch (height) {
    case 8: return expand_block(powers, rate, least, f, h, max_terms, terms, limit);
    default: return expand(powers, rate, least, height, f, h, max_terms, terms, limit);
    }
}

TRIBODE_CLONES void sum_columns(const double* terms, int order, std::size_t height, double* end, double* travel) {
    switch (height) {
    case 8: return sum_up<8>(terms, order, 8, end, travel);
    default: return sum_up<0>(terms, order, height, end, travel);
    }
}

TRIBODE_CLONES void evaluate_columns(const double* terms, int order, std::size_t height, double s, double* x) {
    switch (height) {
    case 8: return evaluate<8>(terms, order, 8, s, x);
    default: return evaluate<0>(terms, order, height, s, x);
    }
}

TRIBODE_CLONES void add_columns(const double* start, const double* matrix, std::size_t columns, std::size_t height,
                                const double* x, double* sum) {
    if (height == 8) return add_product<8>(start, matrix, columns, 8, x, sum);
    add_product<0>(start, matrix, columns, height, x, sum);
}

TRIBODE_CLONES void sensitivity_rates(const SensitivityMatrices& matrices, const double* s, const double* q,
                                      double* rates) {
    const auto set = [&](std::size_t row, const Block& sum) __attribute__((always_inline)) {
        block(rates + row * lane_count) = block(q + row * lane_count) + sum;
    };
    if (matrices.height == 8) return multiply_lanes<8>(matrices, s, set);
    multiply_lanes<0>(matrices, s, set);
}

TRIBODE_CLONES bool expand_sensitivities(const SensitivityMatrices& matrices, double h, int max_terms, double* room,
                                         double* sums) {
    if (matrices.height == 8 && matrices.layers <= few_layers) {
        switch (matrices.parameters) {
        case 1: return expand_few<1>(matrices, h, max_terms, room, sums);
        case 2: return expand_few<2>(matrices, h, max_terms, room, sums);
        default: break;
        }
    }
    if (matrices.height == 8) return expand_together<8>(matrices, h, max_terms, room, sums);
    return expand_together<0>(matrices, h, max_terms, room, sums);
}

TRIBODE_CLONES void propagate_sensitivities(const double* psi, const double* psi_p, const double* f,
                                            const double* rates, std::size_t height, double* s) {
    if (height == 8) return move_together<8>(psi, psi_p, f, rates, 8, s);
    move_together<0>(psi, psi_p, f, rates, height, s);
}

} // namespace tribode
