#include "tribode/solver/sensitivity_series.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace tribode {
namespace {

using Column = std::vector<long double>;

// s after a step, from terms of long numbers.
Column reference(std::size_t n, const std::vector<double>& a, const std::vector<Lanes>& partial, std::size_t p,
                 double h, const std::vector<double>& f, const std::vector<Lanes>& q, const std::vector<Lanes>& s) {
    Column c(n), d(n), sum(n);
    for (std::size_t i = 0; i < n; ++i) {
        c[i] = static_cast<long double>(h) * f[i];
        d[i] = q[i][p];
        for (std::size_t j = 0; j < n; ++j) d[i] += static_cast<long double>(a[j * n + i]) * s[j][p];
        d[i] *= h;
        sum[i] = s[i][p] + d[i];
    }
    for (int order = 2; order < 120; ++order) {
        Column next_c(n), next_d(n);
        for (std::size_t i = 0; i < n; ++i) {
            for (std::size_t j = 0; j < n; ++j) {
                next_c[i] += a[j * n + i] * c[j] * h / order;
                next_d[i] += (a[j * n + i] * d[j] + partial[j * n + i][p] * c[j]) * h / order;
            }
            sum[i] += next_d[i];
        }
        c = next_c;
        d = next_d;
    }
    return sum;
}

// Steps of one length, which is prepared in the end, and steps of other lengths.
void check(std::size_t n, int products, bool lag) {
    std::mt19937 random(static_cast<unsigned>(n));
    std::uniform_real_distribution<double> some(-1, 1);
    std::vector<double> a(n * n);
    for (double& entry : a) entry = some(random);
    for (std::size_t i = 0; i + 1 < n; i += 2) { // x' = v
        for (std::size_t j = 0; j < n; ++j) a[j * n + i] = j == i + 1 ? 1 : 0;
    }
    if (lag) {
        for (std::size_t j = 0; j < n; ++j) a[j * n + n - 1] = j == n - 1 ? -3 : 0;
    }
    std::vector<Lanes> partial(n * n);
    for (std::size_t p = 0; p + 1 < lane_count; ++p) { // the last stands for none
        for (int product = 0; product < (p == 0 ? 0 : products); ++product) {
            std::vector<double> u(n), v(n);
            for (double& entry : u) entry = some(random);
            for (double& entry : v) entry = some(random);
            if (lag && p % 2 == 1) u[n - 1] = v[0] = 0;
            for (std::size_t j = 0; j < n; ++j) {
                for (std::size_t i = 0; i < n; ++i) partial[j * n + i][p] += u[i] * v[j];
            }
        }
    }
    SensitivitySeries series(n);
    SensitivitySeries::Pattern pattern;
    series.set_matrices(pattern, a, partial);
    for (int step = 0; step < 40; ++step) {
        const double h = step % 3 == 2 ? 1.3 * std::abs(some(random)) : step > 30 ? 3 : 0.75;
        std::vector<double> f(series.height());
        std::vector<Lanes> q(series.height()), s(series.height());
        for (std::size_t i = 0; i < n; ++i) {
            f[i] = some(random);
            for (std::size_t p = 0; p + 1 < lane_count; ++p) {
                q[i][p] = some(random);
                s[i][p] = some(random);
            }
        }
        std::vector<Lanes> moved = s;
        series.propagate(pattern, 0, h, f, q, moved);
        for (std::size_t p = 0; p < lane_count; ++p) {
            const Column wanted = reference(n, a, partial, p, h, f, q, s);
            long double largest = 1;
            for (const auto value : wanted) largest = std::max(largest, std::abs(value));
            for (std::size_t i = 0; i < n; ++i) {
                EXPECT_NEAR(moved[i][p], static_cast<double>(wanted[i]), 2e-13 * static_cast<double>(largest))
                    << n << " states, step " << step << " of " << h << ", parameter " << p << ", state " << i;
            }
        }
    }
    EXPECT_FALSE(pattern.prepared.empty());
}

TEST(SensitivitySeries, AgreesWithTermsOfLongNumbers) {
    for (const std::size_t n : {1, 2, 6, 7, 8, 11}) {
        for (const int products : {1, 3}) {
            for (const bool lag : {false, true}) check(n, products, lag);
        }
    }
}

// One or two parameters of up to eight states take another way through memory, up to two products each.
TEST(SensitivitySeries, OfFewParametersHasTheBitsOfOneOfEight) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> some(-1, 1);
    const auto compare = [&](std::size_t n, std::size_t parameters, int products, bool lag) {
        std::vector<double> a(n * n);
        for (double& entry : a) entry = some(random);
        for (std::size_t j = 0; j < n; ++j) a[j * n] = j == 1 ? 1 : 0;
        for (std::size_t j = 0; lag && j < n; ++j) a[j * n + n - 1] = j == n - 1 ? -3 : 0;
        std::vector<Lanes> partial(n * n);
        for (std::size_t p = 0; p < parameters; ++p) {
            for (int product = 0; product < products; ++product) {
                std::vector<double> u(n), v(n);
                for (double& entry : u) entry = some(random);
                for (double& entry : v) entry = some(random);
                if (lag) u[n - 1] = 0;
                for (std::size_t i = 0; i < n * n; ++i) partial[i][p] += u[i % n] * v[i / n];
            }
        }
        SensitivitySeries few(n, parameters), eight(n);
        SensitivitySeries::Pattern of_few, of_eight;
        few.set_matrices(of_few, a, partial);
        eight.set_matrices(of_eight, a, partial);
        for (const double h : {1e-9, 1e-3, 0.1, 0.7, 1.5, 40.0}) { // the last in halves
            std::vector<double> f(few.height());
            std::vector<Lanes> q(few.height()), s(few.height());
            for (std::size_t i = 0; i < n; ++i) {
                f[i] = some(random);
                for (std::size_t p = 0; p < parameters; ++p) {
                    q[i][p] = some(random);
                    s[i][p] = some(random);
                }
            }
            std::vector<Lanes> other = s;
            few.propagate(of_few, 0, h, f, q, s);
            eight.propagate(of_eight, 0, h, f, q, other);
            for (std::size_t i = 0; i < n; ++i) {
                for (std::size_t p = 0; p < lane_count; ++p) {
                    EXPECT_EQ(s[i][p], other[i][p])
                        << n << " states, " << parameters << " parameters, step " << h << ", state " << i;
                }
            }
        }
    };
    for (const std::size_t n : {5, 7, 8}) {
        for (const std::size_t parameters : {1, 2, 3}) {
            for (const int products : {1, 2, 3}) {
                for (const bool lag : {false, true}) compare(n, parameters, products, lag);
            }
        }
    }
}

} // namespace
} // namespace tribode
