#include "tribode/diagnosis/diagnosis_request.hpp"
#include "tribode/diagnosis/system_diagnosis_request.hpp"
#include "tribode/script/conversions.hpp"
#include "tribode/script/lua_function.hpp"
#include "tribode/script/system_options.hpp"
#include "tribode/script/value.hpp"

#include <lua.hpp>

namespace tribode {

namespace {

std::filesystem::path readable(const ScriptContext& script, const std::string& file) {
    auto path = script.run.find_file(file);
    script.run.check_data(path);
    return path;
}

Json diagnose_machine(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.diagnose");
    DiagnosisRequest request;
    request.machine = machine_of(fields);
    request.columns = RecordOptions::read(fields);
    for (const auto& file : fields.texts("data", {})) request.data.push_back(readable(script, file));
    if (request.data.empty()) fields.fail("data", "is empty: a list of files of measured records is needed");
    if (fields.has("validate")) request.validate = readable(script, fields.text("validate"));
    read_options(request.options, fields);
    const std::string where = fields.text("folder", "diagnosis");
    fields.finish();
    DiagnosisResult result = diagnose_files(request, script.run.folder().path(where), script.run.control());
    for (const auto& name : result.files) script.run.folder().add(where + "/" + name);
    script.run.note_work(
        {{"function", "diagnose"}, {"machine", request.machine.hash()}, {"verdict", result.diagnosis.verdict}});
    result.summary["machine"] = result.diagnosis.after.description();
    return std::move(result.summary);
}

int diagnose_system_in_script(const ScriptContext& script, lua_State* lua) {
    constexpr const char* function = "tb.diagnose_system";
    const Equations system = given_system(lua, function);
    const Json options = plain_options(lua, {"system"}, "tb.diagnose_system: options");
    FieldReader fields(options, function);
    SystemDiagnosisRequest request;
    request.columns.record = RecordOptions::read(fields);
    for (const auto& file : fields.texts("data", {})) request.data.push_back(readable(script, file));
    if (request.data.empty()) fields.fail("data", "is empty: a list of files of measured records is needed");
    for (const auto& file : fields.texts("validate", {})) request.validate.push_back(readable(script, file));
    request.free = fields.texts("free", {});
    read_options(request.options, fields);
    const std::string where = fields.text("folder", "diagnosis");
    fields.finish();
    RunFolder folder(script.run.folder().path(where));
    const auto result = diagnose_system_files(system, request, folder, script.run.control());
    for (const auto& [name, hash] : folder.files()) script.run.folder().add(where + "/" + name);
    script.run.note_work(
        {{"function", "diagnose_system"}, {"system", system.fingerprint()}, {"verdict", result.diagnosis.verdict}});
    push(lua, result.summary);
    return 1;
}

} // namespace

const std::vector<LuaFunction>& diagnosis_functions() {
    static const std::vector<LuaFunction> functions = {
        {"diagnose", diagnose_machine, "`tb.diagnose{ machine =, data = { files }, … }`",
         "finds the effect that the machine lacks ([options and result](#tbdiagnose))",
         [] {
             return option_rows<DiagnosisOptions>(with_columns(
                 {machine_row(),
                  {"data", "", "list of texts", "required", "files of measured [records](records.md)"},
                  {"validate", "", "text", "none",
                   "file of a record that is not used for the fit; default: the last third of the first record"}},
                 {{"folder", "", "text", "`\"diagnosis\"`", "of the files of `tribode diagnose`"}}));
         }},
        {"diagnose_system", diagnose_system_in_script, "`tb.diagnose_system{ system =, data = { files }, … }`",
         "finds the term that a system of equations lacks ([options and result](#tbdiagnose_system))",
         [] {
             return option_rows<SystemDiagnosisOptions>(with_columns(
                 {{"system", "", "system", "required", "of `tb.system`"},
                  {"data", "", "list of texts", "required", "files of measured [records](records.md)"},
                  {"validate", "", "list of texts", "none",
                   "files of records that are not used for the fit; default: the last third of the first record"},
                  {"free", "", "list of texts", "none",
                   "parameters and start values, `x.start`, that may be fitted; default: `free` of the system, else "
                   "all"}},
                 {{"folder", "", "text", "`\"diagnosis\"`", "of the files of `tribode diagnose --system`"}}));
         }},
    };
    return functions;
}

} // namespace tribode
