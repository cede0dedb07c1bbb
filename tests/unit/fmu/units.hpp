#pragma once
#include "unit/fmu/unpacked_unit.hpp"

#include <cstdarg>
#include <fmi2Functions.h>
#include <fmi3Functions.h>
#include <gtest/gtest.h>

namespace tribode {

inline std::string& last_message() {
    static std::string text;
    return text;
}

extern "C" inline void log_of_fmi2(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String text, ...) {
    va_list values;
    va_start(values, text);
    last_message() = va_arg(values, const char*); // the text is "%s"
    va_end(values);
}

extern "C" inline void log_of_fmi3(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String text) {
    last_message() = text;
}

// One instance, by the functions of FMI 2.0.
class Fmi2Unit {
  public:
    explicit Fmi2Unit(const UnpackedUnit& unit, fmi2Type type = fmi2CoSimulation) : unit_(unit) {
        c = unit.function<fmi2InstantiateTYPE>("fmi2Instantiate")(
            "one", type, unit.token().c_str(), unit.resource_uri().c_str(), &callbacks_, fmi2False, fmi2False);
        if (!c) throw std::runtime_error(last_message());
    }
    ~Fmi2Unit() { unit_.function<fmi2FreeInstanceTYPE>("fmi2FreeInstance")(c); }
    Fmi2Unit(const Fmi2Unit&) = delete;
    Fmi2Unit& operator=(const Fmi2Unit&) = delete;

    fmi2Status call(const char* name) const { return unit_.function<fmi2Status(fmi2Component)>(name)(c); }
    void initialize(double start = 0) const {
        ASSERT_EQ(unit_.function<fmi2SetupExperimentTYPE>("fmi2SetupExperiment")(c, fmi2False, 0, start, fmi2False, 0),
                  fmi2OK);
        ASSERT_EQ(call("fmi2EnterInitializationMode"), fmi2OK) << last_message();
        ASSERT_EQ(call("fmi2ExitInitializationMode"), fmi2OK) << last_message();
    }
    fmi2Status set(const std::string& name, double value) const {
        const fmi2ValueReference reference = unit_.reference(name);
        return unit_.function<fmi2SetRealTYPE>("fmi2SetReal")(c, &reference, 1, &value);
    }
    double get(const std::string& name) const {
        const fmi2ValueReference reference = unit_.reference(name);
        double value = 0;
        EXPECT_EQ(unit_.function<fmi2GetRealTYPE>("fmi2GetReal")(c, &reference, 1, &value), fmi2OK) << last_message();
        return value;
    }
    fmi2Status step(double t, double size) const {
        return unit_.function<fmi2DoStepTYPE>("fmi2DoStep")(c, t, size, fmi2True);
    }

    fmi2Component c = nullptr;

  private:
    const UnpackedUnit& unit_;
    fmi2CallbackFunctions callbacks_{log_of_fmi2, nullptr, nullptr, nullptr, nullptr};
};

// The same by those of FMI 3.0.
class Fmi3Unit {
  public:
    explicit Fmi3Unit(const UnpackedUnit& unit, bool model_exchange = false) : unit_(unit) {
        if (model_exchange) {
            c = unit.function<fmi3InstantiateModelExchangeTYPE>("fmi3InstantiateModelExchange")(
                "one", unit.token().c_str(), unit.resources().c_str(), false, false, nullptr, log_of_fmi3);
        } else {
            c = unit.function<fmi3InstantiateCoSimulationTYPE>("fmi3InstantiateCoSimulation")(
                "one", unit.token().c_str(), unit.resources().c_str(), false, false, false, false, nullptr, 0, nullptr,
                log_of_fmi3, nullptr);
        }
        if (!c) throw std::runtime_error(last_message());
    }
    ~Fmi3Unit() { unit_.function<fmi3FreeInstanceTYPE>("fmi3FreeInstance")(c); }
    Fmi3Unit(const Fmi3Unit&) = delete;
    Fmi3Unit& operator=(const Fmi3Unit&) = delete;

    fmi3Status call(const char* name) const { return unit_.function<fmi3Status(fmi3Instance)>(name)(c); }
    void initialize(double start = 0) const {
        const auto enter = unit_.function<fmi3EnterInitializationModeTYPE>("fmi3EnterInitializationMode");
        ASSERT_EQ(enter(c, false, 0, start, false, 0), fmi3OK) << last_message();
        ASSERT_EQ(call("fmi3ExitInitializationMode"), fmi3OK) << last_message();
    }
    fmi3Status set(const std::string& name, double value) const {
        const fmi3ValueReference reference = unit_.reference(name);
        return unit_.function<fmi3SetFloat64TYPE>("fmi3SetFloat64")(c, &reference, 1, &value, 1);
    }
    double get(const std::string& name) const {
        const fmi3ValueReference reference = unit_.reference(name);
        double value = 0;
        EXPECT_EQ(unit_.function<fmi3GetFloat64TYPE>("fmi3GetFloat64")(c, &reference, 1, &value, 1), fmi3OK)
            << last_message();
        return value;
    }
    struct Step {
        fmi3Status status;
        bool terminate, early;
        double last_time;
    };
    Step step(double t, double size) const {
        bool event = false, terminate = false, early = false;
        double last = 0;
        const auto status =
            unit_.function<fmi3DoStepTYPE>("fmi3DoStep")(c, t, size, true, &event, &terminate, &early, &last);
        return {status, terminate, early, last};
    }

    fmi3Instance c = nullptr;

  private:
    const UnpackedUnit& unit_;
};

} // namespace tribode
