#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/diagnosis/diagnosis.hpp"
#include "tribode/record/run_folder.hpp"

namespace tribode {

// diagnosis.json as docs/diagnosis.md describes it. `data`: hashes of the records; `seconds`: how long it took.
Json diagnosis_json(const Diagnosis& diagnosis, const std::vector<std::string>& data, const std::string& machine_hash,
                    double seconds);

// The description of the machine with the effects found, as Lua that returns it.
std::string machine_lua(const Json& description);

// Writes machine.json, machine.lua, validate.csv, report.html with its images, and diagnosis.json last: all of them, a
// stop request waits.
void write_diagnosis(const Diagnosis& diagnosis, const Json& summary, RunFolder& folder, const RunControl& control);

// The same in a few lines for a terminal.
std::string diagnosis_text(const Json& summary);

} // namespace tribode
