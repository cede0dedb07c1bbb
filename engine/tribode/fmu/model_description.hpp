#pragma once
#include "tribode/fmu/fmu_export.hpp"
#include "tribode/fmu_runtime/fmu_model.hpp"

#include <string>

namespace tribode {

// The text of modelDescription.xml.
std::string model_description(const fmu::Model& model, FmiVersion version);

} // namespace tribode
