#pragma once
#include "tribode/base/json.hpp"
#include "tribode/diagnosis/system_diagnosis.hpp"
#include "tribode/record/run_folder.hpp"

#include <string>
#include <vector>

namespace tribode {

// diagnosis.json as docs/how-to/diagnose-a-system.md describes it. `data`: hashes of the records.
Json system_diagnosis_json(const SystemDiagnosis& diagnosis, const std::vector<std::string>& data,
                           const std::string& system_hash, double seconds);

// Writes system.lua, validate.csv, report.html with its images, and diagnosis.json last.
void write_system_diagnosis(const SystemDiagnosis& diagnosis, const Json& summary, RunFolder& folder,
                            const RunControl& control);

// The same in a few lines for a terminal.
std::string system_diagnosis_text(const SystemDiagnosis& diagnosis);

} // namespace tribode
