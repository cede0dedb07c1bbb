#pragma once
#include <atomic>
#include <cstddef>
#include <functional>
#include <string>

namespace tribode {

// How long work is watched and ended from outside. Shared by every worker; the functions may be called from any
// thread, `progress` one call at a time.
struct RunControl {
    const std::atomic<bool>* stop = nullptr;                                                 // set by Ctrl-C
    std::function<void(const std::string& what, std::size_t done, std::size_t of)> progress; // may be empty
    unsigned workers = 1;       // threads for independent runs
    std::function<bool()> late; // may be empty: a run asks it now and then, and ends early where it says so

    bool stop_requested() const { return stop && stop->load(std::memory_order_relaxed); }
    bool is_late() const { return late && late(); }
};

// Calls run(i) for i = 0 .. count-1 on control.workers threads, each index once; which thread runs which index is
// left open, so results must depend on the index alone. Ends early, between indices, when a stop is requested.
// The first exception of `run` or of the progress display is thrown again here, after all have ended. Returns the
// number of indices run.
std::size_t for_each_index(std::size_t count, const RunControl& control, const std::string& what,
                           const std::function<void(std::size_t)>& run);

} // namespace tribode
