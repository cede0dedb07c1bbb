#pragma once
#include "tribode/diagnosis/system_diagnosis.hpp"
#include "tribode/record/report.hpp"

#include <string>

namespace tribode {

// The diagnosis for a colleague who does not know the program, in one page.
Report system_report(const SystemDiagnosis& diagnosis);

// What is missing, its size, and how the gap shrinks.
std::string verdict_sentence(const SystemDiagnosis& diagnosis);

std::string gap_unit(const SystemDiagnosis& diagnosis); // of Gap
std::string interpolation_text(Interpolation between);  // "held between samples"

} // namespace tribode
