// The problems of tests/problems/ivp by CVODE, written by hand: BDF with Newton's method, the Jacobian by differences, dense or
// banded, or Adams with functional iteration. One line for each run: problem,method,tolerance,seconds,steps,values.
//
//   bench_by_hand [--quick] [PROBLEM ...]

#include "right_sides.hpp"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <string>
#include <sunlinsol/sunlinsol_band.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_band.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>
#include <vector>

namespace {

struct State {
    const Problem* problem;
    bool late;
};

int rates(double t, N_Vector y, N_Vector f, void* data) {
    const auto& state = *static_cast<State*>(data);
    state.problem->rates(static_cast<int>(state.problem->start.size()), state.late, t, N_VGetArrayPointer(y),
                         N_VGetArrayPointer(f));
    return 0;
}

struct Result {
    long steps = 0;
    bool ok = false;
    std::vector<double> values;
};

Result solve(const Problem& problem, bool adams, double tolerance, SUNContext context) {
    const auto n = static_cast<sunindextype>(problem.start.size());
    N_Vector y = N_VNew_Serial(n, context), scale = N_VNew_Serial(n, context);
    for (sunindextype i = 0; i < n; ++i) {
        NV_Ith_S(y, i) = problem.start[i];
        NV_Ith_S(scale, i) = tolerance * problem.nominal[i];
    }
    State state{&problem, false};
    void* cvode = CVodeCreate(adams ? CV_ADAMS : CV_BDF, context);
    CVodeInit(cvode, rates, 0, y);
    CVodeSVtolerances(cvode, tolerance, scale);
    CVodeSetUserData(cvode, &state);
    CVodeSetMaxNumSteps(cvode, 100000000);
    CVodeSetErrHandlerFn(
        cvode, [](int, const char*, const char*, char*, void*) {}, nullptr);
    SUNMatrix matrix = nullptr;
    SUNLinearSolver linear = nullptr;
    SUNNonlinearSolver nonlinear = nullptr;
    if (adams) {
        nonlinear = SUNNonlinSol_FixedPoint(y, 0, context);
        CVodeSetNonlinearSolver(cvode, nonlinear);
    } else {
        if (problem.band > 0) {
            matrix = SUNBandMatrix(n, problem.band, problem.band, context);
            linear = SUNLinSol_Band(y, matrix, context);
        } else {
            matrix = SUNDenseMatrix(n, n, context);
            linear = SUNLinSol_Dense(y, matrix, context);
        }
        CVodeSetLinearSolver(cvode, linear, matrix);
    }
    Result result;
    double t = 0;
    int flag = 0;
    if (problem.jump > 0) {
        CVodeSetStopTime(cvode, problem.jump);
        flag = CVode(cvode, problem.jump, y, &t, CV_NORMAL);
        CVodeGetNumSteps(cvode, &result.steps);
        state.late = true;
        CVodeReInit(cvode, t, y);
    }
    if (flag >= 0) {
        CVodeSetStopTime(cvode, problem.end);
        flag = CVode(cvode, problem.end, y, &t, CV_NORMAL);
        long steps = 0;
        CVodeGetNumSteps(cvode, &steps);
        result.steps += steps;
    }
    result.ok = flag >= 0;
    result.values.assign(N_VGetArrayPointer(y), N_VGetArrayPointer(y) + n);
    CVodeFree(&cvode);
    if (linear != nullptr) SUNLinSolFree(linear);
    if (nonlinear != nullptr) SUNNonlinSolFree(nonlinear);
    if (matrix != nullptr) SUNMatDestroy(matrix);
    N_VDestroy(y);
    N_VDestroy(scale);
    return result;
}

double processor_time() {
    timespec now{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

void measure(const Problem& problem, bool adams, double tolerance, bool quick, SUNContext context) {
    double least = 0, total = 0;
    Result result;
    // The least of five, or of as many as fit into half a second.
    for (int k = 0; k < (quick ? 1 : 5) && (k == 0 || total < 0.5); ++k) {
        const double begin = processor_time();
        result = solve(problem, adams, tolerance, context);
        const double seconds = processor_time() - begin;
        total += seconds;
        least = k == 0 ? seconds : std::min(least, seconds);
    }
    std::printf("%s,%s,%g,%.9g,%ld,", problem.name, adams ? "CVODE Adams by hand" : "CVODE BDF by hand", tolerance,
                least, result.steps);
    if (!result.ok) std::printf("failed");
    for (std::size_t i = 0; result.ok && i < result.values.size(); ++i) {
        std::printf("%s%.17g", i > 0 ? " " : "", result.values[i]);
    }
    std::printf("\n");
    std::fflush(stdout);
}

} // namespace

int main(int count, char** arguments) {
    bool quick = false;
    std::vector<std::string> names;
    for (int i = 1; i < count; ++i) {
        if (std::strcmp(arguments[i], "--quick") == 0)
            quick = true;
        else
            names.emplace_back(arguments[i]);
    }
    SUNContext context = nullptr;
    SUNContext_Create(nullptr, &context);
    const std::vector<double> tolerances =
        quick ? std::vector<double>{1e-4, 1e-6} : std::vector<double>{1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10};
    for (const auto& problem : problems()) {
        if (!names.empty() && std::find(names.begin(), names.end(), problem.name) == names.end()) continue;
        if (quick && names.empty() && (problem.start.size() > 100 || problem.name == std::string("RINGMOD"))) continue;
        for (const double tolerance : tolerances) {
            measure(problem, false, tolerance, quick, context);
            if (!problem.stiff) measure(problem, true, tolerance, quick, context);
        }
    }
    SUNContext_Free(&context);
    return 0;
}
