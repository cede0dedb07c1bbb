#pragma once
#include <nlohmann/json.hpp>

namespace tribode {

// Plain data: machine descriptions, options, results. Keys keep their order, so that files are reproducible.
using Json = nlohmann::ordered_json;

} // namespace tribode
