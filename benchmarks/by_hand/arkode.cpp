#include "by_hand/loop.hpp"
#include "by_hand/reduced_table.hpp"
#include "by_hand/sundials_handles.hpp"
#include "contender.hpp"

#include <algorithm>
#include <arkode/arkode_erkstep.h>
#include <fmt/format.h>

namespace tribode::bench {

namespace {

int derivative(double, N_Vector x, N_Vector dxdt, void* table) {
    static_cast<const ReducedTable*>(table)->derivative(NV_DATA_S(x), NV_DATA_S(dxdt));
    return 0;
}

int roots(double, N_Vector x, double* g, void* table) {
    const auto& t = *static_cast<const ReducedTable*>(table);
    g[0] = t.forward_velocity(NV_DATA_S(x));
    g[1] = t.room_left(NV_DATA_S(x));
    return 0;
}

Run run_arkode(const Scenario& scenario, double relative_tolerance, Restart restart) {
    ReducedTable table(scenario.table);
    Loop loop(scenario);
    SundialsVectors vectors(ReducedTable::size);
    vectors.set_tolerance(1e-3 * relative_tolerance);
    double* x = NV_DATA_S(vectors.x);

    void* memory = ERKStepCreate(derivative, 0, vectors.x, vectors.context);
    check(ERKStepSVtolerances(memory, relative_tolerance, vectors.tolerance), "ERKStepSVtolerances");
    check(ERKStepSetUserData(memory, &table), "ERKStepSetUserData");
    check(ERKStepSetOrder(memory, 5), "ERKStepSetOrder");
    check(ERKStepRootInit(memory, 2, roots), "ERKStepRootInit");
    int falling[] = {-1, -1};
    check(ERKStepSetRootDirection(memory, falling), "ERKStepSetRootDirection");
    check(ERKStepSetNoInactiveRootWarn(memory), "ERKStepSetNoInactiveRootWarn");

    Run result;
    result.x.reserve(scenario.samples + 1);
    result.x.push_back(0);
    double t = 0, kept_step = 0;
    for (std::size_t k = 0; k < scenario.samples; ++k) {
        table.reference = loop.thrust(result.x.back());
        const double end = static_cast<double>(k + 1) * scenario.table.sample_time;
        while (t < end) {
            // A reversal that the last event left just behind is no fall any more.
            if (table.forward_velocity(x) < -1e-11) result.events += table.catch_up(x, 0, true);
            if (restart == Restart::anew) {
                check(ERKStepReInit(memory, derivative, t, vectors.x), "ERKStepReInit");
            } else {
                check(ERKStepReset(memory, t, vectors.x), "ERKStepReset");
                const double first = std::min(kept_step, end - t);
                if (kept_step > 0) check(ERKStepSetInitStep(memory, first), "ERKStepSetInitStep");
            }
            check(ERKStepSetStopTime(memory, end), "ERKStepSetStopTime");
            const int flag = ERKStepEvolve(memory, end, vectors.x, &t, ARK_NORMAL);
            check(flag, "ERKStepEvolve");
            if (restart == Restart::anew) {
                long steps = 0; // since the restart
                check(ERKStepGetNumSteps(memory, &steps), "ERKStepGetNumSteps");
                result.steps += steps;
            }
            check(ERKStepGetLastStep(memory, &kept_step), "ERKStepGetLastStep");
            if (flag == ARK_ROOT_RETURN) {
                int found[2];
                check(ERKStepGetRootInfo(memory, found), "ERKStepGetRootInfo");
                // The root is located within rounding, so the element may stand just before its limit.
                result.events += table.catch_up(x, found[1] != 0 ? 1e-9 : 0, found[0] != 0);
            }
        }
        t = end;
        result.x.push_back(ReducedTable::position(x));
    }
    if (restart == Restart::with_step) check(ERKStepGetNumSteps(memory, &result.steps), "ERKStepGetNumSteps");
    result.samples = static_cast<long>(scenario.samples);
    ERKStepFree(&memory);
    return result;
}

} // namespace

Contender arkode_by_hand(double relative_tolerance, Restart restart) {
    return {fmt::format("ARKODE {:.0e} {}by hand", relative_tolerance, restart == Restart::anew ? "anew " : ""),
            [=](const Scenario& scenario) { return run_arkode(scenario, relative_tolerance, restart); }};
}

} // namespace tribode::bench
