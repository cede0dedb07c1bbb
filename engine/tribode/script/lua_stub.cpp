#include "tribode/script/lua_stub.hpp"
#include "tribode/script/lua_function.hpp"

#include <algorithm>
#include <cctype>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <map>
#include <set>

namespace tribode {

namespace {

bool is_name(std::string_view text) {
    return !text.empty() && !std::isdigit(static_cast<unsigned char>(text[0])) &&
           std::all_of(text.begin(), text.end(),
                       [](unsigned char c) { return c < 0x80 && (std::isalnum(c) || c == '_'); });
}

// The words "..." of a text, as a type that is one of them.
std::string words_in(const std::string& values) {
    std::string type;
    for (auto begin = values.find('"'); begin != std::string::npos;) {
        const auto end = values.find('"', begin + 1);
        if (end == std::string::npos) break;
        type += (type.empty() ? "" : "|") + values.substr(begin, end - begin + 1);
        begin = values.find('"', end + 1);
    }
    return type;
}

std::string type_of(const std::string& values) {
    const bool is_list = values.starts_with("list of ");
    if (const std::string words = words_in(values); !words.empty())
        return is_list ? fmt::format("({})[]", words) : words;
    if (values.starts_with("list of numbers")) return "number[]";
    if (values.starts_with("list of texts")) return "string[]";
    if (values.starts_with("list of tables")) return "table[]";
    if (values == "table of numbers") return "table<string, number>";
    if (values == "table") return "table";
    if (values == "text") return "string";
    if (values == "true or false") return "boolean";
    if (values.starts_with("whole")) return "integer";
    for (const char* number : {"any", "> 0", "≥ 0", "between"}) {
        if (values.starts_with(number)) return "number";
    }
    if (values == "table of texts") return "table<string, string>";
    return "any";
}

// The types of arguments that have no row in a table of options, by their names: a name means the same in all functions but
// those named `function.name`. Arguments of conditions and of parts are not here: they are symbolic or numbers.
const std::map<std::string_view, std::string_view> argument_types = {
    {"file", "string"},
    {"folder", "string"},
    {"script", "string"},
    {"text", "string"},
    {"title", "string"},
    {"unit", "string"},
    {"which", "\"greatest\"|\"least\""},
    {"scramble", "\"owen\"|\"shift\"|\"none\""},
    {"quick", "boolean"},
    {"ranks", "boolean"},
    {"base_count", "integer"},
    {"bins", "integer"},
    {"count", "integer"},
    {"delay_order", "integer"},
    {"digits", "integer"},
    {"decimate.factor", "integer"},
    {"index", "integer"},
    {"order", "integer"},
    {"periods", "integer"},
    {"points.first", "integer"},
    {"replicates", "integer"},
    {"seed", "integer"},
    {"stream", "integer"},
    {"window_samples", "integer"},
    {"at_hz", "number"},
    {"confidence", "number"},
    {"corner_hz", "number"},
    {"delay_s", "number"},
    {"excitation_hz", "number"},
    {"expected_s", "number"},
    {"f_max_hz", "number"},
    {"f_min_hz", "number"},
    {"format.value", "number"},
    {"friction_feedback", "number"},
    {"from", "number"},
    {"period_s", "number"},
    {"sample_time_s", "number"},
    {"share", "number"},
    {"to", "number"},
    {"loop_margins.amplitude_m", "number"},
    {"loop_gain.amplitude_m", "number[]"},
    {"frequency_hz", "number[]"},
    {"friction_force.position", "number[]"},
    {"frf.excitation", "number[]"},
    {"frf.input", "number[]"},
    {"frf.output", "number[]"},
    {"probabilities", "number[]"},
    {"values", "number[]"},
    {"table1.x", "number[]"},
    {"table1.y", "number[]"},
    {"table2.x", "number[]"},
    {"table2.y", "number[]"},
    {"z", "number[][]"},
    {"least_squares.columns", "number[][]"},
    {"columns", "tribode.column[]"},
    {"read_record.columns", "table<string, string>"},
    {"scale", "table<string, number>"},
    {"fra1", "tribode.response"},
    {"fra2", "tribode.response"},
    {"response", "tribode.response"},
    {"system", "tribode.system"},
    {"attributes", "table"},
    {"design", "table"},
    {"fields", "table"},
    {"machine", "table"},
    {"machine.file", "string|table"},
    {"model", "table<string, any>"},
    {"run.options", "table"},
    {"elements", "table[]"},
    {"panels", "table[]"},
    {"points", "table[]"},
    {"records", "(string|table)[]"},
    {"sections", "table[]"},
    {"tables", "table[]"},
    {"factors", "table[]"},
    {"sobol_indices.factors", "string[]"},
};

std::string type_of_argument(const std::string& function, const std::string& name) {
    auto found = argument_types.find(function + "." + name);
    if (found == argument_types.end()) found = argument_types.find(name);
    return found == argument_types.end() || function.starts_with("parts.") ? "any" : std::string(found->second);
}

// What functions return; of those that are not here the reference says what is in the table.
const std::map<std::string_view, std::string_view> result_types = {
    {"version", "string"},
    {"quick", "boolean"},
    {"format", "string"},
    {"phase_delay", "number"},
    {"standard_normal", "number"},
    {"decimate", "number[]"},
    {"derivative", "number[]"},
    {"friction_force", "number[]"},
    {"linspace", "number[]"},
    {"logspace", "number[]"},
    {"low_pass", "number[]"},
    {"list_folder", "string[]"},
    {"delay_model_response", "tribode.response"},
    {"loop_gain", "tribode.response"},
    {"model_response", "tribode.response"},
    {"plant_response", "tribode.response"},
    {"proposed_response", "tribode.response"},
    {"remove_delay", "tribode.response"},
    {"fmu", "tribode.system"},
    {"system", "tribode.system"},
    {"run_system", "tribode.system_run"},
    {"simulate", "tribode.simulation"},
    {"plant_parameters", "table<string, number>"},
    {"loop_margins", "table<string, any>"},
    {"fit_modal", "table<string, any>"},
    {"effects", "table[]"},
    {"points", "table[]"},
    {"tornado", "table[]"},
    {"worst_cases", "table[]"},
    {"compare", "table"},
    {"diagnose", "table"},
    {"diagnose_system", "table"},
    {"estimate_delay", "table"},
    {"feedforward", "table"},
    {"fit_friction", "table"},
    {"fra", "table"},
    {"frf", "table"},
    {"grid", "table"},
    {"histogram", "table"},
    {"latin_hypercube", "table"},
    {"least_squares", "table"},
    {"linearize", "table"},
    {"list", "table"},
    {"machine", "table"},
    {"monte_carlo", "table"},
    {"multisine", "table"},
    {"one_at_a_time", "table"},
    {"options", "table"},
    {"positioning", "table"},
    {"read_batch", "table"},
    {"read_record", "table"},
    {"regression_sensitivity", "table"},
    {"run", "table"},
    {"saltelli", "table"},
    {"single_frequency", "table"},
    {"sobol", "table"},
    {"sobol_indices", "table"},
    {"statistics", "table"},
    {"steady_state", "table"},
    {"sweep", "table"},
    {"system_variables", "table"},
    {"with_fields", "table"},
    {"table1", "function"},
    {"table2", "function"},
    {"batch", "nil"},
    {"plot", "nil"},
    {"report", "nil"},
    {"write_csv", "nil"},
    {"write_hdf5", "nil"},
    {"write_json", "nil"},
    {"write_mat", "nil"},
    {"write_text", "nil"},
};

std::string result_of(const std::string& function) {
    const auto found = result_types.find(function);
    return found == result_types.end() ? "any" : std::string(found->second);
}

constexpr const char* classes = R"(---@class tribode.response One complex value a frequency
---@field frequency_hz number[]
---@field real number[]
---@field imag number[]
---@field gain_db number[]
---@field phase_deg number[]

---@class tribode.column
---@field name string
---@field unit? string
---@field values number[]

---@class tribode.system A system of equations, as tb.system makes it

---@class tribode.event
---@field t number [s]
---@field name string

---@class tribode.transition
---@field t number [s]
---@field element integer 0: dry friction
---@field kind "slip_forward"|"slip_backward"|"stick"

---@class tribode.simulation
---@field t number[] [s]
---@field r number[] [m]
---@field u number[] [N]
---@field y number[] [m]
---@field x number[] [m]
---@field v number[] [m/s]
---@field f number[] [N]
---@field events tribode.transition[]
---@field ok boolean
---@field message string
---@field statistics table<string, number>
---@field [string] any

---@class tribode.system_run
---@field t number[] [s]
---@field values table<string, number[]>
---@field columns tribode.column[]
---@field events tribode.event[]
---@field final table<string, any>
---@field state table where the run can be continued
---@field ok boolean
---@field message string
---@field t_end number [s]
---@field solver string
---@field statistics table<string, number>
---@field [string] any

)";

// On one line, without what would end a comment.
std::string one_line(std::string text) {
    std::replace(text.begin(), text.end(), '\n', ' ');
    return text;
}

// The first call in "`tb.f{ a =, b = 3, … }`, `tb.f(x)`" behind the name: "{ a =, b = 3, … }".
std::string arguments_in(const std::string& usage) {
    const auto begin = usage.find_first_of("{(\"", usage.find("tb."));
    const auto end = std::min(usage.find('`', usage.find("tb.")), usage.size());
    return begin == std::string::npos || begin > end ? "" : usage.substr(begin, end - begin);
}

// The keys of an outermost table: those before "=".
std::vector<std::string> keys_in(const std::string& arguments) {
    std::vector<std::string> keys;
    std::string word;
    int depth = 0;
    for (const char c : arguments) {
        if (c == '{' || c == '(') ++depth;
        if (c == '}' || c == ')') --depth;
        if (c == '=' && depth == 1) {
            if (is_name(word)) keys.push_back(word);
            word.clear();
        } else if (c == ',' || c == '{' || c == '}') {
            word.clear();
        } else if (c != ' ') {
            word += c;
        }
    }
    return keys;
}

// The names in "(from, to, count)".
std::vector<std::string> plain_arguments(const std::string& arguments) {
    std::vector<std::string> names;
    std::string word;
    for (const char c : arguments) {
        if (c != ',' && c != ')') {
            if (c != '(' && c != ' ') word += c;
            continue;
        }
        if (is_name(word)) names.push_back(word);
        word.clear();
    }
    return names;
}

std::string options_class(const LuaFunction& function, const std::string& arguments) {
    std::string text = fmt::format("---@class tribode.{}.options\n", function.name);
    std::set<std::string> known;
    if (function.options) {
        for (const auto& row : function.options()) {
            if (!is_name(row.path) || !known.insert(row.path).second) continue;
            std::string type = type_of(row.values);
            if (type == "any") type = type_of_argument(function.name, row.path);
            text += fmt::format("---@field {}{} {}", row.path, row.fallback == "required" ? "" : "?", type);
            if (!row.unit.empty()) text += fmt::format(" [{}]", row.unit);
            if (!row.about.meaning.empty()) text += fmt::format(" {}", one_line(std::string(row.about.meaning)));
            if (row.fallback != "none" && row.fallback != "required") text += "; default " + row.fallback;
            text += "\n";
        }
    }
    for (const auto& key : keys_in(arguments)) {
        if (!known.insert(key).second) continue;
        text += fmt::format("---@field {}? {}\n", key, type_of_argument(function.name, key));
    }
    // Where the usage does not list all of them.
    if (!function.options || arguments.find("…") != std::string::npos) text += "---@field [string] any\n";
    return text;
}

} // namespace

