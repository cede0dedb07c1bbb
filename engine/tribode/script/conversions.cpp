#include "tribode/script/conversions.hpp"
#include "tribode/experiment/simulation.hpp"

#include <fmt/format.h>

namespace tribode {

MachineModel machine_of(FieldReader& fields) {
    const Json& description = fields.value("machine");
    if (description.is_null()) fields.fail("machine", "is missing (a machine description, see tb.machine)");
    return MachineModel::from_description(description, fields.name_of("machine"));
}

FrequencyResponse response_of(FieldReader& fields, const char* key) {
    FieldReader table = fields.table(key, true);
    FrequencyResponse response;
    response.frequency_hz = table.numbers("frequency_hz", "Hz", Allowed::positive, {});
    const auto real = table.numbers("real", "", Allowed::finite, {});
    const auto imag = table.numbers("imag", "", Allowed::finite, {});
    for (const char* shown : {"gain_db", "phase_deg"}) table.numbers(shown, "", Allowed::finite, {});
    table.finish();
    if (real.size() != response.size() || imag.size() != response.size()) {
        fields.fail(key, fmt::format("has {} frequencies, {} real and {} imaginary parts, must have as many of "
                                     "each",
                                     response.size(), real.size(), imag.size()));
    }
    for (std::size_t i = 0; i < real.size(); ++i) response.value.emplace_back(real[i], imag[i]);
    return response;
}

Table table_of(FieldReader& fields, const char* key) {
    Table table;
    fields.each(key, [&](FieldReader& column) {
        std::vector<double> values;
        for (const auto& entry : column.value("values")) {
            if (!entry.is_number()) column.fail("values", "must be a list of numbers");
            values.push_back(entry.get<double>());
        }
        table.add(column.text("name"), column.text("unit", ""), std::move(values));
    });
    return table;
}

GivenRecord given_file(const ScriptContext& script, const std::string& file) {
    const auto path = script.run.find_file(file);
    script.run.check_data(path);
    return {path, {}};
}

GivenRecord given_lists(FieldReader& fields, const std::vector<std::string>& names, std::string source) {
    GivenRecord given;
    given.table.source = std::move(source);
    for (const auto& name : names) {
        auto values = fields.numbers(name, "", Allowed::finite, {});
        if (!values.empty()) given.table.add(name, "", std::move(values));
    }
    return given;
}

Record record_of(const ScriptContext& script, FieldReader& fields, const char* file_key,
                 const std::vector<std::string>& wanted) {
    const auto path = script.run.find_file(fields.text(file_key));
    const RecordOptions options = RecordOptions::read(fields);
    script.run.check_data(path);
    return read_record(path, options, wanted);
}

FieldRow machine_row() {
    return {"machine", "", "table", "required", "a [machine description](machine-description.md)"};
}

std::vector<FieldRow> with_columns(std::vector<FieldRow> before, const std::vector<FieldRow>& after) {
    before.push_back(
        {"columns", "", "table of texts", "none", "names of columns in the file, as for `tb.read_record`"});
    before.push_back({"scale", "", "table of numbers", "none", "factors of columns, as for `tb.read_record`"});
    before.insert(before.end(), after.begin(), after.end());
    return before;
}

Json to_json(const FrequencyResponse& response) {
    std::vector<double> real, imag;
    for (const auto& value : response.value) {
        real.push_back(value.real());
        imag.push_back(value.imag());
    }
    return {{"frequency_hz", response.frequency_hz},
            {"real", real},
            {"imag", imag},
            {"gain_db", response.gain_db()},
            {"phase_deg", response.size() ? response.phase_deg() : std::vector<double>{}}};
}

Json to_json(const RunStatistics& s) {
    Json json;
    for (const auto& [name, count] : RunStatistics::counts) json[name] = s.*count;
    json["seconds_integrating"] = s.seconds_integrating;
    json["seconds_events"] = s.seconds_events;
    return json;
}

Json to_json(const ServoTrace& trace) {
    Json table;
    for (const auto& column : to_table(trace).columns) table[column.name] = column.values;
    return table;
}

Json to_json(const StabilityMargins& margins) {
    const auto or_null = [](const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); };
    return {{"gain_margin", or_null(margins.gain_margin)},
            {"gain_reduction_margin", or_null(margins.gain_reduction_margin)},
            {"phase_crossover_hz", or_null(margins.phase_crossover_hz)},
            {"phase_margin_deg", or_null(margins.phase_margin_deg)},
            {"gain_crossover_hz", or_null(margins.gain_crossover_hz)},
            {"modulus_margin", margins.modulus_margin}};
}

Json columns_of(const Table& table) {
    Json columns = Json::array();
    for (const auto& column : table.columns) {
        columns.push_back({{"name", column.name}, {"unit", column.unit}, {"values", column.values}});
    }
    return columns;
}

} // namespace tribode
