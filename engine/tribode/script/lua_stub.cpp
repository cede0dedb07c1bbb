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
        if (!type.empty()) type += '|';
        type += values.substr(begin, end - begin + 1);
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
    if (values == "list of lists") return "number[][]";
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
// those named `function.name`.
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
    {"describing_function.amplitude_m", "number[]"},
    {"load_N", "number"},
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
    {"at", "table<string, number>"},
    {"steady_state.free", "string[]"},
    {"a", "tribode.value"},
    {"b", "tribode.value"},
    {"all.a", "tribode.truth"},
    {"all.b", "tribode.truth"},
    {"any.a", "tribode.truth"},
    {"any.b", "tribode.truth"},
    {"negation.a", "tribode.truth"},
    {"where.condition", "tribode.truth"},
    {"x", "tribode.value"},
    {"delay.seconds", "tribode.value"},
    {"system.states", "table<string, any>"},
    {"system.der", "fun(s: tribode.variables): table<string, tribode.value>"},
    {"options.name", "number|string|boolean|number[]|table"},
    {"write_json.value", "tribode.plain"},
    {"write_mat.version", "\"5\"|\"7.3\"|\"dymola\""},
    {"points", "table[]"},
    {"records", "(string|table)[]"},
    {"sections", "table[]"},
    {"tables", "table[]"},
    {"factors", "table[]"},
    {"sobol_indices.factors", "string[]"},
};

std::string type_of_argument(const std::string& function, const std::string& name) {
    if (function.starts_with("parts.")) return "tribode.part_option";
    auto found = argument_types.find(function + "." + name);
    if (found == argument_types.end()) found = argument_types.find(name);
    return found == argument_types.end() ? "any" : std::string(found->second);
}

// What functions return, with the fields that the reference names.
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
    {"describing_function", "tribode.response"},
    {"model_response", "tribode.response"},
    {"plant_response", "tribode.response"},
    {"proposed_response", "tribode.response"},
    {"remove_delay", "tribode.response"},
    {"frf", "tribode.measured_response"},
    {"fmu", "tribode.system"},
    {"system", "tribode.system"},
    {"run_system", "tribode.system_run"},
    {"simulate", "tribode.simulation"},
    {"single_frequency", "tribode.settled_run"},
    {"positioning", "tribode.positioning_run"},
    {"plant_parameters", "table<string, number>"},
    {"loop_margins", "table<string, number|boolean>"},
    {"fit_modal", "tribode.modal_fit"},
    {"machine", "tribode.machine_description"},
    {"with_fields", "tribode.machine_description"},
    {"effects", "table[]"},
    {"points", "table[]"},
    {"diagnose", "tribode.diagnosis"},
    {"diagnose_system", "tribode.diagnosis"},
    {"options", "table<string, any>"},
    {"run", "{ folder: string, repeated: boolean }"},
    {"read_json", "tribode.plain"},
    {"read_record", "{ data: table<string, number[]>, units: table<string, string>, time?: table }"},
    {"compare", "{ text: string, findings: string[], reference: string, excitation_hz?: number, methods: table[] }"},
    {"sweep", "{ responses: table<string, tribode.response>, loop_gain: tribode.response, columns: tribode.column[], "
              "warnings: string[], statistics: table<string, number> }"},
    {"fra", "{ responses: table<string, tribode.measured_response>, fits: table<string, table>, records: string[], "
            "notes: string[], delay_s: number, text: string, loops: table<string, number|number[]>[], "
            "residuals: table<string, string|number|number[]>[] }"},
    {"identify", "{ machine: tribode.machine_description, parameters: table[], covariance: number[][], "
                 "residuals: number[][], residual_rms_m: number, excess: number, objective: number, "
                 "iterations: integer, converged: boolean, notes: string[] }"},
    {"estimate_delay", "{ delay_s: number, spread_s: number, frequency_hz: number[], delays_s: number[] }"},
    {"spectrum", "{ frequency_hz: number[], power: number[], windows: integer, averages: number, bandwidth_hz: number, "
                 "power_low: number, power_high: number, coherence?: number[], coherence_threshold?: number, "
                 "noise_power?: number[], inputs: table<string, table|number[]>[] }"},
    {"multisine", "{ values: number[], period_samples: integer, frequency_hz: number[], crest_factor: number }"},
    {"chirp", "{ values: number[], frequency_hz: number[] }"},
    {"binary_sequence", "{ values: number[], period_samples: integer }"},
    {"trajectory", "{ values: number[], velocity: number[], acceleration: number[], arrival_s: number[] }"},
    {"fit_friction", "{ elements: table[], residual_rms: number, residual_max: number }"},
    {"least_squares",
     "{ coefficients: number[], standard_errors: number[], residual: number[], relative_error: number }"},
    {"feedforward", "{ method: string, sample_time_s: number, distance_m: number, duration_s: number, "
                    "horizon_s: number, reference_m: number[], thrust_N: number[], response?: tribode.response }"},
    {"system_variables", "{ states: tribode.variable[], algebraic: tribode.variable[], discrete: tribode.variable[], "
                         "parameters: tribode.variable[], inputs: tribode.variable[], outputs: tribode.variable[] }"},
    {"steady_state", "{ start: table<string, any>, inputs: table<string, number>, parameters: table<string, number>, "
                     "residual: number, iterations: integer, conditions: table }"},
    {"linearize", "tribode.linear_system"},
    {"grid", "tribode.design"},
    {"latin_hypercube", "tribode.design"},
    {"list", "tribode.design"},
    {"monte_carlo", "tribode.design"},
    {"one_at_a_time", "tribode.design"},
    {"saltelli", "tribode.design"},
    {"sobol", "tribode.design"},
    {"read_batch", "tribode.merged_batch"},
    {"statistics", "{ count: integer, missing: integer, mean: number, standard_deviation: number, "
                   "standard_error: number, mean_low: number, mean_high: number, least: number, greatest: number, "
                   "quantiles: { probability: number, value: number, low: number, high: number }[] }"},
    {"histogram", "{ edges: number[], counts: integer[], missing: integer }"},
    {"worst_cases", "{ row: integer, value: number }[]"},
    {"sobol_indices",
     "{ first: number[], total: number[], first_error: number[], total_error: number[], factors: string[], "
     "mean: number, variance: number, groups: integer, dropped: integer }"},
    {"regression_sensitivity", "{ coefficients: number[], standard_errors: number[], factors: string[], "
                               "r_squared: number, rows: integer }"},
    {"tornado", "{ name: string, low: number, high: number, low_error: number, high_error: number }[]"},
    {"parts.backlash", "tribode.part"},
    {"parts.coulomb", "tribode.part"},
    {"parts.impact", "tribode.part"},
    {"parts.maxwell", "tribode.part"},
    {"parts.play", "tribode.part"},
    {"parts.relay", "tribode.part"},
    {"delay", "tribode.value"},
    {"no_event", "tribode.value"},
    {"before", "tribode.value"},
    {"tanh", "tribode.value"},
    {"where", "tribode.value"},
    {"all", "tribode.truth"},
    {"any", "tribode.truth"},
    {"greater", "tribode.truth"},
    {"greater_equal", "tribode.truth"},
    {"less", "tribode.truth"},
    {"less_equal", "tribode.truth"},
    {"negation", "tribode.truth"},
    {"table1", "fun(x: tribode.value): tribode.value"},
    {"table2", "fun(x: tribode.value, y: tribode.value): tribode.value"},
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

