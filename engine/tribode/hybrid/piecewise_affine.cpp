#include "tribode/hybrid/piecewise_affine.hpp"

#include <cassert>

namespace tribode {

namespace {

const char* const not_known_to_be_affine = "its equations are not known to be affine between events";
const char* const not_known_to_be_nearly_affine = "its equations are not known to be nearly affine between events";

} // namespace

std::optional<std::string> PiecewiseAffine::why_not_nearly_affine() const { return not_known_to_be_nearly_affine; }

AffineForm PiecewiseAffine::affine_form(const DiscreteState&) const {
    assert(!"a system that is affine gives its form");
    return {};
}

void PiecewiseAffine::append_affine_key(const DiscreteState&, AffineKey&) const {
    assert(!"a system that is affine gives its key");
}

bool PiecewiseAffine::has_varying_input(const DiscreteState&) const { return false; }

void PiecewiseAffine::rate_coefficient(int, double, double, std::span<const double>, const DiscreteState&,
                                       std::span<double>) const {
    assert(!"a system with an input that varies gives its coefficients");
}

void PiecewiseAffine::guard_coefficient(int, double, double, std::span<const double>, const DiscreteState&,
                                        std::span<double>) const {
    assert(!"a system with an input that varies gives its coefficients");
}

void PiecewiseAffine::forcing(double, std::span<const double>, const DiscreteState&, std::span<double>) const {}

std::optional<std::string> why_not_affine(const HybridSystem& system) {
    const PiecewiseAffine* affine = system.piecewise_affine();
    return affine ? affine->why_not_affine() : not_known_to_be_affine;
}

std::optional<std::string> why_not_nearly_affine(const HybridSystem& system) {
    const PiecewiseAffine* affine = system.piecewise_affine();
    return affine ? affine->why_not_nearly_affine() : not_known_to_be_nearly_affine;
}

} // namespace tribode
