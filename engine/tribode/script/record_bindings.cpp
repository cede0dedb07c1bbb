#include "tribode/base/error.hpp"
#include "tribode/record/csv.hpp"
#include "tribode/record/hdf5.hpp"
#include "tribode/record/json_file.hpp"
#include "tribode/record/mat.hpp"
#include "tribode/record/mat4.hpp"
#include "tribode/record/plot.hpp"
#include "tribode/record/report.hpp"
#include "tribode/record/zip.hpp"
#include "tribode/script/conversions.hpp"
#include "tribode/script/lua_function.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace tribode {

namespace {

Json to_json(const TimeGrid& grid) {
    Json json{{"sample_time_s", grid.sample_time},
              {"jitter_rms_s", grid.jitter_rms},
              {"jitter_max_s", grid.jitter_max},
              {"dropped", grid.dropped},
              {"gaps", Json::array()}};
    for (const auto& gap : grid.gaps) json["gaps"].push_back({{"row", gap.row + 1}, {"missing", gap.missing}});
    return json;
}

Json read_json_file(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.read_json");
    const auto path = script.run.find_file(fields.text("file"));
    fields.finish();
    script.run.check_data(path);
    return read_json(path);
}

Json list_folder(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.list_folder");
    const auto path = script.run.find_file(fields.text("folder"));
    fields.finish();
    script.access().check_read(path);
    script.access().note_listed(path);
    std::vector<std::string> names;
    std::error_code problem;
    for (std::filesystem::directory_iterator entry(path, problem), end; !problem && entry != end;
         entry.increment(problem)) {
        names.push_back(entry->path().filename().string());
    }
    if (problem) throw InputError(fmt::format("{}: cannot be listed ({})", path.string(), problem.message()));
    std::sort(names.begin(), names.end());
    return names;
}

Json read_record_file(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.read_record");
    const Record record = record_of(script, fields, "file", {});
    fields.finish();
    Json json{{"data", Json::object()}, {"units", Json::object()}, {"time", nullptr}};
    for (const auto& column : record.table.columns) {
        json["data"][column.name] = column.values;
        json["units"][column.name] = column.unit;
    }
    if (record.time) json["time"] = to_json(*record.time);
    return json;
}

Json write_csv_file(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.write_csv");
    const std::string file = fields.text("file");
    const Table table = table_of(fields, "columns");
    fields.finish();
    script.run.folder().write(file, file.ends_with(".gz") ? gzip(to_csv(table)) : to_csv(table));
    return nullptr;
}

Json write_hdf5_file(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.write_hdf5");
    const std::string file = fields.text("file");
    std::vector<NamedTable> tables;
    fields.each("tables", [&](FieldReader& entry) {
        tables.push_back({entry.text("name"), table_of(entry, "columns")});
    });
    const Json& attributes = fields.value("attributes");
    fields.finish();
    script.run.folder().write(file, to_hdf5(tables, attributes.is_null() ? Json::object() : attributes));
    return nullptr;
}

Json write_mat_file(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.write_mat");
    const std::string file = fields.text("file");
    const Table table = table_of(fields, "columns");
    const std::string version = fields.choice("version", {"5", "7.3", "dymola"}, "5");
    fields.finish();
    script.run.folder().write(file, version == "dymola"
                                        ? to_trajectory(table)
                                        : to_mat(table, version == "5" ? MatVersion::v5 : MatVersion::v7_3));
    return nullptr;
}

Json write_json_file(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.write_json");
    const std::string file = fields.text("file");
    const Json& value = fields.value("value");
    fields.finish();
    script.run.folder().write_json(file, value);
    return nullptr;
}

Json write_text_file(const ScriptContext& script, const Json& arguments) {
    FieldReader fields(arguments, "tb.write_text");
    const std::string file = fields.text("file"), text = fields.text("text");
    fields.finish();
    script.run.folder().write(file, text);
    return nullptr;
}

Json plot(const ScriptContext& script, const Json& arguments) {
    Json figure = arguments;
    if (!figure.is_object() || !figure.contains("file")) throw InputError("tb.plot: file is missing (a text)");
    const std::string file = FieldReader(arguments, "tb.plot").text("file");
    figure.erase("file");
    draw_plot(script.run.folder().path(file), plot_from_json(figure, "tb.plot"));
    script.run.folder().add(file + ".png");
    script.run.folder().add(file + ".svg");
    if (script.run.keeps_plots()) script.run.folder().write(file + plot_data_extension, figure.dump() + "\n");
    return nullptr;
}

Json report(const ScriptContext& script, const Json& arguments) {
    Json fields = arguments;
    if (!fields.is_object() || !fields.contains("file")) throw InputError("tb.report: file is missing (a text)");
    const std::string file = FieldReader(arguments, "tb.report").text("file");
    fields.erase("file");
    const auto page = script.run.folder().path(file);
    const Report contents = report_from_json(fields, "tb.report", page.parent_path());
    const auto beside = std::filesystem::path(file).parent_path();
    for (const auto& image : write_report(page, contents, script.run.control()))
        script.run.folder().add((beside / image).string());
    script.run.folder().add(file);
    return nullptr;
}

} // namespace

