#pragma once
#include "tribode/script/script_run.hpp"
#include "tribode/system/equations.hpp"

namespace tribode {

// The system that the script of the run returns: `return tb.system{...}`. Nothing but the script's work on the way to it is
// done. Throws InputError where it returns something else, and what the script throws.
Equations system_of_file(ScriptRun& run);

} // namespace tribode
