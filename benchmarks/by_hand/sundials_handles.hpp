#pragma once
#include <nvector/nvector_serial.h>
#include <stdexcept>
#include <string>
#include <sundials/sundials_context.h>

namespace tribode::bench {

// Throws on a flag that says a call has failed.
inline void check(int flag, const char* function) {
    if (flag < 0) throw std::runtime_error(std::string(function) + " returned " + std::to_string(flag));
}

// A context and a vector of its own, freed at the end.
class SundialsVectors {
  public:
    explicit SundialsVectors(long size) {
        check(SUNContext_Create(nullptr, &context), "SUNContext_Create");
        x = N_VNew_Serial(size, context);
        tolerance = N_VNew_Serial(size, context);
        N_VConst(0, x);
    }
    ~SundialsVectors() {
        N_VDestroy(x);
        N_VDestroy(tolerance);
        SUNContext_Free(&context);
    }
    SundialsVectors(const SundialsVectors&) = delete;
    SundialsVectors& operator=(const SundialsVectors&) = delete;

    // By kind of state: meters for positions, 100 times that for velocities (the first six states in turn), 1e6 N/m for
    // the thrust, a tenth for the deflection of elements.
    void set_tolerance(double position) {
        for (long i = 0; i < NV_LENGTH_S(tolerance); ++i) {
            NV_Ith_S(tolerance, i) = position * (i > 6 ? 0.1 : i == 6 ? 1e6 : i % 2 == 1 ? 100 : 1);
        }
    }

    SUNContext context = nullptr;
    N_Vector x = nullptr, tolerance = nullptr;
};

} // namespace tribode::bench
