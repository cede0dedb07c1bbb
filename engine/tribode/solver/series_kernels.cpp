#include "tribode/solver/series_kernels.hpp"
#include "tribode/solver/first_crossing.hpp"

#include <array>
#include <cmath>
#include <limits>

namespace tribode {

namespace {

// Columns are processed in blocks of eight numbers. Without fused operations the results are the same bits whichever instructions the processor has. With a size known (Fixed > 0) the
// loops unroll and matrices stay in registers. Matrices have a column of zeros for each number that pads a column.
using Block __attribute__((vector_size(64), aligned(8), may_alias)) = double;
using Bits = long long __attribute__((vector_size(64)));
constexpr long long not_sign = std::numeric_limits<long long>::max(); // all bits of a number but that of its sign

const Block& block(const double* at) { return *reinterpret_cast<const Block*>(at); }
Block& block(double* at) { return *reinterpret_cast<Block*>(at); }

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

// 1/((n+1)(n+2))
constexpr auto reciprocals = [] {
    std::array<double, max_polynomial_terms> values{};
    for (std::size_t n = 0; n < values.size(); ++n) values[n] = 1 / static_cast<double>((n + 1) * (n + 2));
    return values;
}();

// From c_0 and c_1 on, c_{n+1} = h/(n+1) A c_n, until two terms in a row are below half a unit in the last place of
// the largest, as a rule one of the first five, `least` at least. Returns the last n, or 0 where max_terms, an even
// number, do not do. Even and odd terms go each their own way by the square of A, c_{n+2} = h^2/((n+1)(n+2)) A^2 c_n: two
// chains that do not wait for one another. Where nothing is left of two terms but an eigenvector of A, of eigenvalue
// `rate`, numbers take its place.
template <std::size_t Fixed>
[[gnu::always_inline]] inline int expand(const double* a, const double* square, double rate, const double* least,
                                         std::size_t states, std::size_t any_height, double h, int max_terms,
                                         double* terms, double* limit) {
    const std::size_t height = Fixed ? Fixed : any_height;
    const auto term = [&](int n) { return terms + static_cast<std::size_t>(n) * height; };
    const auto scale = [&](int from, double factor, int to) {
        for (std::size_t row = 0; row < height; row += block_size) {
            block(term(to) + row) = block(term(from) + row) * factor;
        }
    };
    // From the last state on: the amplifier's, where there is one, which is slow to end.
    const auto small = [&](int n) {
        std::size_t state = states;
        while (state > 0 && std::abs(term(n)[state - 1]) <= limit[state - 1]) --state;
        return state == 0;
    };
    const auto decays = [&](int n, double factor) {
        std::size_t state = 0;
        while (state < states && std::abs(term(n + 2)[state] - factor * term(n)[state]) <= limit[state]) ++state;
        return state == states;
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
    multiply<Fixed, Fixed>(a, height, height, term(1), h / 2, term(2));
    bool only_decay = false;
    for (int n = 1; n + 3 <= max_terms; n += 2) {
        const double even = h * h * reciprocals[static_cast<std::size_t>(n)];
        const double odd = h * h * reciprocals[static_cast<std::size_t>(n) + 1];
        if (only_decay) {
            scale(n, rate * rate * even, n + 2);
            scale(n + 1, rate * rate * odd, n + 3);
        } else {
            multiply<Fixed, Fixed>(square, height, height, term(n), even, term(n + 2));
            multiply<Fixed, Fixed>(square, height, height, term(n + 1), odd, term(n + 3));
        }
        if (n == 1) {
            set_limits(n + 3);
            continue;
        }
        if (small(n + 2) && small(n + 3)) return n + 3;
        if (!only_decay && rate != 0) only_decay = decays(n, rate * rate * even) && decays(n + 1, rate * rate * odd);
    }
    // States at the end of a long chain have their largest terms later.
    set_limits(max_terms);
    return small(max_terms - 1) && small(max_terms) ? max_terms : 0;
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

// Clang before version 18 gives clones a name by which other files do not find them.
#ifdef __clang__
#define TRIBODE_CLONES
#else
#define TRIBODE_CLONES [[gnu::target_clones("avx512f", "avx2", "default")]]
#endif

TRIBODE_CLONES void multiply_columns(const double* matrix, std::size_t height, std::size_t columns, const double* x,
                                     double* product) {
    if (columns != 8) return multiply<0, 0>(matrix, height, columns, x, 1, product);
    switch (height) {
    case 8: return multiply<8, 8>(matrix, 8, 8, x, 1, product);
    case 16: return multiply<16, 8>(matrix, 16, 8, x, 1, product);
    default: return multiply<0, 8>(matrix, height, 8, x, 1, product);
    }
}

TRIBODE_CLONES int expand_columns(const double* a, const double* square, double rate, const double* least,
                                  std::size_t states, std::size_t height, double h, int max_terms, double* terms,
                                  double* limit) {
    switch (height) {
    case 8: return expand<8>(a, square, rate, least, states, 8, h, max_terms, terms, limit);
    default: return expand<0>(a, square, rate, least, states, height, h, max_terms, terms, limit);
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

} // namespace tribode
