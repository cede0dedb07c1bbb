#pragma once

// The problems of tests/problems/ivp as one writes them by hand in C++. Also a library in C, so that Python programs call the
// same compiled right sides.

#include <vector>

struct Problem {
    const char* name;
    double end;
    double jump; // the instant at which the right side jumps, or 0
    int band;    // half the width of the Jacobian's band, or 0 where it is full
    bool stiff;
    std::vector<double> start;
    std::vector<double> nominal; // of the absolute tolerance
    // `late` says that t lies beyond the jump.
    void (*rates)(int n, bool late, double t, const double* y, double* f);
};

const std::vector<Problem>& problems();

extern "C" {
int problem_count();
const char* problem_name(int k);
int problem_size(int k);
double problem_end(int k);
double problem_jump(int k);
int problem_band(int k);
int problem_stiff(int k);
void problem_start(int k, double* y);
void problem_nominal(int k, double* scale);
void problem_rates(int k, int late, double t, const double* y, double* f);
}
