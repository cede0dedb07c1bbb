#pragma once
#include <array>
#include <cstddef>

namespace tribode {

// Eight numbers, with operations as of one number, which the processor carries out on all of them at one time.
struct alignas(64) Lanes {
    std::array<double, 8> of = {};

    double& operator[](std::size_t i) { return of[i]; }
    double operator[](std::size_t i) const { return of[i]; }

    // Inlined always: what they become depends on the instructions that the caller may use, see TRIBODE_CLONES.
    [[gnu::always_inline]] friend Lanes operator+(const Lanes& a, const Lanes& b) { return of_all(a.all() + b.all()); }
    [[gnu::always_inline]] friend Lanes operator-(const Lanes& a, const Lanes& b) { return of_all(a.all() - b.all()); }
    [[gnu::always_inline]] friend Lanes operator-(double a, const Lanes& b) { return of_all(a - b.all()); }
    [[gnu::always_inline]] friend Lanes operator-(const Lanes& a) { return of_all(-a.all()); }
    [[gnu::always_inline]] friend Lanes operator*(const Lanes& a, const Lanes& b) { return of_all(a.all() * b.all()); }
    [[gnu::always_inline]] friend Lanes operator*(const Lanes& a, double b) { return of_all(a.all() * b); }
    [[gnu::always_inline]] friend Lanes operator*(double a, const Lanes& b) { return of_all(a * b.all()); }
    [[gnu::always_inline]] friend Lanes operator/(const Lanes& a, double b) { return of_all(a.all() / b); }
    [[gnu::always_inline]] friend Lanes operator/(double a, const Lanes& b) { return of_all(a / b.all()); }
    [[gnu::always_inline]] friend Lanes operator/(const Lanes& a, const Lanes& b) { return of_all(a.all() / b.all()); }
    [[gnu::always_inline]] friend Lanes min(const Lanes& a, const Lanes& b) {
        return of_all(a.all() < b.all() ? a.all() : b.all());
    }
    [[gnu::always_inline]] Lanes& operator+=(const Lanes& b) { return *this = *this + b; }
    [[gnu::always_inline]] Lanes& operator-=(const Lanes& b) { return *this = *this - b; }

  private:
    using Vector __attribute__((vector_size(64), may_alias)) = double;
    [[gnu::always_inline]] const Vector& all() const { return *reinterpret_cast<const Vector*>(this); }
    [[gnu::always_inline]] static Lanes of_all(const Vector& values) {
        Lanes lanes;
        *reinterpret_cast<Vector*>(&lanes) = values;
        return lanes;
    }
};
constexpr std::size_t lane_count = 8;

// For functions that compute with lanes: compiled for several processors; the one at hand chooses when the program is loaded.
// Clang before version 18 gives clones a name by which other files do not find them. With the thread sanitizer the choice
// would come before the sanitizer is ready.
#if defined(__clang__) || defined(__SANITIZE_THREAD__)
#define TRIBODE_CLONES
#else
#define TRIBODE_CLONES [[gnu::target_clones("avx512f", "avx2", "default")]]
#endif

} // namespace tribode
