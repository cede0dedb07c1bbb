#include "tribode/diagnosis/diagnosis_request.hpp"
#include "tribode/base/text.hpp"
#include "tribode/diagnosis/diagnosis_files.hpp"
#include "tribode/diagnosis/given_files.hpp"
#include "tribode/record/output_file.hpp"

#include <chrono>

namespace tribode {

DiagnosisResult diagnose_files(const DiagnosisRequest& request, const std::filesystem::path& folder,
                               const RunControl& control) {
    const auto start = std::chrono::steady_clock::now();
    std::vector<std::string> hashes;
    const auto measurement = [&](const std::filesystem::path& file) {
        hashes.push_back(sha256(read_file(file)));
        return read_measurement(file, request.machine, request.columns);
    };
    std::vector<Measurement> records;
    for (const auto& file : request.data) records.push_back(measurement(file));
    std::optional<Measurement> validation;
    if (request.validate) validation = measurement(*request.validate);
    std::vector<std::filesystem::path> files = request.data;
    if (request.validate) files.push_back(*request.validate);
    refuse_repeated_files(files, hashes);
    RunFolder results(folder); // before the work: one that cannot be made is said at once
    DiagnosisResult result;
    result.diagnosis = diagnose(request.machine, std::move(records), std::move(validation), request.options, control);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    result.summary = diagnosis_json(result.diagnosis, hashes, request.machine.hash(), seconds);
    write_diagnosis(result.diagnosis, result.summary, results, control);
    for (const auto& [name, hash] : results.files()) result.files.push_back(name);
    return result;
}

} // namespace tribode
