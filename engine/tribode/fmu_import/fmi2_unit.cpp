#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/fmu_import/unit_library.hpp"
#include "tribode/fmu_import/whole_value.hpp"

#include <array>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <fmi2FunctionTypes.h>
#include <fmt/format.h>

namespace tribode {

namespace {

using Type = UnitDescription::Type;

void log_message(fmi2ComponentEnvironment environment, fmi2String, fmi2Status status, fmi2String, fmi2String message,
                 ...) {
    if (status == fmi2OK || !message) return;
    std::array<char, 1000> text{};
    std::va_list arguments;
    va_start(arguments, message);
    std::vsnprintf(text.data(), text.size(), message, arguments);
    va_end(arguments);
    static_cast<UnitLibrary*>(environment)->log(text.data());
}

class Fmi2Run final : public UnitRun {
  public:
    explicit Fmi2Run(const std::shared_ptr<const UnitFile>& unit) : library_(unit) {
        free_ = library_.function<fmi2FreeInstanceTYPE>("fmi2FreeInstance");
        terminate_ = library_.function<fmi2TerminateTYPE>("fmi2Terminate");
        do_step_ = library_.function<fmi2DoStepTYPE>("fmi2DoStep");
        get_real_ = library_.function<fmi2GetRealTYPE>("fmi2GetReal");
        get_integer_ = library_.function<fmi2GetIntegerTYPE>("fmi2GetInteger");
        get_boolean_ = library_.function<fmi2GetBooleanTYPE>("fmi2GetBoolean");
        set_real_ = library_.function<fmi2SetRealTYPE>("fmi2SetReal");
        set_integer_ = library_.function<fmi2SetIntegerTYPE>("fmi2SetInteger");
        set_boolean_ = library_.function<fmi2SetBooleanTYPE>("fmi2SetBoolean");
        callbacks_ = {log_message, std::calloc, std::free, nullptr, &library_};
        const auto& description = unit->description();
        const std::string resources = "file://" + (unit->folder() / "resources").string();
        instance_ = library_.function<fmi2InstantiateTYPE>("fmi2Instantiate")(
            description.identifier.c_str(), fmi2CoSimulation, description.token.c_str(), resources.c_str(), &callbacks_,
            fmi2False, fmi2False);
        if (!instance_) library_.fail("fmi2Instantiate");
    }
    ~Fmi2Run() override {
        if (started_) terminate_(instance_);
        if (free_) free_(instance_);
    }
    Fmi2Run(const Fmi2Run&) = delete;
    Fmi2Run& operator=(const Fmi2Run&) = delete;

    void start(double t) override {
        const auto call = [&](const char* name, fmi2Status status) {
            if (is_bad(status)) library_.fail(name);
        };
        call("fmi2SetupExperiment", library_.function<fmi2SetupExperimentTYPE>("fmi2SetupExperiment")(
                                        instance_, fmi2False, 0, t, fmi2False, 0));
        call("fmi2EnterInitializationMode",
             library_.function<fmi2EnterInitializationModeTYPE>("fmi2EnterInitializationMode")(instance_));
        call("fmi2ExitInitializationMode",
             library_.function<fmi2ExitInitializationModeTYPE>("fmi2ExitInitializationMode")(instance_));
        started_ = true;
    }

    void step(double t, double step_size) override {
        const fmi2Status status = do_step_(instance_, t, step_size, fmi2True);
        if (is_bad(status) || status == fmi2Discard || status == fmi2Pending) {
            started_ = started_ && status != fmi2Fatal;
            library_.fail(fmt::format("fmi2DoStep from t = {} s", to_text(t)));
        }
    }

  protected:
    void set(const UnitDescription::Variable& variable, double value) override {
        fmi2Status status = fmi2OK;
        if (variable.type == Type::real) {
            status = set_real_(instance_, &variable.reference, 1, &value);
        } else if (variable.type == Type::boolean) {
            const fmi2Boolean number = whole_value<fmi2Boolean>(library_.unit(), variable, value);
            status = set_boolean_(instance_, &variable.reference, 1, &number);
        } else {
            const auto number = whole_value<fmi2Integer>(library_.unit(), variable, value);
            status = set_integer_(instance_, &variable.reference, 1, &number);
        }
        if (is_bad(status)) library_.fail(fmt::format("setting {} to {}", variable.name, to_text(value)));
    }

    double get(const UnitDescription::Variable& variable) override {
        double value = 0;
        fmi2Integer number = 0;
        fmi2Status status = fmi2OK;
        if (variable.type == Type::real) {
            status = get_real_(instance_, &variable.reference, 1, &value);
        } else {
            const auto read = variable.type == Type::boolean ? get_boolean_ : get_integer_;
            status = read(instance_, &variable.reference, 1, &number);
            value = number;
        }
        if (is_bad(status)) library_.fail("reading " + variable.name);
        return value;
    }

  private:
    static bool is_bad(fmi2Status status) { return status == fmi2Error || status == fmi2Fatal; }

    UnitLibrary library_;
    fmi2CallbackFunctions callbacks_{};
    fmi2Component instance_ = nullptr;
    bool started_ = false;
    fmi2FreeInstanceTYPE* free_ = nullptr;
    fmi2TerminateTYPE* terminate_ = nullptr;
    fmi2DoStepTYPE* do_step_ = nullptr;
    fmi2GetRealTYPE* get_real_ = nullptr;
    fmi2GetIntegerTYPE* get_integer_ = nullptr;
    fmi2GetBooleanTYPE* get_boolean_ = nullptr;
    fmi2SetRealTYPE* set_real_ = nullptr;
    fmi2SetIntegerTYPE* set_integer_ = nullptr;
    fmi2SetBooleanTYPE* set_boolean_ = nullptr;
};

} // namespace

std::unique_ptr<UnitRun> open_fmi2_unit(const std::shared_ptr<const UnitFile>& unit) {
    return std::make_unique<Fmi2Run>(unit);
}

} // namespace tribode
