#pragma once
#include "tribode/fmu_runtime/fmu_model.hpp"

#include <memory>
#include <optional>
#include <string>

namespace tribode::fmu {

// One instance of a functional mock-up unit, as both versions of the standard see it. The functions of the two are thin: they
// call one of these, catch what it throws, log it and return the status. Not for use from several threads at one time.
class Instance {
  public:
    enum class Phase { instantiated, initialization, running, stopped };

    // `resources`: the folder of model.json. Throws where it cannot be read, has another token or is of the other kind.
    Instance(const std::string& resources, const std::string& token, bool model_exchange);

    const Model& model() const { return *model_; }
    Phase phase() const { return phase_; }

    void set_start(double t, std::optional<double> tolerance);
    void enter_initialization();
    void exit_initialization();
    void terminate() { phase_ = Phase::stopped; }
    void reset();

    double get(std::size_t reference);
    void set(std::size_t reference, double value);

    // Co-simulation: from the communication point t on. stopped: by an event of the model, before the end of the step or there.
    struct Step {
        double t = 0; // reached [s]
        bool stopped = false;
    };
    Step step(double t, double size);
    double time() const { return time_; }

    // Model exchange, and all that needs the run.
    Run& run();

    // A snapshot of all that changes.
    struct Snapshot {
        Settings settings;
        Phase phase = Phase::instantiated;
        double time = 0;
        std::unique_ptr<Run> run;
    };
    Snapshot snapshot() const;
    void restore(const Snapshot& snapshot);

  private:
    const Variable& variable(std::size_t reference) const;
    double* setting(const Variable& variable);

    std::unique_ptr<const Model> model_;
    Settings settings_;
    Phase phase_ = Phase::instantiated;
    double time_ = 0; // the importing program's [s]
    std::unique_ptr<Run> run_;
};

// "file:///tmp/a%20b/resources" (FMI 2) or a folder (FMI 3) as a folder.
std::string folder_of(const std::string& location);

} // namespace tribode::fmu
