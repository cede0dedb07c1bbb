#pragma once
#include "tribode/analysis/frequency_response.hpp"
#include "tribode/analysis/loop_gain.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/experiment/servo_recorder.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/given_record.hpp"
#include "tribode/record/table.hpp"
#include "tribode/script/lua_function.hpp"
#include "tribode/solver/run_outcome.hpp"

namespace tribode {

// Between plain tables, as scripts have them, and the engine's types: what several modules of bindings use.

MachineModel machine_of(FieldReader& fields); // the key `machine`
FrequencyResponse response_of(FieldReader& fields, const char* key = "response");
Table table_of(FieldReader& fields, const char* key); // a list of {name =, unit =, values =}

// A file of the script's own folders, or of those that it may read.
GivenRecord given_file(const ScriptContext& script, const std::string& file);
// The lists u, y, ... of a table; those that are not there are left out.
GivenRecord given_lists(FieldReader& fields, const std::vector<std::string>& names, std::string source);

// The record that the options `file_key`, columns and scale name, where the script may read it.
Record record_of(const ScriptContext& script, FieldReader& fields, const char* file_key,
                 const std::vector<std::string>& wanted);

// The options read by these, for the reference.
FieldRow machine_row();
// Rows with those of the columns and scale of a record between.
std::vector<FieldRow> with_columns(std::vector<FieldRow> before, const std::vector<FieldRow>& after = {});

Json to_json(const FrequencyResponse& response);
Json to_json(const RunStatistics& statistics);
Json to_json(const ServoTrace& trace);
Json to_json(const StabilityMargins& margins);
Json columns_of(const Table& table); // as tb.write_csv takes them

} // namespace tribode
