#pragma once
#include "tribode/diagnosis/diagnosis.hpp"
#include "tribode/record/record_file.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// What the command line and scripts ask for: a diagnosis from files.
struct DiagnosisRequest {
    MachineModel machine;
    std::vector<std::filesystem::path> data;       // measured records
    std::optional<std::filesystem::path> validate; // validation record; none: the last third of the first record
    RecordOptions columns;                         // of all records
    DiagnosisOptions options;
};

struct DiagnosisResult {
    Diagnosis diagnosis;
    Json summary;                   // diagnosis.json
    std::vector<std::string> files; // written into the folder
};

// Reads the records, diagnoses the machine and writes the results into the folder, which is made once the records are
// read. Throws as read_measurement, diagnose and write_diagnosis do.
DiagnosisResult diagnose_files(const DiagnosisRequest& request, const std::filesystem::path& folder,
                               const RunControl& control);

} // namespace tribode
