#include "tribode/base/error.hpp"
#include "tribode/diagnosis/measurement.hpp"
#include "unit/diagnosis/small_case.hpp"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

using namespace diagnosis_cases;

MachineModel machine_of(const Json& description) { return MachineModel::from_description(description, "case"); }

Table good() { return measured(small_axis(), Json::array(), sine_record(0.01, 1, 1), 1); }

Table changed(Table table, const char* column, const std::function<double(std::size_t, double)>& change) {
    for (auto& c : table.columns) {
        if (c.name != column) continue;
        for (std::size_t k = 0; k < c.values.size(); ++k) c.values[k] = change(k, c.values[k]);
    }
    return table;
}

std::string refusal(const Table& table, const Json& description = small_axis()) {
    try {
        measurement_from_table(table, machine_of(description), "run.csv");
    } catch (const InputError& problem) {
        return problem.what();
    }
    return "";
}

TEST(Measurement, AGoodRecordIsTakenAndItsExcitationIsZero) {
    const Measurement m = measurement_from_table(good(), machine_of(small_axis()), "run.csv");
    EXPECT_EQ(m.size(), 2000u);
    EXPECT_TRUE(std::all_of(m.drive.excitation.begin(), m.drive.excitation.end(), [](double e) { return e == 0; }));
}

TEST(Measurement, AnExcitationIsRecoveredToTheRoundingOfTheFile) {
    DriveRecord record = sine_record(0, 1, 1);
    for (std::size_t k = 0; k < record.t.size(); ++k)
        record.excitation[k] = 8 * std::sin(2 * std::numbers::pi * 40 * record.t[k]);
    const Measurement m =
        measurement_from_table(measured(small_axis(), Json::array(), record, 1), machine_of(small_axis()), "run.csv");
    // u is some 10 N; the controller's sums round a few units in the last place.
    for (std::size_t k = 0; k < m.size(); ++k) EXPECT_NEAR(m.drive.excitation[k], record.excitation[k], 1e-6);
}

TEST(Measurement, MetresAndMillimetresAreToldApart) {
    EXPECT_NE(refusal(changed(good(), "y", [](std::size_t, double y) { return 1e3 * y; })).find("different units"),
              std::string::npos);
}

TEST(Measurement, ThrustAndPositionInEachOthersPlaceAreRefused) {
    Table table = good();
    std::swap(table.columns[2].values, table.columns[3].values);
    EXPECT_NE(refusal(table), "");
}

TEST(Measurement, AControllerThatDoesNotFitIsRefused) {
    Json other = small_axis();
    other["controller"]["kd"] = 700;
    EXPECT_NE(refusal(good(), other).find("controller does not make the recorded u"), std::string::npos);
}

TEST(Measurement, ThrustLoggedASampleEarlierOrLaterIsNoOtherController) {
    const Table table = good();
    const auto& u = table.columns[2].values;
    const auto at = [&](std::size_t k) { return u[std::min(k, u.size() - 1)]; };
    EXPECT_EQ(refusal(changed(table, "u", [&](std::size_t k, double) { return at(k + 1); })), "");
    EXPECT_EQ(refusal(changed(table, "u", [&](std::size_t k, double) { return k > 0 ? at(k - 1) : 0; })), "");
    EXPECT_NE(refusal(changed(table, "u", [&](std::size_t k, double) { return at(k + 4); })), "");
}

TEST(Measurement, PositionsRoundedOnceMoreInTheFileAreNoOtherController) {
    // Every fifth value is one step of the encoder off.
    EXPECT_EQ(refusal(changed(good(), "y", [](std::size_t k, double y) { return k % 5 == 0 ? y + 1e-7 : y; })), "");
}

// Moves with rests between, seen by a coarse encoder: it says the same value at each end for long.
TEST(Measurement, AMachineThatRestsAtBothEndsIsNotClipped) {
    DriveRecord moves = sine_record(0.01, 1, 3);
    for (std::size_t k = 0; k < moves.t.size(); ++k) {
        const double s = std::clamp(2 * std::sin(2 * std::numbers::pi * moves.t[k]), -1.0, 1.0);
        moves.reference[k] = 0.005 * s * (1.5 - 0.5 * s * s);
    }
    Json coarse = small_axis();
    coarse["encoder_resolution_m"] = 5e-6;
    EXPECT_EQ(refusal(measured(coarse, Json::array(), moves, 1), coarse), "");
    // The same with the ends cut off while the reference goes on.
    const Table cut = changed(measured(coarse, Json::array(), sine_record(0.02, 1, 3), 1), "y",
                              [](std::size_t, double y) { return std::clamp(y, 0.005, 0.015); });
    EXPECT_NE(refusal(cut, coarse).find("clipped"), std::string::npos);
}

