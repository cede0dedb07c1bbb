#include "tribode/fmu_runtime/component.hpp"

#include <fmi3Functions.h>

// The functions of FMI 3.0. Scheduled execution and clocks are not supported.

namespace {

using tribode::fmu::Component;
using tribode::fmu::Instance;
using tribode::fmu::Variable;

Component& component(fmi3Instance c) { return *static_cast<Component*>(c); }
fmi3Status status(bool done) { return done ? fmi3OK : fmi3Error; }

// Calls the body with the component; without one the call is an error.
template <class Body>
fmi3Status with(fmi3Instance c, Body body) {
    return c ? status(body(component(c))) : fmi3Error;
}

template <class Body>
fmi3Status with_instance(fmi3Instance c, Body body) {
    return with(c, [&](Component& unit) { return unit.done([&] { body(unit.instance); }); });
}

fmi3Status unsupported(fmi3Instance c, const char* function) {
    return with(c, [&](Component& unit) { return unit.unsupported(function); });
}

fmi3Instance instantiate(bool model_exchange, fmi3String token, fmi3String resources,
                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger) {
    const auto log = [environment, logger](const std::string& message) {
        if (logger) logger(environment, fmi3Error, "logStatusError", message.c_str());
    };
    try {
        auto made = std::make_unique<Component>(resources ? resources : "", token ? token : "", model_exchange);
        made->log_error = log;
        return made.release();
    } catch (const std::exception& problem) {
        log(problem.what());
        return nullptr;
    }
}

} // namespace

extern "C" {

const char* fmi3GetVersion() { return fmi3Version; }
fmi3Status fmi3SetDebugLogging(fmi3Instance, fmi3Boolean, size_t, const fmi3String[]) { return fmi3OK; }

fmi3Instance fmi3InstantiateModelExchange(fmi3String, fmi3String token, fmi3String resources, fmi3Boolean, fmi3Boolean,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger) {
    return instantiate(true, token, resources, environment, logger);
}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String, fmi3String token, fmi3String resources, fmi3Boolean, fmi3Boolean,
                                         fmi3Boolean, fmi3Boolean, const fmi3ValueReference[], size_t,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback) {
    return instantiate(false, token, resources, environment, logger);
}
fmi3Instance fmi3InstantiateScheduledExecution(fmi3String, fmi3String, fmi3String, fmi3Boolean, fmi3Boolean,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                               fmi3ClockUpdateCallback, fmi3LockPreemptionCallback,
                                               fmi3UnlockPreemptionCallback) {
    if (logger) logger(environment, fmi3Error, "logStatusError", "the unit has no scheduled execution");
    return nullptr;
}
void fmi3FreeInstance(fmi3Instance c) { delete static_cast<Component*>(c); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean, fmi3Float64) {
    return with_instance(c, [&](Instance& unit) {
        unit.set_start(start, tolerance_defined ? std::optional(tolerance) : std::nullopt);
        unit.enter_initialization();
    });
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    return with_instance(c, [](Instance& unit) { unit.exit_initialization(); });
}
fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }
fmi3Status fmi3Terminate(fmi3Instance c) {
    return with_instance(c, [](Instance& unit) { unit.terminate(); });
}
fmi3Status fmi3Reset(fmi3Instance c) {
    return with_instance(c, [](Instance& unit) { unit.reset(); });
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t count, fmi3Float64 values[],
                          size_t value_count) {
    if (count != value_count) return fmi3Error; // all are scalars
    return with(c, [&](Component& unit) { return unit.get(references, count, values); });
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                          const fmi3Float64 values[], size_t value_count) {
    if (count != value_count) return fmi3Error;
    return with(c, [&](Component& unit) { return unit.set(references, count, values); });
}

