#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace tribode {

// Sample instants are rounded, so equal lengths of steps at time t differ by that much.
inline bool same_length(double a, double b, double t) {
    return std::abs(a - b) <= 0x1p-51 * (std::abs(t) + std::abs(a));
}

// Which lengths of steps recur: those from sample to sample do, those between events do not.
class RecurringLengths {
  public:
    explicit RecurringLengths(std::size_t most) : most_(most) {}

    // Tells of a length met at time t, and takes note of it.
    bool met(double h, double t) {
        const auto same = [&](double length) { return same_length(length, h, t); };
        if (std::any_of(regular_.begin(), regular_.end(), same)) return true;
        if (regular_.size() == most_) return false;
        if (std::any_of(recent_.begin(), recent_.end(), same)) {
            regular_.push_back(h);
            return true;
        }
        if (recent_.size() < most_recent) {
            recent_.push_back(h);
        } else {
            recent_[next_recent_++ % most_recent] = h;
        }
        return false;
    }

  private:
    static constexpr std::size_t most_recent = 8;

    std::size_t most_;
    std::vector<double> regular_, recent_; // lengths that recur, and those met last [s]
    std::size_t next_recent_ = 0;
};

} // namespace tribode
