#pragma once
#include "tribode/hybrid/piecewise_affine.hpp"
#include "tribode/plant/held_input.hpp"

#include <bit>
#include <functional>
#include <string>
#include <vector>

namespace tribode {

// dx/dt = A x + b u(t) with guards g = G x + h, inside a test.
class AffineSystem final : public HybridSystem, public PiecewiseAffine {
  public:
    struct Memory final : DiscreteValues<Memory> {
        HeldInput u;
        std::vector<double> value;
    };
    static Memory& memory(SystemState& state) { return static_cast<Memory&>(*state.discrete); }
    static const Memory& memory(const DiscreteState& d) { return static_cast<const Memory&>(d); }

    struct Guard {
        std::vector<double> row; // of G
        double offset;           // h
    };

    std::vector<double> start;
    std::vector<std::vector<double>> a; // rows
    std::vector<double> b;              // empty: zero
    HeldInput u;                        // at the start
    std::vector<double> start_memory;   // its first entry is part of the pattern
    bool scaled = false;                // whether A is multiplied by that entry
    std::vector<Guard> guard;
    bool patterns = true; // whether the system says that its input is constant between events
    std::vector<SampleClock> sample_clocks;
    std::function<EventEffect(GuardId, SystemState&)> crossing;
    std::function<EventEffect(ClockId, long k, SystemState&)> sample;

    const std::vector<StateVariable>& states() const override {
        variables_.resize(start.size());
        return variables_;
    }
    const std::vector<SampleClock>& clocks() const override { return sample_clocks; }
    std::size_t guard_count() const override { return guard.size(); }
    SystemState initial_state() const override {
        auto values = std::make_unique<Memory>();
        values->u = u;
        values->value = start_memory;
        return {0.0, start, std::move(values)};
    }
    void derivative(double t, std::span<const double> x, const DiscreteState& d,
                    std::span<double> dxdt) const override {
        rate_coefficient(0, t, 1, x, d, dxdt);
    }
    void guards(double t, std::span<const double> x, const DiscreteState& d, std::span<double> g) const override {
        guard_coefficient(0, t, 1, x, d, g);
    }
    const PiecewiseAffine* piecewise_affine() const override { return this; }
    std::optional<std::string> why_not_affine() const override { return std::nullopt; }
    void rate_coefficient(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                          std::span<double> coefficient) const override {
        for (std::size_t i = 0; i < c.size(); ++i) {
            coefficient[i] = b.empty() ? 0 : b[i] * memory(d).u.taylor(n, t0, h);
            const double scale = scaled ? memory(d).value[0] : 1;
            for (std::size_t j = 0; j < c.size(); ++j) coefficient[i] += scale * a[i][j] * c[j];
        }
    }
    void guard_coefficient(int n, double, double, std::span<const double> c, const DiscreteState&,
                           std::span<double> coefficient) const override {
        for (std::size_t i = 0; i < guard.size(); ++i) {
            coefficient[i] = n == 0 ? guard[i].offset : 0;
            for (std::size_t j = 0; j < c.size(); ++j) coefficient[i] += guard[i].row[j] * c[j];
        }
    }
    bool has_varying_input(const DiscreteState& d) const override { return !patterns || memory(d).u.rate != 0; }
    void append_affine_key(const DiscreteState& d, AffineKey& key) const override {
        key.push_back(std::bit_cast<std::uint64_t>(memory(d).value.empty() ? 0.0 : memory(d).value[0]));
    }
    AffineForm affine_form(const DiscreteState& d) const override {
        const std::size_t n = start.size();
        AffineForm form{std::vector<double>(n * n), std::vector<double>(n * guard.size()), {}, {}};
        for (std::size_t j = 0; j < n; ++j) {
            for (std::size_t i = 0; i < n; ++i) form.a[j * n + i] = (scaled ? memory(d).value[0] : 1) * a[i][j];
            for (std::size_t i = 0; i < guard.size(); ++i) form.g[j * guard.size() + i] = guard[i].row[j];
        }
        return form;
    }
    EventEffect on_crossing(GuardId id, SystemState& state, EventLog& log) const override {
        log.push_back({state.t, static_cast<int>(id), 0});
        return crossing ? crossing(id, state) : EventEffect::none;
    }
    EventEffect on_sample(ClockId id, long k, SystemState& state) const override {
        return sample ? sample(id, k, state) : EventEffect::none;
    }
    std::string guard_name(GuardId id, const SystemState&) const override { return "guard " + std::to_string(id); }

  private:
    mutable std::vector<StateVariable> variables_;
};

} // namespace tribode
