#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"
#include "tribode/batch/distribution.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace tribode {
namespace {

Distribution read(const Json& fields, std::size_t choices = 0) {
    FieldReader reader(fields, "test");
    const Distribution result = Distribution::read(reader, choices);
    reader.finish();
    return result;
}

std::string refusal(const Json& fields, std::size_t choices = 0) {
    try {
        read(fields, choices);
    } catch (const InputError& error) {
        return error.what();
    }
    return "not refused";
}

const std::vector<Json> continuous = {
    {{"distribution", "uniform"}, {"low", -2}, {"high", 3}},
    {{"distribution", "log_uniform"}, {"low", 1e-3}, {"high", 1e3}},
    {{"distribution", "normal"}, {"mean", 2}, {"sd", 0.5}},
    {{"distribution", "normal"}, {"mean", 2}, {"sd", 0.5}, {"low", 1.5}},
    {{"distribution", "normal"}, {"mean", 2}, {"sd", 0.5}, {"low", 1.9}, {"high", 4}},
    {{"distribution", "normal"}, {"mean", 0}, {"sd", 1}, {"low", 5}, {"high", 6}},
    {{"distribution", "lognormal"}, {"median", 3}, {"sd_log", 0.4}},
    {{"distribution", "lognormal"}, {"median", 3}, {"sd_log", 0.4}, {"high", 5}},
    {{"distribution", "triangular"}, {"low", 1}, {"mode", 2}, {"high", 5}},
    {{"distribution", "triangular"}, {"low", 1}, {"mode", 1}, {"high", 5}},
};

TEST(Distribution, QuantileInvertsTheDistributionFunction) {
    for (const auto& description : continuous) {
        const Distribution d = read(description);
        for (const double p : {1e-9, 1e-4, 0.02, 0.31, 0.5, 0.77, 0.999, 1 - 1e-9}) {
            // 1e-7: bounds at 5 and 6 standard deviations leave 3e-7 of the distribution, of which `cumulative` takes
            // differences of numbers near 1.
            const bool far = description.value("low", 0.0) == 5;
            EXPECT_NEAR(d.cumulative(d.quantile(p)), p, far ? 1e-7 : 1e-13) << description.dump() << " " << p;
        }
    }
}

// The bound of Kolmogorov and Smirnov at the level 0.001. The draws are seeded: a test passes always or never.
TEST(Distribution, DrawsFollowTheClosedForm) {
    constexpr std::size_t count = 20000;
    std::uint64_t stream = 0;
    for (const auto& description : continuous) {
        const Distribution d = read(description);
        std::vector<double> x(count);
        for (std::size_t i = 0; i < count; ++i) x[i] = d.quantile(uniform(7, stream, i));
        std::sort(x.begin(), x.end());
        double distance = 0;
        for (std::size_t i = 0; i < count; ++i) {
            const double p = d.cumulative(x[i]), n = static_cast<double>(count), below = static_cast<double>(i);
            distance = std::max({distance, p - below / n, (below + 1) / n - p});
        }
        EXPECT_LT(distance * std::sqrt(static_cast<double>(count)), 1.95) << description.dump();
        ++stream;
    }
}

// Mean and variance in closed form; five standard errors of 200,000 draws.
TEST(Distribution, MomentsAreThoseOfTheFormulas) {
    const auto check = [](const Json& description, double mean, double variance) {
        const Distribution d = read(description);
        constexpr std::size_t count = 200000;
        double sum = 0, squares = 0;
        for (std::size_t i = 0; i < count; ++i) {
            const double x = d.quantile(uniform(3, 0, i)) - mean;
            sum += x;
            squares += x * x;
        }
        EXPECT_NEAR(sum / count, 0, 5 * std::sqrt(variance / count)) << description.dump();
        // Kurtosis up to 6.
        EXPECT_NEAR(squares / count / variance, 1, 5 * std::sqrt(5.0 / count)) << description.dump();
    };
    check(continuous[0], 0.5, 25.0 / 12);
    check(continuous[2], 2, 0.25);
    check(continuous[6], 3 * std::exp(0.08), 9 * std::exp(0.16) * (std::exp(0.16) - 1));
    check(continuous[8], 8.0 / 3, (1 + 4 + 25 - 2 - 5 - 10) / 18.0);
}

TEST(Distribution, BoundsHold) {
    const Distribution d = read({{"distribution", "normal"}, {"mean", 0}, {"sd", 1}, {"low", 6}, {"high", 6.5}});
    for (const double p : {1e-16, 0.5, 1 - 1e-16}) {
        EXPECT_GE(d.quantile(p), 6);
        EXPECT_LE(d.quantile(p), 6.5);
    }
    // Beyond 6 the tail falls by exp(-6 x - x^2/2): half of it lies below 6.11, all to 1 % of the density's slope.
    EXPECT_NEAR(d.quantile(0.5), 6.107, 0.005);
}

TEST(Distribution, ChoiceHasItsShares) {
    const Distribution d = read({{"distribution", "choice"}, {"weights", {1, 0, 3}}}, 3);
    EXPECT_EQ(d.quantile(0.1), 0);
    EXPECT_EQ(d.quantile(0.25), 0);
    EXPECT_EQ(d.quantile(0.26), 2);
    EXPECT_EQ(d.quantile(1 - 0x1p-53), 2);
    EXPECT_EQ(d.quantile(0x1p-53), 0);
    EXPECT_EQ(read(Json::object(), 4).quantile(0.6), 2); // values alone: equal shares
    const Distribution never_first = read({{"weights", {0, 1}}}, 2);
    EXPECT_EQ(never_first.quantile(0x1p-53), 1);
}

TEST(Distribution, RefusesWhatIsNone) {
    EXPECT_NE(refusal({{"low", 2}, {"high", 1}}).find("low must be below high"), std::string::npos);
    EXPECT_NE(refusal({{"distribution", "normla"}}).find("must be one of uniform, log_uniform"), std::string::npos);
    EXPECT_NE(refusal({{"distribution", "log_uniform"}, {"low", 0}, {"high", 1}}).find("positive"), std::string::npos);
    EXPECT_NE(refusal({{"distribution", "normal"}, {"mean", 0}, {"sd", 0}}).find("positive"), std::string::npos);
    EXPECT_NE(refusal({{"distribution", "normal"}, {"mean", 0}, {"sd", 1}, {"low", 9}}).find("1e-12"),
              std::string::npos);
    EXPECT_NE(
        refusal({{"distribution", "triangular"}, {"low", 0}, {"mode", 2}, {"high", 1}}).find("between low and high"),
        std::string::npos);
    EXPECT_NE(refusal({{"distribution", "choice"}}).find("values"), std::string::npos);
    EXPECT_NE(refusal({{"weights", {0, 0}}}, 2).find("zero"), std::string::npos);
    EXPECT_NE(refusal({{"weights", {1}}}, 2).find("one entry"), std::string::npos);
    EXPECT_NE(refusal({{"distribution", "uniform"}, {"low", 0}, {"high", 1}, {"sd", 1}}).find("sd"), std::string::npos);
}

} // namespace
} // namespace tribode
