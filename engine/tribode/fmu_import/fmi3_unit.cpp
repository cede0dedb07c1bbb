#include "tribode/base/text.hpp"
#include "tribode/fmu_import/unit_library.hpp"
#include "tribode/fmu_import/whole_value.hpp"

#include <fmi3FunctionTypes.h>
#include <fmt/format.h>

namespace tribode {

namespace {

using Type = UnitDescription::Type;

void log_message(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String, fmi3String message) {
    if (status != fmi3OK) static_cast<UnitLibrary*>(environment)->log(message);
}

class Fmi3Run final : public UnitRun {
  public:
    explicit Fmi3Run(const std::shared_ptr<const UnitFile>& unit) : library_(unit) {
        free_ = library_.function<fmi3FreeInstanceTYPE>("fmi3FreeInstance");
        terminate_ = library_.function<fmi3TerminateTYPE>("fmi3Terminate");
        do_step_ = library_.function<fmi3DoStepTYPE>("fmi3DoStep");
        const auto& description = unit->description();
        // With the separator at its end, as the standard has it.
        const std::string resources = (unit->folder() / "resources").string() + "/";
        instance_ = library_.function<fmi3InstantiateCoSimulationTYPE>("fmi3InstantiateCoSimulation")(
            description.identifier.c_str(), description.token.c_str(), resources.c_str(), fmi3False, fmi3False,
            fmi3False, fmi3False, nullptr, 0, &library_, log_message, nullptr);
        if (!instance_) library_.fail("fmi3InstantiateCoSimulation");
    }
    ~Fmi3Run() override {
        if (started_) terminate_(instance_);
        if (free_) free_(instance_);
    }
    Fmi3Run(const Fmi3Run&) = delete;
    Fmi3Run& operator=(const Fmi3Run&) = delete;

    void start(double t) override {
        const auto enter = library_.function<fmi3EnterInitializationModeTYPE>("fmi3EnterInitializationMode");
        if (is_bad(enter(instance_, fmi3False, 0, t, fmi3False, 0))) library_.fail("fmi3EnterInitializationMode");
        const auto exit = library_.function<fmi3ExitInitializationModeTYPE>("fmi3ExitInitializationMode");
        if (is_bad(exit(instance_))) library_.fail("fmi3ExitInitializationMode");
        started_ = true;
    }

    void step(double t, double step_size) override {
        fmi3Boolean needs_events = fmi3False, ends = fmi3False, early = fmi3False;
        fmi3Float64 reached = t;
        const fmi3Status status = do_step_(instance_, t, step_size, fmi3True, &needs_events, &ends, &early, &reached);
        if (is_bad(status) || status == fmi3Discard) {
            started_ = started_ && status != fmi3Fatal;
            library_.fail(fmt::format("fmi3DoStep from t = {} s", to_text(t)));
        }
        if (ends) {
            library_.log("it ends the simulation");
            library_.fail(fmt::format("fmi3DoStep from t = {} s", to_text(t)));
        }
    }

  protected:
    void set(const UnitDescription::Variable& variable, double value) override {
        if (is_bad(set_value(variable, value))) {
            library_.fail(fmt::format("setting {} to {}", variable.name, to_text(value)));
        }
    }

    double get(const UnitDescription::Variable& variable) override {
        double value = 0;
        if (is_bad(get_value(variable, value))) library_.fail("reading " + variable.name);
        return value;
    }

  private:
    static bool is_bad(fmi3Status status) { return status == fmi3Error || status == fmi3Fatal; }

    template <class Number, class Function>
    fmi3Status set_as(const char* name, const UnitDescription::Variable& variable, Number number) {
        return library_.function<Function>(name)(instance_, &variable.reference, 1, &number, 1);
    }

    template <class Number, class Function>
    fmi3Status get_as(const char* name, const UnitDescription::Variable& variable, double& value) {
        Number number{};
        const fmi3Status status = library_.function<Function>(name)(instance_, &variable.reference, 1, &number, 1);
        value = static_cast<double>(number);
        return status;
    }

    fmi3Status set_value(const UnitDescription::Variable& variable, double value) {
        switch (variable.type) {
#define TRIBODE_TYPE(kind, Name, number)                                                                               \
    case Type::kind: return set_as<fmi3##Name, fmi3Set##Name##TYPE>("fmi3Set" #Name, variable, number)
            TRIBODE_TYPE(real, Float64, value);
            TRIBODE_TYPE(float32, Float32, static_cast<float>(value));
            TRIBODE_TYPE(boolean, Boolean, whole_value<int>(library_.unit(), variable, value) != 0);
            TRIBODE_TYPE(int8, Int8, whole_value<fmi3Int8>(library_.unit(), variable, value));
            TRIBODE_TYPE(uint8, UInt8, whole_value<fmi3UInt8>(library_.unit(), variable, value));
            TRIBODE_TYPE(int16, Int16, whole_value<fmi3Int16>(library_.unit(), variable, value));
            TRIBODE_TYPE(uint16, UInt16, whole_value<fmi3UInt16>(library_.unit(), variable, value));
            TRIBODE_TYPE(int32, Int32, whole_value<fmi3Int32>(library_.unit(), variable, value));
            TRIBODE_TYPE(uint32, UInt32, whole_value<fmi3UInt32>(library_.unit(), variable, value));
            TRIBODE_TYPE(int64, Int64, whole_value<fmi3Int64>(library_.unit(), variable, value));
            TRIBODE_TYPE(uint64, UInt64, whole_value<fmi3UInt64>(library_.unit(), variable, value));
#undef TRIBODE_TYPE
        }
        return fmi3Error;
    }

    fmi3Status get_value(const UnitDescription::Variable& variable, double& value) {
        switch (variable.type) {
#define TRIBODE_TYPE(kind, Name)                                                                                       \
    case Type::kind: return get_as<fmi3##Name, fmi3Get##Name##TYPE>("fmi3Get" #Name, variable, value)
            TRIBODE_TYPE(real, Float64);
            TRIBODE_TYPE(float32, Float32);
            TRIBODE_TYPE(boolean, Boolean);
            TRIBODE_TYPE(int8, Int8);
            TRIBODE_TYPE(uint8, UInt8);
            TRIBODE_TYPE(int16, Int16);
            TRIBODE_TYPE(uint16, UInt16);
            TRIBODE_TYPE(int32, Int32);
            TRIBODE_TYPE(uint32, UInt32);
            TRIBODE_TYPE(int64, Int64);
            TRIBODE_TYPE(uint64, UInt64);
#undef TRIBODE_TYPE
        }
        return fmi3Error;
    }

    UnitLibrary library_;
    fmi3Instance instance_ = nullptr;
    bool started_ = false;
    fmi3FreeInstanceTYPE* free_ = nullptr;
    fmi3TerminateTYPE* terminate_ = nullptr;
    fmi3DoStepTYPE* do_step_ = nullptr;
};

} // namespace

std::unique_ptr<UnitRun> open_fmi3_unit(const std::shared_ptr<const UnitFile>& unit) {
    return std::make_unique<Fmi3Run>(unit);
}

} // namespace tribode
