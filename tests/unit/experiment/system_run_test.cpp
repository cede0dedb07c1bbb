#include "tribode/experiment/system_run.hpp"
#include "tribode/system/system_builder.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

// Instants k * 1e-4 and rows i * 5e-3 differ by rounding, in either direction. Rows are left limits all the same.
TEST(SystemRun, ARowAtASampleIsTheLeftLimitHoweverItIsRounded) {
    for (const bool affine : {true, false}) {
        SystemBuilder builder("counter");
        const Expression x = builder.state("x", 0), samples = builder.discrete("samples", 0);
        builder.rate(x, affine ? 1 + 0 * x : cos(x));
        builder.sample("count", 1e-4, 0, {{samples, samples + 1}, {x, 0}});
        SystemRunOptions options;
        options.end = 0.5;
        options.output_step = 5e-3;
        const SystemRun run = run_system(EquationSystem(builder.equations()), options);
        ASSERT_TRUE(run.outcome.ok()) << run.outcome.message;
        ASSERT_EQ(run.table.rows(), 101u);
        for (std::size_t i = 0; i < run.table.rows(); ++i) {
            EXPECT_EQ(run.table.find("samples")->values[i], 50 * static_cast<double>(i)) << i;
            EXPECT_NEAR(run.table.find("x")->values[i], i == 0 ? 0 : 1e-4, 1e-9) << i;
        }
    }
}

} // namespace
} // namespace tribode
