#pragma once
// The engine as a library: what programs include. docs/library.md says how, and what may be shared by threads.
//
// The headers named here are the documented part, which changes only with an entry in CHANGELOG.md; all others are the
// engine's own. All quantities are in SI units (m, N, s, kg, Hz), unless a name says otherwise. What a caller did wrong is
// an InputError, whose text is one sentence for the user; a run that ends early is no error but a RunOutcome.

#include "tribode/base/error.hpp"
#include "tribode/base/json.hpp"
#include "tribode/base/run_control.hpp"

// Tables and files of records
#include "tribode/record/json_file.hpp"
#include "tribode/record/record_file.hpp"
#include "tribode/record/table.hpp"

// A machine under a record
#include "tribode/experiment/simulation.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/script/machine_file.hpp"

// Systems of equations
#include "tribode/experiment/system_run.hpp"
#include "tribode/system/equation_system.hpp"
#include "tribode/system/linearization.hpp"
#include "tribode/system/sensitivities.hpp"
#include "tribode/system/steady_state.hpp"
#include "tribode/system/system_builder.hpp"

// Any hybrid system, step by step
#include "tribode/hybrid/hybrid_system.hpp"
#include "tribode/hybrid/observer.hpp"
#include "tribode/solver/simulator.hpp"

// Frequency responses and modal fits
#include "tribode/analysis/frequency_response.hpp"
#include "tribode/analysis/modal_fit.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
