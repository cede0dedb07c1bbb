#pragma once
#include "tribode/script/lua_state.hpp"

namespace tribode {

// The table in a description file, unread: a machine as .lua or .json. A Lua file runs in a state of its own
// that may read its own folder only; it gets `argument` as `...` and must return a table with named fields.
// `files_read` takes the files that were read, see ScriptAccess.
// Throws InputError, whose text begins with the file and, where there is one, the line; EndedEarly on a stop request.
Json read_description(const std::filesystem::path& path, const ScriptLimits& limits = {},
                      const Json& argument = nullptr, std::shared_ptr<FilesRead> files_read = nullptr,
                      const RunControl& control = {});

} // namespace tribode
