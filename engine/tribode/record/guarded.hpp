#pragma once
#include <cstddef>
#include <functional>
#include <optional>
#include <string>

namespace tribode {

// What a guarded process may use.
struct GuardLimits {
    unsigned cpu_seconds;
    std::size_t memory_bytes; // more than its parent has
};

// Runs the work in a process of its own and returns the bytes it returned, or nothing where that process crashed or
// went beyond its limits: for libraries that damaged input can bring down. An InputError of the work is thrown again
// here. What the work changes, prints to standard error or leaves in memory is lost. It must not start threads.
std::optional<std::string> run_guarded(const GuardLimits& limits, const std::function<std::string()>& work);

} // namespace tribode