#define TRIBODE_NO_VARIABLES(Type)                                                                                     \
    fmi3Status fmi3Get##Type(fmi3Instance c, const fmi3ValueReference[], size_t count, fmi3##Type[], size_t) {         \
        return with(c, [&](Component& unit) { return unit.no_variables(count, #Type); });                              \
    }                                                                                                                  \
    fmi3Status fmi3Set##Type(fmi3Instance c, const fmi3ValueReference[], size_t count, const fmi3##Type[], size_t) {   \
        return with(c, [&](Component& unit) { return unit.no_variables(count, #Type); });                              \
    }
TRIBODE_NO_VARIABLES(Float32)
TRIBODE_NO_VARIABLES(Int8)
TRIBODE_NO_VARIABLES(UInt8)
TRIBODE_NO_VARIABLES(Int16)
TRIBODE_NO_VARIABLES(UInt16)
TRIBODE_NO_VARIABLES(Int32)
TRIBODE_NO_VARIABLES(UInt32)
TRIBODE_NO_VARIABLES(Int64)
TRIBODE_NO_VARIABLES(UInt64)
TRIBODE_NO_VARIABLES(Boolean)
TRIBODE_NO_VARIABLES(String)
#undef TRIBODE_NO_VARIABLES
fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference[], size_t count, size_t[], fmi3Binary[], size_t) {
    return with(c, [&](Component& unit) { return unit.no_variables(count, "Binary"); });
}
fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference[], size_t count, const size_t[], const fmi3Binary[],
                         size_t) {
    return with(c, [&](Component& unit) { return unit.no_variables(count, "Binary"); });
}
fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference[], size_t count, fmi3Clock[]) {
    return with(c, [&](Component& unit) { return unit.no_variables(count, "Clock"); });
}
fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference[], size_t count, const fmi3Clock[]) {
    return with(c, [&](Component& unit) { return unit.no_variables(count, "Clock"); });
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference, size_t*) {
    return unsupported(c, "fmi3GetNumberOfVariableDependencies");
}
fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference, size_t[], fmi3ValueReference[], size_t[],
                                       fmi3DependencyKind[], size_t) {
    return unsupported(c, "fmi3GetVariableDependencies");
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState* state) {
    return with_instance(c, [&](Instance& unit) {
        auto* place = static_cast<Instance::Snapshot*>(*state);
        auto now = std::make_unique<Instance::Snapshot>(unit.snapshot());
        delete place;
        *state = now.release();
    });
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
    if (!state) return fmi3Error;
    return with_instance(c, [&](Instance& unit) { unit.restore(*static_cast<Instance::Snapshot*>(state)); });
}
fmi3Status fmi3FreeFMUState(fmi3Instance, fmi3FMUState* state) {
    if (!state) return fmi3OK;
    delete static_cast<Instance::Snapshot*>(*state);
    *state = nullptr;
    return fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState, size_t*) {
    return unsupported(c, "fmi3SerializedFMUStateSize");
}
fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState, fmi3Byte[], size_t) {
    return unsupported(c, "fmi3SerializeFMUState");
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte[], size_t, fmi3FMUState*) {
    return unsupported(c, "fmi3DeserializeFMUState");
}
fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference[], size_t, const fmi3ValueReference[],
                                        size_t, const fmi3Float64[], size_t, fmi3Float64[], size_t) {
    return unsupported(c, "fmi3GetDirectionalDerivative");
}
fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference[], size_t, const fmi3ValueReference[],
                                    size_t, const fmi3Float64[], size_t, fmi3Float64[], size_t) {
    return unsupported(c, "fmi3GetAdjointDerivative");
}