std::string lua_stub() {
    std::string text = fmt::format("---@meta tribode\n"
                                   "-- The module tribode for editors with lua-language-server; made by: tribode "
                                   "completion lua\n\n{}---@class tribode\nlocal tb = {{}}\n",
                                   classes);
    std::set<std::string> tables;
    for (const auto& function : all_functions()) {
        if (const auto dot = function.name.find('.'); dot != std::string::npos) {
            const std::string table = function.name.substr(0, dot);
            if (tables.insert(table).second) text += fmt::format("\ntb.{} = {{}}\n", table);
        }
        const std::string arguments = arguments_in(function.usage);
        const std::string documentation =
            fmt::format("---{}\n---\n---{}\n", one_line(function.usage), one_line(function.documentation));
        text += "\n";
        if (arguments.empty() && std::holds_alternative<std::monostate>(function.function)) {
            text += documentation + fmt::format("---@type {}\ntb.{} = nil\n", result_of(function.name), function.name);
            continue;
        }
        if (function.options || arguments.starts_with('{')) {
            text += options_class(function, arguments) + "\n" + documentation;
            text += fmt::format("---@param options tribode.{}.options{}\n", function.name,
                                function.usage.find('(') < function.usage.find("`,") ? "|any" : "");
            text += fmt::format("---@return {}\nfunction tb.{}(options, ...) end\n", result_of(function.name),
                                function.name);
            continue;
        }
        text += documentation;
        std::vector<std::string> names =
            arguments.starts_with('"') ? std::vector<std::string>{"file"} : plain_arguments(arguments);
        for (const auto& name : names)
            text += fmt::format("---@param {}? {}\n", name, type_of_argument(function.name, name));
        names.emplace_back("...");
        text += fmt::format("---@return {}\nfunction tb.{}({}) end\n", result_of(function.name), function.name,
                            fmt::join(names, ", "));
    }
    return text + "\nreturn tb\n";
}

} // namespace tribode
