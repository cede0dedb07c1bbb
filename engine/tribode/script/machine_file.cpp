#include "tribode/script/machine_file.hpp"
#include "tribode/base/error.hpp"
#include "tribode/record/json_file.hpp"

#include <fmt/format.h>

namespace tribode {

namespace fs = std::filesystem;

static Json run_description(const fs::path& path, const ScriptLimits& limits, const Json& argument,
                            std::shared_ptr<FilesRead> files_read, const RunControl& control) {
    ScriptAccess access;
    access.files_read = std::move(files_read);
    access.read_folders = {path.has_parent_path() ? path.parent_path() : fs::path(".")};
    LuaState state(limits, std::move(access), control);
    return state.run_file(path, argument);
}

Json read_description(const fs::path& path, const ScriptLimits& limits, const Json& argument,
                      std::shared_ptr<FilesRead> files_read, const RunControl& control) {
    const fs::path kind = path.extension();
    if (kind != ".lua" && kind != ".json") {
        throw InputError(fmt::format("{}: a description is a .lua or a .json file", path.string()));
    }
    Json description =
        kind == ".lua" ? run_description(path, limits, argument, std::move(files_read), control) : read_json(path);
    if (!description.is_object()) {
        throw InputError(
            fmt::format("{}: must {} a table of named fields", path.string(), kind == ".lua" ? "return" : "hold"));
    }
    return description;
}

} // namespace tribode
