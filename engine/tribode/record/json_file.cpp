#include "tribode/record/json_file.hpp"
#include "tribode/base/error.hpp"
#include "tribode/record/output_file.hpp"

#include <algorithm>
#include <cctype>
#include <fmt/format.h>
#include <set>
#include <sstream>
#include <vector>

namespace tribode {

namespace {

// Of tables and lists within one another. What reads, prints or compares them goes down by a call for each.
constexpr int max_levels = 64;

// The reader's sentence without its prefix: `[json.exception...] parse error at line 3, column 14: syntax error
// while parsing value - unexpected '}'` becomes `while parsing value - unexpected '}'`.
std::string without_prefix(std::string_view text) {
    for (const std::string_view prefix : {"] ", "parse error at ", ": ", "syntax error "}) {
        const auto at = text.find(prefix);
        if (prefix == ": " && !text.starts_with("line ")) continue;
        if (at != std::string_view::npos) text.remove_prefix(at + prefix.size());
    }
    return std::string(text);
}

} // namespace

std::string to_json_text(const Json& value) { return value.dump(2, ' ', false, Json::error_handler_t::replace) + '\n'; }

void write_json(const std::filesystem::path& path, const Json& value) { write_file(path, to_json_text(value)); }

Json read_json(const std::filesystem::path& path) { return parse_json(read_file(path), path.string()); }

Json parse_json(const std::string& text, const std::string& source) {
    std::istringstream stream(text);

    // The reader takes one character at a time, so the stream stands right behind what it has just read.
    const auto fail = [&](const std::string& problem) {
        const auto position = stream.rdbuf()->pubseekoff(0, std::ios::cur, std::ios::in);
        std::string_view read(text.data(), std::min(text.size(), static_cast<std::size_t>(position)));
        // The end of a number is known by what follows it, which may stand on the next line.
        while (!read.empty() && std::isspace(static_cast<unsigned char>(read.back()))) read.remove_suffix(1);
        const auto line = std::count(read.begin(), read.end(), '\n') + 1;
        const auto column = read.size() - (read.rfind('\n') + 1);
        throw InputError(fmt::format("{}:{}:{}: {}", source, line, std::max(column, std::size_t{1}), problem));
    };

    std::vector<std::set<std::string>> keys; // of the tables that are open, the innermost last
    const auto watch = [&](int depth, Json::parse_event_t event, Json& value) {
        const bool opens = event == Json::parse_event_t::object_start || event == Json::parse_event_t::array_start;
        if (opens && depth >= max_levels) fail(fmt::format("is nested deeper than {} levels", max_levels));
        if (event == Json::parse_event_t::object_start) keys.emplace_back();
        if (event == Json::parse_event_t::object_end) keys.pop_back();
        if (event == Json::parse_event_t::key && !keys.back().insert(value.get<std::string>()).second) {
            fail(fmt::format("the key {} stands twice in one table, must stand once", value.dump()));
        }
        return true;
    };
    try {
        return Json::parse(stream, watch);
    } catch (const Json::exception& problem) {
        fail(without_prefix(problem.what()));
    }
    return {};
}

} // namespace tribode
