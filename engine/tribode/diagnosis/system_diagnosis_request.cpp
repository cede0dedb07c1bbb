#include "tribode/diagnosis/system_diagnosis_request.hpp"
#include "tribode/base/text.hpp"
#include "tribode/diagnosis/given_files.hpp"
#include "tribode/diagnosis/record_defects.hpp"
#include "tribode/diagnosis/system_diagnosis_files.hpp"
#include "tribode/record/output_file.hpp"

#include <algorithm>
#include <chrono>
#include <iterator>

namespace tribode {

SystemDiagnosisResult diagnose_system_files(const Equations& system, const SystemDiagnosisRequest& request,
                                            RunFolder& folder, const RunControl& control) {
    const auto start = std::chrono::steady_clock::now();
    const SystemModel model = system_model_of(system, request.free, request.columns, request.data);
    std::vector<std::string> hashes;
    std::vector<std::string> remarks;
    const auto records_of = [&](const std::vector<std::filesystem::path>& files) {
        std::vector<SystemRecord> records;
        for (const auto& file : files) {
            hashes.push_back(sha256(read_file(file)));
            auto parts = without_defects(read_system_record(file, model, request.columns), model, remarks);
            std::ranges::move(parts, std::back_inserter(records));
        }
        return records;
    };
    auto data = records_of(request.data), validation = records_of(request.validate);
    std::vector<std::filesystem::path> files = request.data;
    std::ranges::copy(request.validate, std::back_inserter(files));
    refuse_repeated_files(files, hashes);
    SystemDiagnosisResult result;
    result.diagnosis = diagnose_system(model, std::move(data), std::move(validation), request.options, control);
    auto& all = result.diagnosis.remarks;
    all.insert(all.begin(), remarks.begin(), remarks.end());
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    result.summary = system_diagnosis_json(result.diagnosis, hashes, system.fingerprint(), seconds);
    write_system_diagnosis(result.diagnosis, result.summary, folder, control);
    return result;
}

} // namespace tribode
