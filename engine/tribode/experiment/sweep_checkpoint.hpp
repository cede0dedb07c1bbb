#pragma once
#include "tribode/experiment/frequency_sweep.hpp"

#include <chrono>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace tribode {

// The points of a sweep that are done, in a file that survives an interruption. The file belongs to one machine, one
// set of options and one version of the program; one that belongs to another is left alone and written over.
// An empty path keeps nothing. Safe to call from the sweep's workers.
class SweepCheckpoint {
  public:
    SweepCheckpoint(std::filesystem::path path, const MachineModel& machine, const SweepOptions& options);

    // One place per frequency. Throws InputError where the file is damaged: its numbers have a checksum.
    std::vector<std::optional<SweepPoint>> load();
    void add(std::size_t index, const SweepPoint& point); // saves now and then
    void save();
    void remove();

    const std::string& key() const { return key_; } // of what the file belongs to

  private:
    void save_locked();

    std::filesystem::path path_;
    std::string key_; // hash of what determines the points
    std::vector<double> frequency_hz_;
    std::mutex mutex_;
    Json points_ = Json::object();                  // index -> point
    std::chrono::steady_clock::time_point saved_{}; // never: the first point is kept at once
};

} // namespace tribode
