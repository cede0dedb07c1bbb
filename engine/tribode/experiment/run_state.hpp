#pragma once
#include "tribode/base/json.hpp"
#include "tribode/solver/integrator.hpp"
#include "tribode/system/equation_system.hpp"

#include <string>

namespace tribode {

// Where a run of a system of equations may be continued.
struct RunState {
    EquationSystem::Snapshot system;
    std::string fingerprint; // of the equations, see Equations
    std::string method;      // of the run
    double step = 0;         // that its method would take next [s]; 0: not known
};

// As plain data with a checksum, which a file or a script may hold: all numbers come back to the bit.
Json to_json(const RunState& state);

// The state again. Throws InputError, beginning with `where`, where it is damaged or is that of other equations than those
// of the fingerprint.
RunState read_run_state(const Json& json, const std::string& fingerprint, const std::string& where);

// Its time alone [s], for what has to be known before the equations are complete. Throws the same.
double time_of_run_state(const Json& json, const std::string& where);

} // namespace tribode
