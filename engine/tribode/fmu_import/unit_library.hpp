#pragma once
#include "tribode/fmu_import/imported_unit.hpp"

#include <string>

namespace tribode {

// The shared library of a unit, loaded as long as this is there, and what its instance has logged.
class UnitLibrary {
  public:
    explicit UnitLibrary(std::shared_ptr<const UnitFile> unit);
    ~UnitLibrary();
    UnitLibrary(const UnitLibrary&) = delete;
    UnitLibrary& operator=(const UnitLibrary&) = delete;

    // Throws InputError where the library has no function of this name.
    template <class Type>
    Type* function(const char* name) const {
        return reinterpret_cast<Type*>(symbol(name));
    }

    const UnitFile& unit() const { return *unit_; }
    // What begins messages: "ball.fmu: fmi2DoStep at t = 0.1 s".
    [[noreturn]] void fail(const std::string& call) const;
    void log(const char* message) { last_message_ = message ? message : ""; }

  private:
    void* symbol(const char* name) const;

    std::shared_ptr<const UnitFile> unit_;
    void* handle_ = nullptr;
    std::string last_message_;
};

// The instance of a unit of that version of FMI.
std::unique_ptr<UnitRun> open_fmi2_unit(const std::shared_ptr<const UnitFile>& unit);
std::unique_ptr<UnitRun> open_fmi3_unit(const std::shared_ptr<const UnitFile>& unit);

} // namespace tribode
