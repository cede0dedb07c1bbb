#pragma once
#include "tribode/fmu_import/imported_unit.hpp"
#include "tribode/system/equations.hpp"

namespace tribode {

// The unit as a sampled block: its inputs and parameters with their start values, its outputs as discrete variables, one
// clock "step" of this period [s], at t = 0 first. At each sample the unit advances over the interval that ends there,
// with the inputs of its beginning; its outputs are then set and its inputs read. Parameters are set as a run begins, with
// an instance of its own.
// Characters of names that Tribode's have not become "_". Throws InputError where two names become one, where the unit
// does not take steps of this length, or where it does not start.
Equations equations_of_unit(const std::shared_ptr<const UnitFile>& unit, double period);

// A unit of FMI in Tribode's form: "N.m" as "N m"; empty where it is none that is known.
std::string unit_from_fmi(std::string_view unit);

} // namespace tribode
