#include "tribode/diagnosis/diagnosis_request.hpp"
#include "tribode/script/conversions.hpp"
#include "tribode/script/lua_function.hpp"

namespace tribode {

namespace {

Json diagnose_machine(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.diagnose");
    DiagnosisRequest request;
    request.machine = machine_of(fields);
    request.columns = RecordOptions::read(fields);
    const auto readable = [&](const std::string& file) {
        const auto path = script.run.find_file(file);
        script.run.check_data(path);
        script.run.note_read(path);
        return path;
    };
    for (const auto& file : fields.texts("data", {})) request.data.push_back(readable(file));
    if (request.data.empty()) fields.fail("data", "is empty: a list of files of measured records is needed");
    if (fields.has("validate")) request.validate = readable(fields.text("validate"));
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

} // namespace

const std::vector<LuaFunction>& diagnosis_functions() {
    static const std::vector<LuaFunction> functions = {
        {"diagnose", diagnose_machine, "`tb.diagnose{ machine =, data = { files }, … }`",
         "finds the effect that the machine lacks ([options and result](#tbdiagnose))",
         [] {
             std::vector<FieldRow> rows = {
                 machine_row(),
                 {"data", "", "list of texts", "required", "files of measured [records](records.md)"},
                 {"validate", "", "text", "none",
                  "file of a record that is not used for the fit; default: the last third of the first record"}};
             for (auto& row : column_rows()) rows.push_back(std::move(row));
             rows.push_back({"folder", "", "text", "`\"diagnosis\"`", "of the files of `tribode diagnose`"});
             return option_rows<DiagnosisOptions>(std::move(rows));
         }},
    };
    return functions;
}

} // namespace tribode
