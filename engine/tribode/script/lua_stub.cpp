#include "tribode/script/lua_stub.hpp"
#include "tribode/script/lua_function.hpp"

#include <algorithm>
#include <cctype>
#include <fmt/format.h>
#include <fmt/ranges.h>
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
    if (const std::string words = words_in(values); !words.empty()) return is_list ? "(" + words + ")[]" : words;
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
    return "any";
}

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

// The plain arguments of "(from, to, count)".
std::vector<std::string> names_in(const std::string& arguments) {
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
            text +=
                fmt::format("---@field {}{} {}", row.path, row.fallback == "required" ? "" : "?", type_of(row.values));
            if (!row.unit.empty()) text += fmt::format(" [{}]", row.unit);
            if (!row.about.meaning.empty()) text += " " + one_line(std::string(row.about.meaning));
            if (row.fallback != "none" && row.fallback != "required") text += "; default " + row.fallback;
            text += "\n";
        }
    }
    for (const auto& key : keys_in(arguments)) {
        if (known.insert(key).second) text += fmt::format("---@field {}? any\n", key);
    }
    // Where the usage does not list all of them.
    if (!function.options || arguments.find("…") != std::string::npos) text += "---@field [string] any\n";
    return text;
}

} // namespace

std::string lua_stub() {
    std::string text = "---@meta tribode\n"
                       "-- The module tribode for editors with lua-language-server; made by: tribode completion lua\n\n"
                       "---@class tribode\nlocal tb = {}\n";
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
            text += documentation + fmt::format("---@type any\ntb.{} = nil\n", function.name);
            continue;
        }
        if (function.options || arguments.starts_with('{')) {
            text += options_class(function, arguments) + "\n" + documentation;
            text += fmt::format("---@param options tribode.{}.options{}\n", function.name,
                                function.usage.find("(") < function.usage.find("`,") ? "|any" : "");
            text += fmt::format("---@return any\nfunction tb.{}(options, ...) end\n", function.name);
            continue;
        }
        text += documentation;
        std::vector<std::string> names =
            arguments.starts_with('"') ? std::vector<std::string>{"file"} : names_in(arguments);
        for (const auto& name : names) text += fmt::format("---@param {}? any\n", name);
        names.emplace_back("...");
        text += fmt::format("---@return any\nfunction tb.{}({}) end\n", function.name, fmt::join(names, ", "));
    }
    return text + "\nreturn tb\n";
}

} // namespace tribode