TEST(Measurement, AControllerThatHadOtherDigitsOfTheEncoderFits) {
    // As a drive that counts half steps: u was made of them, the record has y in whole ones.
    Json coarse = small_axis();
    coarse["encoder_resolution_m"] = 2e-7;
    const Table table = changed(good(), "y", [](std::size_t, double y) { return 2e-7 * std::floor(y / 2e-7 + 0.5); });
    EXPECT_EQ(refusal(table, coarse), "");
    coarse["encoder_resolution_m"] = 1e-9;
    EXPECT_NE(refusal(table, coarse), "") << "a finer encoder has no such digits";
}

TEST(Measurement, AnotherSampleTimeIsRefused) {
    EXPECT_NE(refusal(changed(good(), "t", [](std::size_t, double t) { return 2 * t; })), "");
}

TEST(Measurement, ARecordWithoutMotionIsRefused) {
    EXPECT_NE(refusal(measured(small_axis(), Json::array(), sine_record(0, 1, 1), 1)).find("motion"),
              std::string::npos);
}

TEST(Measurement, AShortRecordIsRefused) {
    EXPECT_NE(refusal(measured(small_axis(), Json::array(), sine_record(0.01, 1, 0.05), 1)).find("too few"),
              std::string::npos);
}

TEST(Measurement, DroppedSamplesAreNoticed) {
    Table table = good();
    auto& y = table.columns[3].values;
    for (const std::size_t k : {300u, 420u, 610u, 820u}) y[k] = y[k - 1];
    EXPECT_NE(refusal(table).find("samples were dropped"), std::string::npos) << refusal(table);
}

// ---- the same in open loop, where no controller tells what y was
// -----------------------------------------------------------------------------------------------------------------

Json open_axis() {
    Json axis = small_axis();
    axis.erase("controller");
    axis["closed_loop"] = false;
    return axis;
}

DriveRecord open_record() {
    DriveRecord record = sine_record(0, 1, 2);
    for (const double t : record.t) {
        double u = 0;
        for (int i = 1; i < 20; ++i) u += 4 * std::sin(2 * std::numbers::pi * 2.5 * i * t + i * i);
        record.u.push_back(u);
    }
    record.reference.clear();
    record.excitation.clear();
    return record;
}

Table open_good() { return measured(open_axis(), Json::array(), open_record(), 1); }

double highest(const Table& table, const char* column) {
    const auto& values = table[column].values;
    return *std::max_element(values.begin(), values.end());
}

void expect_refusal(const Table& table, const char* word, const Json& description) {
    const std::string said = refusal(table, description);
    EXPECT_NE(said.find(word), std::string::npos) << said;
}

// The samples before which the machine moves fastest, apart by 50 and more, in order.
std::vector<std::size_t> fast_places(const std::vector<double>& y, std::size_t count) {
    std::vector<std::size_t> places;
    while (places.size() < count) {
        std::size_t best = 0;
        double most = 0;
        for (std::size_t k = 100; k + 100 < y.size(); ++k) {
            const bool taken = std::any_of(places.begin(), places.end(), [&](std::size_t other) {
                return std::max(k, other) - std::min(k, other) < 50;
            });
            if (taken || std::abs(y[k] - y[k - 1]) <= most) continue;
            most = std::abs(y[k] - y[k - 1]);
            best = k;
        }
        places.push_back(best);
    }
    std::sort(places.begin(), places.end());
    return places;
}

