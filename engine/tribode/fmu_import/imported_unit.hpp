#pragma once
#include "tribode/fmu_import/unit_description.hpp"

#include <filesystem>
#include <memory>
#include <span>

namespace tribode {

// A functional mock-up unit, unpacked. Its folder, which unpack_unit() has made, goes with the last copy.
class UnitFile {
  public:
    // Unpacks FILE.fmu below the folder for temporary files. Runs nothing of it.
    // Throws InputError where it is no unit for co-simulation, or has no library for this kind of computer.
    explicit UnitFile(const std::filesystem::path& file);
    ~UnitFile();
    UnitFile(const UnitFile&) = delete;
    UnitFile& operator=(const UnitFile&) = delete;

    const std::filesystem::path& file() const { return file_; }
    const std::filesystem::path& folder() const { return folder_; }
    const UnitDescription& description() const { return description_; }
    std::filesystem::path library() const;

  private:
    std::filesystem::path file_, folder_;
    UnitDescription description_;
};

// One run of a unit for co-simulation: machine code of the file runs in this process. Values are numbers, a boolean 0 or 1.
//
//     auto run = open_unit(unit);
//     run->set(unit->description().parameters, values);
//     run->start(0, inputs);
//     run->step(0, 0.01); run->get(outputs, values); run->set(inputs, values); run->step(0.01, 0.01); ...
//
// All throw InputError with what the unit says where it refuses, or where a value is none of its variable's type.
class UnitRun {
  public:
    virtual ~UnitRun() = default;

    // Before start() parameters and start values, later inputs.
    void set(std::span<const UnitDescription::Variable> variables, std::span<const double> values);
    void get(std::span<const UnitDescription::Variable> variables, std::span<double> values);
    virtual void start(double t) = 0;                  // [s] initializes
    virtual void step(double t, double step_size) = 0; // [s]

  protected:
    virtual void set(const UnitDescription::Variable& variable, double value) = 0;
    virtual double get(const UnitDescription::Variable& variable) = 0;
};

// Loads its library and makes an instance. Throws InputError.
std::unique_ptr<UnitRun> open_unit(const std::shared_ptr<const UnitFile>& unit);

} // namespace tribode
