#pragma once
#include <functional>
#include <optional>
#include <string>

namespace tribode {

// Runs the work in a process of its own and returns the bytes it returned, or nothing where that process crashed or
// used more than `cpu_seconds`: for libraries that damaged input can bring down. An InputError of the work is thrown
// again here. What the work changes, prints to standard error or leaves in memory is lost. It must not start threads.
std::optional<std::string> run_guarded(unsigned cpu_seconds, const std::function<std::string()>& work);

} // namespace tribode
