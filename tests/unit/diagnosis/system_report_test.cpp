#include "tribode/diagnosis/system_report.hpp"

#include <gtest/gtest.h>
#include <limits>

namespace tribode {
namespace {

// An axis whose angle, a sawtooth of 10 deg, is measured in a closed loop, and whose model has found no effect.
SystemDiagnosis without_effect(double gap) {
    SystemDiagnosis d;
    d.verdict = "unknown_effect";
    d.before.equations.outputs = {{"angle", "deg"}};
    d.before.measured = {0};
    SystemComparison comparison;
    auto& angle = comparison.record.outputs.emplace_back();
    for (int k = 0; k < 1000; ++k) angle.push_back(50 + 0.1 * (k % 100));
    d.validation = {comparison};
    d.validation_gap = {.before = gap, .after = gap, .floor = 0.01};
    return d;
}

TEST(VerdictSentence, SaysWhereAModelDriftsAway) {
    const std::string sentence = verdict_sentence(without_effect(250));
    EXPECT_NE(sentence.find("differs from the validation record by 250 deg rms"), std::string::npos) << sentence;
    EXPECT_NE(sentence.find(" drifts away from the record, whose values vary by 2.89 deg rms"), std::string::npos)
        << sentence;
    EXPECT_EQ(verdict_sentence(without_effect(2)).find("drifts"), std::string::npos);
}

TEST(VerdictSentence, SaysThatAModelCannotBeSimulated) {
    const std::string sentence = verdict_sentence(without_effect(std::numeric_limits<double>::infinity()));
    EXPECT_NE(sentence.find("the model cannot be simulated on the validation record."), std::string::npos) << sentence;
}

} // namespace
} // namespace tribode