// Clocks.
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference[], size_t, fmi3Float64[],
                                  fmi3IntervalQualifier[]) {
    return unsupported(c, "fmi3GetIntervalDecimal");
}
fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference[], size_t, fmi3UInt64[], fmi3UInt64[],
                                   fmi3IntervalQualifier[]) {
    return unsupported(c, "fmi3GetIntervalFraction");
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference[], size_t, fmi3Float64[]) {
    return unsupported(c, "fmi3GetShiftDecimal");
}
fmi3Status fmi3GetShiftFraction(fmi3Instance c, const fmi3ValueReference[], size_t, fmi3UInt64[], fmi3UInt64[]) {
    return unsupported(c, "fmi3GetShiftFraction");
}
fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference[], size_t, const fmi3Float64[]) {
    return unsupported(c, "fmi3SetIntervalDecimal");
}
fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const fmi3ValueReference[], size_t, const fmi3UInt64[],
                                   const fmi3UInt64[]) {
    return unsupported(c, "fmi3SetIntervalFraction");
}
fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference[], size_t, const fmi3Float64[]) {
    return unsupported(c, "fmi3SetShiftDecimal");
}
fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference[], size_t, const fmi3UInt64[],
                                const fmi3UInt64[]) {
    return unsupported(c, "fmi3SetShiftFraction");
}
fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference, fmi3Float64) {
    return unsupported(c, "fmi3ActivateModelPartition");
}

// ---- model exchange ------------------------------------------------------------------------------------------------

fmi3Status fmi3EnterEventMode(fmi3Instance c) {
    return with_instance(c, [](Instance& unit) { unit.run(); });
}
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) {
    return with_instance(c, [](Instance& unit) { unit.run(); });
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean* again, fmi3Boolean* terminate,
                                    fmi3Boolean* nominals_changed, fmi3Boolean* states_changed,
                                    fmi3Boolean* next_defined, fmi3Float64* next_time) {
    return with_instance(c, [&](Instance& unit) {
        const auto result = unit.run().handle_events();
        *again = *nominals_changed = *next_defined = false;
        *next_time = 0;
        *terminate = result.stopped;
        *states_changed = result.states_changed;
    });
}
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) {
    return with_instance(c, [](Instance& unit) { unit.run(); });
}
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean, fmi3Boolean* enter_event_mode,
                                       fmi3Boolean* terminate) {
    *enter_event_mode = *terminate = false;
    return with_instance(c, [](Instance& unit) { unit.run(); });
}
fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time) {
    return with_instance(c, [&](Instance& unit) { unit.run().set_time(time); });
}
fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t count) {
    return with_instance(c, [&](Instance& unit) { unit.run().set_states({x, count}); });
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 values[], size_t count) {
    return with(c, [&](Component& unit) { return unit.list(Variable::Kind::rate, values, count); });
}
fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 values[], size_t count) {
    return with(c, [&](Component& unit) { return unit.list(Variable::Kind::event_indicator, values, count); });
}
fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 values[], size_t count) {
    return with(c, [&](Component& unit) { return unit.list(Variable::Kind::state, values, count); });
}
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 values[], size_t count) {
    return with(c, [&](Component& unit) { return unit.nominals(values, count); });
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t* count) {
    return with_instance(c, [&](Instance& unit) { *count = unit.model().count(Variable::Kind::event_indicator); });
}
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t* count) {
    return with_instance(c, [&](Instance& unit) { *count = unit.model().count(Variable::Kind::state); });
}

// ---- co-simulation -------------------------------------------------------------------------------------------------

fmi3Status fmi3EnterStepMode(fmi3Instance c) { return unsupported(c, "fmi3EnterStepMode"); }
fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference[], size_t, const fmi3Int32[],
                                    fmi3Float64[], size_t) {
    return unsupported(c, "fmi3GetOutputDerivatives");
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 size, fmi3Boolean, fmi3Boolean* event_handling_needed,
                      fmi3Boolean* terminate, fmi3Boolean* early_return, fmi3Float64* last_successful_time) {
    *event_handling_needed = *terminate = *early_return = false;
    if (!c) return fmi3Error;
    Component& unit = component(c);
    const bool done = unit.step(t, size);
    *last_successful_time = unit.last_step_end;
    *terminate = unit.stopped;
    *early_return = unit.stopped && unit.last_step_end < t + size;
    return status(done);
}

} // extern "C"
