#pragma once
#include "tribode/hybrid/hybrid_system.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace tribode {

// Of one discrete state, matrices column by column:
//
//     dx/dt = A x + b(t) + B w(t, x),  g = G x + h(t) + C w(t, x)
struct AffineForm {
    std::vector<double> a; // states x states
    std::vector<double> g; // guards x states
    std::vector<double> b; // states x functions w
    std::vector<double> c; // guards x functions w
};

// Equal keys: equal A, B, C and G. Integers, of any number; values are in it as their bits. The first few need no memory of
// their own: a solver compares keys at each restart.
class AffineKey {
  public:
    void clear() {
        size_ = 0;
        more_.clear();
    }
    void swap(AffineKey& other) noexcept {
        std::swap(size_, other.size_);
        first_.swap(other.first_);
        more_.swap(other.more_);
    }
    void push_back(std::uint64_t part) {
        if (size_ < few) {
            first_[size_] = part;
        } else {
            more_.push_back(part);
        }
        ++size_;
    }
    friend bool operator==(const AffineKey& a, const AffineKey& b) {
        if (a.size_ != b.size_) return false;
        for (std::size_t i = 0; i < few && i < a.size_; ++i) {
            if (a.first_[i] != b.first_[i]) return false;
        }
        return a.size_ <= few || a.more_ == b.more_;
    }
    std::size_t hash() const {
        std::uint64_t hash = 0;
        for (std::size_t i = 0; i < few && i < size_; ++i) hash = 31 * hash + first_[i];
        for (const std::uint64_t part : more_) hash = 31 * hash + part;
        return hash;
    }
    struct Hash {
        std::size_t operator()(const AffineKey& key) const { return key.hash(); }
    };

  private:
    static constexpr std::size_t few = 4;

    std::size_t size_ = 0;
    std::array<std::uint64_t, few> first_{};
    std::vector<std::uint64_t> more_;
};

// What a system tells of its structure to the solvers that use it (HybridSystem::piecewise_affine). Constant, as the system.
//
// The system is piecewise affine where it has the form above without w, b and h polynomials in t, and nearly affine with a
// few functions w that are smooth but for isolated points. All but the reasons and linear_part() is called only where one of
// the two holds.
class PiecewiseAffine {
  public:
    // The reason, as a sentence; nothing where the system is.
    virtual std::optional<std::string> why_not_affine() const = 0;
    virtual std::optional<std::string> why_not_nearly_affine() const;

    // Made once for each key; a solver looks for the key after each event.
    virtual AffineForm affine_form(const DiscreteState& d) const;
    virtual void append_affine_key(const DiscreteState& d, AffineKey& key) const;

    // Whether b or h change between events. Then for x(t0 + s h) = sum c_n s^n (0 <= s <= 1) the n-th coefficients in s,
    // n > 0, of A x + b, from c_n = c alone, and of G x + h. The system gives the sums, because how they round is part of its
    // results: for n = 0 they are derivative() and guards().
    virtual bool has_varying_input(const DiscreteState& d) const;
    virtual void rate_coefficient(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                                  std::span<double> coefficient) const;
    virtual void guard_coefficient(int n, double t0, double h, std::span<const double> c, const DiscreteState& d,
                                   std::span<double> coefficient) const;

    // How many functions w there are, and their values, which go on smoothly beyond the guards.
    virtual std::size_t forcing_count() const { return 0; }
    virtual void forcing(double t, std::span<const double> x, const DiscreteState& d, std::span<double> w) const;

    // The part L of f = L x + rest that no event changes, for a discretization by zero-order hold, into a column-major square
    // matrix preset to zero; zero where the system knows none.
    virtual void linear_part(std::span<double> /*matrix*/) const {}

  protected:
    ~PiecewiseAffine() = default;
};

// Also of a system that tells nothing of its structure.
std::optional<std::string> why_not_affine(const HybridSystem& system);
std::optional<std::string> why_not_nearly_affine(const HybridSystem& system);

} // namespace tribode
