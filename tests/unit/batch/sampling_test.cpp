#include "tribode/base/error.hpp"
#include "tribode/batch/sampling.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

namespace tribode {
namespace {

Design design(const Json& description) { return Design::from_description(description, "test"); }

std::string refusal(const Json& description) {
    try {
        design(description);
    } catch (const InputError& error) {
        return error.what();
    }
    return "not refused";
}

Json numbers(const std::string& name) { return {{"name", name}, {"low", 0}, {"high", 1}}; }

// One of each kind, with the same three factors where it has distributions.
std::vector<Json> every_kind() {
    const Json factors = {numbers("a"),
                          {{"name", "b"}, {"distribution", "normal"}, {"mean", 1}, {"sd", 2}},
                          {{"name", "c"}, {"values", {"erk", "exact", "adams"}}}};
    return {
        {{"design", "grid"},
         {"factors", {{{"name", "a"}, {"values", {1, 2}}}, {{"name", "b"}, {"values", {5, 6, 7}}}}}},
        {{"design", "list"}, {"points", {{{"a", 1}, {"b", "x"}}, {{"b", "y"}, {"a", 2.5}}}}},
        {{"design", "monte_carlo"}, {"factors", factors}, {"count", 50}, {"seed", 3}},
        {{"design", "latin_hypercube"}, {"factors", factors}, {"count", 50}, {"seed", 3}},
        {{"design", "sobol"}, {"factors", factors}, {"count", 64}, {"seed", 3}},
        {{"design", "saltelli"}, {"factors", factors}, {"base_count", 8}, {"seed", 3}},
        {{"design", "one_at_a_time"}, {"factors", factors}},
    };
}

TEST(Design, GridRunsThroughAllCombinationsTheLastFactorFastest) {
    const Design grid = design(every_kind()[0]);
    ASSERT_EQ(grid.count(), 6U);
    std::vector<std::vector<double>> rows;
    for (std::uint64_t i = 0; i < 6; ++i) rows.push_back(grid.row(i));
    EXPECT_EQ(rows, (std::vector<std::vector<double>>{{1, 5}, {1, 6}, {1, 7}, {2, 5}, {2, 6}, {2, 7}}));
    EXPECT_EQ(grid.point(4), (Json{{"a", 2}, {"b", 6}}));
    EXPECT_TRUE(grid.point(4)["a"].is_number_integer());
}

TEST(Design, ListGivesThePointsBack) {
    const Design list = design(every_kind()[1]);
    ASSERT_EQ(list.count(), 2U);
    EXPECT_EQ(list.point(0), (Json{{"a", 1.0}, {"b", "x"}}));
    EXPECT_EQ(list.point(1), (Json{{"a", 2.5}, {"b", "y"}}));
    EXPECT_EQ(list.row(1)[1], 2); // a text stands as its place
}

// In any order, from a copy made of the description as it would come out of a manifest.
TEST(Design, ARowDependsOnDescriptionAndIndexAlone) {
    for (const auto& description : every_kind()) {
        const Design one = design(description);
        const Design other = design(Json::parse(one.description().dump()));
        EXPECT_EQ(other.description(), one.description());
        ASSERT_EQ(other.count(), one.count());
        for (std::uint64_t i = one.count(); i-- > 0;) EXPECT_EQ(other.row(i), one.row(i)) << description.dump() << i;
    }
}

TEST(Design, ALaterFactorLeavesTheOthersAsTheyWere) {
    for (const char* kind : {"monte_carlo", "latin_hypercube", "sobol"}) {
        const Json two = {{"design", kind}, {"count", 16}, {"factors", {numbers("a"), numbers("b")}}};
        const Json three = {{"design", kind}, {"count", 16}, {"factors", {numbers("a"), numbers("b"), numbers("c")}}};
        for (std::uint64_t i = 0; i < 16; ++i) {
            const auto x = design(two).row(i), y = design(three).row(i);
            EXPECT_TRUE(std::equal(x.begin(), x.end(), y.begin())) << kind;
        }
    }
}

TEST(Design, AnotherSeedGivesOtherPoints) {
    for (const char* kind : {"monte_carlo", "latin_hypercube", "sobol"}) {
        Json description = {{"design", kind}, {"count", 16}, {"factors", {numbers("a")}}, {"seed", 1}};
        const auto first = design(description).row(5);
        description["seed"] = 2;
        EXPECT_NE(design(description).row(5), first) << kind;
    }
}

TEST(Design, LatinHypercubeMeetsEachShareOfEachFactorOnce) {
    for (const int count : {1, 2, 3, 7, 100, 1000}) {
        const Design d = design(
            {{"design", "latin_hypercube"}, {"count", count}, {"seed", 9}, {"factors", {numbers("a"), numbers("b")}}});
        for (std::size_t factor = 0; factor < 2; ++factor) {
            std::set<int> shares;
            for (std::uint64_t i = 0; i < d.count(); ++i) shares.insert(static_cast<int>(d.row(i)[factor] * count));
            EXPECT_EQ(shares.size(), static_cast<std::size_t>(count));
        }
    }
}

// Pearson's correlation of 5000 independent pairs scatters by 1/sqrt(5000); five times that.
TEST(Design, FactorsAreNotCorrelated) {
    for (const char* kind : {"monte_carlo", "latin_hypercube", "sobol"}) {
        const Design d =
            design({{"design", kind}, {"count", 5000}, {"factors", {numbers("a"), numbers("b"), numbers("c")}}});
        double ab = 0, bc = 0, next = 0, before = 0;
        for (std::uint64_t i = 0; i < d.count(); ++i) {
            const auto x = d.row(i);
            ab += (x[0] - 0.5) * (x[1] - 0.5) * 12 / 5000;
            bc += (x[1] - 0.5) * (x[2] - 0.5) * 12 / 5000;
            next += before * (x[0] - 0.5) * 12 / 5000;
            before = x[0] - 0.5;
        }
        EXPECT_LT(std::abs(ab), 5 / std::sqrt(5000)) << kind;
        EXPECT_LT(std::abs(bc), 5 / std::sqrt(5000)) << kind;
        // The rows of a Sobol sequence are made to differ from their neighbors.
        const bool evenly = kind == std::string("sobol");
        EXPECT_TRUE(evenly || std::abs(next) < 5 / std::sqrt(5000)) << kind;
    }
}

TEST(Design, SaltelliTakesOneFactorAtATimeFromTheOtherPoint) {
    const Design d = design({{"design", "saltelli"}, {"base_count", 4}, {"factors", {numbers("a"), numbers("b")}}});
    ASSERT_EQ(d.count(), 16U);
    for (std::uint64_t group = 0; group < 4; ++group) {
        const auto a = d.row(4 * group), b = d.row(4 * group + 1);
        EXPECT_EQ(d.row(4 * group + 2), (std::vector<double>{b[0], a[1]}));
        EXPECT_EQ(d.row(4 * group + 3), (std::vector<double>{a[0], b[1]}));
        EXPECT_NE(a[0], b[0]);
    }
}

TEST(Design, OneAtATimeLeavesTheOthersAtTheirMedians) {
    const Design d = design({{"design", "one_at_a_time"}, {"share", 0.1}, {"factors", {numbers("a"), numbers("b")}}});
    ASSERT_EQ(d.count(), 5U);
    EXPECT_EQ(d.row(0), (std::vector<double>{0.5, 0.5}));
    EXPECT_EQ(d.row(1), (std::vector<double>{0.1, 0.5}));
    EXPECT_EQ(d.row(2), (std::vector<double>{0.9, 0.5}));
    EXPECT_EQ(d.row(3), (std::vector<double>{0.5, 0.1}));
    EXPECT_EQ(d.row(4), (std::vector<double>{0.5, 0.9}));
}

TEST(Design, WorksWithoutAListOfItsPoints) {
    const Design d =
        design({{"design", "latin_hypercube"}, {"count", 100'000'000'000'000}, {"factors", {numbers("a")}}});
    EXPECT_EQ(d.count(), 100'000'000'000'000U);
    const double x = d.row(99'999'999'999'999)[0];
    EXPECT_TRUE(x > 0 && x < 1);
}

TEST(Design, RefusesWithThePlace) {
    const auto holds = [](const std::string& text, const std::string& part) {
        EXPECT_NE(text.find(part), std::string::npos) << text;
    };
    holds(refusal({{"design", "sobl"}}), "design = \"sobl\"");
    holds(refusal({{"design", "monte_carlo"}, {"factors", {numbers("a")}}}), "count is missing");
    holds(refusal({{"design", "monte_carlo"}, {"count", 5}}), "factors is missing");
    holds(refusal({{"design", "monte_carlo"}, {"count", 5}, {"factors", {numbers("a"), numbers("a")}}}),
          "factors[2].name = \"a\" is there twice");
    holds(refusal({{"design", "monte_carlo"}, {"count", 5}, {"factors", {{{"name", "a"}, {"low", 1}}}}}), "high");
    holds(refusal({{"design", "grid"}, {"factors", {numbers("a")}}}), "values is missing");
    holds(refusal({{"design", "grid"}, {"count", 5}, {"seed", 1}, {"factors", {{{"name", "a"}, {"values", {1}}}}}}),
          "seed");
    holds(refusal({{"design", "list"}, {"points", {{{"a", 1}}, {{"b", 1}}}}}), "points[2] has no \"a\"");
    holds(refusal({{"design", "list"}, {"points", {{{"a", Json::array()}}}}}), "points[1].a");
    holds(refusal({{"design", "one_at_a_time"}, {"share", 0.6}, {"factors", {numbers("a")}}}), "below 0.5");
    Json many = {{"design", "saltelli"}, {"base_count", 2}, {"factors", Json::array()}};
    for (int i = 0; i < 21; ++i) many["factors"].push_back(numbers(std::string(1, static_cast<char>(97 + i))));
    holds(refusal(many), "are 21, must be at most 20");
}

} // namespace
} // namespace tribode