// In both loops, each with the word that the sentence must have.
TEST(Measurement, SamplesThatAreNotTheMachinesAreNoticed) {
    for (const auto& [table, description] : {std::pair{good(), small_axis()}, {open_good(), open_axis()}}) {
        EXPECT_EQ(refusal(table, description), "");
        const auto& y = table["y"].values;
        const auto fast = fast_places(y, 4);
        const std::size_t from = fast[1];
        const double y_end = 0.8 * highest(table, "y"), u_end = 0.8 * highest(table, "u");
        expect_refusal(changed(table, "y", [&](std::size_t, double v) { return std::min(v, y_end); }), "clipped",
                       description);
        expect_refusal(changed(table, "u", [&](std::size_t, double v) { return std::min(v, u_end); }), "clipped",
                       description);
        expect_refusal(
            changed(table, "y", [&](std::size_t k, double v) { return k > from && k < from + 40 ? y[from] : v; }),
            "repeats its value", description);
        expect_refusal(changed(table, "y", [&](std::size_t k, double v) { return k > from && k < from + 20 ? 0 : v; }),
                       "repeats its value", description);
        expect_refusal(changed(table, "y", [&](std::size_t k, double v) { return k == 900 ? v + 1e-3 : v; }), "outlier",
                       description);
        // Rows that are missing, with instants that do not show it.
        Table short_of = table;
        for (auto& column : short_of.columns) {
            if (column.name == "t") continue;
            for (auto k = fast.rbegin(); k != fast.rend(); ++k) {
                column.values.erase(column.values.begin() + static_cast<std::ptrdiff_t>(*k));
            }
        }
        for (auto& column : short_of.columns) column.values.resize(y.size() - 4);
        expect_refusal(short_of, "samples are missing", description);
    }
}

// The axis moves by 16 um a sample at most, so that noise makes leaps and halts of it.
TEST(Measurement, NoiseOnASlowMotionIsNoFault) {
    for (const double noise : {0.5e-6, 1e-6, 2e-6, 4e-6}) {
        Json noisy = small_axis();
        noisy["noise_rms_m"] = noise;
        for (std::uint64_t seed = 1; seed <= 10; ++seed) {
            EXPECT_EQ(refusal(measured(noisy, Json::array(), sine_record(0.01, 1, 3), seed), noisy), "")
                << noise << " m, seed " << seed;
        }
    }
}

TEST(Measurement, AThrustThatRestsAtItsLimitsByDesignIsNotClipped) {
    DriveRecord record = open_record();
    for (std::size_t k = 0; k < record.u.size(); ++k) {
        const double saw = std::abs(std::remainder(record.t[k] / 0.2, 1.0)) * 160 - 40;
        record.u[k] = std::clamp(saw, -20.0, 20.0); // trapezoids
    }
    EXPECT_EQ(refusal(measured(open_axis(), Json::array(), record, 1), open_axis()), "");
    for (double& u : record.u) u = u > 0 ? 20 : -20; // and rectangles
    EXPECT_EQ(refusal(measured(open_axis(), Json::array(), record, 1), open_axis()), "");
}

TEST(Measurement, ACoarseEncoderDropsNothing) {
    const Json coarse = Json::parse(R"([{"name": "encoder_quantization", "parameters": {"resolution_m": 1e-5}}])");
    EXPECT_EQ(refusal(measured(small_axis(), coarse, sine_record(0.01, 1, 1), 1)), "");
    EXPECT_EQ(refusal(measured(open_axis(), coarse, open_record(), 1), open_axis()), "");
    EXPECT_EQ(refusal(measured(small_axis(), coarse, sine_record(7e-5, 1, 2), 1)), ""); // over 7 steps
}

TEST(Measurement, ALatticeOfValuesShowsTheResolution) {
    std::vector<double> values;
    for (int k = 0; k < 400; ++k) values.push_back(5e-6 * ((k * 37) % 211 - 80));
    EXPECT_NEAR(lattice_step(values, 1e-7), 5e-6, 1e-12);
    values[7] += 2e-6; // one value beside the lattice: there is none
    EXPECT_LT(lattice_step(values, 1e-7), 4e-6);
    const std::vector<double> few = {0, 5e-6, 5e-6, 1.5e-5, 2e-5, 1e-5, 3e-5};
    EXPECT_NEAR(lattice_step(few, 1e-7), 5e-6, 1e-12);
    EXPECT_EQ(lattice_step({few.begin(), few.end() - 1}, 1e-7), 0); // too few to tell
}

} // namespace
} // namespace tribode
