#pragma once
#include "tribode/base/error.hpp"
#include "tribode/base/run_control.hpp"

#include <atomic>
#include <nanobind/nanobind.h>
#include <optional>

namespace tribode::python {

namespace nb = nanobind;

// Ctrl-C while the main thread is in the engine: sets the flag besides what Python does, whose handlers run only after the
// engine has returned.
class InterruptWatch {
  public:
    explicit InterruptWatch(std::atomic<bool>& stop);
    ~InterruptWatch();
    InterruptWatch(const InterruptWatch&) = delete;
    InterruptWatch& operator=(const InterruptWatch&) = delete;

  private:
    bool watching_ = false, installed_ = false;
    std::atomic<bool>* before_ = nullptr;
};

// One call of the engine from Python. Other threads of Python run meanwhile.
class EngineCall {
  public:
    // progress: None, or called with (what, done, of) from any thread, one call at a time; what it raises ends the work.
    EngineCall(nb::handle progress, unsigned workers);

    // work(control), without the GIL. Ctrl-C becomes KeyboardInterrupt, also where the work was ended by it.
    template <class Work>
    auto run(const Work& work) {
        try {
            auto result = [&] {
                const nb::gil_scoped_release released;
                const InterruptWatch watch(stop_);
                return work(static_cast<const RunControl&>(control_));
            }();
            raise_pending();
            return result;
        } catch (const EndedEarly&) {
            raise_pending();
            throw;
        }
    }

  private:
    void raise_pending();

    std::atomic<bool> stop_{false};
    nb::object progress_;
    std::optional<nb::python_error> failure_; // of progress
    RunControl control_;
};

} // namespace tribode::python
