#pragma once
#include "tribode/diagnosis/system_diagnosis.hpp"
#include "tribode/record/report.hpp"

#include <string>

namespace tribode {

// The diagnosis for a colleague who does not know the program, in one page.
Report system_report(const SystemDiagnosis& diagnosis);

// What is missing, its size, and how the gap shrinks.
std::string verdict_sentence(const SystemDiagnosis& diagnosis);

// What an open term is if it is neither itself nor a rival, from this probability on.
inline constexpr const char* none_of_these = "forces at random, or what the library lacks";
inline constexpr double worth_a_line = 0.05;

std::string gap_unit(const SystemDiagnosis& diagnosis); // of Gap
std::string interpolation_text(Interpolation between);  // "held between samples"

} // namespace tribode
