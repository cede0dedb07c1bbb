#pragma once
#include "tribode/base/json.hpp"
#include "tribode/diagnosis/system_diagnosis.hpp"
#include "tribode/diagnosis/system_record.hpp"
#include "tribode/record/run_folder.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace tribode {

// What the command line and scripts ask for: a diagnosis of a system from files.
struct SystemDiagnosisRequest {
    std::vector<std::filesystem::path> data, validate; // without `validate`: the last third of the first record
    SystemColumns columns;
    std::vector<std::string> free; // names; empty: those of the system, else all
    SystemDiagnosisOptions options;
};

struct SystemDiagnosisResult {
    SystemDiagnosis diagnosis;
    Json summary; // diagnosis.json
};

// Reads the records, finds what the system lacks and writes the results. Throws as system_model_of, read_system_record and
// diagnose_system do.
SystemDiagnosisResult diagnose_system_files(const Equations& system, const SystemDiagnosisRequest& request,
                                            RunFolder& folder, const RunControl& control);

} // namespace tribode
