#include "tribode/analysis/sensitivity.hpp"
#include "tribode/analysis/statistics.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/batch/sampling.hpp"
#include "tribode/script/batch_script.hpp"
#include "tribode/script/lua_function.hpp"

namespace tribode {

namespace {

constexpr long max_at_once = 10'000'000; // points in one list

// The options of tb.grid and the like are the description without its kind.
LuaState::Function design_function(const std::string& kind) {
    return [kind](const Json& arguments) {
        Json description = {{"design", kind}};
        if (arguments.is_object()) description.update(arguments);
        description["design"] = kind;
        return Design::from_description(description, "tb." + kind).description();
    };
}

Json points_of(const Json& arguments) {
    FieldReader fields(arguments, "tb.points");
    const Design design = Design::from_description(fields.value("design"), fields.name_of("design"));
    const auto count = static_cast<long>(design.count());
    const long first = fields.integer("first", 1, count, 1);
    const long wanted = fields.integer("count", 1, count - first + 1, count - first + 1);
    fields.finish();
    if (wanted > max_at_once) throw InputError("tb.points: more than 1e7 points at once; use first and count");
    Json points = Json::array();
    for (long i = first - 1; i < first - 1 + wanted; ++i) points.push_back(design.point(static_cast<std::uint64_t>(i)));
    return points;
}

// ---- results -----------------------------------------------------------------------------------------------------

// A list of numbers in which a failed run is NaN.
std::vector<double> values_of(FieldReader& fields, const char* key) {
    const Json& list = fields.value(key);
    if (list.is_null()) fields.fail(key, "is missing (a list of numbers)");
    std::vector<double> values;
    for (const auto& entry : list) {
        if (!list.is_array() || !entry.is_number()) fields.fail(key, "must be a list of numbers");
        values.push_back(entry.get<double>());
    }
    return values;
}

struct NamedFactors {
    std::vector<std::string> names;
    FactorColumns columns;
};

// A list of {name=, values=}.
NamedFactors factors_of(FieldReader& fields) {
    NamedFactors factors;
    fields.each("factors", [&](FieldReader& entry) {
        factors.names.push_back(entry.text("name"));
        factors.columns.push_back(values_of(entry, "values"));
        entry.text("unit", ""); // so that columns of tb.write_csv can be handed on
    });
    if (factors.names.empty()) fields.fail("factors", "is missing (a list of {name =, values =})");
    return factors;
}

Json statistics(const Json& arguments) {
    FieldReader fields(arguments, "tb.statistics");
    const auto values = values_of(fields, "values");
    const auto probabilities =
        fields.numbers("probabilities", "", Allowed::fraction, {0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99});
    const double confidence = fields.number("confidence", "", Allowed::fraction, 0.95);
    fields.finish();
    const Summary s = summarize(values, probabilities, confidence);
    Json quantiles = Json::array();
    for (const auto& q : s.quantiles) {
        quantiles.push_back({{"probability", q.probability}, {"value", q.value}, {"low", q.low}, {"high", q.high}});
    }
    return {{"count", s.count},
            {"missing", s.missing},
            {"mean", s.mean},
            {"standard_deviation", s.standard_deviation},
            {"standard_error", s.standard_error},
            {"mean_low", s.mean_low},
            {"mean_high", s.mean_high},
            {"least", s.least},
            {"greatest", s.greatest},
            {"quantiles", quantiles}};
}

Json histogram_of(const Json& arguments) {
    FieldReader fields(arguments, "tb.histogram");
    const auto values = values_of(fields, "values");
    const long bins = fields.integer("bins", 0, 100000, 0);
    fields.finish();
    const Histogram h = histogram(values, static_cast<std::size_t>(bins));
    return {{"edges", h.edges}, {"counts", h.counts}, {"missing", h.missing}};
}

Json indices(const Json& arguments) {
    FieldReader fields(arguments, "tb.sobol_indices");
    const auto values = values_of(fields, "values");
    const auto names = fields.texts("factors", {});
    const long replicates = fields.integer("replicates", 2, 100000, 200);
    const long seed = fields.integer("seed", 0, 1L << 53, 0);
    fields.finish();
    if (names.empty()) fields.fail("factors", "is missing (the names of the design, its field names)");
    const SobolIndices found =
        sobol_indices(values, names.size(), static_cast<std::size_t>(replicates), static_cast<std::uint64_t>(seed));
    return {{"factors", names},
            {"first", found.first},
            {"first_error", found.first_error},
            {"total", found.total},
            {"total_error", found.total_error},
            {"mean", found.mean},
            {"variance", found.variance},
            {"groups", found.groups},
            {"dropped", found.dropped}};
}

Json regression(const Json& arguments) {
    FieldReader fields(arguments, "tb.regression_sensitivity");
    const auto values = values_of(fields, "values");
    const NamedFactors factors = factors_of(fields);
    const bool ranks = fields.boolean("ranks", false);
    fields.finish();
    const StandardizedRegression found = standardized_regression(factors.columns, values, ranks);
    return {{"factors", factors.names},
            {"coefficients", found.coefficients},
            {"standard_errors", found.standard_errors},
            {"r_squared", found.r_squared},
            {"rows", found.rows}};
}

Json tornado_of(const Json& arguments) {
    FieldReader fields(arguments, "tb.tornado");
    const auto values = values_of(fields, "values");
    const NamedFactors factors = factors_of(fields);
    const double share = fields.number("share", "", Allowed::fraction, 0.1);
    if (share > 0.5) fields.fail("share", "must be at most 0.5");
    fields.finish();
    Json bars = Json::array();
    for (const auto& bar : tornado(factors.columns, values, share)) {
        bars.push_back({{"name", factors.names[bar.factor]},
                        {"low", bar.low},
                        {"high", bar.high},
                        {"low_error", bar.low_error},
                        {"high_error", bar.high_error}});
    }
    return bars;
}

Json worst(const Json& arguments) {
    FieldReader fields(arguments, "tb.worst_cases");
    const auto values = values_of(fields, "values");
    const long count = fields.integer("count", 1, max_at_once, 5);
    const std::string which = fields.choice("which", {"greatest", "least"}, "greatest");
    fields.finish();
    Json rows = Json::array();
    for (const std::size_t row : worst_cases(values, static_cast<std::size_t>(count), which == "greatest")) {
        rows.push_back({{"row", row + 1}, {"value", values[row]}});
    }
    return rows;
}

// ---- batches -----------------------------------------------------------------------------------------------------

Json read_batch(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.read_batch");
    const std::filesystem::path folder = fields.text("folder");
    fields.finish();
    script.access().check_read(folder);
    script.access().note_read(folder / "manifest.json"); // says what the points are
    return merged_batch(folder);
}

int describe(const ScriptContext& script, lua_State* lua) { return describe_batch(lua, script.run); }

} // namespace

const std::vector<LuaFunction>& batch_functions() {
    static const std::vector<LuaFunction> functions = {
        {"batch", describe, "`tb.batch{ … }`",
         "describes a batch of points, once in a script ([how batches run](batch.md), [options](#tbbatch)). It returns "
         "nothing: `tribode batch` runs the points, or `tribode run` at the end of the script"},
        {"read_batch", read_batch, "`tb.read_batch{ folder = }`",
         "reads a complete batch, named with `-D` or inside the run folder, in the form that `finish` "
         "[receives](#tbbatch). It refuses a batch with missing points"},
        {"grid", design_function("grid"), "`tb.grid{ factors = { { name =, values = {…} }, … } }`",
         "every combination, the last factor fastest; values are numbers, texts or booleans"},
        {"list", design_function("list"), "`tb.list{ points = { { name = value, … }, … } }`",
         "the given points; all have the same names"},
        {"monte_carlo", design_function("monte_carlo"), "`tb.monte_carlo{ factors =, count =, seed = 0 }`",
         "independent draws"},
        {"latin_hypercube", design_function("latin_hypercube"), "`tb.latin_hypercube{ factors =, count =, seed = 0 }`",
         "each of `count` equal shares of each factor occurs once"},
        {"sobol", design_function("sobol"), "`tb.sobol{ factors =, count =, seed = 0, scramble = \"owen\" }`",
         "Sobol sequence [Joe 2008] of up to 40 factors; `scramble` is `\"owen\"`, `\"shift\"` or `\"none\"`"},
        {"saltelli", design_function("saltelli"), "`tb.saltelli{ factors =, base_count =, seed = 0 }`",
         "`base_count` groups of (factors + 2) points for `tb.sobol_indices`; up to 20 factors"},
        {"one_at_a_time", design_function("one_at_a_time"), "`tb.one_at_a_time{ factors =, share = 0.05 }`",
         "the medians, then each factor alone at its quantiles `share` and 1 − `share`"},
        {"points", points_of, "`tb.points{ design =, first = 1, count = }`",
         "list of points `{ name = value, … }`, by default all; at most 10⁷ at once"},
        {"statistics", statistics, "`tb.statistics{ values = {…}, probabilities = {…}, confidence = 0.95 }`",
         "`count`, `missing` (values that are not finite: failed runs), `mean`, `standard_deviation`, "
         "`standard_error`, `mean_low`, `mean_high` (Student's interval), `least`, `greatest`, `quantiles`: a list of "
         "`{ probability, value, low, high }`, by default of 0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99; a bound is nan "
         "if there are too few values"},
        {"histogram", histogram_of, "`tb.histogram{ values =, bins = 0 }`",
         "`edges`, `counts`, `missing`; 0 bins: by the rule of Freedman and Diaconis"},
        {"worst_cases", worst, "`tb.worst_cases{ values =, count = 5, which = \"greatest\" }`",
         "list of `{ row, value }`, the worst first; `which` may be `\"least\"`"},
        {"sobol_indices", indices,
         "`tb.sobol_indices{ values =, factors = { \"name\", … }, replicates = 200, seed = 0 }`",
         "for results in the order of a `saltelli` design: lists `first`, `total` (shares of the variance), "
         "`first_error`, `total_error` (bootstrap), `factors`; `mean`, `variance`, `groups`, `dropped` (groups with a "
         "failed run)"},
        {"regression_sensitivity", regression,
         "`tb.regression_sensitivity{ factors = { { name =, values = }, … }, values =, ranks = false }`",
         "standardized regression: lists `coefficients`, `standard_errors`, `factors`; `r_squared`, `rows`. `ranks = "
         "true`: of the ranks"},
        {"tornado", tornado_of, "`tb.tornado{ factors = as above, values =, share = 0.1 }`",
         "list of `{ name, low, high, low_error, high_error }`, the widest first: means of the result where the factor "
         "is among its lowest and highest share, and their standard errors"},
    };
    return functions;
}

} // namespace tribode
