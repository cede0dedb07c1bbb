#include "tribode/script/batch_script.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/text.hpp"
#include "tribode/batch/merge.hpp"
#include "tribode/batch/plan.hpp"
#include "tribode/batch/sampling.hpp"
#include "tribode/batch/workers.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/script/trampoline.hpp"
#include "tribode/script/value.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <limits>
#include <lua.hpp>

namespace tribode {

namespace fs = std::filesystem;

namespace {

// ---- tb.batch ----------------------------------------------------------------------------------------------------

// A Lua value that outlives the call it came with; it ends with its state.
int keep(lua_State* lua, int index) {
    lua_pushvalue(lua, index);
    return luaL_ref(lua, LUA_REGISTRYINDEX);
}

// The points of a script: a list of tables, a function of the index, or a design.
struct ScriptPoints {
    int reference = LUA_NOREF;
    bool function = false;
    std::shared_ptr<const Design> design;
    std::size_t count = 0;

    // Pushes point `index`, a table. [-0, +1]
    void push_point(lua_State* lua, std::size_t index) const {
        if (design) return push(lua, design->point(index - 1));
        lua_rawgeti(lua, LUA_REGISTRYINDEX, reference);
        if (function) {
            lua_pushinteger(lua, static_cast<lua_Integer>(index));
            lua_call(lua, 1, 1);
        } else {
            lua_rawgeti(lua, -1, static_cast<lua_Integer>(index));
            lua_remove(lua, -2);
        }
    }
};

bool is_number(const Json& value) { return value.is_number() || value.is_boolean(); }

double number_of(const Json& value) {
    return value.is_boolean() ? static_cast<double>(value.get<bool>()) : value.get<double>();
}

// The names of the numbers of a point; texts and tables of it reach `run`, but no table of results.
std::vector<std::string> names_of_point(const Json& point) {
    std::vector<std::string> names;
    for (const auto& [name, value] : point.items()) {
        if (is_number(value)) names.push_back(name);
    }
    return names;
}

std::vector<double> parameters_of(const Json& point, const std::vector<std::string>& names, std::size_t index) {
    if (!point.is_object()) {
        throw InputError(fmt::format("tb.batch: points: point {} must be a table of named fields", index));
    }
    if (const auto found = names_of_point(point); found != names) {
        throw InputError(fmt::format("tb.batch: points: point {} has the numbers ({}), point 1 has ({}); all must have "
                                     "the same",
                                     index, fmt::join(found, ", "), fmt::join(names, ", ")));
    }
    std::vector<double> parameters;
    for (const auto& name : names) parameters.push_back(number_of(point[name]));
    return parameters;
}

// Appends numbers, lists of numbers and tables of these, the latter as table.field.
void append_fields(std::vector<KeptField>& fields, const std::string& name, const Json& value) {
    if (!is_column_name(name)) {
        throw InputError(fmt::format("run returned a field \"{}\"; index, failed and reason are taken, and a comma, a "
                                     "quote, a slash or a line break has no place in a name",
                                     name));
    }
    const auto refuse = [&](std::string_view found) {
        throw InputError(
            fmt::format("run returned {} = {}, must be a number, a list of numbers or a table of these", name, found));
    };
    if (is_number(value)) {
        fields.push_back({name, false, {number_of(value)}});
    } else if (value.is_array() || (value.is_object() && value.empty())) {
        KeptField field{name, true, {}};
        for (const auto& entry : value) {
            if (!is_number(entry)) refuse("a list with other things than numbers");
            field.values.push_back(number_of(entry));
        }
        fields.push_back(std::move(field));
    } else if (value.is_object()) {
        for (const auto& [inner, entry] : value.items()) append_fields(fields, name + "." + inner, entry);
    } else {
        refuse(value.type_name());
    }
}

std::vector<KeptField> fields_of(const Json& result) {
    if (!result.is_object()) {
        throw InputError(fmt::format("run returned a {}, must return a table of what is kept of the point",
                                     result.is_null() ? "nil" : result.type_name()));
    }
    std::vector<KeptField> fields;
    for (const auto& [name, value] : result.items()) {
        append_fields(fields, name, value);
    }
    std::sort(fields.begin(), fields.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
    const auto twice =
        std::adjacent_find(fields.begin(), fields.end(), [](const auto& a, const auto& b) { return a.name == b.name; });
    if (twice != fields.end()) throw InputError(fmt::format("run returned two fields \"{}\"", twice->name));
    return fields;
}

// The numbers of math.random belong to the point, too.
void seed_random_numbers(lua_State* lua, std::uint64_t seed) {
    lua_getglobal(lua, "math");
    lua_getfield(lua, -1, "randomseed");
    lua_pushinteger(lua, static_cast<lua_Integer>(seed));
    lua_call(lua, 1, 0);
    lua_pop(lua, 1);
}

PointRow run_point(LuaState& state, const Batch& batch, const ScriptPoints& points, int run, std::size_t index) {
    PointRow row{index, {}, {}, {}};
    try {
        state.enter([&](lua_State* lua) {
            points.push_point(lua, index);
            row.parameters = parameters_of(to_json(lua, -1, "the point"), batch.parameters, index);
            const std::uint64_t seed = point_seed(batch.seed, index);
            seed_random_numbers(lua, seed);
            lua_rawgeti(lua, LUA_REGISTRYINDEX, run);
            lua_insert(lua, -2);
            lua_pushinteger(lua, static_cast<lua_Integer>(seed));
            lua_pushinteger(lua, static_cast<lua_Integer>(index));
            lua_call(lua, 3, 1);
            row.fields = fields_of(to_json(lua, -1, "what run returned"));
            return 0;
        });
    } catch (const EndedEarly&) {
        throw; // a stop request; the point is run another time
    } catch (const OutputError&) {
        throw; // a full disk is no property of the point
    } catch (const std::exception& problem) {
        row.fields.clear();
        row.failure = problem.what();
        if (row.failure.empty()) row.failure = "failed without a message";
    }
    return row;
}

// Field `name` of the options table as plain data.
Json data_field(lua_State* lua, const char* name) {
    lua_getfield(lua, 1, name);
    Json value = to_json(lua, -1, fmt::format("tb.batch: {}", name));
    lua_pop(lua, 1);
    return value;
}

int function_field(lua_State* lua, const char* name, bool required) {
    const int type = lua_getfield(lua, 1, name);
    int reference = LUA_NOREF;
    if (type == LUA_TFUNCTION) {
        reference = keep(lua, -1);
    } else if (type != LUA_TNIL || required) {
        throw InputError(fmt::format("tb.batch: {} is {}, must be a function", name,
                                     type == LUA_TNIL ? "missing" : luaL_typename(lua, -1)));
    }
    lua_pop(lua, 1);
    return reference;
}

ScriptPoints points_field(lua_State* lua, const Json& count) {
    ScriptPoints points;
    const int type = lua_getfield(lua, 1, "points");
    if (type == LUA_TFUNCTION) {
        if (!count.is_number_integer() || count.get<std::int64_t>() < 1) {
            throw InputError(
                "tb.batch: count must be a whole number from 1 on where points is a function of the index");
        }
        points.function = true;
        points.count = count.get<std::size_t>();
    } else if (type == LUA_TTABLE) {
        const bool is_design = lua_getfield(lua, -1, "design") == LUA_TSTRING;
        lua_pop(lua, 1);
        if (is_design) {
            const Json description = to_json(lua, -1, "tb.batch: points");
            points.design = std::make_shared<Design>(Design::from_description(description, "tb.batch: points"));
        }
        points.count = is_design ? points.design->count() : lua_rawlen(lua, -1);
        if (points.count == 0) throw InputError("tb.batch: points is an empty list, must have at least one point");
        if (!count.is_null()) throw InputError("tb.batch: count goes with points that are a function of the index");
    } else {
        throw InputError("tb.batch: points must be a list of tables, a design such as tb.sobol gives, or a function "
                         "of the index with a count");
    }
    points.reference = keep(lua, -1);
    lua_pop(lua, 1);
    return points;
}

} // namespace

int describe_batch(lua_State* lua, ScriptRun& run) {
    static const std::vector<std::string> known = {"name", "seed", "points", "count", "units", "run", "finish"};
    if (lua_gettop(lua) != 1 || !lua_istable(lua, 1)) throw InputError("tb.batch: takes one options table");
    for (lua_pushnil(lua); lua_next(lua, 1); lua_pop(lua, 1)) {
        const std::string key = lua_type(lua, -2) == LUA_TSTRING ? lua_tostring(lua, -2) : "[a number]";
        if (std::find(known.begin(), known.end(), key) == known.end()) {
            throw InputError(fmt::format("tb.batch: {} is not known{}", key, suggestion(key, known)));
        }
    }
    const Json data{
        {"name", data_field(lua, "name")}, {"seed", data_field(lua, "seed")}, {"units", data_field(lua, "units")}};
    FieldReader fields(data, "tb.batch");
    ScriptBatch described;
    Batch& batch = described.batch;
    batch.name = fields.text("name", "");
    batch.seed = static_cast<std::uint64_t>(fields.integer("seed", 0, 1L << 53, 0));
    FieldReader units = fields.table("units");
    for (const auto& [name, unit] : data["units"].items()) batch.units[name] = units.text(name);

    const ScriptPoints points = points_field(lua, data_field(lua, "count"));
    const int function = function_field(lua, "run", true), finish = function_field(lua, "finish", false);
    batch.count = points.count;
    points.push_point(lua, 1);
    const Json first = to_json(lua, -1, "tb.batch: points: point 1");
    if (!first.is_object()) throw InputError("tb.batch: points: point 1 must be a table of named fields");
    batch.parameters = names_of_point(first);
    lua_settop(lua, 0);

    LuaState& state = run.lua();
    batch.point = [&state, points, names = batch.parameters](std::size_t index) {
        std::vector<double> parameters;
        state.enter([&](lua_State* stack) {
            points.push_point(stack, index);
            parameters = parameters_of(to_json(stack, -1, "the point"), names, index);
            return 0;
        });
        return parameters;
    };
    batch.run = [&state, points, function, plain = Batch{batch}](std::size_t index) {
        return run_point(state, plain, points, function, index);
    };
    batch.files_read = [&run] { return run.files_read(); };
    if (finish != LUA_NOREF) {
        described.finish = [&state, finish](const Json& merged) {
            state.enter([&](lua_State* stack) {
                lua_rawgeti(stack, LUA_REGISTRYINDEX, finish);
                push(stack, merged);
                lua_call(stack, 1, 0);
                return 0;
            });
        };
    }
    run.set_batch(std::move(described));
    return 0;
}

// ---- planned batches ---------------------------------------------------------------------------------------------

namespace {

// Where a file of the manifest lies: seen from the folder that the batch was planned in, or a ready one.
fs::path place_of(const std::string& name, const fs::path& folder, const Manifest& manifest) {
    const fs::path there = folder / manifest.working_folder / name;
    return fs::exists(there) ? there : ScriptRun::ready_file(name);
}

ScriptRequest request_of(const Manifest& manifest, const BatchRunRequest& asked, const fs::path& folder) {
    ScriptRequest request;
    request.script = ScriptRun::ready_file(manifest.files.front().name);
    request.folder = folder / "files";
    request.defines = manifest.defines;
    for (const auto& [name, value] : manifest.defines) request.named.emplace_back(value);
    // Who planned the batch knew what is in these; what else lies beside the script may be nobody else's business.
    for (const auto& file : manifest.files) request.named.push_back(ScriptRun::ready_file(file.name));
    request.beside = false;
    request.quick = manifest.quick;
    request.compile = asked.compile;
    request.confine = asked.confine;
    request.only_batch = true;
    return request;
}

Manifest plan_batch_of(const ScriptRun& script, const Batch& batch, const fs::path& folder,
                       const PlanOptions& options) {
    const fs::path working_folder = fs::current_path();
    Manifest draft;
    draft.defines = script.request().defines;
    draft.quick = script.request().quick;
    draft.working_folder = working_folder.lexically_proximate(fs::weakly_canonical(folder)).string();
    return plan_batch(folder, batch, options, draft, [&](const std::string& file) {
        return SourceFile{ScriptRun::name_in_manifest(file, working_folder), sha256(read_file(file))};
    });
}

bool is_same(const Manifest& manifest, const Batch& batch) {
    return batch.name == manifest.name && batch.seed == manifest.seed && batch.count == manifest.count &&
           batch.parameters == manifest.parameters && batch.units == manifest.units;
}

} // namespace

RunControl inside_a_point(const RunControl& control) {
    RunControl inside;
    inside.stop = control.stop;
    inside.workers = 1;
    return inside;
}

PlannedBatch plan_script_batch(const BatchPlanRequest& request, const RunControl& control) {
    const fs::path folder = fs::absolute(request.folder);
    ScriptRequest script_request = request.script;
    script_request.folder = folder / "files";
    script_request.only_batch = true;
    ScriptRun script(script_request, inside_a_point(control));
    script.note_named();
    script.confine(folder);
    const Manifest manifest =
        plan_batch_of(script, script.read_batch().batch, folder, {request.shards, request.shard_seconds});
    PlannedBatch planned{manifest.count, manifest.shards, manifest.pilot["seconds_per_point"].get<double>(), {}};
    const auto failed = manifest.pilot["failed"].get<std::size_t>();
    if (failed > 0) {
        planned.warnings.push_back(fmt::format("{} of {} points that were tried fail: {}", failed,
                                               manifest.pilot["points"].get<std::size_t>(),
                                               manifest.pilot["failure"].get<std::string>()));
    }
    if (!manifest.pilot["repeatable"].get<bool>()) {
        planned.warnings.push_back("a point that was run twice gave two results; where it measures no time, the script "
                                   "changes a table that outlives the point");
    }
    return planned;
}

void require_defines(const fs::path& folder, const Manifest& manifest,
                     const std::map<std::string, std::string>& given) {
    for (const auto& [name, value] : given) {
        const auto planned = manifest.defines.find(name);
        if (planned != manifest.defines.end() && planned->second == value) continue;
        throw InputError(fmt::format("-D {}={}: the batch was planned {}; its options do not change", name, value,
                                     planned == manifest.defines.end() ? "without this option"
                                                                       : "with " + name + "=" + planned->second));
    }
    const fs::path root = fs::weakly_canonical(folder), working = root / manifest.working_folder;
    std::error_code problem;
    const auto is_known = [&](const fs::path& file) {
        return std::any_of(manifest.files.begin(), manifest.files.end(), [&](const SourceFile& known) {
            return fs::equivalent(file, place_of(known.name, root, manifest), problem);
        });
    };
    for (const auto& [name, value] : manifest.defines) {
        const fs::path place = fs::weakly_canonical(working / value, problem);
        // Most options are numbers and words, and name nothing.
        if (given.contains(name) || value.empty() || !fs::exists(place, problem)) continue;
        if (std::mismatch(root.begin(), root.end(), place.begin(), place.end()).first == root.end()) continue;
        if (!fs::is_directory(place, problem) && is_known(place)) continue;
        throw InputError(
            fmt::format("{}: the option {} of the batch names \"{}\", which lies outside its folder and is no "
                        "file that its manifest knows; if the script may read it, give -D {}={} again",
                        folder.string(), name, value, name, value));
    }
}

bool run_script_batch(const BatchRunRequest& asked, const RunControl& control) {
    const fs::path& in = asked.folder;
    const std::optional<std::size_t>& shard = asked.shard;
    const fs::path folder = fs::weakly_canonical(fs::absolute(in));
    const Manifest manifest = Manifest::read(folder);
    if (shard && (*shard < 1 || *shard > manifest.shards)) {
        throw InputError(fmt::format("{}: there is no shard {}; the batch has the shards 1 to {}", in.string(), *shard,
                                     manifest.shards));
    }
    // Names in the script are relative to where it was planned.
    std::error_code problem;
    fs::current_path(folder / manifest.working_folder, problem);
    if (problem) {
        throw InputError(fmt::format("{}: was planned in {}, which is not there ({})", in.string(),
                                     (folder / manifest.working_folder).lexically_normal().string(),
                                     problem.message()));
    }
    manifest.require_unchanged(folder, ScriptRun::ready_file);

    std::optional<FolderLock> lock;
    std::vector<std::size_t> shards;
    if (!shard) {
        lock.emplace(folder);
        shards = missing_shards(folder, manifest, control);
    } else if (!shard_state(folder, manifest, *shard).complete) {
        shards = {*shard};
    }
    if (shards.empty()) return true;

    require_defines(folder, manifest, asked.defines);
    ScriptRun script(request_of(manifest, asked, folder), inside_a_point(control));
    script.confine(folder);
    const Batch& batch = script.read_batch().batch;
    if (!is_same(manifest, batch)) {
        throw InputError(fmt::format("{}: the script describes another batch than when it was planned, though no file "
                                     "has changed; it must not depend on time or chance",
                                     in.string()));
    }
    return run_shards(folder, manifest, batch, shards, control);
}

bool run_batch_of(ScriptRun& script, const fs::path& in, const RunControl& control) {
    const fs::path folder = fs::weakly_canonical(fs::absolute(in));
    const Batch& batch = script.batch().batch;
    script.note_named(); // also what no point of the pilot reads
    if (!fs::exists(folder / "manifest.json")) plan_batch_of(script, batch, folder, {});
    const Manifest manifest = Manifest::read(folder);
    manifest.require_unchanged(folder, ScriptRun::ready_file);
    // What points read, they read in processes of their own.
    for (const auto& file : manifest.files) script.lua().access().note_read(ScriptRun::ready_file(file.name));
    if (!is_same(manifest, batch) || manifest.defines != script.request().defines ||
        manifest.quick != script.request().quick) {
        throw InputError(
            fmt::format("{}: holds a batch with other options; give them again, choose another folder with -o, "
                        "or remove it",
                        in.string()));
    }
    const FolderLock lock(folder);
    return run_shards(folder, manifest, batch, missing_shards(folder, manifest, control), control);
}

std::vector<fs::path> files_of_batch(const fs::path& folder) {
    const Manifest manifest = Manifest::read(folder);
    std::vector<fs::path> files = {folder};
    for (const auto& file : manifest.files) files.push_back(place_of(file.name, folder, manifest));
    return files;
}

MergeSummary merge_script_batch(const fs::path& folder, const fs::path& output, const RunControl& control) {
    const Manifest manifest = Manifest::read(folder);
    manifest.require_unchanged(folder, [&](const std::string& name) { return place_of(name, folder, manifest); });
    return merge_batch(folder, manifest, output, control);
}

Json merged_batch(const fs::path& folder) {
    const Manifest manifest = Manifest::read(folder);
    std::vector<std::vector<double>> parameters(manifest.parameters.size());
    std::map<std::string, Json::array_t> results; // one entry per point
    std::vector<std::size_t> index;
    std::vector<std::uint64_t> seeds;
    Json failures = Json::array();
    const Json nan = std::numeric_limits<double>::quiet_NaN();
    for_each_point(folder, manifest, [&](const PointRow& row) {
        index.push_back(row.index);
        seeds.push_back(point_seed(manifest.seed, row.index));
        for (std::size_t i = 0; i < parameters.size(); ++i) parameters[i].push_back(row.parameters[i]);
        if (!row.failure.empty()) failures.push_back({{"index", row.index}, {"reason", row.failure}});
        for (const auto& field : row.fields) {
            auto& column = results[field.name];
            column.resize(index.size() - 1, nan); // points before that had none
            column.push_back(field.list ? Json(field.values) : Json(field.values.front()));
        }
        for (auto& [name, column] : results) column.resize(index.size(), nan);
    });
    Json json{
        {"name", manifest.name}, {"count", manifest.count}, {"seed", manifest.seed},        {"index", index},
        {"seeds", seeds},        {"units", manifest.units}, {"parameters", Json::object()}, {"results", Json::object()},
        {"failures", failures}};
    for (std::size_t i = 0; i < parameters.size(); ++i) json["parameters"][manifest.parameters[i]] = parameters[i];
    for (auto& [name, column] : results) json["results"][name] = std::move(column);
    return json;
}

} // namespace tribode