const std::vector<LuaFunction>& record_functions() {
    static const std::vector<LuaFunction> functions = {
        {"write_csv", write_csv_file, "`tb.write_csv{ file =, columns = { { name =, unit =, values = {…} }, … } }`",
         "comma-separated, a header line of names; name columns with their unit (`frequency_hz`). A name that ends in "
         "`.gz` compresses it"},
        {"write_hdf5", write_hdf5_file,
         "`tb.write_hdf5{ file =, tables = { { name =, columns = … }, … }, attributes = {…} }`",
         "one group per table, one dataset per column with an attribute `unit`"},
        {"write_mat", write_mat_file, "`tb.write_mat{ file =, columns =, version = \"5\" }`",
         "MAT of version 5, or `\"7.3\"` for columns of 2 GiB and more: each column as an n x 1 double array, without "
         "units; the names must be valid in MATLAB. `\"dymola\"`: a result as Dymola and OpenModelica write it "
         "(version 4), "
         "with any names and with units; the first column is the time and becomes `Time`"},
        {"write_json", write_json_file, "`tb.write_json{ file =, value = }`", "any plain table"},
        {"write_text", write_text_file, "`tb.write_text{ file =, text = }`", "a text, e.g. a table with words in it"},
        {"read_json", read_json_file, "`tb.read_json{ file = }`",
         "the value of a JSON file that the script may read, as a plain table; a relative name is searched as for "
         "`tb.machine`"},
        {"list_folder", list_folder, "`tb.list_folder{ folder = }`",
         "the names in a folder that the script may read, in alphabetical order"},
        {"read_record", read_record_file,
         "`tb.read_record{ file =, columns = { u = \"u_V\" }, scale = { u = 35.15 } }`",
         "a [record](records.md) in CSV, MAT or HDF5: `{ data = { t = {…}, u = {…} }, units = { … }, time = … }`. "
         "`columns`: names in the file; only these are read. Without `columns`, all vectors of one length are read. "
         "`scale`: factors. `time`, if there is a column t: `{ sample_time_s, jitter_rms_s, jitter_max_s, dropped, "
         "gaps = { { row =, missing = }, … } }`. Refused: a missing name, variables that are not vectors of finite "
         "doubles, different lengths, time that does not increase. The file is searched as for `tb.read_json`"},
        {"plot", plot, "`tb.plot{ file =, title =, panels = {…} }`", "writes `file`.png and `file`.svg, see below"},
        {"report", report, "`tb.report{ file =, title =, sections = {…} }`",
         "writes a page in HTML, see [below](#reports)"},
    };
    return functions;
}

} // namespace tribode
