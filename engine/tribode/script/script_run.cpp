#include "tribode/script/script_run.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/kernel_sandbox.hpp"
#include "tribode/base/text.hpp"
#include "tribode/batch/merge.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/script/batch_script.hpp"
#include "tribode/script/bindings.hpp"
#include "tribode/script/machine_file.hpp"
#include "tribode/script/sandbox.hpp"
#include "tribode/system/compiled_c.hpp"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fmt/format.h>
#include <lua.hpp>
#include <sstream>
#include <sys/stat.h>

namespace tribode {

namespace {

// The folder of the results. A missing script is said here, before the folder is made.
std::filesystem::path folder_of(const ScriptRequest& request) {
    if (!request.text) read_file(request.script);
    return request.folder.empty() ? std::filesystem::path("results") / request.script.stem() : request.folder;
}

// The text of -D as a value of the default's type.
Json parse_define(const std::string& name, const std::string& text, const Json& fallback) {
    const auto wrong = [&](const char* wanted) {
        return InputError(fmt::format("-D {}={}: must be {}", name, text, wanted));
    };
    const auto number = [&](std::string_view part) {
        const auto value = parse_number(part);
        if (!value) throw wrong(fallback.is_array() ? "a list of numbers, such as 10,15,20" : "a number");
        return *value;
    };
    if (fallback.is_string()) return text;
    if (fallback.is_boolean()) {
        if (text != "true" && text != "false") throw wrong("true or false");
        return text == "true";
    }
    if (fallback.is_number()) {
        const double value = number(text);
        constexpr double most = 1L << 53; // beyond, not every whole number is a double
        if (fallback.is_number_integer() && std::abs(value) <= most && value == std::trunc(value)) {
            return static_cast<long>(value);
        }
        return value;
    }
    Json list = Json::array();
    for (std::size_t begin = 0; begin <= text.size();) {
        const std::size_t end = std::min(text.find(',', begin), text.size());
        list.push_back(number(std::string_view(text).substr(begin, end - begin)));
        begin = end + 1;
    }
    return list;
}

constexpr int deepest = 4; // nested runs within one another

// The manifest in a folder; null where there is none that can be read.
Json manifest_in(const std::filesystem::path& folder) {
    const auto file = folder / "manifest.json";
    if (!std::filesystem::exists(file)) return nullptr;
    try {
        return read_json(file);
    } catch (const InputError&) {
        return nullptr;
    }
}

// A run that was ended leaves a manifest that says so, one that was killed leaves none.
bool is_unfinished(const std::filesystem::path& folder) {
    const Json manifest = manifest_in(folder);
    return !manifest.is_object() || manifest.value("outcome", Json()) != "done";
}

// As it would stand behind -D name=.
std::string define_of(const Json& value, const std::string& name) {
    if (value.is_string()) return value.get<std::string>();
    if (value.is_boolean()) return value.get<bool>() ? "true" : "false";
    if (value.is_number()) return to_text(value.get<double>());
    std::string text;
    for (const auto& entry : value) {
        if (!value.is_array() || !entry.is_number()) {
            throw InputError(
                fmt::format("tb.run: options.{} must be a number, a text, a boolean or a list of numbers", name));
        }
        if (!text.empty()) text += ',';
        append_text(text, entry.get<double>());
    }
    return text;
}

// The first line of a program may be for the shell. Without it the others keep their numbers.
std::string without_first_comment(std::string text) {
    constexpr std::string_view byte_order_mark = "\xEF\xBB\xBF";
    if (text.starts_with(byte_order_mark)) text.erase(0, byte_order_mark.size());
    if (text.starts_with('#')) text.erase(0, text.find('\n'));
    return text;
}

std::filesystem::path folder_beside(const std::filesystem::path& file) {
    return file.has_parent_path() ? file.parent_path() : std::filesystem::path(".");
}

ScriptRequest with_ready_script(ScriptRequest request) {
    if (request.text) return request;
    const auto ready = ScriptRun::ready_file(request.script.string());
    if (std::filesystem::exists(ready)) request.script = ready; // else the user's own name is in the message
    return request;
}

// The calls that led to an error, as the end of its sentence; empty where the line that it begins with says it all.
std::string calls_of(const std::string& problem, const std::string& traceback) {
    constexpr std::size_t most = 8;
    std::vector<std::string> calls;
    std::istringstream lines(traceback);
    for (std::string line; std::getline(lines, line);) {
        const std::string_view call = trim(line);
        const auto in = call.find(": in ");
        if (in == std::string_view::npos || call.starts_with("[C]")) continue;
        const std::string place(call.substr(0, in));
        if (calls.empty() && problem.starts_with(place + ":")) {
            calls.emplace_back();
        } else {
            calls.push_back(fmt::format("{} ({})", place, call.substr(in + 5)));
        }
    }
    if (calls.size() < 2) return "";
    std::string text = calls[0].empty() ? "" : "; raised at " + calls[0];
    for (std::size_t i = 1; i < calls.size(); ++i) {
        if (i == most && calls.size() > most + 1) {
            text += fmt::format(", and {} more", calls.size() - most);
            break;
        }
        text += (i == 1 ? text.empty() ? "; called from " : ", called from " : ", ") + calls[i];
    }
    return text;
}

} // namespace

ScriptRun::ScriptRun(const ScriptRequest& request, const RunControl& control)
    : request_(with_ready_script(request)),
      control_(control),
      folder_(folder_of(request_)),
      files_read_(std::make_shared<FilesRead>()),
      lua_(request.limits, access(), control),
      goes_on_(is_unfinished(folder_.folder())) {
    add_bindings(lua_, *this);
}

ScriptAccess ScriptRun::access() const {
    ScriptAccess access;
    access.allow_all = request_.allow_all;
    access.run_folder = folder_.folder();
    access.files_read = files_read_;
    access.read_folders = {home() / "models", home() / "scripts"};
    access.read_folders.insert(access.read_folders.end(), request_.read_folders.begin(), request_.read_folders.end());
    access.named = request_.named;
    return access;
}

void ScriptRun::confine(const std::filesystem::path& writable) const {
    if (!request_.confine || request_.allow_all) return;
    const ScriptAccess& access = lua_.access();
    KernelSandbox sandbox{.read = access.named, .write = {access.run_folder, writable}, .execute = {}};
    sandbox.read.insert(sandbox.read.end(), access.read_folders.begin(), access.read_folders.end());
    sandbox.read.insert(sandbox.read.end(), {request_.script, script_folder()});
    for (const auto& unit : request_.units) {
        sandbox.read.push_back(unit->file());
        sandbox.write.push_back(unit->folder());
    }
    sandbox.allow_program("gnuplot");
    if (request_.compile) {
        // The compiler starts others, and all of them write temporary files.
        for (const char* folder : {"/usr", "/bin", "/opt", "/nix/store", "/gnu/store"})
            sandbox.execute.emplace_back(folder);
        const auto cache = CCompiler::usual_cache();
        std::error_code problem; // what is wrong shows when it compiles
        std::filesystem::create_directories(cache.parent_path(), problem);
        ::mkdir(cache.c_str(), S_IRWXU);
        ::setenv("TMPDIR", cache.c_str(), 1);
        sandbox.write.push_back(cache);
    }
    sandbox.enter();
}

// Beside an installed program, wherever it was moved to, bin/tribode and share/tribode; of a program in the folder of its
// build, in the source tree.
std::filesystem::path ScriptRun::home() {
    static const std::filesystem::path found = [] {
        std::error_code none;
        const auto program = std::filesystem::read_symlink("/proc/self/exe", none);
        const auto beside = program.parent_path().parent_path() / "share/tribode";
        for (const std::filesystem::path& folder : {beside, std::filesystem::path(TRIBODE_SOURCE_DIR)}) {
            if (std::filesystem::exists(folder / "models", none)) return folder;
        }
        return std::filesystem::path(TRIBODE_DATA_DIR);
    }();
    return found;
}

std::filesystem::path ScriptRun::find_file(const std::string& name) const {
    std::filesystem::path path = name;
    if (path.empty() || std::filesystem::exists(path)) return path;
    for (const auto& folder : {folder_.folder(), script_folder()}) {
        if (auto there = folder / path; std::filesystem::exists(there)) return there;
    }
    return ready_file(name);
}

std::filesystem::path ScriptRun::script_folder() const {
    return request_.text ? std::filesystem::path(".") : folder_beside(request_.script);
}

std::string ScriptRun::name_in_manifest(const std::filesystem::path& file,
                                        const std::filesystem::path& working_folder) {
    const auto below = file.lexically_relative(std::filesystem::weakly_canonical(working_folder));
    if (!below.empty() && *below.begin() != "..") return below.string();
    const auto ready = file.lexically_relative(std::filesystem::weakly_canonical(home()));
    return !ready.empty() && ready_file(ready.string()) != ready ? ready.string() : file.string();
}

void ScriptRun::check_data(const std::filesystem::path& file) const {
    std::error_code problem;
    const auto path = std::filesystem::canonical(file, problem);
    if (request_.beside && !problem && std::filesystem::is_regular_file(path, problem) &&
        path.parent_path() == std::filesystem::canonical(script_folder(), problem) &&
        !path.filename().native().starts_with('.')) {
        lua_.access().note_read(path);
        return;
    }
    lua_.access().check_read(file);
}

std::filesystem::path ScriptRun::ready_file(const std::string& name) {
    std::filesystem::path path = name;
    if (path.empty() || std::filesystem::exists(path)) return path;
    const bool ready = *path.begin() == "models" || *path.begin() == "scripts";
    return ready ? home() / path : path;
}

std::shared_ptr<const UnitFile> ScriptRun::unit(const std::string& file) {
    const auto path = find_file(file);
    std::error_code problem;
    for (const auto& unit : request_.units) {
        if (!std::filesystem::equivalent(unit->file(), path, problem)) continue;
        lua_.access().note_read(path);
        return unit;
    }
    if (!request_.allow_all) {
        throw InputError(
            fmt::format("{}: a functional mock-up unit is machine code, which runs only where it is named: "
                        "tribode run --fmu {}",
                        printable(file), printable(file)));
    }
    lua_.access().note_read(path);
    request_.units.push_back(std::make_shared<const UnitFile>(path));
    return request_.units.back();
}

Json ScriptRun::machine(const std::string& file, const Json& argument) {
    const auto path = find_file(file);
    check_data(path);
    Json description = read_description(path, lua_.limits(), argument, files_read_, control_);
    return checked_machine(std::move(description), file);
}

Json ScriptRun::checked_machine(Json description, const std::string& name) {
    const MachineModel model = MachineModel::from_description(description, name);
    for (const auto& warning : model.warnings(name)) remark("warning: " + warning);
    machines_[name] = model.hash();
    if (description.contains("mass_kg")) {
        description.erase("mass_kg");
        description["rigid_gain_per_kg"] = model.rigid_gain;
    }
    return description;
}

Json ScriptRun::options(const Json& defaults) {
    options_asked_ = true;
    std::vector<std::string> names;
    Json values = Json::object();
    for (const auto& [name, entry] : defaults.items()) {
        names.push_back(name);
        Json fallback = entry;
        std::vector<std::string> choices;
        if (entry.is_object()) {
            FieldReader fields(entry, "tb.options", name);
            fallback = fields.value("default");
            choices = fields.texts("choices", {});
            fields.text("unit", "");
            fields.text("help", "");
            fields.finish();
        }
        const auto define = request_.defines.find(name);
        values[name] = define == request_.defines.end() ? fallback : parse_define(name, define->second, fallback);
        if (choices.empty()) continue;
        FieldReader(values, "-D").choice(name, choices, "");
    }
    for (const auto& [name, value] : request_.defines) {
        if (values.contains(name)) continue;
        throw InputError(
            fmt::format("-D {}={}: the script has no option \"{}\"{}", name, value, name, suggestion(name, names)));
    }
    options_ = values;
    return values;
}

void ScriptRun::run_script() {
    // What it returns is for those who require it: a system, for one.
    lua_.set_up([&](lua_State* lua) {
        const auto& script = request_.script;
        if (request_.text) {
            set_script_folder(lua, ".");
            load_text(lua, without_first_comment(*request_.text), script.string());
        } else {
            set_script_folder(lua, folder_beside(script));
            load_file(lua, script);
        }
        lua_call(lua, 0, 0);
        return 0;
    });
    if (!options_asked_ && !request_.defines.empty()) {
        throw InputError(fmt::format("-D {}: the script takes no options (it does not call tb.options)",
                                     request_.defines.begin()->first));
    }
}

ScriptBatch& ScriptRun::read_batch() {
    run_script();
    if (!batch_) {
        throw InputError(fmt::format("{}: describes no batch (it does not call tb.batch)", request_.script.string()));
    }
    return *batch_;
}

void ScriptRun::set_batch(ScriptBatch batch) {
    if (request_.text) {
        throw InputError(
            "tb.batch: the script must be a file, because it is read again for the points; write it to one");
    }
    if (batch_) throw InputError("tb.batch: was called before; a script describes one batch");
    if (batch.batch.name.empty()) batch.batch.name = request_.script.stem().string();
    batch_ = std::move(batch);
}

std::vector<std::string> ScriptRun::files_read() const {
    const auto script = std::filesystem::weakly_canonical(std::filesystem::absolute(request_.script));
    std::vector<std::string> files = {script.string()};
    for (const auto& [file, hash] : *files_read_) {
        if (file != script && !std::filesystem::is_directory(file)) files.push_back(file.string());
    }
    return files;
}

void ScriptRun::remark(const std::string& text) {
    if (remarks_.insert(text).second) fmt::print(stderr, "tribode: {}\n", printable(text));
}

void ScriptRun::note_named() {
    std::error_code problem;
    for (const auto& file : request_.named) {
        if (std::filesystem::is_regular_file(file, problem)) lua_.access().note_read(file);
    }
}

Json ScriptRun::files_in_manifest() const {
    const auto run_folder = std::filesystem::weakly_canonical(std::filesystem::absolute(folder_.folder()));
    const auto working_folder = std::filesystem::current_path();
    Json files = Json::object();
    for (const auto& [file, hash] : *files_read_) {
        // What the run has written itself, such as results of its nested runs, is among its results.
        const auto below = file.lexically_relative(run_folder);
        if (below.empty() || *below.begin() == "..") files[name_in_manifest(file, working_folder)] = hash;
    }
    return files;
}

// Throws InputError where this run may not learn what the file holds. The program that a nested run is of may be named
// elsewhere, and its modules lie beside it.
void ScriptRun::check_nested_read(const std::filesystem::path& file, const ScriptRequest& request) const {
    std::error_code problem;
    for (const auto& unit : request_.units) {
        if (std::filesystem::equivalent(unit->file(), file, problem)) return;
    }
    if (file.extension() == ".lua") return lua_.access().check_module(file, folder_beside(request.script));
    lua_.access().check_read(file);
}

bool ScriptRun::is_complete(const ScriptRequest& request) const {
    const Json manifest = manifest_in(request.folder);
    const Json wanted{{"outcome", "done"},
                      {"version", version()},
                      {"quick", request.quick},
                      {"given", request.defines},
                      {"script", {{"file", request.script.string()}, {"sha256", sha256(read_file(request.script))}}}};
    for (const auto& [key, value] : wanted.items()) {
        if (!manifest.is_object() || manifest.value(key, Json()) != value) return false;
    }
    const auto unchanged = [](const std::filesystem::path& file, const Json& hash) {
        const std::string found = hash_of_content(file);
        return !found.empty() && found == hash;
    };
    const Json read = manifest.value("read", Json::object()), files = manifest.value("files", Json::object());
    // The script may have written this manifest itself: it names no file that the script may not read.
    try {
        for (const auto& [name, hash] : read.items()) {
            const auto file = ready_file(name);
            check_nested_read(file, request);
            if (!unchanged(file, hash)) return false;
        }
        for (const auto& [file, hash] : files.items()) {
            if (!unchanged(path_inside(request.folder, file), hash)) return false;
        }
    } catch (const InputError&) {
        return false;
    }
    return true;
}

NestedRun ScriptRun::run_nested(const std::string& script, const std::string& folder, const Json& options,
                                std::optional<bool> quick) {
    if (request_.depth == deepest) {
        throw InputError(fmt::format("tb.run: {} runs within one another, must be at most {}", deepest + 1, deepest));
    }
    ScriptRequest request = request_; // with its limits and rights
    request.limits = lua_.limits();
    request.script = find_file(script);
    request.text.reset();
    lua_.access().check_read(request.script);
    request.folder = folder_.path(folder);
    request.quick = quick.value_or(request_.quick);
    request.keep_plots = true;
    request.depth += 1;
    // What this run has written is there for the next.
    request.read_folders.push_back(folder_.folder());
    request.defines.clear();
    for (const auto& [name, value] : options.items()) request.defines[name] = define_of(value, name);

    NestedRun nested{.folder = request.folder};
    if (goes_on_ && is_complete(request)) {
        nested.repeated = false;
    } else {
        RunControl control = control_;
        if (control.progress) {
            control.progress = [outer = control_.progress, folder](const std::string& what, std::size_t done,
                                                                   std::size_t of) {
                outer(folder + ", " + what, done, of);
            };
        }
        request.confine = false; // it is, by now
        ScriptRun(request, control).execute();
    }
    const std::filesystem::path inside = folder;
    const Json manifest = read_json(request.folder / "manifest.json");
    for (const auto& [file, hash] : manifest.at("files").items()) folder_.add((inside / file).string());
    // What it read decides this run, too. The hashes are those from before it was read.
    for (const auto& [file, hash] : manifest.at("read").items()) {
        const auto place = std::filesystem::weakly_canonical(std::filesystem::absolute(ready_file(file)));
        files_read_->emplace(place, hash.get<std::string>());
    }
    folder_.add((inside / "manifest.json").string());
    work_.push_back({{"function", "run"}, {"script", script}, {"folder", folder}, {"repeated", nested.repeated}});
    return nested;
}

void ScriptRun::execute() {
    // What ended the run is the news; a folder that cannot take the manifest either would only hide it.
    const auto note = [&](const std::string& problem) {
        try {
            write_manifest(problem);
        } catch (const OutputError&) {
        }
        return problem;
    };
    const auto with_calls = [&](const Error& problem) {
        return note(problem.what() + calls_of(problem.what(), lua_.traceback()));
    };
    try {
        run_script();
        if (batch_) run_batch();
    } catch (const InputError& problem) {
        throw InputError(with_calls(problem));
    } catch (const OutputError& problem) {
        throw OutputError(with_calls(problem));
    } catch (const Error& problem) {
        note(problem.what());
        throw;
    }
    write_manifest("done");
}

void ScriptRun::run_batch() {
    const RunControl control = control_;
    control_ = inside_a_point(control);
    in_points_ = true;
    const bool complete = run_batch_of(*this, folder_.folder() / "batch", control);
    control_ = control;
    in_points_ = false;
    if (!complete) {
        throw EndedEarly("interrupted; the points that are done are kept, and the same command goes on from there");
    }
    merge_batch(folder_.folder() / "batch", Manifest::read(folder_.folder() / "batch"), folder_.path("batch.h5"));
    folder_.add("batch.h5");
    if (batch_->finish) batch_->finish(merged_batch(folder_.folder() / "batch"));
}

void ScriptRun::write_manifest(const std::string& outcome) {
    Json manifest;
    manifest["program"] = "tribode";
    const std::string text = request_.text ? *request_.text : read_file(request_.script);
    manifest["script"] = {{"file", request_.script.string()}, {"sha256", sha256(text)}};
    if (request_.text) manifest["script"]["text"] = text;
    manifest["options"] = options_;
    manifest["given"] = request_.defines;
    manifest["quick"] = request_.quick;
    manifest["machines"] = machines_;
    manifest["read"] = files_in_manifest();
    manifest["outcome"] = outcome;
    manifest["work"] = work_;
    folder_.write_manifest(manifest);
}

} // namespace tribode
