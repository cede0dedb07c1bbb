#include "tribode/fmu_runtime/component.hpp"

#include <fmi2Functions.h>

// The functions of FMI 2.0.

namespace {

using tribode::fmu::Component;
using tribode::fmu::Instance;
using tribode::fmu::Variable;

Component& component(fmi2Component c) { return *static_cast<Component*>(c); }
fmi2Status status(bool done) { return done ? fmi2OK : fmi2Error; }

// Calls the body with the component; without one the call is an error.
template <class Body>
fmi2Status with(fmi2Component c, Body body) {
    return c ? status(body(component(c))) : fmi2Error;
}

template <class Body>
fmi2Status with_instance(fmi2Component c, Body body) {
    return with(c, [&](Component& unit) { return unit.done([&] { body(unit.instance); }); });
}

} // namespace

extern "C" {

const char* fmi2GetTypesPlatform() { return fmi2TypesPlatform; }
const char* fmi2GetVersion() { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component, fmi2Boolean, size_t, const fmi2String[]) { return fmi2OK; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions* callbacks, fmi2Boolean, fmi2Boolean) {
    const std::string own_name = name ? name : "";
    const auto log = [own_name, logger = callbacks ? callbacks->logger : nullptr,
                      environment = callbacks ? callbacks->componentEnvironment : nullptr](const std::string& message) {
        if (logger) logger(environment, own_name.c_str(), fmi2Error, "logStatusError", "%s", message.c_str());
    };
    try {
        auto made =
            std::make_unique<Component>(resources ? resources : "", guid ? guid : "", type == fmi2ModelExchange);
        made->log_error = log;
        return made.release();
    } catch (const std::exception& problem) {
        log(problem.what());
        return nullptr;
    }
}

void fmi2FreeInstance(fmi2Component c) { delete static_cast<Component*>(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean, fmi2Real) {
    return with_instance(
        c, [&](Instance& unit) { unit.set_start(start, tolerance_defined ? std::optional(tolerance) : std::nullopt); });
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    return with_instance(c, [](Instance& unit) { unit.enter_initialization(); });
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return with_instance(c, [](Instance& unit) { unit.exit_initialization(); });
}
fmi2Status fmi2Terminate(fmi2Component c) {
    return with_instance(c, [](Instance& unit) { unit.terminate(); });
}
fmi2Status fmi2Reset(fmi2Component c) {
    return with_instance(c, [](Instance& unit) { unit.reset(); });
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference references[], size_t count, fmi2Real values[]) {
    return with(c, [&](Component& unit) { return unit.get(references, count, values); });
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference references[], size_t count, const fmi2Real values[]) {
    return with(c, [&](Component& unit) { return unit.set(references, count, values); });
}

#define TRIBODE_NO_VARIABLES(Type)                                                                                     \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference[], size_t count, fmi2##Type[]) {                \
        return with(c, [&](Component& unit) { return unit.no_variables(count, #Type); });                              \
    }                                                                                                                  \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference[], size_t count, const fmi2##Type[]) {          \
        return with(c, [&](Component& unit) { return unit.no_variables(count, #Type); });                              \
    }
TRIBODE_NO_VARIABLES(Integer)
TRIBODE_NO_VARIABLES(Boolean)
TRIBODE_NO_VARIABLES(String)
#undef TRIBODE_NO_VARIABLES

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* state) {
    return with_instance(c, [&](Instance& unit) {
        auto* place = static_cast<Instance::Snapshot*>(*state);
        auto now = std::make_unique<Instance::Snapshot>(unit.snapshot());
        delete place;
        *state = now.release();
    });
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    if (!state) return fmi2Error;
    return with_instance(c, [&](Instance& unit) { unit.restore(*static_cast<Instance::Snapshot*>(state)); });
}
fmi2Status fmi2FreeFMUstate(fmi2Component, fmi2FMUstate* state) {
    if (!state) return fmi2OK;
    delete static_cast<Instance::Snapshot*>(*state);
    *state = nullptr;
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate, size_t*) {
    return with(c, [](Component& unit) { return unit.unsupported("fmi2SerializedFMUstateSize"); });
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate, fmi2Byte[], size_t) {
    return with(c, [](Component& unit) { return unit.unsupported("fmi2SerializeFMUstate"); });
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte[], size_t, fmi2FMUstate*) {
    return with(c, [](Component& unit) { return unit.unsupported("fmi2DeSerializeFMUstate"); });
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference[], size_t, const fmi2ValueReference[],
                                        size_t, const fmi2Real[], fmi2Real[]) {
    return with(c, [](Component& unit) { return unit.unsupported("fmi2GetDirectionalDerivative"); });
}

// ---- model exchange ------------------------------------------------------------------------------------------------

fmi2Status fmi2EnterEventMode(fmi2Component c) {
    return with_instance(c, [](Instance& unit) { unit.run(); });
}
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo* info) {
    return with_instance(c, [&](Instance& unit) {
        const auto result = unit.run().handle_events();
        *info = {fmi2False, result.stopped, fmi2False, result.states_changed, fmi2False, 0};
    });
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
    return with_instance(c, [](Instance& unit) { unit.run(); });
}
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean, fmi2Boolean* enter_event_mode,
                                       fmi2Boolean* terminate) {
    *enter_event_mode = *terminate = fmi2False;
    return with_instance(c, [](Instance& unit) { unit.run(); });
}
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    return with_instance(c, [&](Instance& unit) { unit.run().set_time(time); });
}
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t count) {
    return with_instance(c, [&](Instance& unit) { unit.run().set_states({x, count}); });
}
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real values[], size_t count) {
    return with(c, [&](Component& unit) { return unit.list(Variable::Kind::rate, values, count); });
}
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real values[], size_t count) {
    return with(c, [&](Component& unit) { return unit.list(Variable::Kind::event_indicator, values, count); });
}
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real values[], size_t count) {
    return with(c, [&](Component& unit) { return unit.list(Variable::Kind::state, values, count); });
}
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real values[], size_t count) {
    return with(c, [&](Component& unit) { return unit.nominals(values, count); });
}

