#pragma once
#include <memory>
#include <utility>
#include <vector>

namespace tribode {

// What jumps: slip states, held values, the memory of sampled blocks. Each hybrid system has its own kind.
class DiscreteState {
  public:
    virtual ~DiscreteState() = default;
    virtual std::unique_ptr<DiscreteState> clone() const = 0;
};

// Gives a plain struct the copying that DiscreteState asks for: struct MyState : DiscreteValues<MyState> {...}.
template <class Values>
class DiscreteValues : public DiscreteState {
  public:
    std::unique_ptr<DiscreteState> clone() const final {
        return std::make_unique<Values>(static_cast<const Values&>(*this));
    }
};

// Everything that changes during a run. A copy is a snapshot: a run continued from it fires no clock twice and gives
// the same numbers, to within the tolerance of its solver.
struct SystemState {
    double t = 0;          // [s]
    std::vector<double> x; // continuous states, in the order of HybridSystem::states()
    std::unique_ptr<DiscreteState> discrete;
    std::vector<long> next_sample; // per clock, the index of its next instant; empty: the first one at or after t

    SystemState() = default;
    SystemState(double time, std::vector<double> states, std::unique_ptr<DiscreteState> values)
        : t(time),
          x(std::move(states)),
          discrete(std::move(values)) {}
    SystemState(const SystemState& other)
        : t(other.t),
          x(other.x),
          discrete(other.discrete ? other.discrete->clone() : nullptr),
          next_sample(other.next_sample) {}
    SystemState& operator=(const SystemState& other) { return *this = SystemState(other); }
    SystemState(SystemState&&) = default;
    SystemState& operator=(SystemState&&) = default;
};

} // namespace tribode