---@class tribode.measured_response: tribode.response
---@field std_gain_db number[]
---@field std_phase_deg number[]
---@field coherence number[]
---@field odd_distortion_db number[]
---@field even_distortion_db number[]
---@field settled number[] 1 or 0
---@field [string] any

---@class tribode.modal_fit k0, and k1, f1_hz, zeta1 and so on for each mode
---@field k0 number
---@field standard_errors table<string, number>
---@field residual_rms number
---@field converged boolean
---@field message string
---@field [string] any

---@class tribode.machine_description A table that you may change
---@field [string] any

---@class tribode.diagnosis The content of diagnosis.json
---@field verdict string
---@field effects table[]
---@field machine any
---@field [string] any

---@alias tribode.plain number|string|boolean|table|nil

---@class tribode.symbol A value of a variable in a function of tb.system, which records what is made of it
---@operator add(tribode.value): tribode.symbol
---@operator sub(tribode.value): tribode.symbol
---@operator mul(tribode.value): tribode.symbol
---@operator div(tribode.value): tribode.symbol
---@operator pow(tribode.value): tribode.symbol
---@operator mod(tribode.value): tribode.symbol
---@operator idiv(tribode.value): tribode.symbol
---@operator unm: tribode.symbol

---@class tribode.condition
---@alias tribode.value number|tribode.symbol
---@alias tribode.truth boolean|tribode.condition
---@alias tribode.variables table<string, any> the variables of a system, by their names

---@class tribode.part A ready part, for the `parts` of tb.system
---@alias tribode.part_option string|number|fun(s: tribode.variables): tribode.value

---@class tribode.variable
---@field name string
---@field unit string
---@field value? number

---@class tribode.linear_system
---@field A number[][]
---@field B number[][]
---@field C number[][]
---@field D number[][]
---@field poles { real: number, imag: number }[]
---@field stable boolean
---@field rate_left? number
---@field jump_left? number
---@field response? tribode.response
---@field margins? table<string, number>
---@field sample_time_s? number
---@field [string] any

---@class tribode.design For the points of tb.batch
---@field design string
---@field count integer
---@field names string[]
---@field factors? table[]
---@field [string] any

---@class tribode.merged_batch
---@field name string
---@field count integer
---@field seed integer
---@field index integer[]
---@field seeds integer[]
---@field units table<string, string>
---@field parameters table<string, number[]>
---@field results table<string, any[]>
---@field failures { index: integer, reason: string }[]

---@class tribode.system A system of equations, as tb.system makes it

---@class tribode.event
---@field t number [s]
---@field name string

---@class tribode.transition
---@field t number [s]
---@field element integer 0: dry friction
---@field kind "slip_forward"|"slip_backward"|"stick"

---@class tribode.signals
---@field t number[] [s]
---@field r number[] [m]
---@field u number[] [N]
---@field y number[] [m]
---@field x number[] [m]
---@field v number[] [m/s]
---@field f number[] [N]

---@class tribode.simulation: tribode.signals
---@field sensitivities? table<string, table<string, number[]>> by parameter, then as signals
---@field events tribode.transition[]
---@field ok boolean
---@field message string
---@field statistics table<string, number>
---@field [string] any

---@class tribode.settled_run: tribode.signals
---@field delayed_thrust number[] [N]
---@field friction_estimate number[] [N]
---@field effective_thrust number[] [N]

---@class tribode.positioning_run: tribode.signals
---@field error number[] [m]
---@field tracking_error number[] [m]
---@field rmse_m number
---@field max_error_m number
---@field settling_s? number
---@field peak_thrust_N number
---@field peak_position_m number
---@field within_rating boolean
---@field within_stroke boolean
---@field spectrum { frequency_hz: number[], amplitude_m: number[] }
---@field columns tribode.column[]
---@field statistics table<string, number>

---@class tribode.system_run
---@field t number[] [s]
---@field values table<string, number[]>
---@field columns tribode.column[]
---@field events tribode.event[]
---@field final table<string, any>
---@field sensitivities? table<string, table<string, number[]>> by parameter, then as values
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