// ---- co-simulation -------------------------------------------------------------------------------------------------

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference[], size_t, const fmi2Integer[],
                                       const fmi2Real[]) {
    return with(c, [](Component& unit) { return unit.unsupported("fmi2SetRealInputDerivatives"); });
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference[], size_t, const fmi2Integer[],
                                        fmi2Real[]) {
    return with(c, [](Component& unit) { return unit.unsupported("fmi2GetRealOutputDerivatives"); });
}
// A model that an event has ended says so by fmi2Discard and fmi2Terminated.
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real size, fmi2Boolean) {
    if (!c) return fmi2Error;
    if (!component(c).step(t, size)) return fmi2Error;
    return component(c).stopped ? fmi2Discard : fmi2OK;
}
fmi2Status fmi2CancelStep(fmi2Component c) {
    return with(c, [](Component& unit) { return unit.unsupported("fmi2CancelStep"); });
}
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind, fmi2Status*) {
    return with(c, [](Component& unit) { return unit.unsupported("fmi2GetStatus"); });
}
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real* value) {
    return with(c, [&](Component& unit) {
        if (kind != fmi2LastSuccessfulTime) return unit.unsupported("fmi2GetRealStatus of this kind");
        *value = unit.last_step_end;
        return true;
    });
}
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind, fmi2Integer*) {
    return with(c, [](Component& unit) { return unit.unsupported("fmi2GetIntegerStatus"); });
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean* value) {
    return with(c, [&](Component& unit) {
        if (kind != fmi2Terminated) return unit.unsupported("fmi2GetBooleanStatus of this kind");
        *value = unit.stopped;
        return true;
    });
}
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind, fmi2String*) {
    return with(c, [](Component& unit) { return unit.unsupported("fmi2GetStringStatus"); });
}

} // extern "C"
