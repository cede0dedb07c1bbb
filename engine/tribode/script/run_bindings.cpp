#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/base/text.hpp"
#include "tribode/script/lua_function.hpp"

#include <cmath>
#include <fmt/format.h>

namespace tribode {

namespace {

// Positional arguments come as a list; the rest of a function's name is for messages.
double argument(const Json& arguments, std::size_t index, const char* what) {
    if (!arguments.is_array() || index >= arguments.size() || !arguments[index].is_number()) {
        throw InputError(fmt::format("{}: argument {} must be a number", what, index + 1));
    }
    return arguments[index].get<double>();
}

Json spaced(const Json& arguments, const char* what, bool logarithmic) {
    const double from = argument(arguments, 0, what), to = argument(arguments, 1, what);
    if (!std::isfinite(from) || !std::isfinite(to)) {
        throw InputError(fmt::format("{}: from {} to {}: both must be finite", what, to_text(from), to_text(to)));
    }
    const double count = argument(arguments, 2, what);
    if (!(count >= 2 && count <= 1e7 && count == std::floor(count))) {
        throw InputError(
            fmt::format("{}: argument 3 = {}, must be a whole number from 2 to 1e7", what, to_text(count)));
    }
    if (logarithmic && !(from > 0 && to > 0)) throw InputError(fmt::format("{}: both ends must be positive", what));
    Json list = Json::array();
    for (double i = 0; i < count; ++i) {
        const double part = i / (count - 1);
        list.push_back(logarithmic ? from * std::pow(to / from, part) : from + (to - from) * part);
    }
    return list;
}

Json run_script(const ScriptContext& context, const Json& arguments) {
    FieldReader fields(arguments, "tb.run");
    const std::string script = fields.text("script"), folder = fields.text("folder");
    const Json& options = fields.value("options");
    std::optional<bool> quick;
    if (fields.has("quick")) quick = fields.boolean("quick", false);
    fields.finish();
    const NestedRun nested =
        context.run.run_nested(script, folder, options.is_null() ? Json::object() : options, quick);
    return {{"folder", nested.folder.string()}, {"repeated", nested.repeated}};
}

Json options(const ScriptContext& script, const Json& defaults) { return script.run.options(defaults); }
Json format(const Json& arguments) {
    const double value = argument(arguments, 0, "tb.format");
    const auto given = [&](std::size_t i) { return arguments.size() > i && !arguments[i].is_null(); };
    if (given(1) && !arguments[1].is_string()) throw InputError("tb.format: argument 2 must be a unit, as a text");
    const double digits = given(2) ? argument(arguments, 2, "tb.format") : 4;
    if (!(digits >= 1 && digits <= 15 && digits == std::floor(digits))) {
        throw InputError(
            fmt::format("tb.format: argument 3 = {}, must be a whole number from 1 to 15", to_text(digits)));
    }
    return format_quantity(value, given(1) ? arguments[1].get<std::string>() : "", static_cast<int>(digits));
}

Json linear(const Json& arguments) { return spaced(arguments, "tb.linspace", false); }
Json logarithmic(const Json& arguments) { return spaced(arguments, "tb.logspace", true); }

} // namespace

const std::vector<LuaFunction>& run_functions() {
    static const std::vector<LuaFunction> functions = {
        {"version", {}, "`tb.version`", "version of the program, a text"},
        {"quick", {}, "`tb.quick`", "true if the user gave `--quick`: make the work small"},
        {"options", options, "`tb.options{ name = default, … }`",
         "the script's options; `-D name=value` on the command line replaces a default. A default is a number, a text, "
         "a boolean, a list of numbers (given as `-D name=1,2,3`), or `{ default =, unit =, help =, choices = }`. A "
         "`-D` that names no option is refused"},
        {"run", run_script, "`tb.run{ script =, folder =, options = {…}, quick = }`",
         "runs another script in a folder of the run folder ([nested runs](report.md#nested-runs)), options as with "
         "`-D`: numbers, texts, booleans, lists of numbers. Returns `{ folder =, repeated = }`: the folder of its "
         "results, for `tb.read_json`, and false if they were already complete after an interruption. `quick` defaults "
         "to that of the calling script"},
        {"linspace", linear, "`tb.linspace(from, to, count)`",
         "list of numbers with equal differences, both ends included"},
        {"logspace", logarithmic, "`tb.logspace(from, to, count)`", "the same with equal ratios"},
        {"format", format, "`tb.format(value, unit, digits)`",
         "a number as one reads it, for `print` and reports: four significant digits (or `digits`), and a prefix to "
         "the "
         "unit where it takes one: `tb.format(1.23e-5, \"m\")` is \"12.3 um\""},
    };
    return functions;
}

} // namespace tribode
