#include "commands/command.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/kernel_sandbox.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/script/machine_file.hpp"
#include "tribode/script/script_run.hpp"

#include <charconv>
#include <cstdio>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>

namespace tribode {

std::atomic<bool> stop_requested{false};
ProgressDisplay progress_display;

RunControl Common::control() const {
    RunControl control;
    control.stop = &stop_requested;
    control.workers = workers;
    if (!quiet) {
        control.progress = [](const std::string& what, std::size_t now, std::size_t of) {
            progress_display.show(what, now, of);
        };
    }
    return control;
}

void Common::add_quiet(CLI::App& app) { app.add_flag("--quiet", quiet, "no progress display"); }

void Common::add_json(CLI::App& app) { app.add_flag("--json", json, "the report as JSON, on standard output"); }

void Common::print(std::string_view text, const Json& value) const {
    fmt::print("{}", json ? to_json_text(value) : text);
}

void Common::note(std::string_view text, const Json& value) const {
    if (json || !quiet) print(text, value);
}

void Common::add_workers(CLI::App& app, const char* what) {
    app.add_option("-j,--workers", workers, what)->check(is_whole(1, 4096));
}

void add_defines(CLI::App& app, std::vector<std::string>& defines, const char* help) {
    app.add_option("-D", defines, help)->take_all()->allow_extra_args(false);
}

std::map<std::string, std::string> defines_of(const std::vector<std::string>& defines) {
    std::map<std::string, std::string> values;
    for (const auto& define : defines) {
        const std::size_t equals = define.find('=');
        if (equals == 0 || equals == std::string::npos) {
            throw InputError(fmt::format("-D {}: must be name=value", define));
        }
        values[define.substr(0, equals)] = define.substr(equals + 1);
    }
    return values;
}

CLI::Validator is_positive() {
    return {[](const std::string& text) {
                const auto value = parse_number(text);
                return value && *value > 0 ? "" : fmt::format("{} is not a positive number", text);
            },
            "POSITIVE"};
}

CLI::Validator is_whole(std::size_t least, std::size_t most) {
    return {[=](const std::string& text) {
                std::size_t value = 0;
                const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
                const bool whole = problem == std::errc() && end == text.data() + text.size();
                return whole && value >= least && value <= most
                           ? ""
                           : fmt::format("{} is not a whole number from {} to {}", text, least, most);
            },
            fmt::format("[{} - {}]", least, most)};
}

std::string choice_of(const std::vector<std::string>& words) { return fmt::format("{{{}}}", fmt::join(words, ",")); }

void add_machine(CLI::App& app, std::string& machine) {
    app.add_option("--machine", machine, "machine description, .lua or .json")->required();
}

MachineModel read_machine(const std::string& file, const Common& common) {
    const auto path = ScriptRun::ready_file(file);
    MachineModel model =
        MachineModel::from_description(read_description(path, {}, nullptr, nullptr, common.control()), file);
    for (const auto& warning : model.warnings(file)) {
        std::fprintf(stderr, "tribode: warning: %s\n", printable(warning).c_str());
    }
    return model;
}

void ColumnOptions::add_to(CLI::App& app) {
    app.add_option("--columns", columns, "names in the record, e.g. t=t_s,u=u_V");
    app.add_option("--scale", scale, "factors that bring columns to SI, e.g. u=35.15");
}

void MachineAndRecord::add_to(CLI::App& app) {
    add_machine(app, machine);
    app.add_option("--input", input, "record, CSV, MAT or HDF5, with t,u (open loop) or t,r,exc (closed loop)")
        ->required();
    columns.add_to(app);
}

// Two names of one file, also where it is not there yet. A device such as /dev/null takes whatever comes.
static bool is_same_file(const std::string& one, const std::string& other) {
    namespace fs = std::filesystem;
    std::error_code problem;
    if (one.empty() || other.empty() || one == standard_output || other == standard_output) return false;
    if (fs::exists(one, problem) && !fs::is_regular_file(one, problem)) return false;
    return fs::equivalent(one, other, problem) ||
           fs::weakly_canonical(fs::absolute(one)) == fs::weakly_canonical(fs::absolute(other));
}

void refuse_overwriting(const std::vector<std::string>& read, const std::vector<std::string>& write) {
    for (auto output = write.begin(); output != write.end(); ++output) {
        const auto is_output = [&](const std::string& file) { return is_same_file(*output, file); };
        if (std::any_of(read.begin(), read.end(), is_output)) {
            throw InputError(fmt::format("{}: is an input and would be overwritten; choose another output", *output));
        }
        if (std::any_of(std::next(output), write.end(), is_output)) {
            throw InputError(fmt::format("{}: would be written twice; choose two files", *output));
        }
    }
}

void confine(const std::string& machine, const std::vector<std::string>& read, const std::vector<std::string>& write) {
    auto inputs = read;
    if (!machine.empty()) inputs.push_back(ScriptRun::ready_file(machine).string());
    refuse_overwriting(inputs, write);
    KernelSandbox sandbox;
    sandbox.read.assign(read.begin(), read.end());
    if (!machine.empty()) {
        const std::filesystem::path file = ScriptRun::ready_file(machine);
        sandbox.read.insert(sandbox.read.end(), {file, file.has_parent_path() ? file.parent_path() : "."});
    }
    for (const auto& file : write) {
        if (file != standard_output) sandbox.allow_output(file);
    }
    sandbox.allow_program("gnuplot");
    sandbox.enter();
}

void remove_earlier_images(const RunFolder& folder) {
    const auto manifest = folder.folder() / "manifest.json";
    std::error_code problem;
    if (!std::filesystem::exists(manifest, problem)) return;
    const auto written = folder.files();
    try {
        const Json earlier = read_json(manifest).at("files");
        for (const auto& [name, hash] : earlier.items()) {
            const bool is_image = name.ends_with(".png") || name.ends_with(".svg");
            if (!is_image || written.contains(name)) continue;
            const auto image = folder.path(name);
            if (std::filesystem::exists(image) && sha256(read_file(image)) == hash) std::filesystem::remove(image);
        }
    } catch (const InputError&) {
        // What is no manifest lists no images.
    } catch (const Json::exception&) {
    }
}

void add_compile(CLI::App& app, ScriptRequest& request) {
    app.add_flag("--compile", request.compile,
                 "equations of tb.run_system through the system's C compiler: faster, the same results");
}

} // namespace tribode
