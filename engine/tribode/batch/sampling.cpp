#include "tribode/batch/sampling.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/random.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <set>

namespace tribode {

namespace {

const std::vector<std::string> design_names = {"grid",  "list",     "monte_carlo",  "latin_hypercube",
                                               "sobol", "saltelli", "one_at_a_time"};
const std::vector<std::string> scramble_names = {"none", "shift", "owen"};

constexpr long max_points = 1L << 53; // an index is then exact as a number of Lua and of a table

// Streams of random_bits, one for each factor, apart from those of other uses of the same seed.
constexpr std::uint64_t draw_stream = 0xd1a3 << 16;
constexpr std::uint64_t order_stream = 0x07de << 16;

bool is_value(const Json& value) {
    return value.is_string() || value.is_boolean() || (value.is_number() && std::isfinite(value.get<double>()));
}

void add_value(Factor& factor, const Json& value) {
    factor.named = factor.named || !value.is_number();
    factor.whole = (factor.whole || factor.values.empty()) && value.is_number_integer();
    factor.values.push_back(value);
}

// The greatest double below 1, for sums that round up to it.
double below_one(double p) { return std::min(p, 1 - 0x1p-53); }

} // namespace

void Design::read_factors(FieldReader& fields) {
    const bool is_grid = kind_ == Kind::grid;
    std::set<std::string> names;
    fields.each("factors", [&](FieldReader& entry) {
        Factor factor;
        factor.name = entry.text("name");
        if (!names.insert(factor.name).second) entry.fail("name", "= \"" + factor.name + "\" is there twice");
        const Json& values = entry.value("values");
        if (!values.is_null() && (!values.is_array() || values.empty())) entry.fail("values", "must be a list");
        for (const auto& value : values) {
            if (!is_value(value)) entry.fail("values", "must hold finite numbers, texts or booleans");
            add_value(factor, value);
        }
        if (!is_grid) {
            factor.distribution = Distribution::read(entry, factor.values.size());
        } else if (factor.values.empty()) {
            entry.fail("values", "is missing (a list; see tb.linspace and tb.logspace)");
        }
        factors_.push_back(std::move(factor));
    });
    if (factors_.empty()) fields.fail("factors", "is missing (a list of tables, one for each varied quantity)");
}

void Design::read_points(FieldReader& fields) {
    const Json& points = fields.value("points");
    if (!points.is_array() || points.empty()) fields.fail("points", "must be a list of tables");
    for (const auto& [name, value] : points[0].items()) factors_.emplace_back().name = name;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const std::string entry = fmt::format("points[{}]", i + 1);
        if (!points[i].is_object() || points[i].size() != factors_.size()) {
            fields.fail(entry, "must be a table with the names of the first");
        }
        for (auto& factor : factors_) {
            const auto value = points[i].find(factor.name);
            if (value == points[i].end()) fields.fail(entry, "has no \"" + factor.name + "\", the first point has");
            if (!is_value(*value)) fields.fail(entry + "." + factor.name, "must be a finite number, text or boolean");
            add_value(factor, *value);
        }
    }
    count_ = points.size();
}

