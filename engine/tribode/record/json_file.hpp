#pragma once
#include "tribode/base/json.hpp"

#include <filesystem>
#include <string>

namespace tribode {

// Indented by 2, a line break at the end. Numbers read back to the same double; nan and inf, which JSON does not
// have, become null; bytes that are not UTF-8 become the replacement character.
std::string to_json_text(const Json& value);

// to_json_text through write_file.
void write_json(const std::filesystem::path& path, const Json& value);

// Throws InputError with file, line and column (both from 1) on a syntax error, on a number that no double can hold
// and on a key that stands twice in one table.
Json read_json(const std::filesystem::path& path);

// The same of a text already read; `source` takes the place of the file's name.
Json parse_json(const std::string& text, const std::string& source);

} // namespace tribode