Design Design::from_description(const Json& description, const std::string& where) {
    FieldReader fields(description, where);
    Design design;
    const std::string kind = fields.choice("design", design_names, "");
    design.kind_ = static_cast<Kind>(std::find(design_names.begin(), design_names.end(), kind) - design_names.begin());
    const bool random = design.kind_ == Kind::monte_carlo || design.kind_ == Kind::latin_hypercube ||
                        design.kind_ == Kind::sobol || design.kind_ == Kind::saltelli;
    design.description_ = {{"design", kind}};

    if (design.kind_ == Kind::list) {
        design.read_points(fields);
        design.description_["points"] = fields.value("points");
    } else {
        design.read_factors(fields);
        design.description_["factors"] = fields.value("factors");
    }
    const std::size_t factors = design.factors_.size();
    if (random) {
        design.seed_ = static_cast<std::uint64_t>(fields.integer("seed", 0, max_points, 0));
        design.description_["seed"] = design.seed_;
    }

    const char* count_key = design.kind_ == Kind::saltelli ? "base_count" : "count";
    std::uint64_t wanted = 0;
    if (random) {
        wanted = static_cast<std::uint64_t>(fields.integer(count_key, 1, max_points / 64, 0));
        if (wanted == 0) fields.fail(count_key, "is missing (how many points)");
    }
    switch (design.kind_) {
    case Kind::list: break;
    case Kind::grid:
        design.count_ = 1;
        for (const auto& factor : design.factors_) {
            if (design.count_ > static_cast<std::uint64_t>(max_points) / factor.values.size()) {
                fields.fail("factors", "have more than 2^53 combinations");
            }
            design.count_ *= factor.values.size();
        }
        break;
    case Kind::monte_carlo:
    case Kind::latin_hypercube: design.count_ = wanted; break;
    case Kind::sobol:
    case Kind::saltelli: {
        const std::size_t dimensions = design.kind_ == Kind::sobol ? factors : 2 * factors;
        if (dimensions > SobolSequence::max_dimensions) {
            fields.fail("factors", fmt::format("are {}, must be at most {}", factors,
                                               SobolSequence::max_dimensions * factors / dimensions));
        }
        design.count_ = design.kind_ == Kind::sobol ? wanted : wanted * (factors + 2);
        std::string scramble = "owen";
        if (design.kind_ == Kind::sobol) {
            scramble = fields.choice("scramble", scramble_names, scramble);
            design.description_["scramble"] = scramble;
        }
        const auto place = std::find(scramble_names.begin(), scramble_names.end(), scramble) - scramble_names.begin();
        design.sequence_.emplace(dimensions, static_cast<SobolSequence::Scramble>(place), design.seed_);
        break;
    }
    case Kind::one_at_a_time:
        design.share_ = fields.number("share", "", Allowed::fraction, 0.05);
        if (!(design.share_ < 0.5)) fields.fail("share", "must be below 0.5");
        design.description_["share"] = design.share_;
        design.count_ = 1 + 2 * factors;
        break;
    }
    if (random) design.description_[count_key] = wanted;
    // A description that comes back says how many points and which names it has; both follow from the rest.
    if (!random || design.kind_ == Kind::saltelli) {
        fields.integer("count", 1, max_points, 1);
        design.description_["count"] = design.count_;
    }
    fields.texts("names", {});
    design.description_["names"] = design.names();
    fields.finish();
    return design;
}

std::vector<std::string> Design::names() const {
    std::vector<std::string> names;
    for (const auto& factor : factors_) names.push_back(factor.name);
    return names;
}

double Design::probability(std::uint64_t index, std::size_t factor) const {
    switch (kind_) {
    case Kind::sobol: return sequence_->coordinate(index, factor);
    case Kind::saltelli: {
        const std::uint64_t rows = factors_.size() + 2, row = index % rows;
        const bool from_b = row == 1 || row == factor + 2;
        return sequence_->coordinate(index / rows, from_b ? factor + factors_.size() : factor);
    }
    case Kind::one_at_a_time:
        if (index == 0 || (index - 1) / 2 != factor) return 0.5;
        return index % 2 == 1 ? share_ : 1 - share_;
    default: break;
    }
    const double p = uniform(seed_, draw_stream + factor, index);
    if (kind_ == Kind::monte_carlo) return p;
    const auto cell = permuted(index, count_, random_bits(seed_, order_stream, factor));
    return below_one((static_cast<double>(cell) + p) / static_cast<double>(count_));
}

double Design::listed(const Factor& factor, std::size_t position) const {
    return factor.named ? static_cast<double>(position + 1) : factor.values[position].get<double>();
}

std::vector<double> Design::row(std::uint64_t index) const {
    std::vector<double> row(factors_.size());
    std::uint64_t rest = index;
    for (std::size_t i = factors_.size(); i-- > 0;) {
        const Factor& factor = factors_[i];
        if (kind_ == Kind::list) {
            row[i] = listed(factor, index);
        } else if (kind_ == Kind::grid) {
            row[i] = listed(factor, rest % factor.values.size());
            rest /= factor.values.size();
        } else {
            const double x = factor.distribution->quantile(probability(index, i));
            row[i] = factor.values.empty() ? x : listed(factor, static_cast<std::size_t>(x));
        }
    }
    return row;
}

Json Design::value(std::size_t factor, double in_row) const {
    if (factors_[factor].whole) return static_cast<std::int64_t>(in_row);
    if (!factors_[factor].named) return in_row;
    return factors_[factor].values[static_cast<std::size_t>(in_row) - 1];
}

Json Design::point(std::uint64_t index) const {
    Json point = Json::object();
    const auto numbers = row(index);
    for (std::size_t i = 0; i < numbers.size(); ++i) point[factors_[i].name] = value(i, numbers[i]);
    return point;
}

} // namespace tribode
